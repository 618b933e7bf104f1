"""Robots as they are at present: the rows of their tables, and their sensors and servos.

Environments and rollouts of one robot play their scenarios with :class:`Robots`. One robot with its
world is :class:`OneRobot`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.command import still_action
from aquafish_gym.damage.sensors import ONLY_ROBOT, sensor_columns, servo_columns
from aquafish_gym.damage.side import Side
from aquafish_gym.engines.worlds import World, make_world
from aquafish_gym.physics.arithmetic import Vector
from aquafish_gym.physics.kinematics import Numbers
from aquafish_gym.scenario import CHANNELS, LATE_FIELDS, STARTS, TIMESTEP, Scenario
from aquafish_gym.stages import NEVER, SlotPlayer
from aquafish_gym.utils.array_types import Floats, Rows


class Robots:
    """The current scenario of B robots, their sensors and servos, and when they change.

    Parameters
    ----------
    scenario
        The robots until :meth:`start`.
    hold
        For how many steps of 0.01 s an action is held.
    late
        Whether a channel may become late, slow or scaled.
    dtype
        Of the observations.
    history
        For how many s actions and readings are kept, for a delay that :meth:`rewrite` brings.

    Attributes
    ----------
    now
        The current scenario (B robots).
    sensors
        Applies the faults of sensors to observations.
    late
        Whether a channel ever was, is or may become late, slow or scaled; only then ``truth`` says
        which.
    """

    def __init__(
        self,
        scenario: Scenario,
        hold: int,
        late: bool = False,
        dtype: Any = np.float32,
        history: float = 0.0,
    ) -> None:
        self.late = late
        self.now = scenario.beginning.copy()
        self._dt = TIMESTEP * hold
        self.sensors = Side(len(scenario), len(CHANNELS), self._dt, dtype)
        still = np.array(still_action(scenario.plan))
        self._servos = Side(len(scenario), len(still), self._dt, first=still)
        self.sensors.remember(history)
        self._servos.remember(history)
        self._player = SlotPlayer(self.now.stages)

    @property
    def next_change(self) -> Rows:
        """(B,) the step of 0.01 s at which each robot changes next; not a copy."""
        return self._player.next_change

    def start(self, rows: Rows, scenario: Scenario) -> None:
        """Let the robots ``rows`` (n,) begin a scenario of n."""
        self.sensors.start(rows)
        self._servos.start(rows)
        for name in STARTS:
            vars(self.now)[name][rows] = vars(scenario)[name]
        self._play(rows, scenario, 0)

    def rewrite(self, scenario: Scenario, step: int) -> None:
        """Let all robots go on from a step of 0.01 s as another scenario says."""
        self._play(np.arange(len(scenario)), scenario, step)

    def _play(self, rows: Rows, scenario: Scenario, step: int) -> None:
        self.late = self.late or scenario.is_late
        self.sensors.remember(scenario.sensor_delay)
        self._servos.remember(scenario.servo_delay)
        self._set(rows, self._player.begin(rows, scenario.stages, step))

    def change(self, rows: Rows) -> None:
        """Let the robots ``rows`` (n,), whose next change has come, change."""
        self._set(rows, self._player.move(rows))

    def _set(self, rows: Rows, fields: Mapping[str, NDArray[Any]]) -> None:
        for name, values in fields.items():
            vars(self.now)[name][rows] = values
        self.sensors.update(rows, sensor_columns(fields))
        self._servos.update(rows, servo_columns(fields))

    def follow(self, action: Numbers) -> Numbers:
        """Return the action that servos follow in this step, which may be an earlier one.

        Numbers of one robot, or rows (B,). Until the first action arrives, servos stand.
        """
        if not self._servos.remembers:
            return action
        commanded = np.reshape(np.array(action, np.float64), (len(action), -1)).T
        carried = self._servos.carry(commanded, np.arange(len(commanded)))
        return tuple(carried[0].tolist() if isinstance(action[0], float) else carried.T)

    def truth(self) -> dict[str, NDArray[Any]]:
        """Return copies of the robots' damaged properties, by their names in ``info``."""
        now = self.now
        late = {name: vars(now)[name].copy() for name in LATE_FIELDS} if self.late else {}
        return {
            "faults": now.faults.copy(),
            "morphology": now.body.copy(),
            "servo_gain": now.servo_gain.copy(),
            "sensor_noise": now.gyro_noise.copy(),
            "sensor_bias": now.sensor_bias.copy(),
            "sensor_lost": now.sensor_stuck | now.sensor_dropped,
            **late,
        }


class OneRobot:
    """One robot on an engine, which changes as its scenario says.

    Parameters
    ----------
    engine
        The name of an engine, or the class of a world.
    robot
        The robot until :meth:`start`.
    hold, late, dtype
        As of :class:`Robots`.
    substeps
        Integration steps in each step of 0.01 s.
    """

    def __init__(
        self,
        engine: str | type[World],
        robot: Scenario,
        hold: int,
        late: bool = False,
        dtype: Any = np.float32,
        substeps: int = 1,
    ) -> None:
        self.robots = Robots(robot, hold, late, dtype)
        self.world: World | None = None  #: From :meth:`start` to :meth:`close`.
        self._engine = engine
        self._substeps = substeps
        self._next_change = NEVER
        self._water: Vector | None = None  # of the task, which no scenario knows

    def start(self, scenario: Scenario) -> World:
        """Begin a scenario of one robot, and return its world."""
        if self.world is None:
            self.world = make_world(self._engine, scenario, self._substeps)
        else:
            self.world.start(scenario)
        self.robots.start(ONLY_ROBOT, scenario)
        self._next_change = int(self.robots.next_change[0])
        self._water = None
        return self.world

    def change(self, step: int) -> bool:
        """Change if the step of 0.01 s of the next change has come; return whether it had."""
        if step != self._next_change or self.world is None:
            return False
        self.robots.change(ONLY_ROBOT)
        self._next_change = int(self.robots.next_change[0])
        self.world.update(self.robots.now)
        self.flow(self._water)
        return True

    def flow(self, water: Vector | None) -> None:
        """Let the water move as a task says, units/s; None leaves it as it is."""
        if water is not None and self.world is not None:
            x, y, z = map(float, water)
            self.world.set_current((x, y, z))
            self._water = water

    def sense(
        self, truth: NDArray[Any], most: Floats, rngs: Sequence[np.random.Generator]
    ) -> NDArray[Any]:
        """Return the observation (k,), given what intact sensors observe.

        ``most`` (k,) are the channels' limits, and ``rngs`` the robot's generator.
        """
        sensors = self.robots.sensors
        if not sensors.broken:
            return truth
        found: NDArray[Any] = sensors.observe(truth[None], -most, most, rngs, ONLY_ROBOT)[0]
        return found

    def close(self) -> None:
        """Free what the world holds; closing twice does no harm."""
        if self.world is not None:
            self.world.close()
            self.world = None
