"""Files of robots that diverged: their state a second before, and what they did since.

If the variable ``AQUAFISH_DIVERGED`` of the environment names a folder, a robot that diverges
leaves a file there; without it nothing is recorded. ``aquafish film FILE`` swims the last second
again, by :func:`~aquafish_gym.engines.swim_again.swim_again`. The recorded commands are those that
the servos followed: delays, lags and policies are already in them.

The compiled engine begins in any state. PyBullet does not: its files hold the whole swim.
"""

from __future__ import annotations

import hashlib
from collections import deque
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.engines.worlds import World
from aquafish_gym.physics.arithmetic import Vector
from aquafish_gym.physics.kinematics import State
from aquafish_gym.physics.layout import STATE_NUMBERS, put_state
from aquafish_gym.scenario import TIMESTEP, Scenario
from aquafish_gym.utils.array_types import Flags, Floats, Reals, Rows, Triple
from aquafish_gym.utils.storage import encode_document, write_bytes

SCHEMA = "aquafish.divergence/1"
RECORDED_STEPS = round(1.0 / TIMESTEP)  # a second
MOST_FILES = 10  # in a folder: whole batches may diverge
START_FIELDS = ("fin_angles", "velocity", "spin")  # that an engine reads at the start alone
# The fields of a scenario that an engine reads, besides the current.
READ_FIELDS = ("body", *START_FIELDS, "drag", "fin_density", "servo_gain")


class _Moment(NamedTuple):
    """What B robots were when a command began, and the command."""

    states: Reals  # (22, B)
    robots: dict[str, Floats]  # the fields that engines read
    current: Floats  # (B, 3)
    command: Floats  # (B, 3) rev/s, rev/s and Hz
    steps: int


class Recording:
    """The last second of B robots on an engine, or their whole swims.

    Parameters
    ----------
    folder
        Where files are written.
    engine, dtype, substeps
        How the robots swim.
    resumes
        Whether the engine begins in any state; else whole swims are kept.
    """

    def __init__(
        self, folder: Path, engine: str, dtype: type[np.floating], substeps: int, resumes: bool
    ) -> None:
        self._folder = folder
        self._engine = engine
        self._dtype = np.dtype(dtype).name
        self._substeps = substeps
        self._resumes = resumes
        self._moments: deque[_Moment] = deque()
        self._steps = 0  # of the recorded moments
        self._clock = 0  # steps since the recording began
        self._robots: dict[str, Floats] = {}
        self._current: Floats = np.zeros((0, 3))
        self._begun: NDArray[np.int64] = np.zeros(0, np.int64)
        self._lost: Flags = np.zeros(0, np.bool_)
        self._reactive = False

    def start(self, scenario: Scenario, rows: Rows | None = None) -> None:
        """Note that robots begin a scenario; without ``rows`` they are all robots there are."""
        if rows is None:
            self._moments.clear()
            self._steps = 0
            self._reactive = scenario.reactive
            self._begun = np.zeros(len(scenario), np.int64)
            self._lost = np.zeros(len(scenario), np.bool_)
            rows = np.arange(len(scenario))
            self._robots = _read_fields(scenario)
            self._current = scenario.current
        self._begun[rows] = self._clock
        self._lost[rows] = False
        self._note_robots(scenario, rows, READ_FIELDS)

    def update(self, scenario: Scenario, rows: Rows) -> None:
        """Note that robots become those of a scenario. Earlier moments keep what they were."""
        # They keep their motion. The angle of a servo that dies in mid-swim is not even a number.
        lasting = tuple(name for name in READ_FIELDS if name not in START_FIELDS)
        self._note_robots(scenario, rows, lasting)

    def _note_robots(self, scenario: Scenario, rows: Rows, names: tuple[str, ...]) -> None:
        self._robots = {name: table.copy() for name, table in self._robots.items()}
        fields = _read_fields(scenario)
        for name in names:
            self._robots[name][rows] = fields[name]
        self._current = self._current.copy()
        self._current[rows] = scenario.current

    def set_current(self, current: Floats) -> None:
        """Note the velocity of the water (B, 3), units/s in the world."""
        self._current = np.array(current, np.float64)

    def note(self, states: Reals, command: Floats, steps: int) -> None:
        """Note states (22 or more, B), and the commands (B, 3) that are held from now on."""
        moment = _Moment(
            states[:STATE_NUMBERS].copy(), self._robots, self._current, command.copy(), steps
        )
        self._moments.append(moment)
        self._steps += steps
        self._clock += steps
        while self._resumes and self._steps - self._moments[0].steps >= RECORDED_STEPS:
            self._steps -= self._moments.popleft().steps

    def judge(self, lost: Flags) -> None:
        """Write a file of each robot that is lost (B,) and was not before."""
        for robot in np.flatnonzero(lost & ~self._lost).tolist():
            self._write(robot)
        self._lost |= lost

    def _write(self, robot: int) -> None:
        if len([*self._folder.glob(_name("*"))]) >= MOST_FILES:
            return
        began = self._clock - self._steps  # of the earliest moment
        moments = list(self._moments)
        while began < self._begun[robot]:  # those of an earlier episode
            began += moments.pop(0).steps
        state = moments[0].states[:, robot].astype(np.float64)
        if not np.isfinite(state).all():
            return  # it was written there: no swim leads to it
        content = {
            "engine": self._engine,
            "dtype": self._dtype,
            "substeps": self._substeps,
            "reactive": self._reactive,
            "begins": began - int(self._begun[robot]),
            "state": state if self._resumes else None,
            **_described(moments, robot),
        }
        # The same swim has the same name.
        encoded = encode_document(content, SCHEMA, indent=None)
        write_bytes(self._folder / _name(hashlib.sha256(encoded).hexdigest()[:16]), encoded)


