"""Many robots on an engine that simulates one, with the methods of the compiled lanes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from aquafish_gym.engines.worlds import World, make_world
from aquafish_gym.physics.layout import STATE_ROWS, put_state
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.array_types import Floats, Rows


class WorldBatch:
    """The B robots of a scenario, each in a :class:`~aquafish_gym.engines.worlds.World` of its own.

    It has the methods of :class:`~aquafish_gym.engines.compiled.lanes.LaneBatch` that the vector
    environment calls. Robots swim one after another, in double precision.
    """

    def __init__(self, scenario: Scenario, engine: str | type[World]) -> None:
        self.batch = len(scenario)
        self._states = np.zeros((STATE_ROWS, self.batch))
        self._commands = np.zeros((3, self.batch))
        self._worlds: list[World] = []
        try:
            for robot in range(self.batch):
                self._worlds.append(make_world(engine, scenario.take(robot)))
                self._read(robot)
        except BaseException:
            self.close()  # an engine such as PyBullet has only so much to give
            raise

    def restart(self, rows: Rows, scenario: Scenario) -> None:
        """Put the robots ``rows`` (n,) at the start of a scenario of n."""
        for i, robot in enumerate(rows.tolist()):
            self._worlds[robot].reset(scenario.take(i))
            self._read(robot)

    def update(self, rows: Rows, scenario: Scenario) -> None:
        """Set bodies, water and servos of the robots ``rows`` (n,) in mid-swim, from a scenario."""
        for i, robot in enumerate(rows.tolist()):
            self._worlds[robot].update(scenario.take(i))

    def set_current(self, currents: Floats) -> None:
        """Set the water's velocity for each robot, (B, 3), units/s in the world."""
        for world, (x, y, z) in zip(self._worlds, currents.tolist(), strict=True):
            world.set_current((x, y, z))

    def command_rows(self) -> Floats:
        """Return the commands (3, B) of the next :meth:`swim`; not a copy: callers write to it."""
        return self._commands

    def state_rows(self) -> Floats:
        """Return the states (25, B), not a copy; those of robots that diverged are NaN."""
        return self._states

    def swim(self, steps: int, after: Callable[[int, int], None] | None = None) -> None:
        """Hold the commands for ``steps``; then call ``after(0, B)``."""
        for robot, (left, right, caudal) in enumerate(self._commands.T.tolist()):
            self._worlds[robot].advance((left, right, caudal), steps)
            self._read(robot)
        if after is not None:
            after(0, self.batch)

    def close(self) -> None:
        """Free what the worlds hold; closing twice does no harm."""
        for world in self._worlds:
            world.close()

    def _read(self, robot: int) -> None:
        put_state(self._states.reshape(-1), robot, self.batch, self._worlds[robot].state())
        if self._worlds[robot].diverged:
            self._states[:, robot] = np.nan
