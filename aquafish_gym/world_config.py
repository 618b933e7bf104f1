"""``WorldConfig``: the water, the servos and the step size of a robot's world."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from aquafish_gym.plans import BodyPlan
from aquafish_gym.scenario import LARGEST_GAIN, Scenario, check_row
from aquafish_gym.utils.array_types import Floats, Triple
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    brief,
    finite_array,
    flag,
    instance,
    integer,
)

MAXIMUM_SUBSTEPS = 64


@dataclass(frozen=True, kw_only=True)
class WorldConfig:
    """Water, servos and step size of a world; the default is the world of all models.

    Raises
    ------
    InvalidArgumentError
        If a field is out of range.

    Examples
    --------
    >>> world = WorldConfig(servo_gain=(1.0, 0.0, 1.0), drag=(1.2, 0.9))
    >>> world.edit(Scenario.create()).servo_gain.tolist()
    [[1.0, 0.0, 1.0]]
    """

    current: Triple = (0.0, 0.0, 0.0)
    """Velocity of the water in the world, x, y and z in units/s, up to 20 each way."""
    drag: tuple[float, float] = (1.0, 1.0)
    """Factors on the drag of the fins and on that of the body, 0 to 10."""
    servo_gain: tuple[float, ...] = (1.0,)
    """Speed over command of all servos, or of each, -2 to 2; 0 is seized, -1 reversed."""
    lag: float = 0.0
    """Delay from a command to the servos' motion, 0 to 1 s."""
    reactive: bool = False
    """Whether the water also resists acceleration; see docs/physics.md."""
    substeps: int = 1
    """Physics steps in 0.01 s, 1 to 64."""

    def __post_init__(self) -> None:
        for name in ("current", "drag"):
            row = check_row(name, getattr(self, name))
            object.__setattr__(self, name, tuple(row.tolist()))
        gains = finite_array(
            "servo_gain", self.servo_gain, (None,), -LARGEST_GAIN, LARGEST_GAIN, flat=True
        ).tolist()
        if not gains:
            raise InvalidArgumentError("servo_gain must be one number or more; got none")
        alike = len(set(gains)) == 1
        object.__setattr__(self, "servo_gain", tuple(gains[:1] if alike else gains))
        object.__setattr__(self, "lag", float(check_row("servo_lag", self.lag, argument="lag")))
        flag("reactive", self.reactive)
        integer("substeps", self.substeps, 1, MAXIMUM_SUBSTEPS)

    @classmethod
    def of(cls, robot: Scenario) -> Self:
        """Return the water and the servos of a scenario of one robot.

        Examples
        --------
        >>> WorldConfig.of(Scenario.create(servo_gain=(1.0, 0.4, 1.0))).servo_gain
        (1.0, 0.4, 1.0)
        """
        instance("robot", robot, Scenario)
        names = ("current", "drag", "servo_gain")
        rows: dict[str, Any] = {name: getattr(robot, name)[0] for name in names}
        return cls(**rows, lag=float(robot.servo_lag[0]), reactive=robot.reactive)

    def gains(self, plan: BodyPlan) -> Floats:
        """Return the gain (F,) of each servo of a plan's robot.

        Raises
        ------
        InvalidArgumentError
            If there are several, and not one for each servo.
        """
        return each_fin("servo_gain", self.servo_gain, plan)

    def edit(self, scenario: Scenario) -> Scenario:
        """Return a scenario in this world: currents and lags add up, drags and gains multiply."""
        instance("scenario", scenario, Scenario)
        gains = self.gains(scenario.plan)
        rates = dict(scenario.rates)
        if "servo_gain" in rates:
            rates["servo_gain"] = rates["servo_gain"] * gains
        return replace(
            scenario,
            current=scenario.current + self.current,
            drag=scenario.drag * self.drag,
            servo_gain=scenario.servo_gain * gains,
            servo_lag=scenario.servo_lag + self.lag,
            reactive=scenario.reactive or self.reactive,
            rates=rates,
        )


def each_fin(name: str, value: ArrayLike, plan: BodyPlan, unit: str = "") -> Floats:
    """Return numbers (F,) from one for all fins, or one for each."""
    given = finite_array(name, value, (None,), unit=unit)
    fins = len(plan.fins)
    if len(given) not in (1, fins):
        raise InvalidArgumentError(
            f"{name} must be one number, or {fins} for {', '.join(plan.names)}; got {brief(value)}"
        )
    return np.resize(given, fins)
