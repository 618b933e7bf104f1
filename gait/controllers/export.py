"""The command ``export``: a controller as one C99 file for a microcontroller, with test vectors.

``controller.c`` restates ``network.respond``, ``command.lane_servo_speeds`` and ``command.reckon``
in C. The test vectors are what these functions return in float32 lanes, and both agree to the bit.
"""

from __future__ import annotations

import re
import textwrap
from dataclasses import dataclass
from importlib.resources import files
from itertools import accumulate
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from tyro.conf import Positional, arg

from aquafish_gym.command import lane_servo_speeds
from aquafish_gym.engines.api import TIMESTEP
from aquafish_gym.rollout.programs import ProgramAgent
from aquafish_gym.sense import RANGE_TOLERANCE, limits
from aquafish_gym.utils.storage import output_file, write_bytes
from aquafish_gym.utils.validation import InvalidArgumentError, brief, file_path, instance
from gait.controllers.controller import Controller, program_of
from gait.controllers.network import OUTPUTS, Senses

VECTOR_COUNT = 1000
VECTOR_FIN_ANGLES = (0.5, -1.0, 2.0)  # rad, at the start of the test vectors
VECTOR_SERVO_GAIN = (1.0, 0.75, 1.25)
_FIRST_LINE = re.compile(rb"/\* Written by `aquafish export`")
_HEADER = re.compile(rf"[\w,]*{','.join(OUTPUTS)}\n".encode())


@dataclass(frozen=True)
class Export:
    """Write a controller as one C99 file for a microcontroller.

    It has a state, a function that resets it, and one that takes a step. It allocates no memory and
    needs only math.h. Beside it goes a CSV of test vectors, by which the file can check itself.
    """

    example: ClassVar[str] = "out/evolve/controller.json --c fish.c"

    controller: Annotated[Positional[Path], arg(metavar="FILE")]
    """A controller.json, as evolve and baseline write it."""
    c: Annotated[Path, arg(metavar="FILE.c")]
    """The C file. Its name is the prefix of its functions: fish.c has fish_step."""

    def execute(self) -> None:
        """Write both files."""
        for path in export_c(Controller.load(self.controller), self.c):
            print(f"wrote {path} ({path.stat().st_size} bytes)")


def export_c(controller: Controller, path: Path | str) -> tuple[Path, Path]:
    """Write a controller as a C file, and test vectors beside it; return both paths.

    Raises
    ------
    InvalidArgumentError
        If the file's name is no identifier of C followed by .c, if another file than an exported
        one is there, or if ``controller`` is no ``Controller``.
    """
    instance("controller", controller, Controller)
    source = file_path("c", path)
    if source.suffix != ".c" or not re.fullmatch(r"[A-Za-z]\w*", source.stem, re.ASCII):
        raise InvalidArgumentError(
            "c must be a file name FILE.c, where FILE is a letter and then letters, digits and _, "
            f"because it begins the names of the functions; got {brief(source.name)}"
        )
    table = source.with_suffix(".csv")
    for file, ours in ((source, _FIRST_LINE), (table, _HEADER)):
        if file.exists() and not (file.is_file() and ours.match(file.read_bytes())):
            raise InvalidArgumentError(
                f"c must not overwrite a file that no export wrote; {file} exists"
            )
        output_file(file, "c")
    text = c_source(controller, source.stem)
    rows = np.concatenate(make_vectors(controller, VECTOR_COUNT), axis=1)
    lines = [",".join((*_columns(controller.senses), *OUTPUTS))]
    lines += [",".join(map(str, row)) for row in rows]
    write_bytes(table, ("\n".join(lines) + "\n").encode())
    write_bytes(source, text.encode())
    return source, table


