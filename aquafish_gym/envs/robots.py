"""Robots as they are at present: their scenario, sensors and servos, and the changes to come.

Environments and rollouts of one robot play a scenario's schedule with :class:`Robots`. One robot
with its world is :class:`OneRobot`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.damage.delays import DelayLines, delay_steps, longest
from aquafish_gym.damage.sensors import ONLY_ROBOT, Readings, Sensors
from aquafish_gym.engines.worlds import World, make_world
from aquafish_gym.physics.arithmetic import Vector
from aquafish_gym.scenario import LATE_FIELDS, TIMESTEP, Scenario
from aquafish_gym.utils.array_types import Floats, Rows

NO_CHANGE_STEP = 2**62


class Schedule:
    """The changes to come of each of B robots.

    Attributes
    ----------
    next_change
        (B,) the step at which each robot changes next; ``NO_CHANGE_STEP`` if it does not.
    """

    def __init__(self, count: int) -> None:
        self.next_change = np.full(count, NO_CHANGE_STEP)
        self._changes: list[list[tuple[int, Any]]] = [[] for _ in range(count)]

    def clear(self, rows: Rows) -> None:
        """Forget the changes of the robots ``rows`` (n,)."""
        self.next_change[rows] = NO_CHANGE_STEP
        for robot in rows.tolist():
            self._changes[robot] = []

    def add(self, robot: int, step: int, change: Any) -> None:
        """Add a change of a robot at a step after those of its other changes."""
        self._changes[robot].append((step, change))
        self.next_change[robot] = self._changes[robot][0][0]

    def pop(self, robot: int) -> Any:
        """Return a robot's next change, which has come."""
        changes = self._changes[robot]
        _, change = changes.pop(0)
        self.next_change[robot] = changes[0][0] if changes else NO_CHANGE_STEP
        return change


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
        self, scenario: Scenario, hold: int, late: bool = False, dtype: Any = np.float32
    ) -> None:
        self.late = late
        self.now = scenario.copy()
        self._dt = TIMESTEP * hold
        self.sensors = Sensors(len(scenario), dtype, dt=self._dt)
        self._servos = DelayLines(len(scenario), 3, first=np.zeros(3))
        self._schedule = Schedule(len(scenario))

    @property
    def next_change(self) -> NDArray[np.int64]:
        """(B,) the step of 0.01 s at which each robot changes next; not a copy."""
        return self._schedule.next_change

    def start(self, rows: Rows, scenario: Scenario) -> None:
        """Let the robots ``rows`` (n,) begin a scenario of n."""
        self._schedule.clear(rows)
        self.sensors.reset(rows)
        self._servos.reset(rows)
        for stage in scenario.stages():
            self.late = self.late or stage.is_late
            self.sensors.remember(stage.sensor_delay)
            self._servos.remember(longest(stage.servo_delay, self._dt))
        for step, changed, to in scenario.schedule:
            for i, robot in enumerate(rows[changed].tolist()):
                self._schedule.add(robot, step, (to, i))
        self._set(rows, scenario)

    def change(self, rows: Rows) -> None:
        """Let the robots ``rows`` (n,) change as their schedules say next."""
        together: dict[int, tuple[Scenario, list[int], list[int]]] = {}
        for robot in rows.tolist():
            to, i = self._schedule.pop(robot)
            _, robots, sources = together.setdefault(id(to), (to, [], []))
            robots.append(robot)
            sources.append(i)
        for to, robots, sources in together.values():
            self._set(np.array(robots), to.take(sources))

    def _set(self, rows: Rows, scenario: Scenario) -> None:
        for name, table in self.now.arrays().items():
            table[rows] = vars(scenario)[name]
        self.sensors.update(rows, Readings.of(scenario))
        delays = delay_steps(scenario.servo_delay, self._dt)
        self._servos.update(rows, delays, scenario.servo_hold / self._dt)

    @property
    def acts_late(self) -> bool:
        """Whether servos may follow earlier actions than the last."""
        return self._servos.active

    def drive(self, speeds: Vector) -> Vector:
        """Return the speeds that servos follow in this step, which may be those of earlier ones.

        Numbers of one robot, or rows (B,). Until the first action arrives, servos stand.
        """
        if not self._servos.active:
            return speeds
        asked = np.reshape(np.array(speeds, np.float64), (3, -1)).T
        left, right, caudal = self._servos.carry(asked, np.arange(len(asked))).T
        if isinstance(speeds[0], float):
            return (float(left[0]), float(right[0]), float(caudal[0]))
        return (left, right, caudal)

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
    whole
        The robot until :meth:`start`.
    hold, late, dtype
        As of :class:`Robots`.
    substeps
        Integration steps in each step of 0.01 s.
    """

    def __init__(
        self,
        engine: str | type[World],
        whole: Scenario,
        hold: int,
        late: bool = False,
        dtype: Any = np.float32,
        substeps: int = 1,
    ) -> None:
        self.robots = Robots(whole, hold, late, dtype)
        self.world: World | None = None  #: From :meth:`start` to :meth:`close`.
        self._engine = engine
        self._substeps = substeps
        self._next_change = NO_CHANGE_STEP

    def start(self, scenario: Scenario) -> World:
        """Begin a scenario of one robot, and return its world."""
        if self.world is None:
            self.world = make_world(self._engine, scenario, self._substeps)
        else:
            self.world.start(scenario)
        self.robots.start(ONLY_ROBOT, scenario)
        self._next_change = int(self.robots.next_change[0])
        return self.world

    def change(self, step: int) -> bool:
        """Change as the schedule says for a step of 0.01 s; return whether anything did."""
        if step != self._next_change or self.world is None:
            return False
        self.robots.change(ONLY_ROBOT)
        self._next_change = int(self.robots.next_change[0])
        self.world.update(self.robots.now)
        return True

    def flow(self, water: Vector | None) -> None:
        """Let the water move as a task says, units/s; None leaves it as it is."""
        if water is not None and self.world is not None:
            x, y, z = map(float, water)
            self.world.set_current((x, y, z))

    def sense(
        self, whole: NDArray[Any], most: Floats, rngs: Sequence[np.random.Generator]
    ) -> NDArray[Any]:
        """Return the observation (k,), where whole sensors observe ``whole``.

        ``most`` (k,) are the channels' limits, and ``rngs`` the robot's generator.
        """
        sensors = self.robots.sensors
        if not sensors.broken:
            return whole
        found: NDArray[Any] = sensors.observe(whole[None], -most, most, rngs, ONLY_ROBOT)[0]
        return found

    def close(self) -> None:
        """Free what the world holds; closing twice does no harm."""
        if self.world is not None:
            self.world.close()
            self.world = None
