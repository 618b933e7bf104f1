"""The built-in tasks: swim forward, recover, hold a station, reach waypoints, return in time.

Their ``current``, ``goal``, ``rewards`` and ``remember`` are straight-line code, which the compiled
loop of a rollout runs too. There ``self`` is :class:`TaskNumbers`, and a ``Number`` is a vector
register of robots' numbers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from aquafish_gym.envs.specification import read_task
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
from aquafish_gym.physics.kinematics import Numbers
from aquafish_gym.scenario import MAXIMUM_CURRENT, TIMESTEP
from aquafish_gym.utils.validation import InvalidArgumentError, brief, finite_array, flag, one_of

LONGEST_TASK_SECONDS = 3600.0
LARGEST_ARGUMENT = 1e6  # a reward must stay finite
SHORTEST_DISTANCE = 1e-3  # units, of a distance that others are divided by
# The least and the greatest value of each number that a built-in task may have, and its unit.
ARGUMENT_RANGES = {
    "seconds": (TIMESTEP, LONGEST_TASK_SECONDS, "s"),
    "ctrl_weight": (0.0, LARGEST_ARGUMENT, ""),
    "forward_weight": (-LARGEST_ARGUMENT, LARGEST_ARGUMENT, ""),
    "slowest": (0.0, MAXIMUM_CURRENT, "units/s"),
    "fastest": (0.0, MAXIMUM_CURRENT, "units/s"),
    "half": (SHORTEST_DISTANCE, LARGEST_ARGUMENT, "units"),
    "turning": (0.0, LARGEST_ARGUMENT, "rad/s"),
    "apart": (0.0, LARGEST_ARGUMENT, "units"),
    "radius": (0.0, LARGEST_ARGUMENT, "units"),
    "reached_weight": (-LARGEST_ARGUMENT, LARGEST_ARGUMENT, ""),
    "pace": (SHORTEST_DISTANCE, MAXIMUM_CURRENT, "units/s"),
    "spare": (0.0, 0.99, ""),
}
WIDEST_CURRENT = math.pi / 3.0  # rad from straight against the robot, of ``ReturnToBuoys``
# Multiples of these, modulo 1, are spread evenly over the unit square, wherever they begin (the
# R2 sequence of M. Roberts, 2018).
_SPREAD = (0.7548776662466927, 0.5698402909980532)


def distance(a: Vector, b: Vector) -> Number:
    """Return the distance between two places."""
    x, y, z = subtract(a, b)
    return square_root(x * x + y * y + z * z)


def effort_cost(task: Any, action: Numbers) -> Number:
    """Return ``ctrl_weight`` times the sum of the action's squares."""
    squares = action[0] * action[0]
    for i in range(1, len(action)):  # numba unrolls it, and cannot loop over action[1:] of one fin
        squares = squares + action[i] * action[i]
    return task.ctrl_weight * squares


def fraction(x: Number) -> Number:
    """Return a number modulo 1."""
    return x - floor(x)


def next_waypoint(task: Any, place: Vector, u: Number, v: Number, count: Number) -> Vector:
    """Return the point after ``place``, ``count`` points after the first; u, v are the offset."""
    up = 2.0 * fraction(u + _SPREAD[0] * count) - 1.0  # uniform on the sphere, as is height
    cosine, sine = cosine_sine(TAU * fraction(v + _SPREAD[1] * count))
    flat = square_root(1.0 - up * up)
    return (
        place[0] + task.apart * flat * cosine,
        place[1] + task.apart * flat * sine,
        place[2] + task.apart * up,
    )


def has_reached(task: Any, step: Step) -> Number:
    """Return 1 where a step ended at the waypoint, else 0."""
    m = step.memory
    return where_less(distance(step.after, (m[0], m[1], m[2])), task.radius, 1.0, 0.0)


def has_returned(task: Any, step: Step) -> Number:
    """Return 1 where a step ended within the radius of the line of buoys or beyond it, else 0."""
    return where_less(step.memory[2] - step.after[1], task.radius, 1.0, 0.0)


@dataclass(frozen=True)
class BuiltIn(Task):
    """A task in straight-line code, with a small penalty on effort."""

    terms: ClassVar[tuple[str, ...]]  # the names of ``rewards``
    seconds: float = 20.0
    ctrl_weight: float = 1e-4

    def __post_init__(self) -> None:
        for name, (low, high, unit) in ARGUMENT_RANGES.items():
            if hasattr(self, name):
                value = float(finite_array(name, getattr(self, name), (), low, high, unit))
                object.__setattr__(self, name, value)

    def rewards(self, step: Step) -> tuple[Number, ...]:
        """Return the values of the reward's terms."""
        raise NotImplementedError

    def reward_terms(self, step: Step) -> dict[str, Number]:
        """Return the terms of the reward by name."""
        return dict(zip(self.terms, self.rewards(step), strict=True))


