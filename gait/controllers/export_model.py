"""A robot's model as a C99 file for a microcontroller, with test vectors.

``model.c`` holds the functions of ``aquafish_gym.code_generation`` and a prediction. The test
vectors are what float64 lanes swim, and both agree to the bit.
"""

from __future__ import annotations

import re
import textwrap
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.bodies import MorphologiesLike, body_array
from aquafish_gym.code_generation import CHANNELS_WITH_GOAL, robot_code
from aquafish_gym.engines.compiled.lanes import LaneBatch
from aquafish_gym.morphology import Morphology
from aquafish_gym.physics.layout import FIELDS, layout
from aquafish_gym.physics.printing import C99
from aquafish_gym.plans import BodyPlan, plan_of
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.validation import InvalidArgumentError, flag
from gait.controllers.c_files import CFile, c_file_path, servo_lines, source_and_header, wrapped
from gait.controllers.network import Senses

# Of the test vectors: a swim in which every number counts.
VECTOR_COUNT = 1000
VECTOR_INTERVAL = 5  # steps of 0.01 s
VECTOR_FIN_ANGLES = (0.5, -1.0, 2.0)  # rad
VECTOR_CURRENT = (0.05, -0.1, 0.02)  # units/s
VECTOR_SERVO_GAIN = (1.0, 0.75, 1.25)
VECTOR_DRAG = (0.9, 1.1)
VECTOR_DENSITY = 1.5
VECTOR_GOAL = (20.0, 30.0, -10.0)  # units

# What the operations of a step are, for the head of the file.
_WORDS = {
    "fma": "fused multiply-adds",
    "multiply": "products",
    "add": "sums",
    "negate": "negations",
    "subtract": "differences",
    "square_root": "square roots",
    "divide": "divisions",
    "abs": "absolute values",
    "where_less": "choices",
}


def export_model(
    bodies: MorphologiesLike, path: Path | str, reactive: bool = False
) -> tuple[Path, Path, Path]:
    """Write a model as a C file, its header and test vectors; return the three paths.

    It takes and raises what :func:`model_file` does.
    """
    return model_file(bodies, path, reactive).write()


def model_file(bodies: MorphologiesLike, path: Path | str, reactive: bool = False) -> CFile:
    """Return a model as a C file to write.

    Parameters
    ----------
    bodies
        One body or several of one plan, such as a posterior sample, all of which the file holds.
        The vectors are the first one's.
    path
        The C file. Its name is the prefix of its functions.
    reactive
        Whether the water also resists acceleration.

    Raises
    ------
    InvalidArgumentError
        If the file's name is no identifier of C followed by .c, if another file than an exported
        one is there, if one is not a body, or if there is none.
    """
    plan = plan_of(bodies)
    rows = body_array(bodies, "bodies", plan)
    if not len(rows):
        raise InvalidArgumentError("bodies must be one or more; got none")
    flag("reactive", reactive)
    file = c_file_path("model", path)
    texts = model_texts(plan, rows, file.stem, reactive)
    commands, seen = model_vectors(Morphology.from_array(rows[0], plan), VECTOR_COUNT, reactive)
    vectors = np.concatenate([commands, seen], axis=1).tolist()
    columns = (*plan.names, *Senses(clock=0, goal=True).names())
    return CFile(file, *texts, columns, vectors)


