"""One robot at a time, told a new command every few steps: what an environment needs.

The engines of ``base.py`` answer whole trials; a :class:`World` is the same engine taken step
by step.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.physics.carriers import Vector
from aquafish_gym.physics.kinematics import State

Triple = tuple[float, float, float]


class World(Protocol):
    """One robot in the water. ``diverged`` says whether it left the finite numbers."""

    @property
    def diverged(self) -> bool: ...

    def reset(self, morphology: NDArray[np.float64], fin_angles: Triple, current: Triple) -> None:
        """Put a robot of nine sizes at the origin, at rest, upright, facing +y.

        ``fin_angles`` are the left and right pectoral angle and the caudal phase, rad;
        ``current`` is the water's own velocity in the world, units/s.
        """

    def advance(self, command: Vector, steps: int = 1) -> None:
        """Hold a command (rev/s, rev/s, Hz) for some steps of 0.01 s."""

    def state(self) -> State:
        """Return the robot's state on plain floats."""

    def close(self) -> None:
        """Free what the world holds; closing twice does no harm."""


class CompiledWorld:
    """One robot on the compiled engine, in double precision: the robot of the lanes.

    Unlike PyBullet's it can be pickled, copied and carried across a fork.
    """

    def __init__(self) -> None:
        from aquafish_gym.engines.lanes import LaneBatch

        # One lane: all the other numbers of a wider register would be wasted.
        self._lanes = LaneBatch(
            np.zeros((1, 9)), np.zeros((1, 3)), dtype=np.float64, threads=1, width=1
        )
        self.diverged = False

    def reset(self, morphology: NDArray[np.float64], fin_angles: Triple, current: Triple) -> None:
        """See :class:`World`."""
        self._lanes.current = current
        self._lanes.replace(np.ones(1, np.bool_), morphology[None], np.array([fin_angles]))
        self.diverged = False

    def advance(self, command: Vector, steps: int = 1) -> None:
        """See :class:`World`."""
        log = self._lanes.advance(np.array([command]), steps)
        self.diverged = bool(log.diverged[0])

    def state(self) -> State:
        """See :class:`World`."""
        now = self._lanes.state()
        angles, rates = now["fin_angles"], now["rates"]
        cosines, sines = np.cos(angles[0]).tolist(), np.sin(angles[0]).tolist()
        return State(
            tuple(now["quaternion"][0].tolist()),
            tuple(now["position"][0].tolist()),
            tuple(now["velocity"][0].tolist()),
            tuple(now["gyro"][0].tolist()),
            (cosines[0], sines[0]),
            (cosines[1], sines[1]),
            (cosines[2], sines[2]),
            tuple(rates[0].tolist()),
        )

    def close(self) -> None:
        """See :class:`World`."""


def make_world(engine: str) -> World:
    """Return a world of an engine that ``check_engine`` allowed; reset it before its first step."""
    if engine == "pybullet":
        from aquafish_gym.engines.bullet import BulletWorld

        return BulletWorld()
    return CompiledWorld()
