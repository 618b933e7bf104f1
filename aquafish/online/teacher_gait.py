"""Gaits of a teacher: its network and a few numbers, imagined, refined, and swum."""

from __future__ import annotations

import copy
import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from aquafish.online import thresholds
from aquafish.online.gaits import NORTHING, Effort, Search
from aquafish.online.teacher import HIDDEN, INTERVAL, Teacher, first_gait, privileged, sensed
from aquafish_gym.command import servo_speeds
from aquafish_gym.engines.compiled.lanes import LaneBatch
from aquafish_gym.physics.arithmetic import TAU, clip, sine_cosine
from aquafish_gym.physics.compiling import compiled_function, register_functions
from aquafish_gym.physics.layout import SPIN, layout
from aquafish_gym.plans import BodyPlan
from aquafish_gym.scenario import TIMESTEP, Scenario
from aquafish_gym.sense import up_and_north
from aquafish_gym.utils.array_types import Floats
from gait.controllers.dense import (
    EXPONENTIAL_LINEAR,
    HYPERBOLIC_TANGENT,
    LINEAR,
    ONE,
    Singles,
    columns,
    layer,
    layers_of,
)
from gait.controllers.network import observe_imu
from gait.search.cma import evolution_strategy
from gait.swims.scores import penalize_diverged


def number_scales(plan: BodyPlan) -> Floats:
    """Return the standard deviations (F + 4,) of the numbers of a teacher's gait.

    They are an offset of each action, and the others of ``thresholds.TEACHER_NUMBER_SCALES``.
    """
    offset, *others = thresholds.TEACHER_NUMBER_SCALES
    return np.array([offset] * len(plan.fins) + others)


@dataclass(frozen=True, eq=False)
class TeacherGait:
    """A gait: a teacher with numbers (F + 4,); see :func:`number_scales`."""

    name: ClassVar[str] = "the teacher"
    refinable: ClassVar[bool] = True

    teacher: Teacher
    numbers: Floats

    @classmethod
    def of(cls, teacher: Teacher) -> Self:
        """Return the teacher as it was trained."""
        return cls(teacher, np.zeros_like(number_scales(teacher.plan)))

    def phases(self) -> list[TeacherGait]:
        """Return it in eight phases of its clock."""
        phase = float(self.numbers[-1] * number_scales(self.teacher.plan)[-1])
        count = thresholds.TEACHER_PHASES
        return [self.at_phase(phase + TAU * k / count) for k in range(count)]

    def at_phase(self, phase: float) -> TeacherGait:
        """Return it with a clock that begins at a phase, rad."""
        numbers = self.numbers.copy()
        numbers[-1] = phase % TAU / number_scales(self.teacher.plan)[-1]
        return TeacherGait(self.teacher, numbers)

    def begin(self, robot: Scenario, previous: NDArray[np.floating]) -> TeacherSwimmer:
        """Return an agent that swims it, beginning now, after the ``previous`` action (F,)."""
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
        """Return how far (P,) gaits of one teacher swim along +y from a state (R,), in units.

        ``robot`` is a scenario of one, whose sizes they are given, and ``previous`` (F,) the action
        before.
        """
        numbers = np.array([gait.numbers for gait in gaits])
        network = TeacherNetwork(gaits[0].teacher, numbers, robot, previous)
        robots = robot.take(np.zeros(len(numbers), np.intp))
        lanes = LaneBatch(robots, threads=1, states=state[:, None])
        with np.errstate(over="ignore", invalid="ignore"):  # of robots that diverge
            for _ in range(round(seconds / (INTERVAL * TIMESTEP))):
                action = network.act(lanes.states)
                lanes.advance(np.array(servo_speeds(robot.plan, tuple(action))).T, INTERVAL)
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
        """Return the next action (F,), in [-1, 1], of a robot in a state (R,)."""
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
    """A teacher that acts for P robots of the same sizes, which differ in a few numbers each.

    Each begins with its clock at 0. The arrays are allocated once: a swim in imagination has
    hundreds of actions.

    Parameters
    ----------
    teacher
        Its weights.
    numbers
        (P, F + 4) changes of the teacher in standard deviations; see :func:`number_scales`.
    robot
        A scenario of one: what broke.
    previous
        (F,) the action before the first.
    """

    def __init__(
        self, teacher: Teacher, numbers: Floats, robot: Scenario, previous: NDArray[np.floating]
    ) -> None:
        plan = teacher.plan
        fins = len(plan.fins)
        # Rows of the values: the library gait's action, the previous action, 1 (for the biases),
        # the inputs of that gait, and its hidden nodes. The teacher's network has the rows up to
        # the inputs, the gait's the rows from the 1 on.
        self._previous = slice(fins, 2 * fins)
        begin = 2 * fins + 1
        end = begin + sensed(plan)
        self._rows = begin - 1, begin, end
        joints = layout(plan).joints
        rows = np.arange(joints.start, joints.stop)
        self._fin_rows = rows.reshape(-1, 2)[:, ::-1].ravel()  # sine, then cosine
        self._weights = teacher.weights
        first = first_gait(plan)
        self._gait = tuple(layers_of(first))
        changes = numbers * number_scales(plan)
        count = len(changes)
        self._offset = np.ascontiguousarray(changes[:, :fins].T, np.float32)
        clock, yaw, _, phase = range(fins, changes.shape[1])
        #: (P,) that the clock makes in an action, rad.
        self.clock_step: Floats = (
            TAU * first.clock * INTERVAL * TIMESTEP * np.exp(changes[:, clock])
        )
        self._turn = _turns(changes[:, yaw:phase])
        self.phase: Floats = changes[:, phase].copy()  #: (P,) of the clock at the next action, rad.
        nodes = sum(weights.shape[1] for weights in self._gait[:-1])
        self._values = np.ones((end + nodes, count), np.float32)
        self._values[self._previous] = previous[:, None]
        self._hidden = tuple(np.ones((n + 1, count), np.float32) for n in HIDDEN)
        self._middle, self._last = (
            columns(np.hstack([self._weights[f"w{i}"], self._weights[f"b{i}"][:, None]]))
            for i in (1, 2)
        )
        self.inform(robot)

    def inform(self, robot: Scenario) -> None:
        """Replace the sizes and servo gains by those of one robot."""
        plan = robot.plan
        sizes = robot.body[0] / plan.nominal - 1.0
        broken = np.concatenate([sizes, robot.servo_gain[0] - 1.0]).astype(np.float32)
        w0 = self._weights["w0"]
        known = np.empty((len(w0), 1), np.float32)
        told = w0.shape[1] - privileged(plan)
        layer(columns(w0[:, told:]), broken[:, None], known, LINEAR)
        known += self._weights["b0"][:, None]
        ends = np.cumsum([sensed(plan), len(plan.fins)])
        inputs, previous, base = np.split(w0[:, :told], ends, axis=1)
        self._first = columns(np.hstack([base, previous, known, inputs]))

    def act(self, states: NDArray[np.floating]) -> Singles:
        """Return the next actions (F, P), in [-1, 1], in states (R, P); a view of its memory."""
        seen = np.ascontiguousarray(states)
        turns = self.phase / TAU
        _compiled(_observe)(self._values, self._rows, seen, self._fin_rows, self._turn, turns)
        networks = self._gait, self._first, self._middle, self._last
        _compiled(_act)(self._values, self._rows, networks, self._hidden)
        self.phase += self.clock_step
        action = self._values[self._previous]
        action += self._offset
        return np.clip(action, -1.0, 1.0, out=action)

    def copy(self) -> Self:
        """Return a network that goes on from here, without effect on this one."""
        other = copy.copy(self)
        other._values = self._values.copy()
        other.phase = self.phase.copy()
        return other


