"""Many robots on an engine that simulates one."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from aquafish_gym.engines.worlds import Swimmers, World, make_world
from aquafish_gym.physics.layout import STATE_ROWS, put_state
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.array_types import Floats, Rows


class WorldBatch(Swimmers):
    """The B robots of a scenario, each in a :class:`~aquafish_gym.engines.worlds.World` of its own.

    Robots swim one after another, in double precision.
    """

    def __init__(self, scenario: Scenario, engine: str | type[World]) -> None:
        self.batch = len(scenario)
        self._states = np.zeros((STATE_ROWS, self.batch))
        self._worlds: list[World] = []
        try:
            for robot in range(self.batch):
                self._worlds.append(make_world(engine, scenario.take(robot)))
                self._read(robot)
        except BaseException:
            self.close()  # an engine such as PyBullet has only so much to give
            raise

    def start(self, scenario: Scenario, rows: Rows | None = None) -> None:
        for robot, one in self._each(scenario, rows):
            self._worlds[robot].start(one)
            self._read(robot)

    def update(self, scenario: Scenario, rows: Rows | None = None) -> None:
        for robot, one in self._each(scenario, rows):
            self._worlds[robot].update(one)

    def set_current(self, current: Floats) -> None:
        for world, (x, y, z) in zip(self._worlds, current.tolist(), strict=True):
            world.set_current((x, y, z))

    def advance(
        self, command: Floats, steps: int = 1, after: Callable[[int, int], None] | None = None
    ) -> None:
        for robot, (left, right, caudal) in enumerate(command.tolist()):
            self._worlds[robot].advance((left, right, caudal), steps)
            self._read(robot)
        if after is not None:
            after(0, self.batch)

    @property
    def states(self) -> Floats:
        """The states (25, B), NaN of robots that diverged; the angles of the last rows stay 0."""
        return self._states

    def close(self) -> None:
        for world in self._worlds:
            world.close()

    def _each(self, scenario: Scenario, rows: Rows | None) -> Iterator[tuple[int, Scenario]]:
        """Yield the number and the scenario of each robot of ``rows``."""
        robots = range(self.batch) if rows is None else rows.tolist()
        for i, robot in enumerate(robots):
            yield robot, scenario.take(i)

    def _read(self, robot: int) -> None:
        put_state(self._states.reshape(-1), robot, self.batch, self._worlds[robot].state())
        if self._worlds[robot].diverged:
            self._states[:, robot] = np.nan
