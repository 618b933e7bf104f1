"""Checks of a log that no body explains, for mistakes in axes, commands, clock and units.

A log that no body explains is more often written wrongly than swum by another robot. A
``LogChange`` returns the log without one mistake. Scans of a few bodies rank all changes by the
unexplained share of the first seconds. Short descents rank the best of these, and complete fits of
the whole log confirm the best three. Changes are tried one at a time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple, Unpack

import numpy as np

from aquafish_gym.utils.validation import InvalidArgumentError, callback, flag, instance, integer
from eea.core.checks import TargetError, real
from eea.core.config import FitConfig
from eea.core.floating import own_errors
from eea.core.session import MAXIMUM_SEED, streams
from eea.fish.joint import fish_robot
from eea.fish.log_changes import AXES, LogChange, possible_changes, three, typical_step
from eea.fish.log_fit import CLOSEST_ROWS_SECONDS, fit_log
from eea.fish.simulator import EngineSimulator, SimulatorOptions
from eea.fish.swim_log import SwimLog
from eea.fish.windows import LogWindows, log_windows
from eea.infer.answer import Answer
from eea.infer.descent import descend
from eea.infer.misfit import COARSE, Regression
from eea.infer.robot import Robot
from eea.infer.scan import EVERY_FOURTH_SAMPLE, scan
from eea.infer.trials import Observed
from eea.infer.unknowns import Unknowns

#: Questions to check for a log that no change explains.
CHECKLIST = (
    "is the time in s, by the clock that the robot swam by, and the same for gyroscope and "
    "commands? Are the rates in rad/s, about x right, y forward and z up? Are the commands those "
    "that were executed, left and right not exchanged? Did each trial begin at rest (if not: "
    "--start moving)?"
)
MUST = (
    "A log has the time in s by the robot's clock, rates in rad/s about x right, y forward and z "
    "up, and the commands that were executed"
)
# The screened part of a trial has at least this duration and this number of rows.
SCREENED_SECONDS = 2.56
SCREENED_ROWS = 48
SCREENED_WINDOWS = 4
SCREENING = FitConfig(bodies=48, poses=32, descents=6, polished=1, restarts=0)
CONFIRMING = FitConfig(alternatives="never", restarts=0)
ITERATIONS = 10  # iterations of a descent
DESCENDED = {"axes": 5, "clock": 3, "delay": 2, "other": 4}  # changes of each kind
CONFIRMED = 3
BETTER = 0.5  # share of the unchanged log's unexplained motion
SAME_PACE = 0.02  # share by which a pace must differ from 1
IN_MOTION = 2.0  # a start in motion has more unknowns, so it must leave this factor less


class TriedChange(NamedTuple):
    """A change, and the motion that the best fit of the changed log leaves unexplained."""

    change: LogChange
    unexplained: float  #: The residuals' rms as a share of the signal's.
    good: bool | None = None  #: Whether the residuals are noise; None if not tested.


@dataclass(frozen=True)
class LogCheck:
    """The changes tried on a log that no body explains, and those that help.

    Examples
    --------
    >>> str(LogCheck(0.4, tried=())).partition(":")[0]
    'no change of axes, commands, clock or units helps'
    """

    unexplained: float  #: Residuals' rms of the unchanged log, as a share of the signal's.
    tried: tuple[TriedChange, ...]  #: The tried changes, the best first.

    @property
    def fits(self) -> tuple[TriedChange, ...]:
        """The changes with which a body explains the log."""
        return tuple(one for one in self.tried if one.good)

    @property
    def better(self) -> tuple[TriedChange, ...]:
        """The tested changes that leave less than half unexplained, but more than noise."""
        most = BETTER * self.unexplained
        return tuple(t for t in self.tried if t.good is False and t.unexplained < most)

    def __str__(self) -> str:
        if self.fits:
            ways = ", or with ".join(one.change.words for one in self.fits)
            return f"with {ways} a body fits: change the log, and infer again. {MUST}"
        if self.better:
            best = self.better[0]
            return (
                f"with {best.change.words} the best fit leaves {best.unexplained:.0%} of the "
                f"motion unexplained instead of {self.unexplained:.0%}; besides that: {CHECKLIST}"
            )
        return f"no change of axes, commands, clock or units helps: {CHECKLIST}"


@own_errors
def check_log(
    log: SwimLog,
    joint: FitConfig | None = None,
    seed: int = 0,
    *,
    moving: bool = False,
    unexplained: float | None = None,
    progress: Callable[[str], None] | None = None,
    **simulator: Unpack[SimulatorOptions],
) -> LogCheck:
    """Try possible mistakes of a log, and return the changes with which a body explains it.

    Mistakes are other axes and signs of the gyroscope, exchanged commands of a left and a right
    fin, a clock that runs at 0.5 to 2 times the pace, a gyroscope up to 0.2 s early or 0.4 s late,
    degrees, a constant in the gyroscope, and a start in motion. Servo faults are not tried:
    ``infer_log`` infers them.

    Parameters
    ----------
    log
        A log that no body explains.
    joint
        Settings of the inference; only its nuisances and noise are used.
    seed
        Seed of everything random.
    moving
        Whether the caller says that each trial begins in mid-swim.
    unexplained
        Residuals' rms of the best fit of the unchanged log, as a share of the signal's
        (``belief.goodness.unexplained``); None to fit it.
    progress
        Called with the present step in words.
    **simulator
        See ``EngineSimulator``.

    Examples
    --------
    >>> from aquafish_gym import simulate
    >>> commands = [(0.5, -0.5, 1.0), (-0.5, 0.4, 0.7)]
    >>> logs = [simulate(None, u, (0.5, 1.0, -2.0), 128, dtype="float64") for u in commands]
    >>> right = SwimLog.of_trials(commands, logs)
    >>> print(check_log(SwimLog(right.time, right.gyro[:, [1, 0, 2]], right.commands, right.trial)))
    with x and y of the gyroscope exchanged a body fits: change the log, and infer again. A log...
    """
    instance("log", log, SwimLog)
    flag("moving", moving)
    callback("progress", progress)
    integer("seed", seed, 0, MAXIMUM_SEED)
    if unexplained is not None:
        real("unexplained", unexplained, 0.0, 1e6)
    say = progress or (lambda _: None)
    settings = FitConfig() if joint is None else instance("joint", joint, FitConfig)
    seen = _Log(log, settings, seed, moving, simulator)
    if unexplained is None:
        say("fitting the log as it is")
        unexplained = _share(seen.confirmed(LogChange()))
    changes = list(possible_changes(log, moving))
    say(f"trying {len(changes)} changes of axes, commands, clock and units")
    scanned = [t for change in changes if (t := seen.screened(change, 0))]
    scanned.sort(key=lambda t: t.unexplained)
    descended: list[TriedChange] = []
    for kind, most in DESCENDED.items():
        likely = [t.change for t in scanned if t.change.kind == kind][:most]
        if likely:
            say(f"trying {likely[0].words}")
        descended += [t for change in likely if (t := seen.screened(change, ITERATIONS))]
    descended.sort(key=lambda t: t.unexplained * (IN_MOTION if t.change.moving else 1.0))
    confirmed: list[TriedChange] = []
    tested: set[int] = set()
    # A start in motion has many unknowns: a short fit cannot judge it.
    for one in [*descended[:CONFIRMED], *(t for t in descended[CONFIRMED:] if t.change.moving)]:
        say(f"fitting with {one.change.words}")
        tested.add(id(one.change))
        found = seen.confirmed(one.change)
        good = found is not None and found.good
        change = one.change
        if found is not None and good:
            change = _settled(change, found, typical_step(log))
        confirmed.append(TriedChange(change, _share(found), good))
        if good:
            break
    known = {id(t.change) for t in descended}
    rest = [t for t in descended if id(t.change) not in tested]
    rest += [t for t in scanned if id(t.change) not in known]
    return LogCheck(unexplained, (*sorted(confirmed, key=lambda t: t.unexplained), *rest))


def _share(found: Answer | None) -> float:
    """Return the unexplained share of a fit's signal; 1 without a fit."""
    share = None if found is None else found.goodness.unexplained
    return 1.0 if share is None else share


