"""What a robot is to do, and what that is worth. The physics measures, a task judges.

A task is written once for one robot and for many: every ``Number`` is a float, or a row (B,) of B
robots' numbers, and a vector is a tuple of three. numpy's functions take both.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from types import MemberDescriptorType
from typing import ClassVar, NamedTuple

import numpy as np

from aquafish_gym.physics.arithmetic import TAU, Number, Vector, subtract
from aquafish_gym.scenario import MAXIMUM_CURRENT, TIMESTEP
from aquafish_gym.utils.validation import InvalidArgumentError, brief, finite_array, flag, one_of

MOST = 1e6  # of a weight: a reward must stay finite
LEAST = 1e-3  # units, of a distance that others are divided by
LONGEST = 3600.0  # s
Memory = tuple[Number, ...]


class Step(NamedTuple):
    """What a robot did in a step of an environment.

    Positions are of the body's centre in the world, in units of 5 cm.
    """

    before: Vector  #: Where it was when the step began.
    after: Vector  #: Where it is.
    orientation: tuple[Number, Number, Number, Number]  #: (x, y, z, w), from body to world.
    action: Vector  #: Of the servos, in [-1, 1].
    memory: Memory  #: The task's own, of this episode.
    dt: float  #: How long the step was, s.

    @property
    def velocity(self) -> Vector:
        """Mean velocity over the step, units/s."""
        x, y, z = subtract(self.after, self.before)
        return (x / self.dt, y / self.dt, z / self.dt)


@dataclass(frozen=True)
class Task:
    """What there is to do in an episode; a subclass says at least what each step is worth.

    What a task needs to know of an episode is its memory: numbers that :meth:`begin` chooses and
    :meth:`remember` brings up to date.

    Attributes
    ----------
    has_goal
        Whether it has a place to be at, which the robot then observes.
    seconds
        How long an episode lasts.

    Examples
    --------
    >>> class SwimUp(Task):
    ...     def reward_terms(self, step: Step) -> dict[str, Number]:
    ...         return {"reward_up": step.velocity[2]}
    >>> SwimUp().seconds
    20.0
    """

    has_goal: ClassVar[bool] = False
    seconds: float = 20.0

    def __post_init__(self) -> None:
        for field in fields(self):
            own = getattr(type(self), field.name, field.default)
            if own is not field.default and not isinstance(own, MemberDescriptorType):  # of slots
                raise InvalidArgumentError(
                    f"{type(self).__name__}.{field.name} must be a field of a class under "
                    f"@dataclass(frozen=True): `{field.name}: {field.type} = {brief(own)}`; "
                    f"as it stands the task has {brief(getattr(self, field.name))}"
                )
        seconds = float(finite_array("seconds", self.seconds, (), TIMESTEP, LONGEST, "s"))
        object.__setattr__(self, "seconds", seconds)

    def begin(self, rng: np.random.Generator) -> tuple[float, ...]:  # noqa: ARG002
        """Return the memory with which one robot's episode begins."""
        return ()

    def current(self, memory: Memory, seconds: Number) -> Vector | None:  # noqa: ARG002
        """Return the water's own velocity at a moment, units/s; None leaves it as it is."""
        return None

    def goal(self, memory: Memory) -> Vector:
        """Return the place to be at, in units."""
        raise NotImplementedError(f"{type(self).__name__} has a goal: its `goal` must say where")

    def reward_terms(self, step: Step) -> Mapping[str, Number]:
        """Return what a step is worth, in terms whose sum is the reward."""
        raise NotImplementedError(
            f"{type(self).__name__}.reward_terms must say what steps are worth"
        )

    def remember(self, step: Step) -> Memory:
        """Return the memory after a step."""
        return step.memory


def distance(a: Vector, b: Vector) -> Number:
    """Return how far two places are from each other."""
    x, y, z = subtract(a, b)
    square = x * x + y * y + z * z
    return math.sqrt(square) if isinstance(square, float) else np.sqrt(square)


