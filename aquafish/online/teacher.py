"""The teacher: a policy that is given what broke, evaluated by numpy for P robots at once.

In reinforcement learning a teacher is a policy with privileged inputs (A. Kumar and others, "RMA:
Rapid motor adaptation for legged robots", 2021). This one needs no student: the agent infers
exactly the privileged inputs.
"""

from __future__ import annotations

import base64
import binascii
import copy
import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from aquafish.online import thresholds
from aquafish.online.gaits import load_library
from aquafish_gym.morphology import Morphology
from aquafish_gym.physics.arithmetic import TAU, sine_cosine
from aquafish_gym.physics.compiling import compiled
from aquafish_gym.physics.layout import FIELDS, LEFT, RATES
from aquafish_gym.scenario import TIMESTEP, Scenario
from aquafish_gym.sense import up_and_north
from aquafish_gym.utils.array_types import Floats
from aquafish_gym.utils.storage import read_document, read_packaged, write_document
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    brief,
    file_path,
    finite_array,
    instance,
    sequence,
)
from gait.controllers.controller import Controller
from gait.controllers.network import OUTPUT_GAIN, observe_imu

Singles = NDArray[np.float32]

TEACHER_SCHEMA = "aquafish.teacher/1"
CLOCK = 0.7  # Hz, that of the library's first gait
INTERVAL = 20  # steps of 0.01 s that an action is held
#: Shapes of the weights: ``w`` (out, in) and ``b`` (out,) of each layer.
SHAPES: dict[str, tuple[int, ...]] = {
    "w0": (128, 35),
    "b0": (128,),
    "w1": (64, 128),
    "b1": (64,),
    "w2": (3, 64),
    "b2": (3,),
}
PRIVILEGED = 12  # the last inputs, which are constant in a swim: nine sizes and three servo gains
SENSED = 17  # the first inputs, which are those of the library's first gait
_FIN_ROWS = [row + at for row in range(LEFT, RATES, 2) for at in (1, 0)]  # sine, then cosine
#: What a layer makes of its sums.
LINEAR = 0
HYPERBOLIC_TANGENT = 1
EXPONENTIAL_LINEAR = 2
# Singles, so that compiled code computes with nothing else.
_ZERO, _HALF, _ONE, _EIGHTH = (np.float32(x) for x in (0.0, 0.5, 1.0, 0.125))
_TANH_LIMIT = np.float32(9.0)  # 1 - tanh(9) = 3e-8
_N1, _N2, _N3 = (np.float32(x / 135135) for x in (17325, 378, 1))
_D1, _D2, _D3 = (np.float32(x / 135135) for x in (62370, 3150, 28))
_LARGEST_WEIGHT = float(np.finfo(np.float16).max)