def _settled(change: LogChange, found: Answer, step: float) -> LogChange:
    """Return a change of the clock or of a delay, refined by the nuisances of its complete fit.

    Readings that are moved too far look like a lag. A clock that is changed too much looks like
    slow servos.
    """
    table = found.table()
    if change.kind == "clock" and "servo gain" in table:
        return replace(change, pace=change.pace / table["servo gain"][0])
    if change.kind == "delay" and "lag" in table:
        rows = change.rows - round(table["lag"][0] / step)
        return replace(change, rows=rows, delay=rows * step) if rows else change
    return change


class _Log(NamedTuple):
    """A log and the settings of its fits."""

    log: SwimLog
    settings: FitConfig
    seed: int
    moving: bool
    simulator: SimulatorOptions

    def robot(self, windows: LogWindows) -> Robot:
        """Return the fish in some windows."""
        return fish_robot(
            EngineSimulator(windows.steps, plan=windows.plan, **self.simulator), windows
        )

    def screened(self, change: LogChange, iterations: int) -> TriedChange | None:
        """Return a refined change with the unexplained share of a short fit of the first seconds.

        None if the change is impossible.
        """
        moving = self.moving or change.moving
        try:
            log = change.apply(self.log, self.moving)
            some = _shortened(log, moving)
            windows = log_windows(some, moving, SCREENED_SECONDS if moving else None)
        except InvalidArgumentError:
            return None
        fish = self.robot(windows)
        count = min(len(windows.gyro), SCREENED_WINDOWS)
        whole = windows.observed
        observed = Observed(
            whole.inputs[:count],
            whole.signal[:count],
            None if whole.weight is None else whole.weight[:count],
            None if whole.time is None else whole.time[:count],
        )
        wanted = ("servo_gain", "gyro_bias", *(["lag"] if change.kind == "delay" else []))
        parameters = Unknowns.of(fish, count, wanted if iterations else ())
        regression = Regression(parameters, observed, None)
        rng = np.random.default_rng(self.seed)
        theta = scan(regression, rng, SCREENING)
        misfit = regression.misfit(COARSE if iterations else EVERY_FOURTH_SAMPLE)
        if iterations:
            sigma = regression.sigma_near(misfit, theta)
            ended = descend(misfit, theta, sigma, iterations, 1e-2)
            best = int(ended.squares.argmin())
            squares = float(ended.squares[best])
            values = dict(zip(parameters.names, parameters.natural(ended.theta[best]), strict=True))
            change = _refined(change, values)
        else:
            squares = float(misfit.squares(theta).min())
        if not np.isfinite(squares):
            return None
        return TriedChange(change, float(np.sqrt(squares / misfit.count)) / regression.rms)

    def confirmed(self, change: LogChange) -> Answer | None:
        """Return the complete fit of the whole changed log; None if it is impossible."""
        moving = self.moving or change.moving
        config = replace(CONFIRMING, nuisances=self.settings.nuisances, noise=self.settings.noise)
        try:
            changed = change.apply(self.log, self.moving)
            windows = log_windows(changed, moving)
            finer = log_windows(changed, moving, within=CLOSEST_ROWS_SECONDS)
            if config.nuisances is not None:  # a swim in motion has no current
                groups = self.robot(windows).groups
                chosen = tuple(n for n in config.nuisances if n in groups)
                config = replace(config, nuisances=chosen)
            return fit_log(
                windows, finer, self.robot, config, lambda: streams(self.seed)["inference"]
            )
        except (InvalidArgumentError, TargetError):
            return None