def model_texts(
    plan: BodyPlan, bodies: NDArray[np.float64], name: str, reactive: bool = False
) -> tuple[str, str]:
    """Return the C file and header of bodies (M, S); ``name`` begins the names of the functions."""
    code = robot_code(plan)
    fins = len(plan.fins)
    swim = code.step_reactive if reactive else code.step
    operations = code.traced(swim).operations
    numbers = len(code.traced(swim).lines)
    counts = [f"{count} {_WORDS[operation]}" for operation, count in operations.most_common()]
    functions = code.source(C99, code.robot_rows, code.start, swim, code.sense, prefix="NAME_")
    functions = functions.replace("NAME_step_reactive", "NAME_step")
    heads = re.findall(r"^void \w+\(.*\)$", functions, re.MULTILINE)
    values = {
        "BODIES": "a body" if len(bodies) == 1 else f"{len(bodies)} bodies, a sample",
        "LAW": ", with the added mass of the water" if reactive else "",
        "OPERATIONS": operations.total(),
        "COUNTS": "\n * ".join(textwrap.wrap(", ".join(counts), 95)),
        "NUMBERS": numbers,
        "STACK": f"{8 * numbers / 1024:.0f}",
        "STATE_BYTES": 8 * layout(plan).state_numbers,
        "ROBOT_BYTES": 8 * layout(plan).robot_rows,
        "STATE_NUMBERS": layout(plan).state_numbers,
        "ROBOT_NUMBERS": layout(plan).robot_rows,
        "CHANNELS": CHANNELS_WITH_GOAL,
        "BODY_COUNT": len(bodies),
        "SIZES": "\n" + ",\n".join(f"    {{{wrapped(row)}}}" for row in bodies.tolist()) + "\n",
        "FUNCTIONS": functions,
        "PROTOTYPES": "\n".join(f"{head};" for head in heads),
        "DENSITY": VECTOR_DENSITY,
        "DRAG": wrapped(VECTOR_DRAG),
        "FIN_ANGLES": wrapped(_of_fins(VECTOR_FIN_ANGLES, plan)),
        "SERVO_GAIN": wrapped(_of_fins(VECTOR_SERVO_GAIN, plan)),
        "CURRENT": wrapped(VECTOR_CURRENT),
        "GOAL": wrapped(VECTOR_GOAL),
        "INTERVAL": VECTOR_INTERVAL,
        "TYPE": "double",
        "FORMAT": "%lf",
        "FINS": fins,
        "SERVOS": servo_lines(plan),
        "SIZE_COUNT": len(plan.dimensions),
        "DIMENSIONS": "\n *            ".join(
            textwrap.wrap(", ".join(d.name for d in plan.dimensions), 86)
        ),
        "COLUMNS": fins + CHANNELS_WITH_GOAL,
        "ANSWERS": CHANNELS_WITH_GOAL,
    }
    return source_and_header("model", name, values, {"double": True})


def _of_fins(numbers: tuple[float, ...], plan: BodyPlan) -> list[float]:
    """Return a number for each fin; more fins repeat them."""
    found: list[float] = np.resize(numbers, len(plan.fins)).tolist()
    return found


def model_vectors(
    body: Morphology, count: int, reactive: bool = False, seed: int = 0
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return random commands (K, F) and what float64 lanes sense after each, (K, 12)."""
    plan = body.plan
    commands = np.random.default_rng(seed).uniform(
        plan.command_low, plan.command_high, (count, len(plan.fins))
    )
    scenario = Scenario.create(
        body,
        plan=plan,
        current=VECTOR_CURRENT,
        drag=VECTOR_DRAG,
        fin_density=VECTOR_DENSITY,
        servo_gain=_of_fins(VECTOR_SERVO_GAIN, plan),
        reactive=reactive,
    )
    lanes = LaneBatch(scenario, np.float64)
    begin = [0.0] * layout(plan).state_numbers
    code = robot_code(plan)
    code.start(_of_fins(VECTOR_FIN_ANGLES, plan), begin)
    lanes.states[: layout(plan).state_numbers, 0] = begin
    log = lanes.log(commands[None], count * VECTOR_INTERVAL, "pose", VECTOR_INTERVAL)
    states = np.zeros((count, layout(plan).state_numbers))
    for field, samples in (
        ("orientation", log.quaternion),
        ("position", log.position),
        ("spin", log.gyro),
    ):
        assert samples is not None  # recorded with the pose
        states[:, FIELDS[field]] = samples[0, VECTOR_INTERVAL - 1 :: VECTOR_INTERVAL]
    seen = [[0.0] * CHANNELS_WITH_GOAL for _ in range(count)]
    for state, row in zip(states.tolist(), seen, strict=True):
        code.sense(state, list(VECTOR_GOAL), row)
    return commands, np.array(seen)
