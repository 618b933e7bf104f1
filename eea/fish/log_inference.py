"""Joint inference from a recorded swim."""

from __future__ import annotations

import time
from typing import Unpack

import numpy as np
from numpy.typing import ArrayLike

from aquafish_gym.morphology import Morphology
from eea.core.config import FitConfig, JointConfig
from eea.core.result import RoundRecord
from eea.core.session import streams
from eea.fish.estimate import MorphologyEstimate
from eea.fish.joint import fish_joint
from eea.fish.simulator import EngineSimulator, SimulatorOptions
from eea.fish.swim_log import SwimLog
from eea.fish.windows import log_windows
from eea.joint.inference import fit
from eea.joint.least_squares import Observed
from eea.joint.session import round_fit


def infer_log(
    log: SwimLog,
    joint: FitConfig | None = None,
    seed: int = 0,
    truth: Morphology | ArrayLike | None = None,
    *,
    moving: bool = False,
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
        The body, if known: only for OBJ_FIT.
    moving
        Whether each trial's record begins in mid-swim; otherwise it begins at rest.
    **simulator
        See ``EngineSimulator``.

    Returns
    -------
    MorphologyEstimate
        Of one round, whatever the number of trials; its ``belief`` has the posterior, the findings
        and the verdict.

    Raises
    ------
    ConfigurationError, InvalidArgumentError
        If a setting is wrong, or a trial too short; see ``log_windows``.

    Examples
    --------
    >>> from aquafish_gym import simulate
    >>> commands = [(0.5, -0.5, 1.0), (-0.5, 0.4, 0.7)]
    >>> logs = [simulate(None, u, (0.5, 1.0, -2.0), 96, dtype="float64") for u in commands]
    >>> found = infer_log(SwimLog.of_trials(commands, logs), truth=Morphology.nominal())
    >>> bool(found.objective_fitness > 0.99)
    True
    """
    began = time.monotonic()
    windows = log_windows(log, moving)
    settings = vars(FitConfig() if joint is None else joint)
    config = JointConfig(**settings | {"steps": windows.gyro.shape[1], "rounds": 1})
    body = None if truth is None else Morphology.coerce(truth).to_array()
    fish = fish_joint(EngineSimulator(windows.steps, **simulator), windows)
    observed = Observed(np.arange(len(windows.gyro)), windows.gyro)
    posterior = fit(observed, fish, config, streams(seed)["estimation"])
    command = windows.series[-1, windows.begun // windows.interval :].mean(axis=0)
    seconds, layout = time.monotonic() - began, fish.problem.models
    record = RoundRecord.of(1, command, None, round_fit(posterior), layout, body, None, seconds)
    return MorphologyEstimate(config, seed, layout, body, [record], belief=posterior)