def _shortened(log: SwimLog, moving: bool) -> SwimLog:
    """Return the first seconds of the first trials."""
    blocks = log.blocks[:SCREENED_WINDOWS]
    windows = -(-SCREENED_WINDOWS // len(blocks)) if moving else 1
    rows = []
    for block in blocks:
        end = log.time[block.start] + windows * SCREENED_SECONDS + (0.25 if moving else 0.0)
        count = int(np.searchsorted(log.time[block], end, "right"))
        rows.append(np.arange(block.start, block.stop)[: max(count, windows * SCREENED_ROWS)])
    kept = np.concatenate(rows)
    parts = (log.time[kept], log.gyro[kept], log.commands[kept], log.trial[kept])
    return SwimLog(*parts, plan=log.plan)


def _refined(change: LogChange, found: dict[str, float]) -> LogChange:
    """Return a change with its number corrected by the nuisances of a fit."""
    if change.kind == "clock":
        # A factor on servo speeds in a log whose times were divided by the pace.
        pace = change.pace / found["servo gain"]
        return replace(change, pace=pace) if abs(pace - 1.0) > SAME_PACE else change
    if any(change.constant):
        bias = [found[f"gyro bias {axis}"] for axis in AXES]
        return replace(change, constant=three(np.add(change.constant, bias)))
    return change
