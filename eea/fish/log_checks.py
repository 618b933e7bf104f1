"""Mistakes of a log: of its axes, commands, clock and units, tried where no body explains it.

A log that no body explains is more often written wrongly than swum by another robot. Each mistake
can be undone: :class:`LogChange` returns the log without it. Scans of a few bodies rank all changes
by what they leave unexplained in the first seconds, short descents rank the best of these, and
complete fits of the whole log confirm the best three. Changes are tried one at a time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import permutations, product
from typing import NamedTuple, Unpack

import numpy as np

from aquafish_gym.utils.validation import InvalidArgumentError, flag, instance
from eea.core.angles import Floats
from eea.core.checks import TargetError
from eea.core.config import FitConfig
from eea.core.session import streams
from eea.fish.joint import fish_joint
from eea.fish.simulator import EngineSimulator, SimulatorOptions
from eea.fish.swim_log import SwimLog
from eea.fish.windows import log_windows
from eea.joint.inference import fit
from eea.joint.initialization import SCANNED, scan
from eea.joint.joint_posterior import JointPosterior
from eea.joint.least_squares import COARSE, Regression, descend
from eea.joint.observed import Observed
from eea.joint.parameters import Parameters

#: What a log must be, as questions; for those whose log no change explains.
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
SCREENED_SECONDS, SCREENED_ROWS = 2.56, 48  # of a trial: at least both
SCREENED_WINDOWS = 4
SCREENING = FitConfig(bodies=48, poses=32, descents=6, polished=1, restarts=0)
CONFIRMING = FitConfig(alternatives="never", restarts=0)
ITERATIONS = 10  # of a descent
DESCENDED = {"axes": 5, "clock": 3, "delay": 2, "other": 4}  # changes of each kind
CONFIRMED = 3
BETTER = 0.5  # of what the log as it is leaves unexplained
PACES = tuple(1.1**power for power in range(-7, 8) if power)  # 0.51 to 1.95
DELAYS = (-0.4, -0.2, 0.05, 0.1, 0.2)  # s; the lag covers 0.2 s before each
SAME_PACE = 0.02  # share by which a pace must differ from 1
DEGREE = np.pi / 180.0
AXES = ("x", "y", "z")
MIRRORED = ("x", "-y", "-z")  # the rates of a fish whose left is its right
LEAST_CONSTANT = 0.1  # rad/s: infer_log finds smaller ones as a bias
IN_MOTION = 2.0  # a start in motion has so many unknowns that it must leave so much less


@dataclass(frozen=True, eq=False)
class LogChange:
    """What may have to be changed in a log; the default changes nothing.

    Examples
    --------
    >>> LogChange(axes=("y", "x", "z")).words
    'x and y of the gyroscope exchanged'
    >>> LogChange(pace=1.2).words
    'time running 1.2 times as fast'
    """

    #: The rates about x, y and z are those about these axes of the log, such as "-y".
    axes: tuple[str, str, str] = AXES
    flippers: bool = False  #: Whether the commands of the left and right flipper are exchanged.
    pace: float = 1.0  #: The times are divided by this.
    rows: int = 0  #: By so many rows the gyroscope's readings are moved to later times.
    delay: float = 0.0  #: The same in s.
    factor: float = 1.0  #: The rates are multiplied by this.
    constant: tuple[float, float, float] = (0.0, 0.0, 0.0)  #: This is taken from the rates, rad/s.
    moving: bool = False  #: Whether trials said to begin at rest begin in mid-swim.

    @property
    def kind(self) -> str:
        """Of which kind it is, for fair shares of the effort: a key of ``DESCENDED``."""
        if self.axes != AXES:
            return "axes"
        if self.pace != 1.0:
            return "clock"
        return "delay" if self.rows else "other"

    @property
    def words(self) -> str:
        """What is changed, after "with"."""
        said = [_axes_in_words(self.axes)] if self.axes != AXES else []
        if self.flippers:
            said.append(
                "the commands of the left and right flipper exchanged (or the signs of the "
                "gyroscope's y and z changed: the fish is symmetric)"
            )
        if self.pace != 1.0:
            said.append(f"time running {round(self.pace, 2):g} times as fast")
        if self.rows:
            way = "later" if self.rows > 0 else "earlier"
            said.append(f"the gyroscope {1000.0 * abs(self.delay):.3g} ms {way}")
        if self.factor == DEGREE:
            said.append("the gyroscope read in degrees/s")
        elif self.factor != 1.0:
            said.append(f"the gyroscope's rates times {self.factor:.3g}")
        if any(self.constant):
            parts = [
                f"{value:.2g} rad/s from {axis}"
                for value, axis in zip(self.constant, AXES, strict=True)
                if abs(value) >= LEAST_CONSTANT / 2.0
            ]
            said.append(f"a constant taken from the gyroscope ({', '.join(parts)})")
        if self.moving:
            said.append("the swim begun in motion, not at rest (--start moving)")
        return " and ".join(said) or "no change"

    def apply(self, log: SwimLog, moving: bool = False) -> SwimLog:
        """Return the changed log.

        Parameters
        ----------
        log
            The log.
        moving
            Whether its trials are said to begin in mid-swim.

        Raises
        ------
        InvalidArgumentError
            If it cannot be so changed: trials are too short, or rates get too large.
        """
        order = [AXES.index(axis[-1]) for axis in self.axes]
        signs = [-1.0 if axis[0] == "-" else 1.0 for axis in self.axes]
        gyro = self.factor * np.array(signs) * log.gyro[:, order] - np.array(self.constant)
        commands = log.commands[:, [1, 0, 2]] if self.flippers else log.commands
        if not self.rows:
            return SwimLog(log.time / self.pace, gyro, commands, log.trial)
        read, seen = [], []  # rows of the readings, and of the times at which they were taken
        for block in log.blocks:
            rows = np.arange(block.start, block.stop)
            late = max(self.rows, 0)
            if self.rows > 0 and not (moving or self.moving):  # the first row is the start at rest
                read.append(np.append(rows[0], rows[1 : len(rows) - late]))
                seen.append(np.append(rows[0], rows[1 + late :]))
            else:
                early = max(-self.rows, 0)
                read.append(rows[early : len(rows) - late])
                seen.append(rows[late : len(rows) - early])
        at, taken = np.concatenate(seen), np.concatenate(read)
        return SwimLog(log.time[at] / self.pace, gyro[taken], commands[at], log.trial[at])


class TriedChange(NamedTuple):
    """A change and what the best fit leaves unexplained with it."""

    change: LogChange
    unexplained: float  #: The residuals' rms as a share of the signal's.
    good: bool | None = None  #: Whether they are noise; None if that was not tested.


@dataclass(frozen=True)
class LogCheck:
    """What was tried on a log that no body explains, and what helps."""

    unexplained: float  #: What the log as it is leaves, as a share of the signal's rms.
    tried: tuple[TriedChange, ...]  #: What leaves least first.

    @property
    def fits(self) -> tuple[TriedChange, ...]:
        """The changes with which a body explains the log."""
        return tuple(one for one in self.tried if one.good)

    @property
    def better(self) -> tuple[TriedChange, ...]:
        """The tested changes that leave less than half, though more than noise."""
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
        return f"no change of axes, flippers, clock or units helps: {CHECKLIST}"


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
    """Try what may be wrong with a log, and return with which changes a body explains it.

    Tried are all axes and signs of the gyroscope, exchanged flippers, a clock that runs at 0.5 to 2
    times the pace, a gyroscope up to 0.2 s early or 0.4 s late, degrees, a constant in the
    gyroscope, and a start in motion. Servo faults are not: ``infer_log`` infers those.

    Parameters
    ----------
    log
        A log that no body explains.
    joint
        Settings of the inference, of which nuisances and noise count.
    seed
        Seed of everything random.
    moving
        Whether each trial is said to begin in mid-swim.
    unexplained
        What the best fit of the log as it is leaves, as a share of the signal's rms
        (``belief.goodness.unexplained``); None to fit it.
    progress
        Called with what is being done, in words.
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
    say = progress or (lambda _: None)
    settings = FitConfig() if joint is None else joint
    seen = _Log(log, settings, seed, moving, simulator)
    if unexplained is None:
        say("fitting the log as it is")
        unexplained = _share(seen.confirmed(LogChange()))
    changes = list(_changes(log, moving))
    say(f"trying {len(changes)} changes of axes, flippers, clock and units")
    scanned = [t for change in changes if (t := seen.screened(change, 0))]
    scanned.sort(key=lambda t: t.unexplained)
    descended: list[TriedChange] = []
    for kind, most in DESCENDED.items():
        likely = [t.change for t in scanned if t.change.kind == kind][:most]
        if likely:
            say(f"trying {likely[0].words}")
        descended += [t for change in likely if (t := seen.screened(change, ITERATIONS))]
    descended.sort(key=lambda t: t.unexplained * (IN_MOTION if t.change.moving else 1.0))
    known = {id(t.change) for t in descended}
    confirmed = []
    for one in descended[:CONFIRMED]:
        say(f"fitting with {one.change.words}")
        found = seen.confirmed(one.change)
        good = found is not None and found.good
        change = one.change
        if found is not None and good:
            change = _settled(change, found, _step(log))
        confirmed.append(TriedChange(change, _share(found), good))
        if good:
            break
    rest = [*descended[len(confirmed) :], *(t for t in scanned if id(t.change) not in known)]
    return LogCheck(unexplained, (*sorted(confirmed, key=lambda t: t.unexplained), *rest))


