"""The built-in tasks: swim forward, recover, hold a station, reach waypoints."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from aquafish_gym.envs.task import Memory as Memory
from aquafish_gym.envs.task import Step as Step
from aquafish_gym.envs.task import Task as Task
from aquafish_gym.physics.arithmetic import (
    TAU,
    Number,
    Vector,
    cosine_sine,
    floor,
    square_root,
    subtract,
    where_less,
)
from aquafish_gym.scenario import MAXIMUM_CURRENT
from aquafish_gym.utils.validation import InvalidArgumentError, brief, finite_array, flag, one_of

MOST = 1e6  # of a weight: a reward must stay finite
LEAST = 1e-3  # units, of a distance that others are divided by


# The built-in tasks are written as plain functions, which the compiled loop of a rollout runs too:
# of the task's own numbers, and of others that are floats, rows, or lanes of vector registers.
# Lanes give every task the same count of remembered numbers, so that a memory is read by index.
REMEMBERED = 6


class TaskNumbers(NamedTuple):
    """The numbers of all built-in tasks; of each its own, the others 0."""

    ctrl_weight: float
    forward_weight: float
    half: float
    apart: float
    radius: float
    reached_weight: float


class TaskFunctions(NamedTuple):
    """A task as straight-line functions of ``(task, memory or step)``; None where it has none."""

    reward_terms: Callable[[Any, Step], tuple[Number, ...]]
    current: Callable[[Any, Memory, Number], Vector] | None = None
    goal: Callable[[Any, Memory], Vector] | None = None
    remember: Callable[[Any, Step], Memory] | None = None
    make_step: type[Step] = Step


def task_functions(task: Task) -> TaskFunctions | None:
    """Return the functions that a compiled loop runs; None of a task that is not built in."""
    return _FUNCTIONS.get(type(task))


def task_numbers(task: Task) -> TaskNumbers:
    """Return the numbers that go with :func:`task_functions`."""
    return TaskNumbers(*(float(getattr(task, name, 0.0)) for name in TaskNumbers._fields))


def distance(a: Vector, b: Vector) -> Number:
    """Return the distance between two places."""
    x, y, z = subtract(a, b)
    return square_root(x * x + y * y + z * z)


def effort(action: Vector) -> Number:
    """Return the sum of the action's squares."""
    left, right, caudal = action
    return left * left + right * right + caudal * caudal


def _price(task: Any, step: Step) -> Number:
    return -task.ctrl_weight * effort(step.action)


def _forward_terms(task: Any, step: Step) -> tuple[Number, ...]:
    speed = (step.after[1] - step.before[1]) / step.dt
    return task.forward_weight * speed, _price(task, step)


def _station_current(_task: Any, memory: Memory, seconds: Number) -> Vector:
    speed, heading, turning = memory[0], memory[1], memory[2]
    cosine, sine = cosine_sine(heading + turning * seconds)
    return (speed * cosine, speed * sine, 0.0 * speed)


def _origin(_task: Any, memory: Memory) -> Vector:
    zero = 0.0 * memory[0]
    return (zero, zero, zero)


def _station_terms(task: Any, step: Step) -> tuple[Number, ...]:
    place = _origin(task, step.memory)
    before, after = distance(step.before, place), distance(step.after, place)
    away = after / task.half
    return 1.0 / (1.0 + away * away), (before - after) / step.dt, _price(task, step)


def _waypoint(_task: Any, memory: Memory) -> Vector:
    return (memory[0], memory[1], memory[2])


def _reached(task: Any, step: Step) -> Number:
    return where_less(distance(step.after, _waypoint(task, step.memory)), task.radius, 1.0, 0.0)


def _waypoint_terms(task: Any, step: Step) -> tuple[Number, ...]:
    goal = _waypoint(task, step.memory)
    nearer = distance(step.before, goal) - distance(step.after, goal)
    return nearer / step.dt, task.reached_weight * _reached(task, step), _price(task, step)


# Multiples of these, modulo 1, are spread evenly over the unit square, wherever they begin (the
# R2 sequence of M. Roberts, 2018).
_SPREAD = (0.7548776662466927, 0.5698402909980532)


def _fraction(x: Number) -> Number:
    return x - floor(x)


def _next_waypoint(task: Any, place: Vector, u: Number, v: Number, count: Number) -> Vector:
    up = 2.0 * _fraction(u + _SPREAD[0] * count) - 1.0  # uniform on the sphere, as is height
    cosine, sine = cosine_sine(TAU * _fraction(v + _SPREAD[1] * count))
    flat = square_root(1.0 - up * up)
    return (
        place[0] + task.apart * flat * cosine,
        place[1] + task.apart * flat * sine,
        place[2] + task.apart * up,
    )


