"""The simulator of candidate fish, in one of the engines of ``aquafish_gym``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypedDict

import numpy as np
from numpy.typing import ArrayLike

from aquafish_gym.engines.api import simulate
from aquafish_gym.engines.packages import resolve_engine
from aquafish_gym.imu import ImuLog
from aquafish_gym.utils.validation import finite_array
from eea.core.experiment import Comparer, Simulator, Trials


class SimulatorOptions(TypedDict, total=False):
    """Keywords of :class:`EngineSimulator`."""

    engine: str
    dtype: str
    current: ArrayLike
    substeps: int
    threads: int | None


@dataclass(frozen=True, eq=False)
class EngineSimulator(Simulator):
    """Candidate fish, simulated in batches.

    It cannot be subclassed, since comparisons in the engine would bypass another ``simulate``:
    inherit from ``eea.Simulator`` and hold one of these.

    Raises
    ------
    InvalidArgumentError, UnknownNameError, EngineUnavailableError
        If a setting is wrong or the engine is not to be had.

    Examples
    --------
    >>> trials = Trials(np.full((5, 9), 0.3), np.full((5, 3), 0.4), np.zeros((5, 3)))
    >>> EngineSimulator(steps=64).simulate(trials).gyro.shape
    (5, 64, 3)
    """

    steps: int  #: Length of a trial in steps of 0.01 s.
    #: See ``aquafish_gym.simulate``. The compiled engine's single precision is the fastest.
    engine: str = "numba"
    dtype: str = "float32"
    current: ArrayLike = (0.0, 0.0, 0.0)
    substeps: int = 1
    threads: int | None = None

    def __init_subclass__(cls, **_: Any) -> None:
        raise TypeError(
            "EngineSimulator cannot be subclassed; inherit from eea.Simulator and hold one"
        )

    def __post_init__(self) -> None:
        finite_array("current", self.current, (3,))
        # One motionless robot, so that a wrong setting is refused here.
        self.simulate(Trials(np.zeros((1, 9)), np.zeros((1, 3)), np.zeros((1, 3))))

    def simulate(self, trials: Trials) -> ImuLog:
        """Run B trials of bodies (B, 9), commands (B, 3) and fin angles (B, 3)."""
        return simulate(trials.models, trials.commands, trials.angles, **vars(self))

    def comparer(self, steps: int) -> Comparer | None:
        """Return a comparer of behaviours in the compiled engine, if it can be used."""
        if resolve_engine("engine", self.engine) != "numba" or steps != self.steps:
            return None
        # numba is imported here to keep `import eea.fish.simulator` quick.
        from eea.fish.spectral import SHORTEST, SpectralComparer

        if steps < SHORTEST:
            return None
        return SpectralComparer(steps, self.dtype, self.current, self.substeps, self.threads)