def _read_fields(scenario: Scenario) -> dict[str, Floats]:
    """Return the fields that an engine reads, with a density of each fin."""
    fields = {name: vars(scenario)[name] for name in READ_FIELDS}
    count = len(scenario)
    density = fields["fin_density"].reshape(count, -1)
    return fields | {"fin_density": np.broadcast_to(density, (count, 3))}


def _name(which: str) -> str:
    return f"diverged-{which}.json"


def _described(moments: list[_Moment], robot: int) -> dict[str, Any]:
    """Return the robots that one robot was, and its commands, ready for JSON."""
    robots: list[dict[str, Any]] = []
    commands = []
    for moment in moments:
        now = {name: table[robot].tolist() for name, table in moment.robots.items()}
        if not robots or now != robots[-1]:
            robots.append(now)
        commands.append(
            {
                "robot": len(robots) - 1,
                "current": moment.current[robot].tolist(),
                "command": moment.command[robot].astype(np.float64).tolist(),
                "steps": moment.steps,
            }
        )
    return {"robots": robots, "commands": commands}


class RecordedWorld(World):
    """A world that leaves a file if its robot diverges; see the module."""

    def __init__(self, world: World, recording: Recording) -> None:
        self._world = world
        self._recording = recording
        self._state = np.zeros(STATE_NUMBERS)

    def _start(self, scenario: Scenario) -> None:
        self._world._start(scenario)
        self._recording.start(scenario)
        self.diverged = False

    def _update(self, scenario: Scenario) -> None:
        self._world._update(scenario)
        self._recording.update(scenario, np.zeros(1, np.intp))

    def _swim(self, command: Vector, steps: int) -> None:
        put_state(self._state, 0, 1, self._world.state())
        self._recording.note(self._state[:, None], np.array([command]), steps)
        self._world._swim(command, steps)
        self.diverged = self._world.diverged
        self._recording.judge(np.array([self.diverged]))

    def set_current(self, current: Triple) -> None:
        self._world.set_current(current)
        self._recording.set_current(np.array([current]))

    def state(self) -> State:
        return self._world.state()

    @property
    def fin_angles(self) -> Vector:
        return self._world.fin_angles

    def close(self) -> None:
        self._world.close()


def record_world(world: World, engine: str, substeps: int, folder: Path) -> World:
    """Return a world that has not started, recorded."""
    recording = Recording(folder, engine, np.float64, substeps, resumes=engine == "numba")
    return RecordedWorld(world, recording)