@dataclass(frozen=True, eq=False)
class Teacher:
    """A network with the layers 35, 128, 64, 3 and exponential linear units, given what broke.

    Its inputs are, in this order: the directions up and north in body axes (6); the gyroscope times
    0.5, clipped to [-1, 1] (3); sine and cosine of a clock of 0.7 Hz (2); sine and cosine of the
    three fin angles (6); the previous action (3); the clipped action of the library's first gait
    for these 17 inputs (3); the nine sizes relative to the nominal ones minus 1; the servo gains
    minus 1 (3). The output, clipped to [-1, 1], is the action, which is held for 0.2 s.

    Parameters
    ----------
    weights
        Arrays of the shapes in ``SHAPES``.
    offline
        What its training took: simulated robot ``steps`` of 0.01 s, and CPU ``seconds``.
    curve
        [actions of all robots, mean return of their last episodes] in training.

    Raises
    ------
    InvalidArgumentError
        If a weight is missing, unknown, of another shape, or beyond half precision.
    """

    weights: dict[str, Singles]
    offline: dict[str, float]
    curve: Sequence[Sequence[float]] = ()

    def __post_init__(self) -> None:
        given = instance("weights", self.weights, dict)
        _check_names("weights", given, SHAPES)
        weights = {
            name: finite_array(
                f"weights[{name!r}]", given[name], shape, -_LARGEST_WEIGHT, _LARGEST_WEIGHT
            ).astype(np.float32)
            for name, shape in SHAPES.items()
        }
        offline = instance("offline", self.offline, dict)
        _check_names("offline", offline, ("steps", "seconds"))
        for name, spent in offline.items():
            finite_array(f"offline[{name!r}]", spent, (), 0.0)
        curve: tuple[Sequence[float], ...] = ()
        if len(sequence("curve", self.curve)):
            curve = tuple(map(tuple, finite_array("curve", self.curve, (None, 2)).tolist()))
        vars(self).update(weights=weights, offline=offline, curve=curve)

    @classmethod
    def load(cls, path: Path | str | None = None) -> Self:
        """Read a teacher's file, by default the packaged ``teacher.json``.

        Raises
        ------
        InvalidArgumentError
            If it cannot be read, is damaged, or is no teacher.
        """
        if path is None:
            return cls._packaged("teacher.json")
        file = file_path("teacher", path)
        return cls._from_document(str(file), read_document(file, TEACHER_SCHEMA, "teacher"))

    @classmethod
    def load_any_water(cls) -> Self:
        """Read the packaged teacher that was trained in random water."""
        return cls._packaged("teacher_any_water.json")

    @classmethod
    def _packaged(cls, name: str) -> Self:
        return cls._from_document(name, read_packaged("aquafish.online", name, TEACHER_SCHEMA))

    @classmethod
    def _from_document(cls, name: str, document: dict[str, Any]) -> Self:
        try:
            _check_names("fields", document, ("offline", "curve", "weights"))
            weights = decode_weights(document["weights"], SHAPES)
            return cls(weights, document["offline"], document["curve"])
        except InvalidArgumentError as error:
            raise InvalidArgumentError(f"teacher: {name}: {error}") from None

    def save(self, path: Path | str) -> None:
        """Write a file of some 35 KB: the weights in half precision, as base64."""
        document = {
            "offline": self.offline,
            "curve": self.curve,
            "weights": encode_weights(self.weights),
        }
        write_document(file_path("path", path), document, TEACHER_SCHEMA)


def encode_weights(weights: Mapping[str, Singles]) -> dict[str, str]:
    """Return arrays in half precision, as base64."""
    return {
        name: base64.b64encode(value.astype("<f2").tobytes()).decode()
        for name, value in weights.items()
    }


def decode_weights(given: object, shapes: Mapping[str, tuple[int, ...]]) -> dict[str, Singles]:
    """Return arrays of some shapes, as :func:`encode_weights` gives them.

    Raises
    ------
    InvalidArgumentError
        If an array is missing, unknown, or no base64 of its shape.
    """
    texts = instance("weights", given, dict)
    _check_names("weights", texts, shapes)
    return {name: _decoded(name, texts[name], shape) for name, shape in shapes.items()}


def _check_names(argument: str, given: Mapping[str, Any], wanted: Sequence[str] | Any) -> None:
    if set(given) != set(wanted):
        raise InvalidArgumentError(
            f"{argument} must be named {', '.join(wanted)}; got {brief(sorted(given))}"
        )


def _decoded(name: str, text: object, shape: tuple[int, ...]) -> Singles:
    """Return an array of half precision from base64."""
    try:
        numbers = np.frombuffer(base64.b64decode(instance(name, text, str), validate=True), "<f2")
        return numbers.astype(np.float32).reshape(shape)
    except (binascii.Error, ValueError):
        raise InvalidArgumentError(
            f"weights[{name!r}] must be base64 of {shape} numbers of half precision; "
            f"got {brief(text)}"
        ) from None


