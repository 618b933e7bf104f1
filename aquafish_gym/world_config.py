"""``WorldConfig``: the water, the servos and the step size of a robot's world."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Self

from aquafish_gym.plans import AQUAFISH, check_same_plan
from aquafish_gym.scenario import Scenario, check_row
from aquafish_gym.utils.array_types import Triple
from aquafish_gym.utils.validation import flag, instance, integer

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
    servo_gain: Triple = (1.0, 1.0, 1.0)
    """Speed over command of the left, right and caudal servo, -2 to 2; 0 is seized, -1 reversed."""
    lag: float = 0.0
    """Delay from a command to the servos' motion, 0 to 1 s."""
    reactive: bool = False
    """Whether the water also resists acceleration; see docs/physics.md."""
    substeps: int = 1
    """Physics steps in 0.01 s, 1 to 64."""

    def __post_init__(self) -> None:
        for name in ("current", "drag", "servo_gain"):
            row = check_row(name, getattr(self, name))
            object.__setattr__(self, name, tuple(row.tolist()))
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
        check_same_plan("robot", robot.plan, AQUAFISH)
        names = ("current", "drag", "servo_gain")
        rows: dict[str, Any] = {name: getattr(robot, name)[0] for name in names}
        return cls(**rows, lag=float(robot.servo_lag[0]), reactive=robot.reactive)

    def edit(self, scenario: Scenario) -> Scenario:
        """Return a scenario in this world: currents and lags add up, drags and gains multiply."""
        instance("scenario", scenario, Scenario)
        check_same_plan("scenario", scenario.plan, AQUAFISH)  # it has three gains
        rates = dict(scenario.rates)
        if "servo_gain" in rates:
            rates["servo_gain"] = rates["servo_gain"] * self.servo_gain
        return replace(
            scenario,
            current=scenario.current + self.current,
            drag=scenario.drag * self.drag,
            servo_gain=scenario.servo_gain * self.servo_gain,
            servo_lag=scenario.servo_lag + self.lag,
            reactive=scenario.reactive or self.reactive,
            rates=rates,
        )