def _share(found: JointPosterior | None) -> float:
    """Return what a fit leaves unexplained, all if there is none."""
    share = None if found is None else found.goodness.unexplained
    return 1.0 if share is None else share


def _settled(change: LogChange, found: JointPosterior, step: float) -> LogChange:
    """Return a change of the clock or of a delay with the number that its complete fit says.

    Readings that are moved too far look like a lag, and a clock that is changed too much like slow
    servos.
    """
    table = found.table()
    if change.kind == "clock" and "servo gain" in table:
        return replace(change, pace=change.pace / table["servo gain"][0])
    if change.kind == "delay" and "lag" in table:
        rows = change.rows - round(table["lag"][0] / step)
        return replace(change, rows=rows, delay=rows * step) if rows else change
    return change


class _Log(NamedTuple):
    """A log and how it is fitted."""

    log: SwimLog
    settings: FitConfig
    seed: int
    moving: bool
    simulator: SimulatorOptions

    def screened(self, change: LogChange, iterations: int) -> TriedChange | None:
        """Return a change, refined, with what a short fit of the first seconds leaves.

        None if the log cannot be so changed.
        """
        moving = self.moving or change.moving
        try:
            log = change.apply(self.log, self.moving)
            some = _shortened(log, moving)
            windows = log_windows(some, moving, SCREENED_SECONDS if moving else None)
        except InvalidArgumentError:
            return None
        fish = fish_joint(EngineSimulator(windows.steps, **self.simulator), windows)
        count = min(len(windows.gyro), SCREENED_WINDOWS)
        whole = windows.observed
        observed = Observed(
            whole.commands[:count],
            whole.signal[:count],
            None if whole.weight is None else whole.weight[:count],
            None if whole.time is None else whole.time[:count],
        )
        wanted = ("servo_gain", "gyro_bias", *(["lag"] if change.kind == "delay" else []))
        parameters = Parameters.of(fish, count, wanted if iterations else ())
        regression = Regression(parameters, observed, None)
        rng = np.random.default_rng(self.seed)
        theta = scan(regression, rng, SCREENING)
        misfit = regression.misfit(COARSE if iterations else SCANNED)
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

    def confirmed(self, change: LogChange) -> JointPosterior | None:
        """Return the complete fit of the whole changed log; None if there is none."""
        moving = self.moving or change.moving
        config = replace(CONFIRMING, nuisances=self.settings.nuisances, noise=self.settings.noise)
        try:
            windows = log_windows(change.apply(self.log, self.moving), moving)
            fish = fish_joint(EngineSimulator(windows.steps, **self.simulator), windows)
            if config.nuisances is not None:  # a swim in motion has no current
                chosen = tuple(n for n in config.nuisances if n in fish.groups)
                config = replace(config, nuisances=chosen)
            rng = streams(self.seed)["inference"]
            return fit(windows.observed, fish, config, rng)
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
    return SwimLog(log.time[kept], log.gyro[kept], log.commands[kept], log.trial[kept])