class TeacherNetwork:
    """A teacher that acts for P robots of the same sizes, which differ in seven numbers each.

    Each begins with its clock at 0. The arrays are allocated once: a swim in imagination has
    hundreds of actions.

    Parameters
    ----------
    teacher
        Its weights.
    numbers
        (P, 7) changes of the teacher in standard deviations; see ``TEACHER_NUMBER_SCALES``.
    robot
        A scenario of one: what broke.
    previous
        (3,) the action before the first.
    """

    # Rows of the values: the library gait's action, the previous action, 1 (for the biases), the 17
    # inputs of that gait, and its hidden nodes. The teacher's network has the rows up to the
    # inputs, the gait's the rows from the 1 on.
    _BASE = slice(0, 3)
    _PREVIOUS = slice(3, 6)
    _ONE = 6
    _SENSED = slice(7, 7 + SENSED)
    _CLOCK = _SENSED.start + 9
    _FINS = slice(_CLOCK + 2, _SENSED.stop)

    def __init__(
        self, teacher: Teacher, numbers: Floats, robot: Scenario, previous: NDArray[np.floating]
    ) -> None:
        self._weights = teacher.weights
        self._gait = _gait_matrices()
        changes = numbers * thresholds.TEACHER_NUMBER_SCALES
        count = len(changes)
        self._offset = np.ascontiguousarray(changes[:, :3].T, np.float32)
        #: (P,) that the clock makes in an action, rad.
        self.clock_step: Floats = TAU * CLOCK * INTERVAL * TIMESTEP * np.exp(changes[:, 3])
        self._turn = _turns(changes[:, 4:6])
        self.phase: Floats = changes[:, 6].copy()  #: (P,) of the clock at the next action, rad.
        nodes = sum(weights.shape[1] for weights in self._gait[:-1])
        self._values = np.ones((self._SENSED.stop + nodes, count), np.float32)
        self._values[self._PREVIOUS] = previous[:, None]
        self._hidden = [np.ones((n + 1, count), np.float32) for n in (128, 64)]
        self._middle, self._last = (
            _transposed(np.hstack([self._weights[f"w{i}"], self._weights[f"b{i}"][:, None]]))
            for i in (1, 2)
        )
        self.inform(robot)

    def inform(self, robot: Scenario) -> None:
        """Replace the sizes and servo gains by those of one robot."""
        sizes = robot.body[0] / Morphology.nominal().to_array() - 1.0
        broken = np.concatenate([sizes, robot.servo_gain[0] - 1.0]).astype(np.float32)
        w0 = self._weights["w0"]
        known = np.empty((len(w0), 1), np.float32)
        _respond(_transposed(w0[:, -PRIVILEGED:]), broken[:, None], known, LINEAR)
        known += self._weights["b0"][:, None]
        sensed, previous, base = np.split(w0[:, :-PRIVILEGED], (SENSED, SENSED + 3), axis=1)
        self._first = _transposed(np.hstack([base, previous, known, sensed]))

    def act(self, states: NDArray[np.floating]) -> Singles:
        """Return the next actions (3, P), in [-1, 1], in states (25, P); a view of its memory."""
        values = self._values
        turned = np.einsum("ijp,jp->ip", self._turn, states[FIELDS["orientation"]])
        up, north = up_and_north(tuple(turned))
        observe_imu(values, self._SENSED.start, up, north, tuple(states[FIELDS["spin"]]))
        values[self._CLOCK], values[self._CLOCK + 1] = sine_cosine(self.phase / TAU)
        self.phase += self.clock_step
        values[self._FINS] = states[_FIN_ROWS]
        end = self._SENSED.stop
        for weights in self._gait[:-1]:
            nodes = values[end : end + weights.shape[1]]
            _respond(weights, values[self._ONE : end], nodes, HYPERBOLIC_TANGENT)
            end += len(nodes)
        base = values[self._BASE]
        _respond(self._gait[-1], values[self._ONE : end], base, LINEAR)
        np.clip(base, -1.0, 1.0, out=base)
        below = values[: self._SENSED.stop]
        for weights, hidden in zip((self._first, self._middle), self._hidden, strict=True):
            _respond(weights, below, hidden[:-1], EXPONENTIAL_LINEAR)
            below = hidden
        action = values[self._PREVIOUS]
        _respond(self._last, below, action, LINEAR)
        action += self._offset
        return np.clip(action, -1.0, 1.0, out=action)

    def copy(self) -> Self:
        """Return a network that goes on from here, without effect on this one."""
        other = copy.copy(self)
        other._values = self._values.copy()
        other.phase = self.phase.copy()
        return other