def effort(action: Vector) -> Number:
    """Return the sum of the action's squares."""
    left, right, caudal = action
    return left * left + right * right + caudal * caudal


@dataclass(frozen=True)
class _Moving(Task):
    """A task in which effort has a small price."""

    ctrl_weight: float = 1e-4

    def __post_init__(self) -> None:
        super().__post_init__()
        self._checked("ctrl_weight", 0.0, MOST)

    def _checked(self, name: str, low: float, high: float, unit: str = "") -> None:
        value = float(finite_array(name, getattr(self, name), (), low, high, unit))
        object.__setattr__(self, name, value)

    def _price(self, step: Step) -> dict[str, Number]:
        return {"reward_ctrl": -self.ctrl_weight * effort(step.action)}


@dataclass(frozen=True)
class SwimForward(_Moving):
    """Swim along the world's +y, which is where the robot faces at the start, with little effort.

    As in Gymnasium's Swimmer: the speed made good over the step, less a small price on the action.

    Attributes
    ----------
    forward_weight
        Of the speed along +y in units/s, at most a million.
    ctrl_weight
        Of the sum of the action's squares; not negative.
    """

    forward_weight: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self._checked("forward_weight", -MOST, MOST)

    def reward_terms(self, step: Step) -> dict[str, Number]:
        """Return ``reward_forward`` and ``reward_ctrl``."""
        speed = (step.after[1] - step.before[1]) / step.dt
        return {"reward_forward": self.forward_weight * speed, **self._price(step)}


@dataclass(frozen=True)
class Recover(SwimForward):
    """Swim forward for a minute, in which something breaks: ``AquaFishRecovery-v0``.

    What breaks, and when, is the environment's ``damage``.
    """

    seconds: float = 60.0


@dataclass(frozen=True)
class HoldStation(_Moving):
    """Stay where you are, in a current from anywhere in the horizontal plane.

    What each step is worth falls with the distance d from the start, as 1 / (1 + (d / half)^2); and
    the way that the water takes is lost until it is made good.

    Attributes
    ----------
    slowest, fastest
        The current's speed is uniform between these, units/s.
    half
        The distance at which ``reward_near`` is a half, in units.
    turning
        The current turns by up to so many rad/s, either way; 0 is a constant one.
    """

    has_goal: ClassVar[bool] = True
    seconds: float = 60.0
    slowest: float = 0.1
    fastest: float = 0.3
    half: float = 2.0
    turning: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self._checked("slowest", 0.0, MAXIMUM_CURRENT, "units/s")
        self._checked("fastest", self.slowest, MAXIMUM_CURRENT, "units/s")
        self._checked("half", LEAST, MOST, "units")
        self._checked("turning", 0.0, MOST, "rad/s")

    def begin(self, rng: np.random.Generator) -> tuple[float, ...]:
        """Return the current's speed, where it flows at first, and how fast it turns."""
        speed, heading = rng.uniform(self.slowest, self.fastest), rng.uniform(-np.pi, np.pi)
        return (float(speed), float(heading), float(rng.uniform(-self.turning, self.turning)))

    def current(self, memory: Memory, seconds: Number) -> Vector:
        """Return the current."""
        speed, heading, turning = memory
        angle = heading + turning * seconds
        return (speed * np.cos(angle), speed * np.sin(angle), 0.0 * speed)

    def goal(self, memory: Memory) -> Vector:
        """Return the origin, where the robot begins."""
        nowhere = 0.0 * memory[0]
        return (nowhere, nowhere, nowhere)

    def reward_terms(self, step: Step) -> dict[str, Number]:
        """Return ``reward_near``, ``reward_progress`` (units/s towards it), and ``reward_ctrl``."""
        place = self.goal(step.memory)
        before, after = distance(step.before, place), distance(step.after, place)
        away = after / self.half
        return {
            "reward_near": 1.0 / (1.0 + away * away),
            "reward_progress": (before - after) / step.dt,
            **self._price(step),
        }


