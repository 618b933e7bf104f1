"""Swim the last second of a robot that diverged again, and name the numbers that left the finite.

The files are those of :mod:`~aquafish_gym.engines.divergence`.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from pkgutil import resolve_name
from typing import Any, NamedTuple

import numpy as np

from aquafish_gym.engines.divergence import READ_FIELDS, RECORDED_STEPS, SCHEMA
from aquafish_gym.engines.worlds import WORLDS, World, diverged_states
from aquafish_gym.physics.arithmetic import Vector
from aquafish_gym.physics.kinematics import State
from aquafish_gym.physics.layout import FIELDS, STATE_NUMBERS, put_state
from aquafish_gym.scenario import TIMESTEP, Scenario
from aquafish_gym.utils.array_types import Floats, Triple
from aquafish_gym.utils.storage import DamagedFileError, read_document
from aquafish_gym.utils.validation import InvalidArgumentError, finite_array, one_of

LONGEST_AFTERMATH = 100  # steps for which a robot that ran away is followed until NaN or infinity
_COMPONENTS = {
    "orientation": ("x", "y", "z", "w"),
    "left": ("cosine", "sine"),
    "right": ("cosine", "sine"),
    "phase": ("cosine", "sine"),
    "rates": ("left", "right", "caudal"),
}
_AXES = ("x", "y", "z")


class SwimAgain(NamedTuple):
    """The last second of a swim that diverged, and the steps after it until a number is not finite.

    Attributes
    ----------
    time, states, bodies, servo_gain
        (T,) s since the second began, (T, 22), (T, 9) sizes and (T, 3): at the start and after each
        step. The states after the robot ran away are the last.
    first_step
        The step of the swim at ``time`` 0.
    runaway
        The index of the first state that ran away or is not finite; None if there is none.
    """

    time: Floats
    states: Floats
    bodies: Floats
    servo_gain: Floats
    first_step: int
    runaway: int | None

    def explain(self) -> str:
        """Return sentences that name the step and the numbers that are not finite."""
        if self.runaway is None:
            return f"It does not diverge: all {len(self.time) - 1} steps are finite."
        step = self.first_step + self.runaway
        said = f"It runs away in step {step} ({TIMESTEP * step:.2f} s of its swim)."
        if self.runaway > 0:
            said += f" A step before, {_fastest(self.states[self.runaway - 1])}."
        gone = np.flatnonzero(~np.isfinite(self.states).all(axis=1))
        if not len(gone):
            return f"{said} All numbers stay finite for {len(self.time) - 1 - self.runaway} more."
        names = ", ".join(_not_finite(self.states[gone[0]]))
        return f"{said} Not finite in step {self.first_step + gone[0]}: {names}."


def _fastest(state: Floats) -> str:
    """Return the component of velocity and spin that is furthest from 0, in words."""
    name, unit = max(
        (("velocity", "units/s"), ("spin", "rad/s")),
        key=lambda pair: float(np.abs(state[FIELDS[pair[0]]]).max()),
    )
    axis = int(np.argmax(np.abs(state[FIELDS[name]])))
    return f"{name} {_AXES[axis]} is {state[FIELDS[name]][axis]:.3g} {unit}"


def _not_finite(state: Floats) -> list[str]:
    """Return the names of a state's fields, or of their components, that are not finite."""
    names = []
    for name in State._fields:
        bad = ~np.isfinite(state[FIELDS[name]])
        components = _COMPONENTS.get(name, _AXES)
        if bad.all():
            names.append(name)
        else:
            names += [f"{name} {c}" for c, one in zip(components, bad, strict=True) if one]
    return names


def is_divergence(path: str | os.PathLike[str]) -> bool:
    """Return whether a file is a swim that diverged, whether it is damaged or not."""
    try:
        with Path(path).open("rb") as file:
            return f'"{SCHEMA}"'.encode() in file.read(100)
    except OSError:
        return False


def swim_again(path: str | os.PathLike[str]) -> SwimAgain:
    """Swim a recorded swim again, on the engine on which it diverged.

    Raises
    ------
    InvalidArgumentError, EngineUnavailableError
        If the file cannot be read or is none of a swim that diverged, or its engine is missing.
    """
    swim = _read(path)
    states = np.array([*_states(swim)])
    lost = diverged_states(states.T)
    runaway = int(np.argmax(lost)) if lost.any() else None
    last = len(states) - 1 if runaway is None else runaway
    first = max(0, last - RECORDED_STEPS)
    gone = np.flatnonzero(~np.isfinite(states).all(axis=1))
    kept = slice(first, int(gone[0]) + 1 if len(gone) else None)
    of_step = np.repeat([c.robot for c in swim.commands], [c.steps for c in swim.commands])
    of_state = np.pad(of_step, (0, max(0, len(states) - len(of_step))), mode="edge")[kept]
    count = len(of_state)
    return SwimAgain(
        TIMESTEP * np.arange(count, dtype=np.float64),
        states[kept],
        np.array([swim.robots[robot].body[0] for robot in of_state]),
        np.array([swim.robots[robot].servo_gain[0] for robot in of_state]),
        swim.begins + first,
        None if runaway is None else runaway - first,
    )


