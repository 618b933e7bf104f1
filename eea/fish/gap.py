"""The reality gap: how a target's world differs from its models'."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.imu import ImuLog
from aquafish_gym.morphology import FINS
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.validation import finite_array, one_of
from aquafish_gym.world_config import WorldConfig
from eea.core.angles import Floats, wrap

MOST_SPIN = 100.0  # rad/s of noise or bias


@dataclass(frozen=True, kw_only=True)
class RealityGap(WorldConfig):
    """Differences of a target from its models, which do not know them; none by default.

    They are relative to the shared world: currents add up, and substeps multiply.

    Raises
    ------
    InvalidArgumentError, UnknownNameError
        If a number is out of range, or there is no such servo.

    Examples
    --------
    >>> print(RealityGap(drag=(0.8, 1.2), seized="caudal", seized_angle=0.5))
    drag 0.8 1.2, seized caudal, seized_angle 0.5
    """

    gyro_noise: float = 0.0
    """Standard deviation of the gyroscope's white noise, rad/s in each sample and axis."""
    gyro_bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """The gyroscope's reading at rest, rad/s."""
    seized: Literal["left_pectoral", "right_pectoral", "caudal"] | None = None
    """A servo that is stuck at the same angle in every trial."""
    seized_angle: float = 0.0
    """Its angle (of a flipper) or phase (of the tail), rad."""

    def __post_init__(self) -> None:
        super().__post_init__()
        noise = float(finite_array("gyro_noise", self.gyro_noise, (), 0.0, MOST_SPIN, "rad/s"))
        bias = finite_array("gyro_bias", self.gyro_bias, (3,), -MOST_SPIN, MOST_SPIN, "rad/s")
        angle = float(finite_array("seized_angle", self.seized_angle, (), unit="rad"))
        object.__setattr__(self, "gyro_noise", noise)
        object.__setattr__(self, "gyro_bias", tuple(bias.tolist()))
        object.__setattr__(self, "seized_angle", angle)
        if self.seized is not None:
            one_of("seized", self.seized, FINS)

    @property
    def changes(self) -> dict[str, Any]:
        """The fields that differ from the models' world, by name."""
        plain = RealityGap()
        return {name: value for name, value in vars(self).items() if value != vars(plain)[name]}

    def __str__(self) -> str:
        words = []
        for name, value in self.changes.items():
            values = value if isinstance(value, tuple) else (value,)
            numbers = (f"{v:g}" if isinstance(v, float) else str(v) for v in values)
            words.append(name if value is True else " ".join([name, *numbers]))
        return ", ".join(words) or "nothing"

    def edit(self, scenario: Scenario) -> Scenario:
        """Return a scenario of the models' world with the target's differences.

        Examples
        --------
        >>> gap = RealityGap(seized="caudal", servo_gain=(0.9, 0.9, 0.9))
        >>> gap.edit(Scenario.create()).servo_gain.tolist()
        [[0.9, 0.9, 0.0]]
        """
        edited = super().edit(scenario)
        return replace(edited, servo_gain=np.where(self._stuck, 0.0, edited.servo_gain))

    @property
    def _stuck(self) -> NDArray[np.bool_]:
        return np.array([fin == self.seized for fin in FINS])

    def placed(self, angles: Floats) -> Floats:
        """Return fin angles (..., 3) in rad, a seized servo's at its angle."""
        return np.where(self._stuck, wrap(self.seized_angle), angles)

    def felt(self, log: ImuLog, rng: np.random.Generator) -> ImuLog:
        """Return a log with the gyroscope's noise and bias."""
        if log.gyro is None or not (self.gyro_noise or any(self.gyro_bias)):
            return log
        noise = self.gyro_noise * rng.standard_normal(log.gyro.shape)
        return replace(log, gyro=log.gyro + np.array(self.gyro_bias) + noise)
