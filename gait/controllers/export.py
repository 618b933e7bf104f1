"""The command ``export``, and a controller as a C99 file for a microcontroller, with vectors.

``controller.c`` restates ``network.responder``, ``command.lane_servo_speeds`` and
``command.reckon`` in C. The test vectors are what these functions return in float32 lanes, and both
agree to the bit.
"""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from tyro.conf import Positional, arg

from aquafish_gym.bodies import MorphologiesLike, read_bodies
from aquafish_gym.command import lane_servo_speeds
from aquafish_gym.engines.api import TIMESTEP
from aquafish_gym.morphology import Morphology
from aquafish_gym.plans import BodyPlan, check_plan
from aquafish_gym.rollout.programs import ProgramAgent
from aquafish_gym.runs.command_line import BodiesFile, Given
from aquafish_gym.sense import RANGE_TOLERANCE, limits
from aquafish_gym.utils.validation import InvalidArgumentError, instance, printable
from gait.controllers.c_files import (
    CFile,
    c_file_path,
    c_float,
    c_floats,
    servo_lines,
    source_and_header,
    wrapped,
)
from gait.controllers.controller import Controller, program_of
from gait.controllers.export_model import model_file
from gait.controllers.export_policy import policy_file
from gait.controllers.network import Senses
from gait.controllers.sb3_zip import read_policy

VECTOR_COUNT = 1000
VECTOR_FIN_ANGLES = (0.5, -1.0, 2.0)  # rad, at the start of the test vectors
VECTOR_SERVO_GAIN = (1.0, 0.75, 1.25)


@dataclass(frozen=True)
class Export(Given):
    """Write a controller, or a model to predict with, as a C99 file for a microcontroller.

    A controller (--c) has a state, a function that resets it, and one that takes a step. --c also
    takes a policy of stable-baselines3, of any environment; it has a function from an observation
    to the action. A model (--model) has the robot's time step, its senses, and a function that
    predicts what a series of commands leads to. None allocates memory, and all call only math.h.
    Beside each go its header, fish.h for fish.c, and a CSV of test vectors, by which the file can
    check itself.
    """

    example: ClassVar[str] = "out/evolve/controller.json --c fish.c --model model.c"

    controller: Annotated[Positional[Path | None], arg(metavar="FILE")] = None
    """A controller.json, as evolve and baseline write it; or the .zip of a policy, as model.save of
    stable-baselines3 writes it: dense layers of PPO, A2C, TRPO, SAC, TQC, TD3 or DDPG."""
    c: Annotated[Path | None, arg(metavar="FILE.c")] = None
    """The C file of the controller or policy. Its name is the prefix of its functions: fish.c has
    fish_step."""
    model: Annotated[Path | None, arg(metavar="FILE.c")] = None
    """The model's C file, of the controller's body unless --morphology gives others."""
    normalize: Annotated[Literal["none"] | Path | None, arg(metavar="FILE.npz|none")] = None
    """VecNormalize's mean, var, epsilon and clip, by which the policy's observations were scaled,
    or none if it scaled rewards alone; see docs/howto/export.md."""
    activation: Annotated[str | None, arg(metavar="NAME")] = None
    """Which of Tanh, ReLU, LeakyReLU, ELU and SiLU computes what the policy's own activation_fn
    does, if it is not one of PyTorch."""
    plan: str | None = None
    """The body plan of a model without a controller: its name, or a JSON file; default aquafish."""
    morphology: BodiesFile = None
    reactive: bool = False
    """Whether the model's water also resists acceleration; see docs/physics.md."""

    def execute(self) -> None:
        """Write the files."""
        if self.c is None and self.model is None:
            raise InvalidArgumentError("give --c FILE.c, --model FILE.c or both")
        if self.c is not None and self.controller is None:
            raise InvalidArgumentError(
                "--c needs a controller.json or a policy's .zip before it; got none"
            )
        zipped = self.controller is not None and self.controller.suffix.lower() == ".zip"
        if not zipped:
            self.refuse_given(["normalize", "activation"], "without the .zip of a policy")
        elif self.model is not None:
            raise InvalidArgumentError(
                f"--model takes the body of a controller.json; a policy has none: {self.controller}"
            )
        if self.model is None:
            self.refuse_given(["plan", "morphology", "reactive"], "without --model")
        elif self.c is not None and self.model.stem.lower() == self.c.stem.lower():
            raise InvalidArgumentError(
                "--c and --model must have two names, which begin those of the functions; "
                f"got {self.c} and {self.model}"
            )
        made: list[CFile] = []
        found = None
        if self.controller is not None and not zipped:
            found = Controller.load(self.controller)
        if self.controller is not None and self.c is not None:
            made.append(
                policy_file(read_policy(self.controller, self.normalize, self.activation), self.c)
                if found is None
                else controller_file(found, self.c)
            )
        if self.model is not None:
            if found is not None:
                self.refuse_given(["plan"], "with a controller, which has a plan of its own")
            plan = check_plan(self.plan or "aquafish") if found is None else found.plan
            bodies: MorphologiesLike = found.morphology if found else Morphology.nominal(plan)
            if self.morphology is not None:
                bodies = read_bodies(self.morphology, "morphology", plan)
            made.append(model_file(bodies, self.model, self.reactive))
        written = [path for file in made for path in file.write()]  # now that none is refused
        for path in written:
            print(printable(f"wrote {path} ({path.stat().st_size} bytes)"))