def c_source(controller: Controller, name: str) -> str:
    """Return a controller as a C file whose functions' names begin with ``name``."""
    senses = controller.senses
    layers = controller.layers or (1,) * controller.nodes
    nodes, sources = np.nonzero(controller.weights)
    first = np.searchsorted(nodes, np.arange(controller.nodes + 1))
    clipped = controller.output == "clip"
    hidden = len(layers) > 1
    activation = "NAME_tanh(z)"
    if clipped:
        activation = "NAME_clip(z, 1.0f)"
    if clipped and hidden:
        activation = f"layer < NAME_layers - 1 ? NAME_tanh(z) : {activation}"
    given = ["imu"] * senses.imu + ["goal"] * senses.goal
    start = ["fin_angles", "servo_gain"] * senses.fins
    sizes = {"imu": 9, "goal": 3, "fin_angles": 3, "servo_gain": 3}
    rows = {"imu": "row", "goal": "row + 9" if senses.imu else "row"}
    most = limits(observe_fins=False, has_goal=True)
    unit, spin, way = most[[0, 6, 9]] * RANGE_TOLERANCE
    values = {
        "DESCRIPTION": repr(controller),
        "MILLISECONDS": controller.interval * round(1000 * TIMESTEP),
        "INTERVAL": controller.interval,
        "PERIOD": _float(controller.interval * TIMESTEP),
        "INPUTS": len(senses.names),
        "INPUT_NAMES": "\n * ".join(textwrap.wrap(", ".join(senses.names), 97)) or "none",
        "NODES": controller.nodes,
        "LAYERS": len(layers),
        "WIDEST": max(layers),
        "LAYER_END": _wrapped(accumulate(layers)),
        "FIRST": _wrapped(first),
        "SOURCE": _wrapped(sources if len(sources) else [0]),
        "WEIGHT": _floats(controller.weights[nodes, sources] if len(sources) else [0.0]),
        "BIAS": _floats(controller.bias),
        "RESPONSE": _floats(controller.response),
        "CLOCK": _float(controller.clock),
        "HARMONICS": senses.clock,
        "ACTIVATION": activation,
        "RESET_PARAMETERS": "".join(f", const float {x}[{sizes[x]}]" for x in start),
        "RESET_CALL": "".join(f", {x}" for x in start),
        "STEP_PARAMETERS": "".join(f", const float {x}[{sizes[x]}]" for x in given),
        "STEP_CALL": "".join(f", {x}" for x in given),
        "STEP_TEST": "".join(f", {rows[x]}" for x in given),
        "UNIT_LIMIT": _float(unit),
        "GYRO_LIMIT": _float(spin),
        "GOAL_LIMIT": _float(way),
        "RANGES": f"gyroscope {most[6]:.4g} rad/s, goal {most[9]:.4g}",
        "COLUMNS": len(_columns(senses)) + len(OUTPUTS),
        "FIN_ANGLES": _floats(VECTOR_FIN_ANGLES),
        "SERVO_GAIN": _floats(VECTOR_SERVO_GAIN),
    }
    parts = {
        "imu": senses.imu,
        "clock": senses.clock > 0,
        "fins": senses.fins,
        "goal": senses.goal,
        "senses": senses.imu or senses.goal,
        "waves": senses.clock > 0 or senses.fins,
        "tanh": hidden or not clipped,
    }
    # In the template, a line "//? part" begins what only some controllers have, and "//." ends it.
    lines = []
    kept = True
    template = files("gait.controllers").joinpath("controller.c").read_text(encoding="utf-8")
    for line in template.splitlines():
        if line.startswith("//"):
            kept = line == "//." or parts[line.removeprefix("//? ")]
        elif kept:
            lines.append(line)
    text = re.sub(r"\$([A-Z_]+)", lambda found: str(values[found[1]]), "\n".join(lines))
    return re.sub(r"\bNAME(?=_|\b)|(?<=-D)NAME", name, text) + "\n"


def make_vectors(
    controller: Controller, steps: int, seed: int = 0
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return random observations (steps, n) and the commands (steps, 3) that follow, in float32.

    The observations, all in range, are up, north and gyro if the controller has an IMU, then the
    way to the goal if it senses one.
    """
    scale = np.repeat((0.6, 1.0, 10.0), (6, 3, 3))  # goals are units away
    felt = np.random.default_rng(seed).standard_normal((steps, 12)) * scale
    most = limits(observe_fins=False, has_goal=True)
    observations = np.clip(felt, -most, most).astype(np.float32)
    senses = controller.senses
    seen = observations[:, [*range(9 * senses.imu), *range(9, 9 + 3 * senses.goal)]]
    return seen, answers(controller, observations)


def answers(controller: Controller, observations: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the commands (T, 3) that follow observations (T, 12): up, north, gyro, goal.

    The swim begins with ``VECTOR_FIN_ANGLES`` and ``VECTOR_SERVO_GAIN``.
    """
    fins = np.array([VECTOR_FIN_ANGLES])
    agent = ProgramAgent(program_of([controller]), fins, VECTOR_SERVO_GAIN, np.float32)
    times = np.arange(len(observations)) * controller.interval * TIMESTEP
    pairs = zip(observations, times.tolist(), strict=True)
    actions = np.array([agent.act(seen[None], time)[0] for seen, time in pairs])
    left, right, caudal = actions.T
    return np.stack(lane_servo_speeds((left, right, caudal)), axis=1)


def _columns(senses: Senses) -> tuple[str, ...]:
    return Senses(imu=senses.imu, clock=0, goal=senses.goal).names


def _float(number: float) -> str:
    """Return the shortest literal of a number in float32; a controller's all fit."""
    return str(np.float32(number)) + "f"


def _floats(numbers: ArrayLike) -> str:
    return _wrapped(map(_float, np.asarray(numbers).tolist()))


def _wrapped(items: Any) -> str:
    """Return items with commas, on lines of their own if they are many."""
    joined = ", ".join(map(str, items))
    if len(joined) < 60:
        return joined
    return "\n" + textwrap.fill(joined, 100, initial_indent=" " * 4, subsequent_indent=" " * 4)
