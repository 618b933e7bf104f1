"""Many robots on an engine that simulates one."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from aquafish_gym.command import servo_speeds
from aquafish_gym.engines.worlds import Swimmers, World, make_world
from aquafish_gym.physics.kinematics import Numbers
from aquafish_gym.physics.layout import layout, state_numbers
from aquafish_gym.scenario import Scenario
from aquafish_gym.sense import observe
from aquafish_gym.utils.array_types import Flags, Floats, Observations, Rows


class WorldBatch(Swimmers):
    """The B robots of a scenario, each in a :class:`~aquafish_gym.engines.worlds.World` of its own.

    Robots swim one after another, in double precision.
    """

    def __init__(self, scenario: Scenario, engine: str | type[World]) -> None:
        self.batch = len(scenario)
        self.layout = layout(scenario.plan)
        self._plan = scenario.plan
        self._states = np.zeros((self.layout.state_rows, self.batch))
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

    def act(
        self,
        action: Floats,  # noqa: ARG002
        followed: Numbers,
        steps: int = 1,
        task: Any = None,  # noqa: ARG002
        memory: Floats | None = None,  # noqa: ARG002
    ) -> tuple[Flags, Observations, None]:
        speeds = np.transpose(servo_speeds(self._plan, followed)).tolist()
        for robot, command in enumerate(speeds):
            self._worlds[robot].advance(tuple(command), steps)
            self._read(robot)
        lost: Flags = np.array([world.diverged for world in self._worlds])
        return lost, observe(self.state()), None

    @property
    def states(self) -> Floats:
        """The states (N, B), the last ones of robots that diverged; roll, pitch and yaw stay 0."""
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
        if not self._worlds[robot].diverged:
            numbers = state_numbers(self._worlds[robot].state())
            self._states[: len(numbers), robot] = numbers
