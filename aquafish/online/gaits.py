"""Gaits: how one begins, acts, goes on in imagination, and is refined; and those of the library.

A gait is a controller or a teacher with numbers of its own (``aquafish.online.teacher_gait``).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from aquafish.online import thresholds
from aquafish.online.self_model import SENSOR_FIELDS, SelfModel, imu_readings
from aquafish_gym.command import scale_action
from aquafish_gym.engines.compiled.lanes import LaneBatch
from aquafish_gym.morphology import Morphology
from aquafish_gym.physics.layout import FIELDS, layout
from aquafish_gym.plans import (
    AQUAFISH,
    FOUR_FINS,
    TAIL_FISH,
    BodyPlan,
    PlanLike,
    check_plan,
    check_same_plan,
)
from aquafish_gym.rollout import rollout
from aquafish_gym.scenario import TIMESTEP, Scenario
from aquafish_gym.utils.array_types import Floats
from aquafish_gym.utils.storage import read_document, read_packaged
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    brief,
    file_path,
    finite_array,
    instance,
)
from gait.controllers.agents import ControllerAgent
from gait.controllers.controller import Controller, check_controllers, program_of
from gait.controllers.network import Senses
from gait.search.cma import FINALS_EVERY, REFINING, evolution_strategy
from gait.search.templates import Template
from gait.swims.poses import stream
from gait.swims.scores import by_kind, penalize_diverged

LIBRARY_SCHEMA = "aquafish.library/1"
#: The packaged libraries of plans; that of tail-fish is made in water with added mass.
PACKAGED = {
    AQUAFISH: "library.json",
    FOUR_FINS: "library_four_fins.json",
    TAIL_FISH: "library_tail_fish.json",
}
NORTHING = FIELDS["position"].start + 1


class Ahead(NamedTuple):
    """Where a robot will be after some actions, from which a gait is refined."""

    state: Floats  #: (R,)
    action: NDArray[np.float32]  #: (F,) the last one; 0 without one.
    way: float  #: How far it will swim along +y from there until the end, units.
    seconds: float  #: For how long that is.


class Effort(NamedTuple):
    """How long a refinement may search, and what thinking time it is charged."""

    generations: int  #: Of a controller.
    teacher_generations: int
    seconds: float
    every: bool = True  #: Whether a gait of each kind is refined, or only the one that is swum.


class Search(NamedTuple):
    """A search by CMA-ES for gaits near one."""

    strategy: Any  #: Of pycma.
    generations: int
    mean_every: int  #: The mean of the strategy swims, too, once in this number of generations.


class Swimmer(Protocol):
    """An agent that swims a gait of one robot."""

    @property
    def gait(self) -> Gait:
        """What it swims."""

    def act(self, robot: Scenario, state: Floats) -> NDArray[np.float32]:
        """Return the next action (F,), in [-1, 1], of a robot in a state (R,)."""

    def after(self, actions: int) -> Gait:
        """Return the gait that goes on as this agent will after some actions."""

    def copy(self) -> Self:
        """Return an agent that goes on from here, without effect on this one."""


class Gait(Protocol):
    """What a robot can swim."""

    @property
    def name(self) -> str:
        """For people."""

    @property
    def refinable(self) -> bool:
        """Whether it is small enough to be refined in time."""

    def begin(self, robot: Scenario, previous: NDArray[np.floating]) -> Swimmer:
        """Return an agent that swims it, beginning now, after the ``previous`` action (F,)."""

    @staticmethod
    def ahead(
        gaits: Sequence[Any],
        robot: Scenario,
        state: Floats,
        seconds: float,
        previous: NDArray[np.floating],
    ) -> Floats:
        """Return how far (P,) gaits of this class would swim; see :func:`imagine_gaits`."""

    def search(self, effort: Effort, seconds: float, rng: np.random.Generator) -> Search:
        """Return a search for gaits near this one that swim far in some seconds."""

    def near(self, vectors: Sequence[Floats], robot: Scenario) -> Sequence[Self]:
        """Return the gaits of a robot that a search tries as vectors (D,)."""


def imagine_gaits(
    gaits: Sequence[Gait],
    robot: Scenario,
    state: Floats,
    seconds: float,
    previous: NDArray[np.floating],
) -> Floats:
    """Return how far (P,) gaits would swim along +y from a state (R,), in units.

    ``robot`` is a scenario of one, which they are told, and ``previous`` (F,) the action before.
    """
    ways = []
    for _, alike in groupby(gaits, key=type):  # those of a class swim together
        several = list(alike)
        ways.append(several[0].ahead(several, robot, state, seconds, previous))
    return np.concatenate(ways)


def refine_gait(
    gait: Gait, robot: Scenario, begin: Ahead, effort: Effort, rng: np.random.Generator
) -> tuple[Gait, float]:
    """Return the best gait near one that CMA-ES finds, and how far it swims, units."""
    strategy, generations, mean_every = gait.search(effort, begin.seconds, rng)
    best = gait
    farthest = -math.inf
    for generation in range(generations):
        vectors = strategy.ask()
        mean = [] if generation % mean_every else [strategy.mean]
        gaits = gait.near([*vectors, *mean], robot)
        far = gait.ahead(gaits, robot, begin.state, begin.seconds, begin.action)
        strategy.tell(vectors, (-far[: len(vectors)]).tolist())
        if far.max() > farthest:
            farthest = float(far.max())
            best = gaits[int(far.argmax())]
    return best, farthest


def swim_ahead(swimmer: Swimmer, model: SelfModel, actions: int, seconds: float) -> Ahead:
    """Return where a robot will be after some actions, and its way in the ``seconds`` after them.

    A copy of the swimmer swims: it does not change itself.
    """
    plan = model.robot.plan
    dt = model.hold * TIMESTEP
    copy = swimmer.copy()
    lanes = LaneBatch(model.robot, threads=1, states=model.state[:, None])
    state = model.state
    begin = state
    last: NDArray[np.float32] = np.zeros(len(plan.fins), np.float32)
    for k in range(1, actions + round(seconds / dt) + 1):
        action = copy.act(model.robot, state)
        lanes.advance(scale_action(plan, action[None]), model.hold)
        state = lanes.states[:, 0].astype(np.float64)
        if k == actions:
            begin, last = state, action
    return Ahead(begin, last, float(state[NORTHING] - begin[NORTHING]), seconds)


@dataclass(frozen=True, eq=False)
class ControllerGait:
    """A controller as a gait, which is told its fin angles."""

    controller: Controller
    name: str = "a gait refined before"

    @property
    def refinable(self) -> bool:
        """Whether CMA-ES refines its network in a second."""
        return self.controller.nodes <= thresholds.MAXIMUM_REFINED_NODES

    def begin(self, robot: Scenario, previous: NDArray[np.floating]) -> Swimmer:  # noqa: ARG002
        """Return an agent that swims it, beginning now; it needs no previous action."""
        agent = ControllerAgent(self.controller)
        agent.reset({"fin_angles": np.zeros(len(robot.plan.fins))})  # the swimmer sets them
        return _ControllerSwimmer(self, agent)

    @staticmethod
    def ahead(
        gaits: Sequence[ControllerGait],
        robot: Scenario,
        state: Floats,
        seconds: float,
        previous: NDArray[np.floating],  # noqa: ARG004
    ) -> Floats:
        """Return how far (P,) gaits would swim; see :func:`imagine_gaits`."""
        return imagine([gait.controller for gait in gaits], robot, state, seconds)

    def search(self, effort: Effort, seconds: float, rng: np.random.Generator) -> Search:  # noqa: ARG002
        """Return a search over the controller's weights, biases and clock."""
        source = np.random.default_rng(stream(int(rng.integers(2**32)), 6))
        first = Template.like(self.controller).vector(self.controller)
        strategy = evolution_strategy(
            first, thresholds.CONTROLLER_POPULATION, source, REFINING, diagonal=True
        )
        return Search(strategy, effort.generations, FINALS_EVERY)

    def near(self, vectors: Sequence[Floats], robot: Scenario) -> list[ControllerGait]:
        """Return the gaits of vectors of the search."""
        first = replace(
            self.controller,
            morphology=Morphology.from_array(robot.body[0], robot.plan),
            sample=None,
        )
        template = Template.like(first)
        return [ControllerGait(one) for one in template.controllers(np.array(vectors), first)]


