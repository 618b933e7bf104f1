"""The entrants of the recovery league: agents that play one episode at a time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from aquafish.online.agent import AgentConfig, SelfModelAgent
from aquafish.online.belief import Water
from aquafish.online.gaits import ControllerGait, load_library, read_library
from aquafish.online.phases import Episode, Phase
from aquafish.online.self_model import SelfModel
from aquafish.online.teacher import Teacher
from aquafish.online.teacher_gait import TeacherGait
from aquafish_gym.plans import AQUAFISH, BodyPlan
from aquafish_gym.scenario import CHANNELS, Scenario
from eea.core.angles import Floats
from experiments.league.ceiling import search_gait
from experiments.league.policy import ANY_WATER, SEEDS, FixedGait, Offline, Student, StudentAgent
from experiments.league.trials import DirectSearch, TrialAndError, load_archive
from gait.controllers.controller import Controller

#: What breaks, by its name in ``info``, and the field of a scenario that it is.
TRUTH = ("morphology", "servo_gain", "sensor_noise", "sensor_bias", "sensor_lost")
FIELDS = ("body", "servo_gain", "gyro_noise", "sensor_bias", "sensor_dropped")
MADE = Path(__file__).parent / "data"
CEILING = "ceiling"


class Entrant(Protocol):
    """An agent in one episode.

    The initial fin angles (3,), rad, are None where it cannot know them. It may also have
    ``measure(y_position)``. The league then calls it after each step with the true distance along
    +y, which no observation contains.
    """

    def begin(self, fin_angles: ArrayLike | None) -> None: ...
    def act(self, observation: ArrayLike) -> ArrayLike: ...


class Still:
    """No servo moves."""

    def __init__(self, plan: BodyPlan = AQUAFISH) -> None:
        self._action = [0.0 if fin.turns else -1.0 for fin in plan.fins]

    def begin(self, fin_angles: ArrayLike | None) -> None:
        """Begin an episode."""

    def act(self, observation: ArrayLike) -> ArrayLike:  # noqa: ARG002
        """Hold every servo."""
        return self._action


class Unwatched(Episode):
    """An episode in which nothing surprises."""

    watches = False


class Blind(SelfModelAgent):
    """The agent that never looks for damage: it only refines the whole robot's gait."""

    _episode = Unwatched


class Told(Episode):
    """An episode in which nothing is inferred, since the truth is told."""

    def explain(self, *_: object) -> None:
        """Infer nothing."""


class Oracle(SelfModelAgent):
    """The agent that learns the truth about its body, servos and sensors when they change.

    Like the agent, it refines its gait when calibrated, and after each change.
    """

    _episode = Told
    truth: dict[str, Any] | None = None

    def learn(self, info: dict[str, Any]) -> None:
        """Become the robot that ``info`` describes, from the next action on."""
        names = dict(zip(TRUTH, FIELDS, strict=True))
        self.truth = {field: np.asarray(info[name])[None] for name, field in names.items()}

    def _observe(self, phase: Phase, observed: Floats) -> Phase:
        if self.truth is None:
            return super()._observe(phase, observed)
        model = phase.model
        stuck = np.zeros((1, len(CHANNELS)), np.bool_)
        robot = replace(model.robot, **self.truth, sensor_stuck=stuck)
        # Its sensors have changed already; the rest of it does so now.
        sensors: dict[str, Any] = {
            name: getattr(robot, name) for name in (*FIELDS[2:], "sensor_stuck")
        }
        model.become(replace(model.robot, **sensors), model.state)
        phase = super()._observe(phase, observed)
        self.truth = None
        phase.model.become(robot, phase.model.state)
        self._change_gait(phase)
        return phase

    def _change_gait(self, phase: Phase) -> None:
        """Swim the best known gait of the robot that it has become, and refine it."""
        phase.episode.change_gait(phase.model, phase.water)


class Ceiling(Oracle):
    """The oracle that searches a gait after each change, for five CPU minutes."""

    def _change_gait(self, phase: Phase) -> None:
        """Swim the best of the gait that it finds and those that the oracle knows."""
        episode = phase.episode
        model = phase.model
        seconds = episode.chooser.until - episode.steps * episode.dt
        gait, far = search_gait(self.library, model.robot, model.state, seconds, self.config.seed)
        episode.log("searched", f"a gait that should make {far:.1f} units")
        episode.chooser.swim(ControllerGait(gait), model)
        super()._change_gait(phase)


class ToldItsTeacher(Told):
    """The same, in which nothing is swum but a teacher."""

    def change_gait(self, model: SelfModel, water: Water, soon: bool = False) -> None:  # noqa: ARG002
        """Swim the teacher: in foreign water that of any water."""
        teachers = self.chooser.teachers
        self.chooser.swim(TeacherGait.of(teachers[-1 if water.foreign else 0]), model)


class ToldTeacher(Oracle):
    """The oracle that swims nothing but its teacher."""

    _episode = ToldItsTeacher