def _waypoint_remember(task: Any, step: Step) -> Memory:
    m = step.memory
    reached = _reached(task, step)
    there = _next_waypoint(task, (m[0], m[1], m[2]), m[4], m[5], m[3] + 1.0)
    return (
        m[0] + reached * (there[0] - m[0]),
        m[1] + reached * (there[1] - m[1]),
        m[2] + reached * (there[2] - m[2]),
        m[3] + reached,
        m[4],
        m[5],
    )


@dataclass(frozen=True)
class _Moving(Task):
    """A task with a small penalty on effort."""

    ctrl_weight: float = 1e-4

    def __post_init__(self) -> None:
        super().__post_init__()
        self._checked("ctrl_weight", 0.0, MOST)

    def _checked(self, name: str, low: float, high: float, unit: str = "") -> None:
        value = float(finite_array(name, getattr(self, name), (), low, high, unit))
        object.__setattr__(self, name, value)


@dataclass(frozen=True)
class SwimForward(_Moving):
    """Swim along the world's +y, which the robot faces at the start, with little effort.

    As in Gymnasium's Swimmer: the mean speed over the step, less a small penalty on the action.

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
        forward, price = _forward_terms(self, step)
        return {"reward_forward": forward, "reward_ctrl": price}


@dataclass(frozen=True)
class Recover(SwimForward):
    """Swim forward for a minute in which something breaks: ``AquaFishRecovery-v0``.

    The environment's ``damage`` states what breaks and when.
    """

    seconds: float = 60.0


@dataclass(frozen=True)
class HoldStation(_Moving):
    """Stay at the start, in a current from anywhere in the horizontal plane.

    The reward of a step falls with the distance d from the start, as 1 / (1 + (d / half)^2).
    Drifting away costs the distance that is lost until it is made good.

    Attributes
    ----------
    slowest, fastest
        The current's speed is uniform between these, units/s.
    half
        The distance at which ``reward_near`` is a half, in units.
    turning
        The current turns by up to this many rad/s, either way; 0 is a constant one.
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
        """Return the current's speed, its initial direction, and how fast it turns."""
        speed, heading = rng.uniform(self.slowest, self.fastest), rng.uniform(-np.pi, np.pi)
        return (float(speed), float(heading), float(rng.uniform(-self.turning, self.turning)))

    def current(self, memory: Memory, seconds: Number) -> Vector:
        """Return the current."""
        return _station_current(self, memory, seconds)

    def goal(self, memory: Memory) -> Vector:
        """Return the origin, where the robot begins."""
        return _origin(self, memory)

    def reward_terms(self, step: Step) -> dict[str, Number]:
        """Return ``reward_near``, ``reward_progress`` (units/s towards it), and ``reward_ctrl``."""
        near, progress, price = _station_terms(self, step)
        return {"reward_near": near, "reward_progress": progress, "reward_ctrl": price}


@dataclass(frozen=True)
class ReachWaypoints(_Moving):
    """Swim to a point, then to the next: in 3-D, each ``apart`` from the last in any direction.

    Attributes
    ----------
    apart
        Units from each point to the next, and from the start to the first.
    radius
        A point is reached within this many units.
    reached_weight
        The reward for reaching one.
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
        return (*_next_waypoint(self, (0.0, 0.0, 0.0), u, v, 0.0), 0.0, u, v)

    def goal(self, memory: Memory) -> Vector:
        """Return the present point."""
        return _waypoint(self, memory)

    def reward_terms(self, step: Step) -> dict[str, Number]:
        """Return ``reward_progress`` (units/s towards the point), ``reward_reached``, and ctrl."""
        progress, reached, price = _waypoint_terms(self, step)
        return {"reward_progress": progress, "reward_reached": reached, "reward_ctrl": price}

    def remember(self, step: Step) -> Memory:
        """Return the next point once one is reached."""
        return _waypoint_remember(self, step)


# Of exactly these classes: a subclass may have overridden a method.
_FUNCTIONS: dict[type[Task], TaskFunctions] = {
    SwimForward: TaskFunctions(_forward_terms),
    Recover: TaskFunctions(_forward_terms),
    HoldStation: TaskFunctions(_station_terms, _station_current, _origin),
    ReachWaypoints: TaskFunctions(_waypoint_terms, goal=_waypoint, remember=_waypoint_remember),
}

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
            f"current must be 0 where the task has a current of its own; got {current} with "
            f"{type(task).__name__}"
        )