@dataclass(frozen=True)
class _ControllerSwimmer:
    """See :meth:`ControllerGait.begin`."""

    gait: ControllerGait
    _agent: ControllerAgent

    def act(self, robot: Scenario, state: Floats) -> NDArray[np.float32]:
        self._agent.fin_angles = layout(robot.plan).angles(state)[None]
        return self._agent.act(imu_readings(state[:, None])[0])

    def after(self, actions: int) -> ControllerGait:  # noqa: ARG002
        return self.gait

    def copy(self) -> Self:
        return replace(self, _agent=self._agent.copy())


def read_library(library: Path | PlanLike = AQUAFISH) -> dict[str, Any]:
    """Return the content of a library: its ``gaits``, and what they took, ``offline``.

    It is a JSON file, or the packaged one of a plan. ``experiments.gaits.library`` makes them.
    """
    if isinstance(library, Path) or (isinstance(library, str) and library.endswith(".json")):
        return read_document(file_path("library", library), LIBRARY_SCHEMA, "library")
    plan = check_plan(library)
    if plan not in PACKAGED:
        raise InvalidArgumentError(
            f"library must be given for the plan {plan.name}, of which none is packaged; "
            "python -m experiments.gaits.library makes it"
        )
    return read_packaged("aquafish.online", PACKAGED[plan], LIBRARY_SCHEMA)


