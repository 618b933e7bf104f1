"""Gaits of a teacher: its network and seven numbers, imagined, refined, and swum."""

from __future__ import annotations

import copy
import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from aquafish.online import thresholds
from aquafish.online.gaits import NORTHING, Effort, Search, load_library
from aquafish.online.teacher import INTERVAL, PRIVILEGED, SENSED, Teacher
from aquafish_gym.command import servo_speeds
from aquafish_gym.engines.compiled.lanes import LaneBatch
from aquafish_gym.morphology import Morphology
from aquafish_gym.physics.arithmetic import TAU, sine_cosine
from aquafish_gym.physics.layout import FIELDS, JOINTS
from aquafish_gym.plans import AQUAFISH
from aquafish_gym.scenario import TIMESTEP, Scenario
from aquafish_gym.sense import up_and_north
from aquafish_gym.utils.array_types import Floats
from gait.controllers.dense import (
    EXPONENTIAL_LINEAR,
    HYPERBOLIC_TANGENT,
    LINEAR,
    Singles,
    columns,
    layer,
    layers_of,
)
from gait.controllers.network import observe_imu
from gait.search.cma import evolution_strategy
from gait.swims.scores import penalize_diverged

CLOCK = 0.7  # Hz, that of the library's first gait
_PHASE = 6  # of the numbers
_FIN_ROWS = [
    JOINTS + 2 * fin + at for fin in range(len(AQUAFISH.fins)) for at in (1, 0)
]  # sine, then cosine


@dataclass(frozen=True, eq=False)
class TeacherGait:
    """A gait: a teacher with seven numbers; see ``thresholds.TEACHER_NUMBER_SCALES``."""

    name: ClassVar[str] = "the teacher"
    refinable: ClassVar[bool] = True

    teacher: Teacher
    numbers: Floats

    @classmethod
    def of(cls, teacher: Teacher) -> Self:
        """Return the teacher as it was trained."""
        return cls(teacher, np.zeros(len(thresholds.TEACHER_NUMBER_SCALES)))

    def phases(self) -> list[TeacherGait]:
        """Return it in eight phases of its clock."""
        return [
            self.at_phase(
                float(self.numbers[_PHASE] * thresholds.TEACHER_NUMBER_SCALES[_PHASE])
                + TAU * k / thresholds.TEACHER_PHASES
            )
            for k in range(thresholds.TEACHER_PHASES)
        ]

    def at_phase(self, phase: float) -> TeacherGait:
        """Return it with a clock that begins at a phase, rad."""
        numbers = self.numbers.copy()
        numbers[_PHASE] = phase % TAU / thresholds.TEACHER_NUMBER_SCALES[_PHASE]
        return TeacherGait(self.teacher, numbers)

    def begin(self, robot: Scenario, previous: NDArray[np.floating]) -> TeacherSwimmer:
        """Return an agent that swims it, beginning now, after the ``previous`` action (3,)."""
        network = TeacherNetwork(self.teacher, self.numbers[None], robot, previous)
        return TeacherSwimmer(self, robot, network)

    @staticmethod
    def ahead(
        gaits: Sequence[TeacherGait],
        robot: Scenario,
        state: Floats,
        seconds: float,
        previous: NDArray[np.floating],
    ) -> Floats:
        """Return how far (P,) gaits of one teacher swim along +y from a state (25,), in units.

        ``robot`` is a scenario of one, whose sizes they are given, and ``previous`` (3,) the action
        before.
        """
        numbers = np.array([gait.numbers for gait in gaits])
        network = TeacherNetwork(gaits[0].teacher, numbers, robot, previous)
        robots = robot.take(np.zeros(len(numbers), np.intp))
        lanes = LaneBatch(robots, threads=1, states=state[:, None])
        with np.errstate(over="ignore", invalid="ignore"):  # of robots that diverge
            for _ in range(round(seconds / (INTERVAL * TIMESTEP))):
                action = network.act(lanes.states)
                lanes.advance(np.array(servo_speeds(AQUAFISH, tuple(action))).T, INTERVAL)
        far = lanes.states[NORTHING].astype(np.float64) - state[NORTHING]
        return penalize_diverged(far, seconds)

    def search(self, effort: Effort, seconds: float, rng: np.random.Generator) -> Search:
        """Return a search over the numbers.

        The generations are those of a swim of 40 s; a shorter swim has more of them.
        """
        most = effort.teacher_generations
        actions = round(seconds / (INTERVAL * TIMESTEP))
        count = min(
            math.ceil(most * thresholds.BUDGET_ACTIONS / actions),
            thresholds.MOST_GENERATIONS_RATIO * most,
        )
        source = np.random.default_rng(int(rng.integers(2**32)))
        sigma = thresholds.TEACHER_FIRST_SIGMA if effort.every else thresholds.TEACHER_LATER_SIGMA
        strategy = evolution_strategy(self.numbers, thresholds.TEACHER_POPULATION, source, sigma)
        return Search(strategy, count, mean_every=count)

    def near(self, vectors: Sequence[Floats], robot: Scenario) -> list[TeacherGait]:  # noqa: ARG002
        """Return the gaits with numbers that are the vectors of the search."""
        return [TeacherGait(self.teacher, vector) for vector in vectors]


