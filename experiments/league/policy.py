"""The learned rival, RMA, as plain numbers that numpy evaluates, and what entrants share.

A. Kumar, Z. Fu, D. Pathak, J. Malik, RMA: Rapid Motor Adaptation for Legged Robots, RSS 2021.
``experiments.league.policies`` trains it and writes its files; ``experiments.league.students`` says
in what it departs from the paper.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish.online.gaits import load_library
from aquafish.online.teacher import Teacher, decode_weights, encode_weights, shapes_of
from aquafish_gym.plans import AQUAFISH
from aquafish_gym.scenario import CHANNELS, TIMESTEP
from aquafish_gym.utils.storage import read_document, write_document
from gait.controllers.agents import ControllerAgent
from gait.controllers.controller import Controller
from gait.controllers.inputs import NetworkInputs
from gait.controllers.network import OUTPUT_GAIN, Senses

Floats = NDArray[np.float64]
Numbers = NDArray[np.float32]

SEEDS = 3  # of the training in known water
ANY_WATER = "any-water"
TWINS = ("0", ANY_WATER, *map(str, range(1, SEEDS)))  # pairs of teacher and student
STUDENT_SCHEMA = "aquafish.student/1"
SENSES = Senses(fins=True)  # of ``PPO, fins``
INPUTS = len(SENSES.names()) + 6  # of a policy: also its previous action, and the gait's
CLOCK = 0.7  # Hz, of ``PPO, fins``
INTERVAL = 20  # steps of 0.01 s of an action
DT = INTERVAL * TIMESTEP  # s of an action
CELLS = 96  # of the student's memory
CHANGE_SCALE = 8.0  # of the difference between a frame and the one before
ESTIMATES = 30  # corrections of nine readings, turns of fins, what broke, and of the action
#: Shapes of a student's weights: ``w`` (out, in) and ``b`` (out,) of each layer. Those of the
#: memory, a gated recurrent unit, are its gates' in torch's order: reset, update, new.
SHAPES: dict[str, tuple[int, ...]] = {
    "enter_w": (CELLS, 2 * INPUTS),
    "enter_b": (CELLS,),
    "in_w": (3 * CELLS, CELLS),
    "in_b": (3 * CELLS,),
    "back_w": (3 * CELLS, CELLS),
    "back_b": (3 * CELLS,),
    "mix_w": (CELLS, CELLS + INPUTS),
    "mix_b": (CELLS,),
    "estimate_w": (ESTIMATES, CELLS),
    "estimate_b": (ESTIMATES,),
}


class Offline(NamedTuple):
    """What was spent on an entrant before its first episode."""

    steps: int = 0  #: Simulated robot steps of 0.01 s.
    seconds: float = 0.0  #: CPU time.


def begin_inputs(fin_angles: Floats) -> NetworkInputs:
    """Return the inputs of networks with ``SENSES`` of B robots, at fin angles (B, 3), rad."""
    return NetworkInputs(SENSES, CLOCK, INTERVAL, fin_angles)


def drive(gait: Controller, seen: NDArray[Any]) -> NDArray[Any]:
    """Return the outputs (B, 3), before they are clipped, of a feed-forward controller.

    ``seen`` (B, 17) are the inputs; the outputs have their precision.
    """
    values = seen
    begin = 0
    for count in gait.layers or ():
        rows = slice(begin, begin + count)
        weights = gait.weights[rows, : values.shape[1]].astype(seen.dtype)
        z = OUTPUT_GAIN * (gait.bias[rows].astype(seen.dtype) + values @ weights.T)
        values = np.hstack([values, np.tanh(z)])
        begin = rows.stop
    return np.asarray(z)


def known_or_zero(fin_angles: ArrayLike | None) -> Floats:
    """Return fin angles (1, 3); 0 if they are None."""
    return np.zeros((1, 3)) if fin_angles is None else np.reshape(fin_angles, (1, 3))


class FixedGait(ControllerAgent):
    """One controller in one episode, which takes unknown fin angles for 0."""

    def begin(self, fin_angles: ArrayLike | None) -> None:
        """Begin an episode."""
        self.reset({"fin_angles": known_or_zero(fin_angles)})


@dataclass(frozen=True, eq=False)
class Student:
    """A network that estimates what its teacher is told from what a robot senses.

    Attributes
    ----------
    teacher
        The student's copy of it, which acts on the estimates and has learned with the student.
    weights
        Arrays of the shapes in ``SHAPES``.
    offline
        What its training took, without its teacher's.
    curve
        [actions of all robots, mean pace in a test, units/s] in training.
    """

    teacher: Teacher
    weights: dict[str, Numbers]
    offline: Offline
    curve: tuple[tuple[float, float], ...] = ()

    def save(self, path: Path) -> None:
        """Write a file of weights in half precision."""
        document = {
            "offline": self.offline._asdict(),
            "curve": self.curve,
            "teacher": {
                "offline": self.teacher.offline,
                "weights": encode_weights(self.teacher.weights),
            },
            "weights": encode_weights(self.weights),
        }
        write_document(path, document, STUDENT_SCHEMA, indent=None)

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a file of weights."""
        data: dict[str, Any] = read_document(path, STUDENT_SCHEMA, "student")
        offline = Offline(**data["offline"])
        teacher = Teacher(
            decode_weights(data["teacher"]["weights"], shapes_of(AQUAFISH)),
            data["teacher"]["offline"],
        )
        curve = tuple((steps, pace) for steps, pace in data["curve"])
        return cls(teacher, decode_weights(data["weights"], SHAPES), offline, curve)