@dataclass(frozen=True)
class SwimForward(BuiltIn):
    """Swim along the world's +y, which the robot faces at the start, with little effort.

    As in Gymnasium's Swimmer: the mean speed over the step, less a small penalty on the action.

    Attributes
    ----------
    forward_weight
        Of the speed along +y in units/s, at most a million.
    ctrl_weight
        Of the sum of the action's squares; not negative.
    """

    terms: ClassVar[tuple[str, ...]] = ("reward_forward", "reward_ctrl")
    forward_weight: float = 1.0

    def rewards(self, step: Step) -> tuple[Number, ...]:
        """Return the speed along +y in units/s, weighted, and the effort's cost, negative."""
        speed = (step.after[1] - step.before[1]) / step.dt
        return self.forward_weight * speed, -effort_cost(self, step.action)


@dataclass(frozen=True)
class Recover(SwimForward):
    """Swim forward for a minute in which something breaks: ``AquaFishRecovery-v0``.

    The environment's ``damage`` states what breaks and when.
    """

    seconds: float = 60.0


@dataclass(frozen=True)
class HoldStation(BuiltIn):
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
    terms: ClassVar[tuple[str, ...]] = ("reward_near", "reward_progress", "reward_ctrl")
    seconds: float = 60.0
    slowest: float = 0.1
    fastest: float = 0.3
    half: float = 2.0
    turning: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        finite_array("fastest", self.fastest, (), self.slowest, MAXIMUM_CURRENT, "units/s")

    def begin(self, rng: np.random.Generator) -> tuple[float, ...]:
        """Return the current's speed, its initial direction, and how fast it turns."""
        speed, heading = rng.uniform(self.slowest, self.fastest), rng.uniform(-np.pi, np.pi)
        return (float(speed), float(heading), float(rng.uniform(-self.turning, self.turning)))

    def current(self, memory: Memory, seconds: Number) -> Vector:
        """Return the current."""
        speed = memory[0]
        heading = memory[1]
        turning = memory[2]
        cosine, sine = cosine_sine(heading + turning * seconds)
        return (speed * cosine, speed * sine, 0.0 * speed)

    def goal(self, memory: Memory) -> Vector:
        """Return the origin, where the robot begins."""
        zero = 0.0 * memory[0]
        return (zero, zero, zero)

    def rewards(self, step: Step) -> tuple[Number, ...]:
        """Return nearness, the speed towards the start in units/s, and the effort's cost."""
        zero = 0.0 * step.memory[0]
        start = (zero, zero, zero)
        before, after = distance(step.before, start), distance(step.after, start)
        away = after / self.half
        near = 1.0 / (1.0 + away * away)
        return near, (before - after) / step.dt, -effort_cost(self, step.action)


@dataclass(frozen=True)
class ReachWaypoints(BuiltIn):
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
    terms: ClassVar[tuple[str, ...]] = ("reward_progress", "reward_reached", "reward_ctrl")
    seconds: float = 60.0
    apart: float = 6.0
    radius: float = 1.5
    reached_weight: float = 5.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.radius >= self.apart:
            raise InvalidArgumentError(
                f"radius must be less than apart, {self.apart:g}; got {self.radius:g}"
            )

    def begin(self, rng: np.random.Generator) -> tuple[float, ...]:
        """Return the first point, how many were reached, and where the next ones come from."""
        u, v = rng.random(2).tolist()
        return (*next_waypoint(self, (0.0, 0.0, 0.0), u, v, 0.0), 0.0, u, v)

    def goal(self, memory: Memory) -> Vector:
        """Return the present point."""
        return (memory[0], memory[1], memory[2])

    def rewards(self, step: Step) -> tuple[Number, ...]:
        """Return the speed towards the point in units/s, the bonus, and the effort's cost."""
        goal = (step.memory[0], step.memory[1], step.memory[2])
        nearer = distance(step.before, goal) - distance(step.after, goal)
        bonus = self.reached_weight * has_reached(self, step)
        return nearer / step.dt, bonus, -effort_cost(self, step.action)

    def remember(self, step: Step) -> Memory:
        """Return the next point once one is reached."""
        m = step.memory
        reached = has_reached(self, step)
        there = next_waypoint(self, (m[0], m[1], m[2]), m[4], m[5], m[3] + 1.0)
        return (
            m[0] + reached * (there[0] - m[0]),
            m[1] + reached * (there[1] - m[1]),
            m[2] + reached * (there[2] - m[2]),
            m[3] + reached,
            m[4],
            m[5],
        )


