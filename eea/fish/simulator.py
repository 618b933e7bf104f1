"""The fish as a problem of the EEA, and the simulator of candidate fish."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypedDict

import numpy as np
from numpy.typing import ArrayLike

from aquafish_gym.engines.api import simulate
from aquafish_gym.engines.packages import GPU, resolve_engine
from aquafish_gym.imu import ImuLog
from aquafish_gym.plans import AQUAFISH, BodyPlan, PlanLike, check_plan
from eea.core.checks import instance, whole
from eea.core.experiment import Comparer, Simulator, Trials
from eea.core.genome import action_layout, model_layout
from eea.core.problem import Problem
from eea.fish.swim_log import fastest_spin


def fish_problem(plan: PlanLike = AQUAFISH) -> Problem:
    """Return the fish of a plan as a problem: its sizes, servos, fins, and IMU axes."""
    plan = check_plan(plan)
    models = model_layout((d.name, d.maximum, d.bits) for d in plan.dimensions)
    bounds = zip(plan.names, plan.command_low.tolist(), plan.command_high.tolist(), strict=True)
    return Problem(
        models, action_layout(bounds), hidden=plan.names, axes=3, fastest=fastest_spin(plan)
    )


class SimulatorOptions(TypedDict, total=False):
    """Keywords of :class:`EngineSimulator`, but the plan."""

    engine: str
    dtype: str
    current: ArrayLike
    substeps: int
    threads: int | None
    reactive: bool


@dataclass(frozen=True, eq=False)
class EngineSimulator(Simulator):
    """Candidate fish, simulated in batches.

    Raises
    ------
    InvalidArgumentError, UnknownNameError, EngineUnavailableError
        If a setting is wrong or the engine is not installed.

    Examples
    --------
    >>> trials = Trials(np.full((5, 9), 0.3), np.full((5, 3), 0.4), np.zeros((5, 3)))
    >>> EngineSimulator(steps=64).simulate(trials).gyro.shape
    (5, 64, 3)
    """

    steps: int  #: Length of a trial in steps of 0.01 s.
    #: See ``aquafish_gym.simulate``. The compiled engines' single precision is the fastest.
    engine: str = "numba"
    dtype: str | None = None
    current: ArrayLike = (0.0, 0.0, 0.0)
    substeps: int = 1
    threads: int | None = None
    reactive: bool = False
    plan: BodyPlan = AQUAFISH  #: The candidates' body plan.

    def __post_init__(self) -> None:
        object.__setattr__(self, "plan", check_plan(self.plan))
        # Simulate one motionless robot, so that a wrong setting raises here.
        still = np.zeros((1, len(self.plan.fins)))
        self.simulate(Trials(np.zeros((1, len(self.plan.dimensions))), still, still))

    def simulate(self, trials: Trials) -> ImuLog:
        """Run B trials of bodies (B, S), commands (B, F) and fin angles (B, F)."""
        instance("trials", trials, Trials)
        return simulate(trials.models, trials.commands, trials.angles, **vars(self))

    def comparer(self, steps: int) -> Comparer | None:
        """Return a comparer of behaviours in the compiled engine, if it can be used.

        It cannot replace the ``simulate`` of a subclass.
        """
        whole("steps", steps, 1)
        own = type(self) is EngineSimulator and steps == self.steps
        engine = resolve_engine("engine", self.engine, batch=True)
        if not own or engine not in ("numba", GPU):
            return None
        # numba is imported here to keep `import eea.fish.simulator` quick.
        from eea.fish.spectral import SHORTEST_SPECTRUM_STEPS, SpectralComparer

        if steps < SHORTEST_SPECTRUM_STEPS:
            return None
        return SpectralComparer(
            steps,
            self.dtype or "float32",
            self.current,
            self.substeps,
            self.threads,
            self.reactive,
            self.plan,
            engine,
        )