class _Command(NamedTuple):
    robot: int
    current: Triple
    command: Vector
    steps: int


class _Swim(NamedTuple):
    """What a file holds."""

    engine: str
    dtype: str
    substeps: int
    begins: int
    state: Floats | None
    robots: list[Scenario]
    commands: list[_Command]


def _read(path: str | os.PathLike[str]) -> _Swim:
    document = read_document(path, SCHEMA, "the swim")
    try:
        robots = [_robot(robot, bool(document["reactive"])) for robot in document["robots"]]
        commands = [
            _Command(
                range(len(robots))[command["robot"]],
                _three(command["current"]),
                _three(command["command"]),
                int(command["steps"]),
            )
            for command in document["commands"]
        ]
        state = document["state"]
        if state is not None:
            state = finite_array("state", state, (STATE_NUMBERS,))
        if not commands:
            raise InvalidArgumentError("commands must be one or more; got none")
        return _Swim(
            one_of("engine", document["engine"], WORLDS),
            one_of("dtype", document["dtype"], ("float32", "float64")),
            int(document["substeps"]),
            int(document["begins"]),
            state,
            robots,
            commands,
        )
    except (KeyError, IndexError, TypeError, ValueError) as error:
        raise DamagedFileError(f"the swim: {path} is damaged: {error!r}") from None


def _robot(fields: dict[str, Any], reactive: bool) -> Scenario:
    """Return a robot of a file, beyond the ranges of :meth:`Scenario.create` if it was."""
    whole = vars(Scenario.create(fin_density=1.0))
    given = {}
    for name in READ_FIELDS:
        shape = (3,) if name == "fin_density" else whole[name].shape[1:]
        given[name] = finite_array(name, fields[name], shape)[None]
    return Scenario.fill(given, reactive)


def _three(numbers: Any) -> Triple:
    x, y, z = finite_array("command", numbers, (3,)).tolist()
    return (x, y, z)


def _states(swim: _Swim) -> Iterator[Floats]:
    """Yield the states (22,) at the start and after each step.

    The swim of a robot that ran away goes on, with its last command, until a number is not finite.
    """
    march = _march_compiled(swim) if swim.engine == "numba" else _march_bullet(swim)
    recorded = sum(command.steps for command in swim.commands)
    lost = False
    for step, state in enumerate(march):
        yield state
        lost = lost or bool(diverged_states(state[:, None])[0])
        if not np.isfinite(state).all() or (step == recorded and not lost):
            return


def _march_compiled(swim: _Swim) -> Iterator[Floats]:
    from aquafish_gym.engines.compiled.lanes import LaneBatch

    dtype = np.float32 if swim.dtype == "float32" else np.float64
    lanes = LaneBatch(swim.robots[0], dtype, swim.substeps, threads=1)
    if swim.state is not None:
        lanes.states[:STATE_NUMBERS, 0] = swim.state
    yield lanes.states[:STATE_NUMBERS, 0].astype(np.float64)
    robot = 0
    for command in _held(swim):
        if command.robot != robot:
            robot = command.robot
            lanes.update(swim.robots[robot])
        lanes.set_current(np.array([command.current]))
        lanes.advance(np.array([command.command]))
        yield lanes.states[:STATE_NUMBERS, 0].astype(np.float64)


def _march_bullet(swim: _Swim) -> Iterator[Floats]:
    world: World = resolve_name(WORLDS[swim.engine])(swim.substeps)
    world.start(swim.robots[0])
    state = np.zeros(STATE_NUMBERS)
    try:
        put_state(state, 0, 1, world.state())
        yield state.copy()
        robot = 0
        for command in _held(swim):
            if command.robot != robot:
                robot = command.robot
                world.update(swim.robots[robot])
            world.set_current(command.current)
            world.advance(command.command)
            put_state(state, 0, 1, world.state())
            yield state.copy()
    finally:
        world.close()


def _held(swim: _Swim) -> Iterator[_Command]:
    """Yield the command of each step; the last one is held on."""
    for command in swim.commands:
        for _ in range(command.steps):
            yield command
    for _ in range(LONGEST_AFTERMATH):
        yield swim.commands[-1]