@dataclass
class TeacherSwimmer:
    """An agent that swims a teacher's gait of a robot, a scenario of one that it was told last."""

    gait: TeacherGait
    robot: Scenario
    network: TeacherNetwork

    def act(self, robot: Scenario, state: Floats) -> NDArray[np.float32]:
        """Return the next action (3,), in [-1, 1], of a robot in a state (25,)."""
        if robot is not self.robot:
            self.robot = robot
            self.network.inform(robot)
        return self.network.act(state[:, None])[:, 0].copy()

    def after(self, actions: int) -> TeacherGait:
        """Return its gait with the phase that its clock will have after some actions."""
        network = self.network
        return self.gait.at_phase(float(network.phase[0] + actions * network.clock_step[0]))

    def copy(self) -> Self:
        """Return an agent that goes on from here, without effect on this one."""
        return replace(self, network=self.network.copy())


class TeacherNetwork:
    """A teacher that acts for P robots of the same sizes, which differ in seven numbers each.

    Each begins with its clock at 0. The arrays are allocated once: a swim in imagination has
    hundreds of actions.

    Parameters
    ----------
    teacher
        Its weights.
    numbers
        (P, 7) changes of the teacher in standard deviations; see
        ``thresholds.TEACHER_NUMBER_SCALES``.
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
        self._gait = _first_gait()
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
            columns(np.hstack([self._weights[f"w{i}"], self._weights[f"b{i}"][:, None]]))
            for i in (1, 2)
        )
        self.inform(robot)

    def inform(self, robot: Scenario) -> None:
        """Replace the sizes and servo gains by those of one robot."""
        sizes = robot.body[0] / Morphology.nominal().to_array() - 1.0
        broken = np.concatenate([sizes, robot.servo_gain[0] - 1.0]).astype(np.float32)
        w0 = self._weights["w0"]
        known = np.empty((len(w0), 1), np.float32)
        layer(columns(w0[:, -PRIVILEGED:]), broken[:, None], known, LINEAR)
        known += self._weights["b0"][:, None]
        sensed, previous, base = np.split(w0[:, :-PRIVILEGED], (SENSED, SENSED + 3), axis=1)
        self._first = columns(np.hstack([base, previous, known, sensed]))

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
            layer(weights, values[self._ONE : end], nodes, HYPERBOLIC_TANGENT)
            end += len(nodes)
        base = values[self._BASE]
        layer(self._gait[-1], values[self._ONE : end], base, LINEAR)
        np.clip(base, -1.0, 1.0, out=base)
        below = values[: self._SENSED.stop]
        for weights, hidden in zip((self._first, self._middle), self._hidden, strict=True):
            layer(weights, below, hidden[:-1], EXPONENTIAL_LINEAR)
            below = hidden
        action = values[self._PREVIOUS]
        layer(self._last, below, action, LINEAR)
        action += self._offset
        return np.clip(action, -1.0, 1.0, out=action)

    def copy(self) -> Self:
        """Return a network that goes on from here, without effect on this one."""
        other = copy.copy(self)
        other._values = self._values.copy()
        other.phase = self.phase.copy()
        return other


@functools.cache
def _first_gait() -> list[Singles]:
    return layers_of(load_library()[0])


def _turns(angles: Floats) -> Singles:
    """Return matrices (4, 4, P) that turn the world of orientations by yaws and pitches (P, 2)."""
    x, y, z, w = Rotation.from_euler("ZX", angles).as_quat().T
    rows = [[w, -z, y, x], [z, w, -x, y], [-y, x, w, z], [-x, -y, -z, w]]
    return np.array(rows, np.float32)
