"""Files of robots that diverged: the arguments with which ``simulate`` swims them again."""

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np

from aquafish_gym.command import servo_speeds
from aquafish_gym.physics.kinematics import rotation, to_body
from aquafish_gym.plans import AQUAFISH, plan_document
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.array_types import Floats, Rows
from aquafish_gym.utils.storage import write_bytes

MOST_FILES = 10  # in a folder: whole batches may diverge


class Recorded:
    """An engine of one robot, or of B, that writes a file of each robot that diverges.

    ``simulate`` knows no changes, so a file begins where the robot or its water last changed, in
    the robot's axes there. Its commands are the servos' times their gains. ``how`` has the
    arguments ``engine``, ``dtype`` and ``substeps``. Robots with heavy fins or late servos leave
    no file.
    """

    def __init__(self, engine: Any, scenario: Scenario, folder: Path, how: dict[str, Any]) -> None:
        self._engine = engine
        self._folder = folder
        self._how = how | {"reactive": scenario.reactive, "record": "pose"}
        self._plan = scenario.plan
        self._robots = scenario.beginning.copy().columns()
        self._start: dict[str, Floats] = {}
        self._clock = 0  # steps of 0.01 s
        self._speeds: list[tuple[int, int, Floats]] = []  # from and to which step, (B, F)
        self._began, self._since = np.zeros((2, len(scenario)), np.int64)
        self._lost = np.zeros(len(scenario), np.bool_)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):  # of a copy that is being made
            raise AttributeError(name)
        return getattr(self._engine, name)

    def start(self, scenario: Scenario, *rows: Rows) -> None:
        self._engine.start(scenario, *rows)
        self._began[rows or ...] = self._clock
        self._lost[rows or ...] = False
        self._change(scenario.beginning.columns(), rows or ...)

    def update(self, scenario: Scenario, *rows: Rows) -> None:
        self._engine.update(scenario, *rows)
        self._change(scenario.columns(), rows or ...)

    def set_current(self, current: Any) -> None:
        self._engine.set_current(current)
        rows = np.flatnonzero((self._robots["current"] != current).any(axis=1))
        self._change({"current": np.reshape(current, (-1, 3))[rows]}, rows)

    def advance(self, command: Any, steps: int = 1) -> None:
        self._hold(command, steps)
        self._engine.advance(command, steps)
        self._judge(self._engine.diverged)

    def act(self, action: Any, followed: Any, steps: int = 1, *judged: Any) -> Any:
        self._hold(np.transpose(servo_speeds(self._plan, followed)), steps)
        found = self._engine.act(action, followed, steps, *judged)
        self._judge(found[0])
        return found

    def _hold(self, command: Any, steps: int) -> None:
        self._clock += steps
        speeds = self._robots["servo_gain"] * command
        self._speeds.append((self._clock - steps, self._clock, speeds))
        needed = self._since.min()
        self._speeds = [one for one in self._speeds if one[1] >= needed]

    def _judge(self, lost: Any) -> None:
        for robot in np.flatnonzero(lost & ~self._lost).tolist():
            self._write(robot)
        self._lost |= lost

    def _change(self, fields: dict[str, Floats], rows: Any) -> None:
        for name, table in fields.items():
            self._robots[name][rows] = table
        state = self._engine.state()
        fins = np.arctan2(state.joints[1::2], state.joints[::2])
        axes: Any = rotation(tuple(np.reshape(q, -1) for q in state.orientation))  # type: ignore[arg-type]
        start = {"fin_angles": fins, "velocity": to_body(axes, state.velocity), "spin": state.spin}
        water = to_body(axes, tuple(self._robots["current"].T))
        for name, vector in (start | {"current": water}).items():
            table = np.reshape(vector, (len(vector), -1)).T
            self._start.setdefault(name, table.copy())[rows] = table[rows]
        self._since[rows] = self._clock

    def _write(self, robot: int) -> None:
        full = len([*self._folder.glob("diverged-*.json")]) >= MOST_FILES
        heavy = (self._robots["fin_density"][robot] != 1.0).any()
        if full or heavy or self._robots["servo_lag"][robot]:
            return
        since = self._since[robot].item()
        # The command before says how fast the servos turn at first.
        first = max(self._began[robot].item(), since - 1)
        held = [one for one in self._speeds if one[1] > first]
        speeds = np.repeat([one[2][robot] for one in held], [b - a for a, b, _ in held], axis=0)
        gain = np.where(speeds[-1] < 0.0, -2.0, 2.0)  # halves commands, as gains may double them
        begun = since - held[0][0]
        arguments = self._how | {
            "morphologies": self._robots["body"][robot].tolist(),
            "drag": self._robots["drag"][robot].tolist(),
            **{name: table[robot].tolist() for name, table in self._start.items()},
            "commands": [np.maximum(speeds / gain, self._plan.command_low).tolist()],
            "servo_gain": gain.tolist(),
            "begun": begun,
            **({} if self._plan == AQUAFISH else {"plan": plan_document(self._plan)}),
            "steps": self._clock - since,
            "engine": "numba" if begun else self._how["engine"],  # PyBullet begins at rest
        }
        text = json.dumps(arguments).encode()
        write_bytes(self._folder / f"diverged-{hashlib.sha256(text).hexdigest()[:16]}.json", text)