def export_c(controller: Controller, path: Path | str) -> tuple[Path, Path, Path]:
    """Write a controller as a C file, its header and test vectors; return the three paths.

    It raises what :func:`controller_file` does.
    """
    return controller_file(controller, path).write()


def controller_file(controller: Controller, path: Path | str) -> CFile:
    """Return a controller as a C file to write.

    Raises
    ------
    InvalidArgumentError
        If the file's name is no identifier of C followed by .c, if another file than an exported
        one is there, or if ``controller`` is no ``Controller``.
    """
    instance("controller", controller, Controller)
    source = c_file_path("c", path)
    texts = controller_texts(controller, source.stem)
    rows = np.concatenate(make_vectors(controller, VECTOR_COUNT), axis=1)
    return CFile(source, *texts, (*_columns(controller.senses), *controller.plan.names), rows)


def controller_texts(controller: Controller, name: str) -> tuple[str, str]:
    """Return a controller's C file and header; ``name`` begins the names of its functions."""
    senses = controller.senses
    plan = controller.plan
    fins = len(plan.fins)
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
    sizes = {"imu": 9, "goal": 3, "fin_angles": fins, "servo_gain": fins}
    rows = {"imu": "row", "goal": "row + 9" if senses.imu else "row"}
    most = limits(has_goal=True)
    unit, spin, way = most[[0, 6, 9]] * RANGE_TOLERANCE
    values = {
        "DESCRIPTION": repr(controller),
        "MILLISECONDS": controller.interval * round(1000 * TIMESTEP),
        "INTERVAL": controller.interval,
        "PERIOD": c_float(controller.interval * TIMESTEP),
        "INPUTS": len(controller.inputs),
        "INPUT_NAMES": "\n * ".join(textwrap.wrap(", ".join(controller.inputs), 97)) or "none",
        "NODES": controller.nodes,
        "LAYERS": len(layers),
        "WIDEST": max(layers),
        "LAYER_END": wrapped(accumulate(layers)),
        "FIRST": wrapped(first),
        "SOURCE": wrapped(sources if len(sources) else [0]),
        "WEIGHT": c_floats(controller.weights[nodes, sources] if len(sources) else [0.0]),
        "BIAS": c_floats(controller.bias),
        "RESPONSE": c_floats(controller.response),
        "CLOCK": c_float(controller.clock),
        "HARMONICS": senses.clock,
        "ACTIVATION": activation,
        "RESET_PARAMETERS": "".join(f", const float {x}[{sizes[x]}]" for x in start),
        "RESET_CALL": "".join(f", {x}" for x in start),
        "STEP_PARAMETERS": "".join(f", const float {x}[{sizes[x]}]" for x in given),
        "STEP_CALL": "".join(f", {x}" for x in given),
        "STEP_TEST": "".join(f", {rows[x]}" for x in given),
        "UNIT_LIMIT": c_float(unit),
        "GYRO_LIMIT": c_float(spin),
        "GOAL_LIMIT": c_float(way),
        "RANGES": f"gyroscope {most[6]:.4g} rad/s, goal {most[9]:.4g}",
        "TYPE": "float",
        "FORMAT": "%f",
        "FINS": fins,
        "SERVOS": servo_lines(plan),
        "COMMANDS": _commands(plan),
        "COLUMNS": len(_columns(senses)) + fins,
        "ANSWERS": fins,
        "FIN_ANGLES": c_floats(np.resize(VECTOR_FIN_ANGLES, fins)),
        "SERVO_GAIN": c_floats(np.resize(VECTOR_SERVO_GAIN, fins)),
    }
    parts = {
        "imu": senses.imu,
        "clock": senses.clock > 0,
        "fins": senses.fins,
        "goal": senses.goal,
        "senses": senses.imu or senses.goal,
        "waves": senses.clock > 0 or senses.fins,
        "double": senses.clock > 0 or senses.fins,
        "clip": True,
        "tanh": hidden or not clipped,
    }
    return source_and_header("controller", name, values, parts)


