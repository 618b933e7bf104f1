"""One robot at a time, told a new command every few steps: what an environment needs."""

from __future__ import annotations

from pkgutil import resolve_name
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.physics.arithmetic import Vector
from aquafish_gym.physics.kinematics import State

Triple = tuple[float, float, float]

# A robot has diverged once the squares of its velocity (units/s) and spin (rad/s) sum to this,
# though its numbers may stay finite for some steps more. (Bullet cuts speeds off, and a runaway
# would never get to infinity there.)
RUNAWAY = 1e12


class World(Protocol):
    """One robot in the water. ``diverged`` says whether it ran away; see ``RUNAWAY``."""

    diverged: bool

    def reset(self, morphology: NDArray[np.float64], fin_angles: Triple, current: Triple) -> None:
        """Put a robot of nine sizes at the origin, at rest, upright, facing +y.

        ``fin_angles`` are the left and right pectoral angle and the caudal phase, rad;
        ``current`` is the water's own velocity in the world, units/s.
        """

    def advance(self, command: Vector, steps: int = 1) -> None:
        """Hold a command (rev/s, rev/s, Hz) for some steps of 0.01 s."""

    def state(self) -> State:
        """Return the robot's state on plain floats."""

    @property
    def fin_angles(self) -> Vector:
        """Left and right pectoral angle and caudal phase in [-pi, pi], rad."""

    def close(self) -> None:
        """Free what the world holds; closing twice does no harm."""


# Loaded when first asked for: they know this module, and it not them.
WORLDS: dict[str, str] = {
    "numba": "aquafish_gym.engines.compiled.single:CompiledWorld",
    "pybullet": "aquafish_gym.engines.bullet.world:BulletWorld",
}


def make_world(engine: str, reactive: bool = False) -> World:
    """Return a world of an engine that ``check_engine`` allowed; reset it before its first step.

    ``reactive`` says whether the water has the terms of ``physics/reactive.py``.
    """
    found: World = resolve_name(WORLDS[engine])(reactive=reactive)
    return found
