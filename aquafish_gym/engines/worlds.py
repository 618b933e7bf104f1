"""One robot, commanded step by step on an engine: the world of an environment."""

from __future__ import annotations

from collections import deque
from pkgutil import resolve_name
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.physics.arithmetic import Vector
from aquafish_gym.physics.kinematics import State
from aquafish_gym.scenario import TIMESTEP, Scenario

Triple = tuple[float, float, float]

# A robot has diverged once the squares of its velocity (units/s) and spin (rad/s) sum to this,
# though its numbers may stay finite for some steps more. (Bullet cuts speeds off, so that a robot
# that runs away never reaches infinity there.)
RUNAWAY = 1e12


class World(Protocol):
    """One robot in the water. The scenarios that it takes are of one robot."""

    @property
    def diverged(self) -> bool:
        """Whether the robot ran away; see ``RUNAWAY``."""

    def reset(self, scenario: Scenario) -> None:
        """Put the robot at the origin, upright, facing +y and at rest, fins as the scenario has."""

    def update(self, scenario: Scenario) -> None:
        """Give the robot the scenario's body, drag, current and servo gains in mid-swim."""

    def set_current(self, current: Triple) -> None:
        """Set the velocity of the water from now on, units/s in the world."""

    def advance(self, command: Vector, steps: int = 1) -> None:
        """Hold a command (rev/s, rev/s, Hz) for some steps of 0.01 s."""

    def state(self) -> State:
        """Return the robot's state on plain floats."""

    @property
    def fin_angles(self) -> Vector:
        """Left and right pectoral angle and caudal phase in [-pi, pi], rad."""

    def close(self) -> None:
        """Free what the world holds; closing twice does no harm."""


# Loaded when first used: these modules import this one.
WORLDS: dict[str, str] = {
    "numba": "aquafish_gym.engines.compiled.single:CompiledWorld",
    "pybullet": "aquafish_gym.engines.bullet.world:BulletWorld",
}


class LaggedWorld:
    """A world whose servos follow the command that was given ``servo_lag`` seconds before.

    A servo's speed is constant within a step of 0.01 s: it is the mean, over the step, of the
    delayed command, which is 0 before the first one.
    """

    def __init__(self, world: World, lag: float) -> None:
        self.world = world  #: Which everything happens in; it is closed with this one.
        whole, self._rest = divmod(lag / TIMESTEP, 1.0)
        # The commands that lie less than lag and a step back, of which the first two count.
        self._given: deque[NDArray[np.float64]] = deque(maxlen=int(whole) + 2)
        self._forget()

    def _forget(self) -> None:
        self._given.extend(np.zeros((self._given.maxlen or 0, 3)))

    @property
    def diverged(self) -> bool:
        """See :class:`World`."""
        return self.world.diverged

    def reset(self, scenario: Scenario) -> None:
        """See :class:`World`; the servos stand still again."""
        self._forget()
        self.world.reset(scenario)

    def update(self, scenario: Scenario) -> None:
        """See :class:`World`."""
        self.world.update(scenario)

    def set_current(self, current: Triple) -> None:
        """See :class:`World`."""
        self.world.set_current(current)

    def advance(self, command: Vector, steps: int = 1) -> None:
        """See :class:`World`."""
        for _ in range(steps):
            self._given.append(np.array(command))
            older, newer = self._given[0], self._given[1]
            left, right, caudal = (self._rest * older + (1.0 - self._rest) * newer).tolist()
            self.world.advance((left, right, caudal))

    def state(self) -> State:
        """See :class:`World`."""
        return self.world.state()

    @property
    def fin_angles(self) -> Vector:
        """See :class:`World`."""
        return self.world.fin_angles

    def close(self) -> None:
        """See :class:`World`."""
        self.world.close()


def make_world(engine: str, scenario: Scenario, substeps: int = 1) -> World:
    """Return a world with a scenario's one robot at its start.

    Parameters
    ----------
    engine
        A name in ``WORLDS`` that ``check_engine`` allowed.
    scenario
        Of one robot; its schedule and its sensors' faults are for the caller.
    substeps
        Physics steps in 0.01 s.

    Examples
    --------
    >>> seized = Scenario.create([0.3] * 9, servo_gain=(1.0, 0.0, 1.0))
    >>> world = make_world("numba", seized)
    >>> world.advance((0.5, 0.5, 0.0), steps=50)
    >>> [round(angle, 3) for angle in world.fin_angles]
    [1.571, 0.0, 0.0]
    """
    bare: World = resolve_name(WORLDS[engine])(substeps)
    lag = float(scenario.servo_lag[0])
    world = LaggedWorld(bare, lag) if lag else bare
    world.reset(scenario)
    return world