def _turns(angles: Floats) -> Singles:
    """Return matrices (4, 4, P) that turn the world of orientations by yaws and pitches (P, 2)."""
    x, y, z, w = Rotation.from_euler("ZX", angles).as_quat().T
    rows = [[w, -z, y, x], [z, w, -x, y], [-y, x, w, z], [-x, -y, -z, w]]
    return np.array(rows, np.float32)


@functools.cache
def _compiled(function: Callable[..., None]) -> Callable[..., None]:
    """Return a function of this file, compiled."""
    register_functions(up_and_north, observe_imu, _turned)
    found: Callable[..., None] = compiled_function(function, error_model="numpy")
    return found


def _turned(turn: Singles, states: Floats, row: int, robot: int) -> Any:
    """Return a row of a robot's orientation, turned."""
    total = turn[row, 0, robot] * states[0, robot]
    for k in range(1, 4):
        total += turn[row, k, robot] * states[k, robot]
    return total


def _observe(
    values: Singles,
    rows: tuple[int, int, int],
    states: Any,
    fin_rows: NDArray[np.int64],
    turn: Singles,
    turns: Floats,
) -> None:
    """Put what P robots observe into the ``values`` of ``TeacherNetwork``.

    Parameters
    ----------
    rows
        Of the 1, of the first input, and after the last one.
    states
        (R, P), in single or double precision; ``fin_rows`` are those of the fins' inputs.
    turn
        (4, 4, P) that turn the robots' worlds.
    turns
        (P,) that their clocks have made.
    """
    _, begin, end = rows
    clock = end - fin_rows.size - 2
    for p in range(values.shape[1]):
        orientation = (
            _turned(turn, states, 0, p),
            _turned(turn, states, 1, p),
            _turned(turn, states, 2, p),
            _turned(turn, states, 3, p),
        )
        up, north = up_and_north(orientation)
        gyro = (states[SPIN, p], states[SPIN + 1, p], states[SPIN + 2, p])
        observe_imu(values[:, p], begin, up, north, gyro)
        values[clock, p], values[clock + 1, p] = sine_cosine(turns[p])
        for k in range(fin_rows.size):
            values[clock + 2 + k, p] = states[fin_rows[k], p]


def _act(
    values: Singles,
    rows: tuple[int, int, int],
    networks: tuple[tuple[Singles, ...], Singles, Singles, Singles],
    hidden: tuple[Singles, Singles],
) -> None:
    """Put the sums of a teacher's last layer into the rows of the previous actions of ``values``.

    ``networks`` are the weights of the library gait's layers and of the teacher's three, and
    ``hidden`` is room for the teacher's hidden nodes, with a row of 1 each.
    """
    one, _, end = rows
    gait, first, middle, last = networks
    fins = one // 2
    top = end
    for weights in gait[:-1]:
        nodes = values[top : top + weights.shape[1]]
        layer(weights, values[one:top], nodes, HYPERBOLIC_TANGENT)
        top += weights.shape[1]
    base = values[:fins]
    layer(gait[-1], values[one:top], base, LINEAR)
    for node in range(fins):
        for p in range(values.shape[1]):
            base[node, p] = clip(base[node, p], ONE)  # which keeps what is no number
    layer(first, values[:end], hidden[0][:-1], EXPONENTIAL_LINEAR)
    layer(middle, hidden[0], hidden[1][:-1], EXPONENTIAL_LINEAR)
    layer(last, hidden[1], values[fins:one], LINEAR)