@dataclass(frozen=True)
class ReturnToBuoys(BuiltIn):
    """Get back to a line of buoys in time, against a current: ``AquaFishReturn-v0``.

    The line lies across +y, which the robot faces at the start. A robot that swims towards it at
    ``pace`` through the water arrives with the share ``spare`` of the time left in any current.

    Attributes
    ----------
    pace
        Speed along +y through the water, units/s; more than ``fastest``.
    spare
        Share of the time, in [0, 0.99].
    radius
        The line is reached within this many units.
    slowest, fastest
        The current's speed is uniform between these, units/s; it is within 60 degrees of -y.
    reached_weight
        The reward for reaching the line.
    """

    terms: ClassVar[tuple[str, ...]] = ("reward_progress", "reward_reached", "reward_ctrl")
    seconds: float = 60.0
    pace: float = 0.7
    spare: float = 0.3
    radius: float = 1.0
    slowest: float = 0.05
    fastest: float = 0.2
    reached_weight: float = 10.0

    def __post_init__(self) -> None:
        super().__post_init__()
        finite_array("fastest", self.fastest, (), self.slowest, MAXIMUM_CURRENT, "units/s")
        if self.pace <= self.fastest:
            raise InvalidArgumentError(
                f"pace must be more than fastest, {self.fastest:g} units/s; got {self.pace:g}"
            )

    def begin(self, rng: np.random.Generator) -> tuple[float, ...]:
        """Return the current along x and y, the line's distance, and that it is not reached."""
        speed = float(rng.uniform(self.slowest, self.fastest))
        heading = float(rng.uniform(-WIDEST_CURRENT, WIDEST_CURRENT))
        ahead = -speed * math.cos(heading)
        seconds = (1.0 - self.spare) * self.seconds
        return (speed * math.sin(heading), ahead, self.radius + seconds * (self.pace + ahead), 0.0)

    def current(self, memory: Memory, seconds: Number) -> Vector:  # noqa: ARG002
        """Return the current."""
        return (memory[0], memory[1], 0.0 * memory[0])

    def rewards(self, step: Step) -> tuple[Number, ...]:
        """Return speed towards the line in units/s, bonus, effort's cost; 0 once it was reached."""
        counts = 1.0 - step.memory[3]
        nearer = step.after[1] - step.before[1]
        bonus = self.reached_weight * has_returned(self, step)
        cost = counts * effort_cost(self, step.action)
        return counts * (nearer / step.dt), counts * bonus, -cost

    def remember(self, step: Step) -> Memory:
        """Return the memory, which keeps whether the line was reached."""
        m = step.memory
        reached = m[3] + (1.0 - m[3]) * has_returned(self, step)
        return (*m[:3], reached, *m[4:])  # lanes remember more numbers

    def succeeded(self, step: Step) -> Number:
        """Return 1 where the line is reached, else 0."""
        return has_returned(self, step)


TASKS: dict[str, BuiltIn] = {
    "forward": SwimForward(),
    "station": HoldStation(),
    "waypoint": ReachWaypoints(),
    "recovery": Recover(),
    "return": ReturnToBuoys(),
}


class TaskNumbers(NamedTuple):
    """The numbers of all built-in tasks; of each its own, the others 0."""

    ctrl_weight: float
    forward_weight: float
    half: float
    apart: float
    radius: float
    reached_weight: float


class TaskFunctions(NamedTuple):
    """The functions of a built-in task; None where it has none."""

    rewards: Callable[[Any, Step], tuple[Number, ...]]
    current: Callable[[Any, Memory, Number], Vector] | None
    goal: Callable[[Any, Memory], Vector] | None
    remember: Callable[[Any, Step], Memory] | None
    make_step: type[Step] = Step


def compiled_task(task: Task | None) -> tuple[TaskFunctions, TaskNumbers] | None:
    """Return what the compiled loop takes of a task; None of none and of one not built in."""
    kind: Any = type(task)
    # Of exactly these classes: a subclass may have overridden a method.
    if kind not in (SwimForward, Recover, HoldStation, ReachWaypoints, ReturnToBuoys):
        return None
    functions = TaskFunctions(
        kind.rewards,
        None if kind.current is Task.current else kind.current,
        None if kind.goal is Task.goal else kind.goal,
        None if kind.remember is Task.remember else kind.remember,
    )
    numbers = (float(getattr(task, name, 0.0)) for name in TaskNumbers._fields)
    return functions, TaskNumbers(*numbers)


def lane_task(task: Task) -> tuple[TaskFunctions, TaskNumbers] | None:
    """Return :func:`compiled_task` of a task whose steps only its rewards judge, else None.

    What a task remembers and when it succeeds are computed in double precision, and so must be the
    rewards that belong to them: a rounded distance could be a success without its reward.
    """
    judges_more = task.has_success or type(task).remember is not Task.remember
    return None if judges_more else compiled_task(task)


def check_task(task: object) -> Task:
    """Return a task from its name, from what a specification in JSON says of it, or itself."""
    if isinstance(task, str):
        return TASKS[one_of("task", task, TASKS)]
    if isinstance(task, Mapping):
        task = read_task(task)
    if not isinstance(task, Task):
        raise InvalidArgumentError(
            f"task must be a Task or one of {', '.join(TASKS)}; got {brief(task)}"
        )
    flag("task.has_goal", task.has_goal)
    finite_array("task.seconds", task.seconds, (), *ARGUMENT_RANGES["seconds"])
    return task
