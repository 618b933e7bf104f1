"""Gaits of a teacher: its network and seven numbers, imagined, refined, and swum."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from aquafish.online import thresholds
from aquafish.online.teacher import INTERVAL, Teacher, TeacherNetwork
from aquafish_gym.command import servo_speeds
from aquafish_gym.engines.compiled.lanes import LaneBatch
from aquafish_gym.physics.arithmetic import TAU
from aquafish_gym.physics.layout import FIELDS
from aquafish_gym.scenario import TIMESTEP, Scenario
from aquafish_gym.utils.array_types import Floats
from gait.search.cma import evolution_strategy
from gait.swims.scores import penalize_diverged

_PHASE = 6  # of the numbers
_NORTHING = FIELDS["position"].start + 1


@dataclass(frozen=True, eq=False)
class TeacherGait:
    """A gait: a teacher with seven numbers of its own; see ``TEACHER_NUMBER_SCALES``."""

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


class TeacherAgent:
    """An agent that swims a teacher's gait, beginning now.

    Parameters
    ----------
    gait
        What it swims.
    robot
        A scenario of one: what broke.
    previous
        (3,) the action before its first.
    """

    def __init__(self, gait: TeacherGait, robot: Scenario, previous: NDArray[np.floating]) -> None:
        self.controller = gait
        self._robot = robot
        self._network = TeacherNetwork(gait.teacher, gait.numbers[None], robot, previous)

    def after(self, actions: int) -> TeacherGait:
        """Return its gait with the phase that its clock will have after some actions."""
        network = self._network
        return self.controller.at_phase(float(network.phase[0] + actions * network.clock_step[0]))

    def inform(self, robot: Scenario) -> None:
        """Replace what broke by that of a robot."""
        if robot is not self._robot:
            self._robot = robot
            self._network.inform(robot)

    def act(self, state: Floats) -> NDArray[np.float32]:
        """Return the next action (3,), in [-1, 1], in a state (25,)."""
        return self._network.act(state[:, None])[:, 0].copy()

    def copy(self) -> TeacherAgent:
        """Return an agent that goes on from here, without effect on this one."""
        other = object.__new__(TeacherAgent)
        vars(other).update(vars(self), _network=self._network.copy())
        return other


def imagine_teacher(
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
            lanes.advance(np.array(servo_speeds(tuple(action))).T, INTERVAL)
    far = lanes.states[_NORTHING].astype(np.float64) - state[_NORTHING]
    return penalize_diverged(far, seconds)


def refine_teacher(
    first: TeacherGait,
    robot: Scenario,
    state: Floats,
    seconds: float,
    previous: NDArray[np.floating],
    generations: int,
    rng: np.random.Generator,
    sigma: float = thresholds.TEACHER_FIRST_SIGMA,
) -> tuple[TeacherGait, float]:
    """Return the best gait of a teacher that CMA-ES finds, and how far it swims, units.

    ``generations`` are those of a swim of 40 s; a shorter swim has more of them. See
    :func:`imagine_teacher` for the others.
    """
    actions = round(seconds / (INTERVAL * TIMESTEP))
    count = math.ceil(generations * thresholds.BUDGET_ACTIONS / actions)
    count = min(count, thresholds.MOST_GENERATIONS_RATIO * generations)
    strategy = evolution_strategy(first.numbers, thresholds.TEACHER_POPULATION, rng, sigma)
    best = first
    farthest = -math.inf
    for generation in range(count):
        vectors = strategy.ask()
        gaits = [TeacherGait(first.teacher, vector) for vector in vectors]
        if not generation:
            gaits.append(first)
        far = imagine_teacher(gaits, robot, state, seconds, previous)
        strategy.tell(vectors, (-far[: len(vectors)]).tolist())
        if far.max() > farthest:
            farthest = float(far.max())
            best = gaits[int(far.argmax())]
    return best, farthest
