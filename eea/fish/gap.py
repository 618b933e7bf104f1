"""The reality gap: differences of a target's world from the world of its models."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from aquafish_gym.scenario import MAXIMUM_SPIN
from aquafish_gym.utils.validation import finite_array
from aquafish_gym.world_config import WorldConfig


@dataclass(frozen=True, kw_only=True)
class RealityGap(WorldConfig):
    """Differences of a target from its models, unknown to the models; none by default.

    They are relative to the shared world: currents add up, and substeps multiply.

    Raises
    ------
    InvalidArgumentError
        If a number is out of range.

    Examples
    --------
    >>> print(RealityGap(drag=(0.8, 1.2), gyro_noise=0.01))
    drag 0.8 1.2, gyro_noise 0.01
    """

    gyro_noise: float = 0.0
    """Standard deviation of the gyroscope's white noise, rad/s in each sample and axis."""
    gyro_bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """The gyroscope's reading at rest, rad/s."""

    def __post_init__(self) -> None:
        super().__post_init__()
        noise = finite_array("gyro_noise", self.gyro_noise, (), 0.0, MAXIMUM_SPIN, "rad/s")
        bias = finite_array("gyro_bias", self.gyro_bias, (3,), -MAXIMUM_SPIN, MAXIMUM_SPIN, "rad/s")
        object.__setattr__(self, "gyro_noise", float(noise))
        object.__setattr__(self, "gyro_bias", tuple(bias.tolist()))

    @property
    def changes(self) -> dict[str, Any]:
        """The fields that differ from the models' world, by name."""
        plain = RealityGap()
        return {name: value for name, value in vars(self).items() if value != vars(plain)[name]}

    def __str__(self) -> str:
        words = []
        for name, value in self.changes.items():
            values = value if isinstance(value, tuple) else (value,)
            words.append(name if value is True else " ".join([name, *(f"{v:g}" for v in values)]))
        return ", ".join(words) or "nothing"
