"""Joint inference from a recorded swim: the body, with intervals."""

from __future__ import annotations

from collections.abc import Callable
from typing import Unpack

from numpy.typing import ArrayLike

from aquafish_gym.morphology import Morphology
from aquafish_gym.utils.validation import callback, flag, instance
from eea.core.config import FitConfig
from eea.core.floating import own_errors
from eea.core.session import streams
from eea.fish.estimate import MorphologyEstimate
from eea.fish.joint import check_groups, fish_robot
from eea.fish.log_checks import LogCheck, check_log
from eea.fish.log_fit import CLOSEST_ROWS_SECONDS, fit_log
from eea.fish.simulator import EngineSimulator, SimulatorOptions
from eea.fish.swim_log import SwimLog
from eea.fish.windows import LogWindows, log_windows
from eea.infer.optima import Optima
from eea.infer.robot import Robot


@own_errors
def infer_log(
    log: SwimLog,
    joint: FitConfig | None = None,
    seed: int = 0,
    truth: Morphology | ArrayLike | None = None,
    *,
    moving: bool = False,
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
    check
        Whether to try possible mistakes of a log that no body with intact servos explains (see
        ``check_log``); the estimate's ``check`` holds the result. If a change of the log explains
        it, servo faults are not tried.
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
        If a setting is wrong, or a trial is too short; see ``log_windows``.

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
    flag("check", check)
    windows = log_windows(log, moving)
    config = FitConfig() if joint is None else joint
    check_groups(config.nuisances, windows.plan, windows)
    if truth is not None:
        Morphology.coerce(truth, log.plan)  # raises for what is no body
    finer = log_windows(log, moving, within=CLOSEST_ROWS_SECONDS)
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
        return fish_robot(EngineSimulator(by.steps, plan=by.plan, **simulator), by)

    doubts = doubt if check else None
    posterior = fit_log(
        windows, finer, robot, config, lambda: streams(seed)["estimation"], doubts, progress
    )
    checked = found[0] if found and not posterior.good else None
    return MorphologyEstimate.of(posterior, truth, checked, seed)
