"""Robots in the water: one, the world of an environment, or many.

Engines have the same verbs for one robot (:class:`World`) as for B (:class:`Swimmers`):

- ``start(scenario)`` puts robots at the origin, upright and facing +y, as the scenario says; they
  forget earlier commands.
- ``update(scenario)`` gives them the bodies, the drag, the water and the servos of a scenario in
  mid-swim; they keep their motion.
- ``set_current(current)`` sets the velocity of the water from now on.
- ``advance(command, steps)`` holds a command in rev/s or Hz for some steps of 0.01 s; B
  robots do actions: ``act(action, ...)``.
- ``state()`` returns the :class:`~aquafish_gym.physics.kinematics.State` that they are in.
- ``diverged`` says whether it ran away; ``physics.kinematics.has_diverged`` is the rule.
- ``close()`` frees what the engine holds; closing twice does no harm.

Servos follow the command that was given ``servo_lag`` seconds before, and the command was 0 before
the first one; :func:`~aquafish_gym.command.late_command` says how fast they turn in a step. A lag
that changes in mid-swim is no longer than the longest one of the scenario, its changes included,
with which the robot started: no earlier commands are remembered.

Otherwise a scenario's changes are for the caller, and so are the faults of its sensors.
"""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections import deque
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import numpy as np

from aquafish_gym.command import lag_parts, late_command
from aquafish_gym.physics.kinematics import Numbers, State, has_diverged
from aquafish_gym.physics.layout import Layout
from aquafish_gym.scenario import TIMESTEP, Scenario
from aquafish_gym.utils.array_types import Flags, Floats, Observations, Reals, Rows, Triple
from aquafish_gym.utils.validation import InvalidArgumentError


class World(ABC):
    """One robot in the water; the module's docstring says what the methods mean.

    The scenarios that it takes are of one robot. Engines define what is abstract here.
    """

    diverged = False  #: Whether the robot ran away.
    # The commands of the last steps, as far back as a lag may reach; None without one.
    _given: deque[Numbers] | None = None
    _longest_lag = 0.0  # s
    _lag_steps = 0  # steps
    _newer_share = 1.0

    def start(self, scenario: Scenario) -> None:
        """Put the robot at the start of a scenario.

        Raises
        ------
        InvalidArgumentError
            If the angle of a dead servo's fin has not been drawn.
        """
        scenario.check_angles()
        self._longest_lag = longest_lags(scenario).item()
        count = remembered_steps(self._longest_lag)
        still = (0.0,) * len(scenario.plan.fins)
        self._given = deque([still] * count, count) if self._longest_lag else None
        robot = scenario.beginning
        self._set_lag(robot)
        self._start(robot)

    def update(self, scenario: Scenario) -> None:
        """Give the robot the body, the drag, the water and the servos of a scenario in mid-swim.

        Raises
        ------
        InvalidArgumentError
            If the servos' lag is longer than the robot remembers its commands.
        """
        check_lags(scenario, self._longest_lag)
        self._set_lag(scenario)
        self._update(scenario)

    def advance(self, command: Numbers, steps: int = 1) -> None:
        """Hold a command (rev/s or Hz of each servo) for some steps of 0.01 s."""
        given = self._given
        if given is None:
            self._swim(command, steps)
            return
        for _ in range(steps):
            given.append(command)
            newest = len(given) - 1 - self._lag_steps
            self._swim(late_command(given[newest - 1], given[newest], self._newer_share), 1)

    def _set_lag(self, scenario: Scenario) -> None:
        lag_steps, self._newer_share = lag_parts(scenario.servo_lag.item() / TIMESTEP)
        self._lag_steps = int(lag_steps)

    @abstractmethod
    def _start(self, scenario: Scenario) -> None:
        """Do the engine's part of :meth:`start`."""

    @abstractmethod
    def _update(self, scenario: Scenario) -> None:
        """Do the engine's part of :meth:`update`: all of it except the servos' lag."""

    @abstractmethod
    def _swim(self, command: Numbers, steps: int) -> None:
        """Advance with servos that obey at once."""

    @abstractmethod
    def set_current(self, current: Triple) -> None:
        """Set the velocity of the water from now on, units/s in the world."""

    @abstractmethod
    def state(self) -> State:
        """Return the robot's state on plain floats."""

    @property
    @abstractmethod
    def fin_angles(self) -> Numbers:
        """Each fin's angle, or the phase of one that sweeps, in [-pi, pi], rad."""

    @abstractmethod
    def close(self) -> None:
        """Free what the world holds; closing twice does no harm."""


