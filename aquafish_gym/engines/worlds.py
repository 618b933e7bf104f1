"""One robot, commanded step by step on an engine: the world of an environment."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from pkgutil import resolve_name
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.physics.arithmetic import Vector
from aquafish_gym.physics.kinematics import State
from aquafish_gym.scenario import TIMESTEP, Scenario
from aquafish_gym.utils.array_types import Triple

# A robot has diverged once the squares of its velocity (units/s) and spin (rad/s) sum to this,
# though its numbers may stay finite for some steps more. (Bullet cuts speeds off, so that a robot
# that runs away never reaches infinity there.)
RUNAWAY_SQUARE = 1e12


class World(ABC):
    """One robot in the water. The scenarios that it takes are of one robot.

    Its servos follow the command that was given ``servo_lag`` seconds before. A servo's speed is
    constant within a step of 0.01 s: it is the mean, over the step, of the delayed command, which
    is 0 before the first one.
    """

    diverged = False  #: Whether the robot ran away; see ``RUNAWAY_SQUARE``.
    # The commands of the last lag and step; the first two of them count.
    _given: deque[NDArray[np.float64]] | None = None
    _rest = 0.0  # of the lag, in steps

    def reset(self, scenario: Scenario) -> None:
        """Put the robot at the origin, upright, facing +y and at rest, fins as the scenario has."""
        whole, self._rest = divmod(float(scenario.servo_lag[0]) / TIMESTEP, 1.0)
        lags, count = whole or self._rest, int(whole) + 2
        self._given = deque(np.zeros((count, 3)), maxlen=count) if lags else None
        self._start(scenario)

    def advance(self, command: Vector, steps: int = 1) -> None:
        """Hold a command (rev/s, rev/s, Hz) for some steps of 0.01 s."""
        if self._given is None:
            self._swim(command, steps)
            return
        for _ in range(steps):
            self._given.append(np.array(command))
            older, newer = self._given[0], self._given[1]
            left, right, caudal = (self._rest * older + (1.0 - self._rest) * newer).tolist()
            self._swim((left, right, caudal), 1)

    @abstractmethod
    def _start(self, scenario: Scenario) -> None:
        """Do the engine's part of :meth:`reset`."""

    @abstractmethod
    def _swim(self, command: Vector, steps: int) -> None:
        """Advance with servos that obey at once."""

    @abstractmethod
    def update(self, scenario: Scenario) -> None:
        """Give the robot the scenario's body, drag, current and servo gains in mid-swim."""

    @abstractmethod
    def set_current(self, current: Triple) -> None:
        """Set the velocity of the water from now on, units/s in the world."""

    @abstractmethod
    def state(self) -> State:
        """Return the robot's state on plain floats."""

    @property
    @abstractmethod
    def fin_angles(self) -> Vector:
        """Left and right pectoral angle and caudal phase in [-pi, pi], rad."""

    @abstractmethod
    def close(self) -> None:
        """Free what the world holds; closing twice does no harm."""


# Loaded when first used: these modules import this one.
WORLDS: dict[str, str] = {
    "numba": "aquafish_gym.engines.compiled.single:CompiledWorld",
    "pybullet": "aquafish_gym.engines.bullet.world:BulletWorld",
}


def make_world(engine: str | type[World], scenario: Scenario, substeps: int = 1) -> World:
    """Return a world with a scenario's one robot at its start, for a checked engine or a class.

    The scenario's schedule and its sensors' faults are for the caller.

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
    world.reset(scenario)
    return world