class StudentAgent:
    """A student in one episode, which takes unknown fin angles for 0."""

    def __init__(self, student: Student) -> None:
        self._student = student
        self._gait = load_library()[0]

    def begin(self, fin_angles: ArrayLike | None) -> None:
        """Begin an episode."""
        self._inputs = begin_inputs(known_or_zero(fin_angles))
        self._action: Numbers = np.zeros((1, 3), np.float32)
        self._cells: Numbers = np.zeros(CELLS, np.float32)
        self._before: Numbers | None = None

    def act(self, observation: ArrayLike) -> Floats:
        """Return the teacher's action for what the student estimates, and what it adds to it."""
        readings = np.asarray(observation, float)[None, : len(CHANNELS)]
        seen = self._inputs.observe(readings).astype(np.float32)
        now = np.hstack([seen, self._action, self._base(seen)])[0]
        before = now if self._before is None else self._before
        self._before = now
        action = self._respond(now, before)
        self._action = np.clip(action, -1.0, 1.0)[None]
        self._inputs.follow(self._action)
        return np.asarray(self._action[0], np.float64)

    def _base(self, seen: Numbers) -> Numbers:
        return np.asarray(drive(self._gait, seen).clip(-1.0, 1.0))

    def _respond(self, now: Numbers, before: Numbers) -> Numbers:
        """Return the action (3,), not clipped, for what is sensed now and before, (23,) each."""
        w = self._student.weights
        change = CHANGE_SCALE * (now - before)
        entered = elu(w["enter_w"] @ np.hstack([now, change]) + w["enter_b"])
        inside = np.split(w["in_w"] @ entered + w["in_b"], 3)
        back = np.split(w["back_w"] @ self._cells + w["back_b"], 3)
        keep = _sigmoid(inside[1] + back[1])
        new = np.tanh(inside[2] + _sigmoid(inside[0] + back[0]) * back[2])
        self._cells = (1.0 - keep) * new + keep * self._cells
        mixed = elu(w["mix_w"] @ np.hstack([self._cells, now]) + w["mix_b"])
        found = w["estimate_w"] @ mixed + w["estimate_b"]
        imu = now[:9] + found[:9]
        imu[6:] = imu[6:].clip(-1.0, 1.0)
        turn = found[9:15].reshape(3, 2) + np.array([0.0, 1.0], np.float32)
        turn /= np.linalg.norm(turn, axis=1, keepdims=True) + 1e-4
        sine, cosine = now[11:17].reshape(3, 2).T
        fins = np.stack(
            [sine * turn[:, 1] + cosine * turn[:, 0], cosine * turn[:, 1] - sine * turn[:, 0]], 1
        )
        inputs = np.hstack([imu, now[9:11], fins.ravel()])
        base = self._base(inputs[None])[0]
        told = np.hstack([inputs, now[17:20], base, found[15:27]])
        t = self._student.teacher.weights
        hidden = elu(t["w1"] @ elu(t["w0"] @ told + t["b0"]) + t["b1"])
        return np.asarray(t["w2"] @ hidden + t["b2"] + found[27:])


def elu(x: Numbers) -> Numbers:
    """Return the exponential linear unit."""
    return np.where(x > 0.0, x, np.expm1(np.minimum(x, 0.0)))


def _sigmoid(x: Numbers) -> Numbers:
    return np.asarray(0.5 + 0.5 * np.tanh(0.5 * x))
