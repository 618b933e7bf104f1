"""Joint inference from a recorded swim: the body, and the time of a change."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple, Unpack

import numpy as np
from numpy.typing import ArrayLike

from aquafish_gym.morphology import Morphology
from aquafish_gym.utils.validation import InvalidArgumentError, callback, flag, instance, integer
from eea.core.angles import Floats
from eea.core.config import FitConfig
from eea.core.floating import own_errors
from eea.core.session import MAXIMUM_SEED, streams
from eea.fish.estimate import MorphologyEstimate
from eea.fish.joint import check_groups, fish_robot
from eea.fish.log_checks import LogCheck, check_log
from eea.fish.log_fit import CLOSEST_ROWS_SECONDS, fit_log
from eea.fish.prior import check_belief, noise_now, since
from eea.fish.simulator import EngineSimulator, SimulatorOptions
from eea.fish.swim_log import SwimLog, shown
from eea.fish.windows import LogWindows, Start, log_windows
from eea.infer.answer import Answer
from eea.infer.known import FALSE_ALARM_PROBABILITY, Known, Verdict, check_alarm
from eea.infer.optima import Optima
from eea.infer.robot import Robot
from eea.infer.trials import Observed

WINDOW_SECONDS = 1.0  # s; a change shows in the first window that lies entirely after it


@own_errors
def infer_log(
    log: SwimLog,
    joint: FitConfig | None = None,
    seed: int = 0,
    truth: Morphology | ArrayLike | None = None,
    *,
    moving: bool = False,
    prior: Answer | Morphology | None = None,
    start: Start | None = None,
    check: bool = False,
    progress: Callable[[str], None] | None = None,
    **simulator: Unpack[SimulatorOptions],
) -> MorphologyEstimate:
    """Infer the body, nuisances and initial states of a recorded swim, with intervals.

    Parameters
    ----------
    log
        A log of any rate; see ``read_log``. The simulation is interpolated to its times.
    joint
        Settings of the inference.
    seed
        Seed of everything random.
    truth
        The body, if known; only OBJ_FIT uses it.
    moving
        Whether each trial's record begins in mid-swim, in an unknown state; otherwise it begins at
        rest, with unknown fin angles.
    prior
        The earlier body: a posterior, or a known body. Each fin may have changed since, with a
        chance of 0.1; see ``eea.fish.prior``. The noise is then taken from ``joint``, or from the
        posterior or, where it is noisier, from the log. None: no prior knowledge.
    start
        The state at the first row of each trial, if it is known; the water is still.
    check
        Whether to try possible mistakes of a log that no body with intact servos explains (see
        ``check_log``); the estimate's ``check`` holds the result. If a change of the log explains
        it, servo faults are not tried. ``prior`` and ``start`` must be None.
    progress
        Called with the present step in words.
    **simulator
        See ``EngineSimulator``.

    Returns
    -------
    MorphologyEstimate
        The body. Its ``belief`` has the posterior, the findings and the verdict.

    Raises
    ------
    ConfigurationError, InvalidArgumentError
        If a setting is wrong, the noise of a body's gyroscope is not given, ``prior`` is no
        posterior of this fish, or a trial is too short; see ``log_windows``.

    Examples
    --------
    >>> from aquafish_gym import simulate
    >>> commands = [(0.5, -0.5, 1.0), (-0.5, 0.4, 0.7)]
    >>> logs = [simulate(None, u, (0.5, 1.0, -2.0), 96, dtype="float64") for u in commands]
    >>> found = infer_log(SwimLog.of_trials(commands, logs), truth=Morphology.nominal())
    >>> bool(found.objective_fitness > 0.99)
    True
    """
    callback("progress", progress)
    if joint is not None:
        instance("joint", joint, FitConfig)
    if flag("check", check) and (prior is not None or start is not None):
        raise InvalidArgumentError("check must be False where prior or start is given; got True")
    windows = log_windows(log, moving, start=start)
    config = FitConfig() if joint is None else joint
    check_groups(config.nuisances, windows)
    if truth is not None:
        Morphology.coerce(truth)  # raises for what is no body
    if prior is not None:
        config = replace(config, noise=_known_noise(config, prior, windows))
    finer = log_windows(log, moving, start=start, within=CLOSEST_ROWS_SECONDS)
    found: list[LogCheck] = []

    def doubt(plain: Optima) -> bool:
        """Check the log; return whether a fault of the robot is the better explanation."""
        share = plain.goodness.unexplained
        found.append(
            check_log(
                log, joint, seed, moving=moving, unexplained=share, progress=progress, **simulator
            )
        )
        return not found[0].fits

    def robot(by: LogWindows) -> Robot:
        fish = fish_robot(EngineSimulator(by.steps, **simulator), by)
        return fish if prior is None else since(fish, prior)

    doubts = doubt if check else None
    posterior = fit_log(
        windows, finer, robot, config, lambda: streams(seed)["estimation"], doubts, progress
    )
    checked = found[0] if found and not posterior.good else None
    return MorphologyEstimate.of(posterior, truth, checked, seed)


def _known_noise(config: FitConfig, prior: Answer | Morphology, windows: LogWindows) -> float:
    """Return the noise, rad/s, for a swim with a prior."""
    if config.noise is not None:
        return config.noise
    if not isinstance(prior, Answer):
        raise InvalidArgumentError(
            "joint must have the gyroscope's noise where prior is a body, since an unknown noise "
            "would explain any change; got noise=None"
        )
    return noise_now(prior, windows)[0]


class Watched(NamedTuple):
    """The tests of a swim, window by window."""

    time: Floats  #: (E,) end of each window, s of swimming since the record's beginning.
    looks: tuple[Verdict, ...]
    alarm: float  #: The probability of a false alarm in each window.

    @property
    def noticed(self) -> float | None:
        """Time of the detected change, s; None without a change."""
        changed = [not look.same for look in self.looks]
        return float(self.time[changed.index(True)]) if any(changed) else None

    def __str__(self) -> str:
        seconds = f"{shown(self.time[-1], 4)} s of swimming, {len(self.looks)} windows"
        if self.noticed is None:
            return f"{seconds}: this is still the body that was inferred"
        return (
            f"{seconds}: since {shown(self.noticed, 4)} s this is no longer the body that was "
            f"inferred (p = {min(look.p for look in self.looks):.0e}; one false alarm in "
            f"{1.0 / self.alarm:,.0f} windows)"
        )


@own_errors
def watch_swim(
    log: SwimLog,
    belief: Answer,
    *,
    alarm: float = FALSE_ALARM_PROBABILITY,
    seed: int = 0,
    until_noticed: bool = False,
    progress: Callable[[int, int], None] | None = None,
    **simulator: Unpack[SimulatorOptions],
) -> Watched:
    """Compare a swim with the posterior of a body, one window of a second at a time.

    A window has at least 16 readings, so it is longer in a slow log.
    ``eea.infer.known`` describes the test. The noise is that of the posterior's trials,
    or of the log where it is noisier.

    Parameters
    ----------
    log
        A swim that begins at any moment; all its trials count. The first 0.2 s of each trial only
        determine the servo speeds.
    belief
        A ``result.belief`` of joint inference, or the result of ``load_posterior`` or
        ``known_body``.
    alarm
        The probability of a false alarm in each window, more than 0.
    seed
        Seed of the random starting points.
    until_noticed
        Whether to stop at the first window that another body explains.
    progress
        Called after each window with the number of finished windows and of all windows.
    **simulator
        See ``EngineSimulator``.

    Raises
    ------
    ConfigurationError, InvalidArgumentError
        If an argument is wrong, ``belief`` is no posterior of this fish, a trial is too short, no
        servo moves, or the noise is unknown: that of trials without noise, and of a sparse log.

    Examples
    --------
    >>> log = read_log("swim.csv")  # doctest: +SKIP
    >>> print(watch_swim(log, load_posterior("posterior.npz")))  # doctest: +SKIP
    60 s of swimming, 59 windows: this is still the body that was inferred
    """
    flag("until_noticed", until_noticed)
    callback("progress", progress)
    integer("seed", seed, 0, MAXIMUM_SEED)
    windows = log_windows(log, True, WINDOW_SECONDS)
    joint = fish_robot(EngineSimulator(windows.steps, **simulator), windows)
    check_belief("belief", belief, joint)
    if not windows.series.any():
        raise InvalidArgumentError("log must contain motion: no servo moves in any of its trials")
    sigma, samples = noise_now(belief, windows)
    belief = replace(belief, sigma=sigma, samples=samples)
    check_alarm(alarm)
    known = Known.of(belief, joint)
    rng = np.random.default_rng(seed)
    finer = log_windows(log, True, WINDOW_SECONDS, within=CLOSEST_ROWS_SECONDS)
    joint = fish_robot(EngineSimulator(finer.steps, **simulator), finer)
    doubting = Known.of(belief, joint)
    again = np.random.default_rng(seed)
    looks: list[Verdict] = []
    for i, gyro in enumerate(windows.gyro):
        weight = None if windows.weight is None else windows.weight[i][None]
        window = Observed(np.array([i]), gyro[None], weight)
        looks.append(known.test(window, rng, alarm))
        if not looks[-1].same and finer.unknown(i) > windows.unknown(i):
            looks[-1] = doubting.test(window, again, alarm)
        if progress is not None:
            progress(i + 1, len(windows.gyro))
        if until_noticed and not looks[-1].same:
            break
    return Watched(windows.ends[: len(looks)], tuple(looks), alarm)