class Swimmers(ABC):
    """B robots in the water; the module's docstring says what the methods mean.

    ``rows`` (n,) are the numbers of the robots of a scenario of n; None is all.
    """

    batch: int  #: B

    @abstractmethod
    def start(self, scenario: Scenario, rows: Rows | None = None) -> None:
        """Put the robots ``rows`` at the start of a scenario."""

    @abstractmethod
    def update(self, scenario: Scenario, rows: Rows | None = None) -> None:
        """Give the robots ``rows`` bodies, drag, water and servos of a scenario in mid-swim.

        Raises
        ------
        InvalidArgumentError
            If a servo's lag is longer than its robot remembers its commands.
        """

    @abstractmethod
    def set_current(self, current: Floats) -> None:
        """Set the velocity of the water (B, 3) from now on, units/s in the world."""

    @abstractmethod
    def act(
        self,
        action: Floats,
        followed: Numbers,
        steps: int = 1,
        task: Any = None,
        memory: Floats | None = None,
    ) -> tuple[Flags, Observations, list[Floats] | None]:
        """Do actions (F, B) in [-1, 1] for some steps of 0.01 s.

        Return which robots (B,) diverged, what intact sensors (B, 9) then observe, and the terms
        (B,) of the reward where the engine judges a task, which may be None. Robots that diverged
        are back in the state in which the action began; their terms are 0.

        Parameters
        ----------
        action
            What the task judges.
        followed
            Rows (B,) of the actions that servos follow, which may be earlier ones.
        task
            The functions and the numbers of a task (``envs.tasks.compiled_task``).
        memory
            What the task remembers, (M, B).
        """

    @property
    @abstractmethod
    def states(self) -> Reals:
        """The states (N, B) themselves, no copy: the rows of ``layout``."""

    layout: Layout  #: Of the robots' plan.

    def state(self) -> State:
        """Return the robots' state on rows (B,)."""
        return self.layout.state(self.states.astype(np.float64))

    @abstractmethod
    def close(self) -> None:
        """Free what the engine holds; closing twice does no harm."""


def diverged_states(state: State) -> Flags:
    """Return which robots (B,) of a state on rows ran away or are not finite."""
    with np.errstate(over="ignore", invalid="ignore"):
        lost: Flags = has_diverged(state) > 0.0
    return lost


def longest_lags(scenario: Scenario) -> Floats:
    """Return the longest lag (B,) that each robot of a scenario ever has, s."""
    longest: Floats = np.maximum.reduceat(scenario.servo_lag, scenario.first)
    return longest


def remembered_steps(lag: float) -> int:
    """Return how many commands count, of the last steps and the present one, with a lag in s."""
    return int(lag / TIMESTEP) + 2


def check_lags(scenario: Scenario, longest: Floats | float) -> None:
    """Refuse an update to lags beyond the ``longest`` (n,) for which commands are remembered."""
    beyond = scenario.servo_lag > longest
    if beyond.any():
        raise InvalidArgumentError(
            "servo_lag must not grow beyond the longest one of the scenario with which a robot "
            f"started; got {scenario.servo_lag[beyond].max():g} s"
        )


# Loaded when first used: these modules import this one.
WORLDS: dict[str, str] = {
    "numba": "aquafish_gym.engines.compiled.single:CompiledWorld",
    "pybullet": "aquafish_gym.engines.bullet.world:BulletWorld",
}
BATCHES: dict[str, str] = {
    "numba": "aquafish_gym.engines.compiled.lanes:LaneBatch",
    "cuda": "aquafish_gym.engines.cuda:CudaBatch",
}
RECORDER = "aquafish_gym.engines.divergence:Recorded"


def batch_class(engine: str) -> Any:
    """Return the class of an engine's compiled batches: ``LaneBatch``, or its own of that."""
    return resolve_name(BATCHES[engine])


def recording_folder() -> Path | None:
    """Return the folder for files of robots that diverge, which ``AQUAFISH_DIVERGED`` names."""
    named = os.environ.get("AQUAFISH_DIVERGED")
    return Path(named) if named else None


def make_world(engine: str | type[World], scenario: Scenario, substeps: int = 1) -> World:
    """Return a world with a scenario's one robot at its start, for a checked engine or a class.

    Examples
    --------
    >>> seized = Scenario.create([0.3] * 9, servo_gain=(1.0, 0.0, 1.0))
    >>> world = make_world("numba", seized)
    >>> world.advance((0.5, 0.5, 0.0), steps=50)
    >>> [round(angle, 3) for angle in world.fin_angles]
    [1.571, 0.0, 0.0]
    """
    kind: Any = resolve_name(WORLDS[engine]) if isinstance(engine, str) else engine
    world: World = kind(substeps)
    if isinstance(engine, str) and (folder := recording_folder()):
        how = {"engine": engine, "dtype": "float64", "substeps": substeps}
        world = resolve_name(RECORDER)(world, scenario, folder, how)
    world.start(scenario)
    return world