def make_vectors(
    controller: Controller, steps: int, seed: int = 0
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return random observations (steps, n) and the commands (steps, F) that follow, in float32.

    The observations, all in range, are up, north and gyro if the controller has an IMU, then the
    way to the goal if it senses one.
    """
    scale = np.repeat((0.6, 1.0, 10.0), (6, 3, 3))  # goals are units away
    felt = np.random.default_rng(seed).standard_normal((steps, 12)) * scale
    most = limits(has_goal=True)
    observations = np.clip(felt, -most, most).astype(np.float32)
    senses = controller.senses
    seen = observations[:, [*range(9 * senses.imu), *range(9, 9 + 3 * senses.goal)]]
    return seen, answers(controller, observations)


def answers(controller: Controller, observations: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the commands (T, F) that follow observations (T, 12): up, north, gyro, goal.

    The swim begins with ``VECTOR_FIN_ANGLES`` and ``VECTOR_SERVO_GAIN``, which more fins repeat.
    """
    count = len(controller.plan.fins)
    fins = np.resize(VECTOR_FIN_ANGLES, (1, count))
    gains = np.resize(VECTOR_SERVO_GAIN, count)
    agent = ProgramAgent(program_of([controller]), fins, gains, np.float32)
    times = np.arange(len(observations)) * controller.interval * TIMESTEP
    pairs = zip(observations, times.tolist(), strict=True)
    actions = np.array([agent.act(seen[None], time)[0] for seen, time in pairs])
    return np.stack(lane_servo_speeds(controller.plan, tuple(actions.T)), axis=1)


def _commands(plan: BodyPlan) -> str:
    """Return the lines of C that set the command, as ``lane_servo_speeds`` does."""
    middles = (plan.command_low + plan.command_high) / 2
    reaches = (plan.command_high - plan.command_low) / 2
    lines = []
    for i, (middle, reach) in enumerate(zip(middles.tolist(), reaches.tolist(), strict=True)):
        begin = f"{c_float(middle)} + " if middle else ""
        lines.append(f"    command[{i}] = {begin}{c_float(reach)} * action[{i}];")
    return "\n".join(lines)


def _columns(senses: Senses) -> tuple[str, ...]:
    return Senses(imu=senses.imu, clock=0, goal=senses.goal).names()