@functools.partial(compiled, error_model="numpy")
def _tanh(z: Any) -> Any:
    """Return tanh z in single precision: the Pade approximant [7/6] of tanh(z / 8), doubled thrice.

    See :func:`gait.controllers.network.tanh`.
    """
    y = min(max(z, -_TANH_LIMIT), _TANH_LIMIT) * _EIGHTH
    q = y * y
    n = y * (_ONE + q * (_N1 + q * (_N2 + q * _N3)))
    d = _ONE + q * (_D1 + q * (_D2 + q * _D3))
    for _ in range(3):
        n, d = n * d + n * d, d * d + n * n
    return n / d


@functools.partial(compiled, error_model="numpy")
def _respond(weights: Singles, values: Singles, nodes: Singles, kind: int) -> None:
    """Put into ``nodes`` (N, P) what a layer of weights (M, N) makes of ``values`` (M, P).

    Each sum is taken in the order of the M values, and no function of a mathematical library is
    called: so the numbers are the same on every processor.
    """
    sums = np.empty(weights.shape[1], np.float32)
    for p in range(values.shape[1]):
        sums[:] = _ZERO
        for i in range(values.shape[0]):
            value = values[i, p]
            row = weights[i]
            for j in range(sums.size):
                sums[j] += row[j] * value
        if kind == HYPERBOLIC_TANGENT:
            for j in range(sums.size):
                sums[j] = _tanh(sums[j])
        elif kind == EXPONENTIAL_LINEAR:  # exp(z) - 1 = 2 t / (1 - t), where t = tanh(z / 2)
            for j in range(sums.size):
                t = _tanh(_HALF * min(sums[j], _ZERO))
                sums[j] = max(sums[j], _ZERO) + (t + t) / (_ONE - t)
        nodes[:, p] = sums


def _transposed(matrix: Singles) -> Singles:
    return np.ascontiguousarray(matrix.T)


@functools.cache
def _gait_matrices() -> list[Singles]:
    return [_transposed(matrix) for matrix in dense_layers(load_library()[0])]


def dense_layers(gait: Controller) -> list[Singles]:
    """Return the matrix (nodes, 1 + inputs + earlier nodes) of each layer of a controller.

    The first column is the bias. The controller must have layers and no memory.
    """
    inputs = len(gait.senses.names)
    ends = np.cumsum((0, *(gait.layers or ()))).tolist()
    return [
        np.hstack(
            [
                OUTPUT_GAIN * gait.bias[begin:end, None],
                OUTPUT_GAIN
                * gait.response[begin:end, None]
                * gait.weights[begin:end, : inputs + begin],
            ]
        ).astype(np.float32)
        for begin, end in pairwise(ends)
    ]


def _turns(angles: Floats) -> Singles:
    """Return matrices (4, 4, P) that turn the world of orientations by yaws and pitches (P, 2)."""
    x, y, z, w = Rotation.from_euler("ZX", angles).as_quat().T
    rows = [[w, -z, y, x], [z, w, -x, y], [-y, x, w, z], [-x, -y, -z, w]]
    return np.array(rows, np.float32)


def check_teachers(
    teachers: object, packaged: bool, hold: int
) -> tuple[Teacher, Teacher] | tuple[()]:
    """Return the teachers beside a library, which may be the packaged one."""
    if teachers is None:
        return (Teacher.load(), Teacher.load_any_water()) if packaged else ()
    given = sequence("teachers", teachers)
    if not len(given):
        return ()
    if len(given) != 2:
        raise InvalidArgumentError(
            f"teachers must be two, for known water and for any other, or none; got {len(given)}"
        )
    if hold != INTERVAL:
        raise InvalidArgumentError(f"teachers need a hold of {INTERVAL} steps; got {hold}")
    known, foreign = (instance("teachers", one, Teacher) for one in given)
    return known, foreign
