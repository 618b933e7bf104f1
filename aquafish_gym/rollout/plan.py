"""Arguments and results of a rollout: programs, plans, trajectories."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.envs.tasks import Task
from aquafish_gym.physics.arithmetic import Vector
from aquafish_gym.scenario import TIMESTEP, Scenario
from aquafish_gym.utils.validation import InvalidArgumentError

Floats = NDArray[np.float64]
#: From an observation, (9,) or (12,) with a goal, and the time in s, to an action (3,) in [-1, 1].
Act = Callable[[Floats, float], ArrayLike]


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
    """

    function: Callable[..., Vector]
    weights: Floats
    layout: NDArray[np.int64]
    scratch: int
    interval: int
    observes_goal: bool = False


@dataclass(frozen=True, eq=False)
class Path:
    """How B robots swam in N steps of 0.01 s; T samples are at the start and after each action.

    Attributes
    ----------
    time
        (T,) s.
    position, quaternion, fin_angles
        (B, T, 3), (B, T, 4) and (B, T, 3), as in :class:`~aquafish_gym.ImuLog`.
    gyro, commands
        (B, N, 3) angular velocity at the end of each step, rad/s about the body's axes, and the
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
    recorded
        The path, if it was recorded; its numbers are NaN once a robot has diverged.
    """

    returns: Floats
    diverged: NDArray[np.bool_]
    end: Floats
    recorded: Path | None = None

    @property
    def path(self) -> Path:
        """The path; raises InvalidArgumentError if it was not recorded."""
        if self.recorded is None:
            raise InvalidArgumentError('path is not there: record must be "path"')
        return self.recorded


@dataclass(frozen=True)
class Plan:
    """A checked rollout, for either loop."""

    scenario: Scenario
    task: Task | None
    steps: int
    interval: int
    memory: Floats  # (B, M)
    rngs: tuple[np.random.Generator, ...]
    path: bool
    substeps: int

    @property
    def dt(self) -> float:
        """How long an action is held, s."""
        return self.interval * TIMESTEP

    @property
    def flows(self) -> bool:
        """Whether the task says how the water flows."""
        return self.task is not None and type(self.task).current is not Task.current

    @property
    def broken_sensors(self) -> bool:
        """Whether any sensor ever observes something else than what is."""
        return is_noisy(self.scenario) or any(
            np.any(part)
            for one in _stages(self.scenario)
            for part in (one.sensor_bias, one.sensor_stuck, one.sensor_dropped)
        )

    @property
    def times(self) -> Floats:
        """The times (T,) of a path's samples, s."""
        return np.array([*range(0, self.steps, self.interval), self.steps]) * TIMESTEP


def is_noisy(scenario: Scenario) -> bool:
    """Return whether any gyroscope is ever noisy."""
    return any(np.any(one.gyro_noise) for one in _stages(scenario))


def _stages(scenario: Scenario) -> list[Scenario]:
    return [scenario, *(change.to for change in scenario.schedule)]


def joined(robots: Sequence[Trajectories], plan: Plan) -> Trajectories:
    """Return the trajectories of robots that swam one by one."""
    returns, diverged, end = (
        np.concatenate([getattr(one, name) for one in robots])
        for name in ("returns", "diverged", "end")
    )
    if not plan.path:
        return Trajectories(returns, diverged, end)
    paths = [vars(one.path) for one in robots]
    joined = {name: np.concatenate([path[name] for path in paths]) for name in paths[0]}
    return Trajectories(returns, diverged, end, Path(**{**joined, "time": plan.times}))