def _student(twin: int | str) -> Student:
    return Student.load(MADE / f"policies/student-{twin}.json")


def _library(*gaits: int, plan: BodyPlan = AQUAFISH) -> Offline:
    """Return what some gaits of a plan's library took; without numbers, all."""
    spent = read_library(plan)["offline"]
    chosen = gaits or range(len(spent["steps"]))
    return Offline(*(sum(spent[name][i] for i in chosen) for name in Offline._fields))


def _teachers() -> Offline:
    """Return what the teachers of the agent took."""
    return _sum(*(_of(one) for one in (Teacher.load(), Teacher.load_any_water())))


def _library_and_teachers(plan: BodyPlan = AQUAFISH) -> Offline:
    """Return what the gaits and the teachers of a plan's agent took."""
    return _sum(_library(plan=plan), *([_teachers()] if plan == AQUAFISH else []))


def _of(teacher: Teacher) -> Offline:
    return Offline(int(teacher.offline["steps"]), teacher.offline["seconds"])


def _sum(*spent: Offline) -> Offline:
    steps, seconds = map(sum, zip(*spent, strict=True))
    return Offline(int(steps), round(seconds, 1))


@dataclass(frozen=True)
class Entry:
    """How an entrant is made, and what was spent on it before its first episode.

    ``make`` takes the ``plan``, settings of ``AgentConfig``, which tell what an agent may know of
    its sensors, and the episode's number as ``seed``; ``spent`` reads the entrant's file. An
    episode of 60 s takes about ``cpu`` CPU seconds, by which the league says how long it will take.
    Entrants of ``any_plan`` play other fish than the paper's; their ``spent`` takes the plan, too.
    """

    make: Callable[..., Entrant]
    spent: Callable[..., Offline] = lambda **_: Offline()
    cpu: float = 0.3
    any_plan: bool = False

    def offline(self, plan: BodyPlan = AQUAFISH) -> Offline:
        """Return simulated robot steps of 0.01 s, and CPU time in s."""
        return self.spent(plan=plan) if self.any_plan else self.spent()


def _self_model(
    kind: type[SelfModelAgent] = SelfModelAgent, cpu: float = 6.0, **more: Any
) -> Entry:
    def make(plan: BodyPlan = AQUAFISH, **known: Any) -> SelfModelAgent:
        return kind(config=AgentConfig(**known, **more), robot=Scenario.create(plan=plan))

    return Entry(make, _library_and_teachers, cpu, any_plan=True)


def _gait(number: int) -> Entry:
    return Entry(lambda **_: FixedGait(load_library()[number]), lambda: _library(number))


def _rma(*twins: int | str) -> Entry:
    """Return the entry of students, of which episode number i has the (i mod N)-th of N.

    What was spent is the mean of their trainings: an episode has one of them.
    """

    def spent() -> Offline:
        students = [_student(twin) for twin in twins]
        trained = _sum(*(_sum(_of(one.teacher), one.offline) for one in students))
        each = Offline(trained.steps // len(twins), trained.seconds / len(twins))
        return _sum(_library(0), each)

    return Entry(lambda seed, **_: StudentAgent(_student(twins[seed % len(twins)])), spent)


def _archive() -> tuple[tuple[Controller, ...], Floats, Floats, Offline]:
    return load_archive(MADE / "archive.json")


_FREE: dict[str, Any] = dict.fromkeys(
    ("inference_seconds", "refinement_seconds", "both_seconds", "quick_seconds"), 0.0
)
ENTRANTS: dict[str, Entry] = {
    "still": Entry(lambda plan=AQUAFISH, **_: Still(plan), any_plan=True),
    "CMA-ES, fins": _gait(1),
    "PPO, fins": _gait(0),
    "RMA": _rma(*range(SEEDS)),
    "RMA, any water": _rma(ANY_WATER),
    "oracle, teacher alone": Entry(
        lambda plan=AQUAFISH, **known: ToldTeacher(  # noqa: ARG005
            config=AgentConfig(**known)
        ),
        lambda: _sum(_library(0), _teachers()),
        1.0,
    ),
    "trial and error": Entry(lambda **_: TrialAndError(*_archive()[:3]), lambda: _archive()[3]),
    "direct search": Entry(
        lambda seed, **_: DirectSearch(load_library()[0], seed), lambda: _library(0)
    ),
    "blind": _self_model(Blind, cpu=3.0),
    "self-model": _self_model(),
    "self-model, library only": _self_model(cpu=2.0, refinements=0),
    "self-model, thinking free": _self_model(**_FREE),
    "oracle": _self_model(Oracle, **_FREE),
    CEILING: _self_model(Ceiling, cpu=310.0, **_FREE),
}
#: Those that play if none are named: all without the ceiling, which takes minutes an episode.
USUAL = tuple(name for name in ENTRANTS if name != CEILING)