# Multiples of these, modulo 1, are spread evenly over the unit square, wherever they begin (the
# R2 sequence of M. Roberts, 2018).
_SPREAD = (0.7548776662466927, 0.5698402909980532)


@dataclass(frozen=True)
class ReachWaypoints(_Moving):
    """Swim to a point, then to the next: in 3-D, each ``apart`` from the last in any direction.

    Attributes
    ----------
    apart
        Units from each point to the next, and from the start to the first.
    radius
        A point is reached within so many units.
    reached_weight
        What reaching one is worth.
    """

    has_goal: ClassVar[bool] = True
    seconds: float = 60.0
    apart: float = 6.0
    radius: float = 1.5
    reached_weight: float = 5.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self._checked("apart", 0.0, MOST, "units")
        self._checked("radius", 0.0, MOST, "units")
        self._checked("reached_weight", -MOST, MOST)
        if self.radius >= self.apart:
            raise InvalidArgumentError(
                f"radius must be less than apart, {self.apart:g}; got {self.radius:g}"
            )

    def begin(self, rng: np.random.Generator) -> tuple[float, ...]:
        """Return the first point, how many were reached, and where the next ones come from."""
        u, v = rng.random(2).tolist()
        return (*self._after((0.0, 0.0, 0.0), u, v, 0.0), 0.0, u, v)

    def _after(self, place: Vector, u: Number, v: Number, count: Number) -> Vector:
        up = 2.0 * ((u + _SPREAD[0] * count) % 1.0) - 1.0  # uniform on the sphere, as is height
        angle, flat = TAU * ((v + _SPREAD[1] * count) % 1.0), np.sqrt(1.0 - up * up)
        x, y, z = place
        return (
            x + self.apart * flat * np.cos(angle),
            y + self.apart * flat * np.sin(angle),
            z + self.apart * up,
        )

    def goal(self, memory: Memory) -> Vector:
        """Return the present point."""
        return (memory[0], memory[1], memory[2])

    def _reached(self, step: Step) -> Number:
        return 1.0 * (distance(step.after, self.goal(step.memory)) < self.radius)

    def reward_terms(self, step: Step) -> dict[str, Number]:
        """Return ``reward_progress`` (units/s towards the point), ``reward_reached``, and ctrl."""
        goal = self.goal(step.memory)
        nearer = distance(step.before, goal) - distance(step.after, goal)
        return {
            "reward_progress": nearer / step.dt,
            "reward_reached": self.reached_weight * self._reached(step),
            **self._price(step),
        }

    def remember(self, step: Step) -> Memory:
        """Return the next point once one is reached."""
        x, y, z, count, u, v = step.memory
        reached = self._reached(step)
        there = self._after((x, y, z), u, v, count + 1.0)
        goal = tuple(old + reached * (new - old) for old, new in zip((x, y, z), there, strict=True))
        return (*goal, count + reached, u, v)


TASKS: dict[str, Task] = {
    "forward": SwimForward(),
    "station": HoldStation(),
    "waypoint": ReachWaypoints(),
    "recovery": Recover(),
}


def check_task(task: object) -> Task:
    """Return a task from its name or itself."""
    if isinstance(task, str):
        return TASKS[one_of("task", task, TASKS)]
    if not isinstance(task, Task):
        raise InvalidArgumentError(
            f"task must be a Task or one of {', '.join(TASKS)}; got {brief(task)}"
        )
    flag("task.has_goal", task.has_goal)
    return task


def check_water(task: Task, current: Vector) -> None:
    """Raise InvalidArgumentError if there is a current where the task has one of its own."""
    if type(task).current is not Task.current and any(current):
        raise InvalidArgumentError(
            f"current must be 0 where the task says how the water flows; got {current} with "
            f"{type(task).__name__}"
        )
