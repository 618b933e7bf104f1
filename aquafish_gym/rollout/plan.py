"""Arguments and results of a rollout: programs, plans, trajectories."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.envs.tasks import Task
from aquafish_gym.physics.arithmetic import Number
from aquafish_gym.plans import AQUAFISH, BodyPlan
from aquafish_gym.scenario import TIMESTEP, Scenario
from aquafish_gym.utils.array_types import Floats

#: From an observation, (9,) or (12,) with a goal, and the time in s, to an action (3,) in [-1, 1].
Act = Callable[[Floats, float], ArrayLike]

PROGRAM_CHANNELS = 12  # that a program observes: up, north, gyroscope, and the way to a goal


@dataclass(frozen=True, eq=False)
class Program:
    """Policies that the compiled loop can run: one function, and B robots' numbers for it.

    Attributes
    ----------
    function
        See ``engines/compiled/kernel.py``, and for its ``layout``.
    weights
        (rows, B).
    scratch
        How many numbers it keeps of a robot.
    interval
        For how many steps of 0.01 s an action is held.
    observes_goal
        Whether it needs a task with a goal.
    plan
        The body plan of its robots.
    """

    function: Callable[..., tuple[Number, ...]]
    weights: Floats
    layout: NDArray[np.int64]
    scratch: int
    interval: int
    observes_goal: bool = False
    plan: BodyPlan = AQUAFISH


@dataclass(frozen=True, eq=False)
class Path:
    """How a robot swam in N steps of 0.01 s; T samples are at the start and after each action.

    Its numbers are NaN once the robot has diverged.

    Attributes
    ----------
    time
        (T,) s.
    position, quaternion, fin_angles
        (T, 3), (T, 4) and (T, 3), as in :class:`~aquafish_gym.ImuLog`.
    gyro, commands
        (N, 3) angular velocity at the end of each step, rad/s about the body's axes, and the
        command in force until then, rev/s, rev/s and Hz.
    """

    time: Floats
    position: Floats
    quaternion: Floats
    fin_angles: Floats
    gyro: Floats
    commands: Floats


@dataclass(frozen=True, eq=False)
class Trajectories:
    """The result of a rollout of B robots.

    Attributes
    ----------
    returns
        (B,) sums of the task's rewards up to a divergence; 0 without a task.
    diverged
        (B,) whether a robot left the finite numbers.
    end
        (B, 3) the last positions, units; NaN of robots that diverged.
    paths
        B paths of robots that swam one at a time; the compiled loop keeps none.
    """

    returns: Floats
    diverged: NDArray[np.bool_]
    end: Floats
    paths: tuple[Path, ...] = ()


@dataclass(frozen=True)
class Plan:
    """A checked rollout, for either loop."""

    scenario: Scenario
    task: Task | None
    steps: int
    interval: int
    memory: Floats  # (B, M)
    rngs: tuple[np.random.Generator, ...]
    substeps: int

    @property
    def dt(self) -> float:
        """How long an action is held, s."""
        return self.interval * TIMESTEP
