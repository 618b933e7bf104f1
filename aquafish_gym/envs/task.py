"""The interface of a task: rewards, a goal, a current, and what it remembers of an episode.

A task is written once for one robot and for many: every ``Number`` is a float, or a row (B,) of B
robots' numbers, and a vector is a tuple of three. numpy's functions take both.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, NamedTuple

import numpy as np

from aquafish_gym.physics.arithmetic import Number, Vector, subtract
from aquafish_gym.physics.kinematics import Numbers

Memory = tuple[Number, ...]


class Step(NamedTuple):
    """One step of an environment.

    Positions are of the body's centre in the world, in units of 5 cm.
    """

    before: Vector  #: Position at the start of the step.
    after: Vector  #: Position now.
    orientation: tuple[Number, Number, Number, Number]  #: (x, y, z, w), from body to world.
    action: Numbers  #: Of the F servos, in [-1, 1].
    memory: Memory  #: The task's own, of this episode.
    dt: float  #: Length of the step, s.

    @property
    def velocity(self) -> Vector:
        """Mean velocity over the step, units/s."""
        x, y, z = subtract(self.after, self.before)
        return (x / self.dt, y / self.dt, z / self.dt)


class Task:
    """The goal of an episode and its rewards; a subclass states at least :meth:`reward_terms`.

    A task keeps what it needs of an episode in its memory: numbers that :meth:`begin` draws and
    :meth:`remember` updates.

    Attributes
    ----------
    has_goal
        Whether the task has a goal position, to which the robot then observes the way.
    seconds
        Length of an episode.

    Examples
    --------
    >>> class SwimUp(Task):
    ...     seconds = 30.0
    ...
    ...     def reward_terms(self, step: Step) -> dict[str, Number]:
    ...         return {"reward_up": step.velocity[2]}
    """

    has_goal: ClassVar[bool] = False
    seconds: float = 20.0

    def begin(self, rng: np.random.Generator) -> tuple[float, ...]:  # noqa: ARG002
        """Return the memory at the start of one robot's episode."""
        return ()

    def current(self, memory: Memory, seconds: Number) -> Vector | None:  # noqa: ARG002
        """Return the water's velocity at a time, units/s; None leaves it as it is."""
        return None

    def goal(self, memory: Memory) -> Vector:
        """Return the goal position, units."""
        raise NotImplementedError(f"{type(self).__name__} has a goal: define its `goal`")

    def reward_terms(self, step: Step) -> Mapping[str, Number]:
        """Return the terms whose sum is the reward of a step."""
        raise NotImplementedError(f"{type(self).__name__} must define reward_terms")

    def remember(self, step: Step) -> Memory:
        """Return the memory after a step."""
        return step.memory

    def succeeded(self, step: Step) -> Number | None:  # noqa: ARG002
        """Return 1 where a step ends the episode by success, else 0; None if no step can.

        The environment then terminates, and ``info`` has ``is_success``. A rollout does not end
        before its time: there the task's memory must keep that nothing counts any more.
        """
        return None

    @property
    def has_success(self) -> bool:
        """Whether an episode can end by success."""
        return type(self).succeeded is not Task.succeeded