def load_library(library: Path | PlanLike = AQUAFISH) -> list[Controller]:
    """Return the gaits of a library, those for the whole robot first; see ``read_library``."""
    return [Controller.from_dict(one) for one in read_library(library)["gaits"]]


def gaits_of(plan: BodyPlan, library: Path | None = None) -> list[Controller]:
    """Return the gaits of a plan: of a library's file, or of the packaged one.

    Without either, it is one that runs all servos at full speed.
    """
    if library is None and plan not in PACKAGED:
        fins = len(plan.fins)
        senses = Senses(fins=True)
        weights = np.zeros((fins, len(senses.names(plan)) + fins))
        full, body = np.ones(fins), Morphology.nominal(plan)
        return [Controller(weights, full, full, 1.0, body, 0, None, senses, (fins,), "clip", 20)]
    gaits = load_library(library or plan)
    check_same_plan("library", gaits[0].plan, plan)
    return gaits


def check_library(library: Sequence[Controller], plan: BodyPlan, hold: int) -> list[Controller]:
    """Return the gaits of a plan's library, each of which holds an action for ``hold`` steps."""
    if not isinstance(library, list | tuple) or not library:
        raise InvalidArgumentError(f"library must have a gait; got {brief(library)}")
    for gait in library:
        instance("library", gait, Controller)
        check_same_plan("library", gait.plan, plan)
        if gait.interval != hold or gait.senses.goal:
            raise InvalidArgumentError(
                f"library must have gaits without a goal whose interval is hold, {hold} steps; "
                f"got {gait!r}"
            )
    return list(library)


def imagine(
    controllers: Sequence[Controller], robot: Scenario, state: Floats, seconds: float
) -> Floats:
    """Return how far (P,) controllers would swim along +y from a state (R,), in units.

    ``robot`` is a scenario of one, whose sensors count as whole. The controllers know its fin
    angles and servo gains.

    Raises
    ------
    InvalidArgumentError
        If an argument does not fit.
    """
    controllers = check_controllers(controllers)
    if len(instance("robot", robot, Scenario)) != 1:
        raise InvalidArgumentError(f"robot must be one robot; got {robot!r}")
    state = finite_array("state", state, (layout(robot.plan).state_rows,))
    seconds = float(finite_array("seconds", seconds, (), TIMESTEP, unit="s"))
    sensors = {name: np.zeros_like(getattr(robot, name)) for name in SENSOR_FIELDS}
    whole = replace(robot, **sensors)
    seconds = round(seconds / TIMESTEP) * TIMESTEP
    far = np.empty(len(controllers))
    for numbers, those in by_kind(controllers):
        rows = np.zeros(len(those), np.intp)
        swum = rollout(
            program_of(those),
            whole.take(rows),
            seconds=seconds,
            believed_gain=robot.servo_gain[rows],
            dtype=np.float32,
            threads=1,
            start=np.repeat(state[:, None], len(those), axis=1),
        )
        far[numbers] = swum.end[:, 1] - state[NORTHING] - robot.current[0, 1] * seconds
    return penalize_diverged(far, seconds)