def _changes(log: SwimLog, moving: bool) -> Iterator[LogChange]:
    """Yield all changes that are tried."""
    for order, signs in product(permutations(AXES), product(("", "-"), repeat=3)):
        x, y, z = (f"{sign}{axis}" for sign, axis in zip(signs, order, strict=True))
        if (x, y, z) not in (AXES, MIRRORED):
            yield LogChange(axes=(x, y, z))
    yield LogChange(flippers=True)
    yield from (LogChange(pace=pace) for pace in PACES)
    step = _step(log)
    counts = dict.fromkeys(round(delay / step) for delay in DELAYS)
    yield from (LogChange(rows=count, delay=count * step) for count in counts if count)
    yield from (LogChange(factor=factor) for factor in (DEGREE, 1.0 / DEGREE))
    for level in (log.gyro.mean(axis=0), log.gyro[0]):
        if np.abs(level).max() >= LEAST_CONSTANT:
            yield LogChange(constant=_three(level))
    if not moving:
        yield LogChange(moving=True)


def _refined(change: LogChange, found: dict[str, float]) -> LogChange:
    """Return a change of a number with the number that the nuisances of a fit say."""
    if change.kind == "clock":
        # Servos that are slower by a factor, in a log whose time has been divided by the pace.
        pace = change.pace / found["servo gain"]
        return replace(change, pace=pace) if abs(pace - 1.0) > SAME_PACE else change
    if any(change.constant):
        bias = [found[f"gyro bias {axis}"] for axis in AXES]
        return replace(change, constant=_three(np.add(change.constant, bias)))
    return change


def _step(log: SwimLog) -> float:
    """Return the typical time between two rows, s."""
    return float(np.median([np.median(np.diff(log.time[rows])) for rows in log.blocks]))


def _three(numbers: Floats) -> tuple[float, float, float]:
    x, y, z = numbers.tolist()
    return x, y, z


def _axes_in_words(axes: tuple[str, str, str]) -> str:
    """Return a signed permutation in words."""
    moved = [right for right, axis in zip(AXES, axes, strict=True) if axis[-1] != right]
    turned = [axis[-1] for axis in axes if axis[0] == "-"]
    if not moved:
        noun = "the sign" if len(turned) == 1 else "the signs"
        words = f"{noun} of {_listed(turned)} of the gyroscope changed"
        if turned == ["x", "y"]:  # the fish is symmetric
            words += " (or those of both flippers' commands: the fish is symmetric)"
        return words
    if not turned and len(moved) == 2:
        return f"{_listed(moved)} of the gyroscope exchanged"
    words = f"x, y and z of the gyroscope taken from the log's {_listed(axes)}"
    return f"{words}, as in ROS" if axes == ("-y", "x", "z") else words


def _listed(names: Sequence[str]) -> str:
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)
