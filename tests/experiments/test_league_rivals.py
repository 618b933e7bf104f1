"""The league's rivals: learned policies in numpy, and agents that try gaits on the robot."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

from aquafish.online.gaits import load_library
from aquafish.online.teacher import Teacher
from aquafish_gym import AQUAFISH, Morphology
from aquafish_gym.utils.storage import read_document
from aquafish_gym.utils.validation import InvalidArgumentError

pytest.importorskip("stable_baselines3")
from experiments.league.archive import SIZE, Archive, Varied, varied
from experiments.league.entrants import ENTRANTS, MADE, Entry, _rma
from experiments.league.episodes import Episode, play
from experiments.league.policies import Policies
from experiments.league.policy import (
    ANY_WATER,
    CELLS,
    SENSES,
    TWINS,
    Offline,
    Student,
    StudentAgent,
)
from experiments.league.robots import Conditions, TrainingRobots
from experiments.league.trials import DirectSearch, TrialAgent, TrialAndError, load_archive, predict
from gait import Controller
from tests.pictures import is_drawn

GRID = np.array([[x, y, 0.5] for x in np.linspace(0, 1, 6) for y in np.linspace(0, 1, 6)])


def gait(action: ArrayLike) -> Controller:
    """Return a gait whose action is constant."""
    weights, bias = np.zeros((3, len(SENSES.names(AQUAFISH)) + 3)), np.asarray(action, float) / 2.5
    return Controller(
        weights, bias, np.ones(3), 0.7, Morphology.nominal(), 0,
        senses=SENSES, layers=(3,), output="clip", interval=20,
    )  # fmt: skip


def swim(agent: TrialAgent, pace: Callable[[np.ndarray, int], float], steps: int = 300) -> float:
    """Return the way after step 100 of a robot whose pace is a function of action and step."""
    agent.begin((0.0, 0.0, 0.0))
    way = [0.0]
    for t in range(steps):
        way.append(way[-1] + 0.2 * pace(np.asarray(agent.act(np.zeros(9))), t))
        agent.measure(way[-1])
    return way[-1] - way[100]


def test_trial_and_error_finds_a_better_gait_where_the_first_no_longer_works() -> None:
    gaits = [gait((x, y, 0.0)) for x, y, _ in GRID]
    paces = 0.8 - 0.1 * np.abs(GRID[:, :2] - 0.4).sum(axis=1)
    order = np.argsort(-paces)
    agent = TrialAndError([gaits[i] for i in order], paces[order], GRID[order])

    def pace(action: np.ndarray, t: int) -> float:
        return 0.7 if t < 100 else 0.6 - 1.5 * abs(action[0] - 1.0)  # only x = 1 works well

    way = swim(agent, pace)
    chose = [event for event in agent.events if event[1] == "chose"]
    assert float(chose[-1][2].split()[0]) > 0.5
    assert way > 40 * 0.2 * pace(np.array([0.4, 0.4, 0.0]), 100) + 10.0
    assert agent.events[0][1] == "alarm"


def test_an_agent_raises_no_alarm_while_its_pace_is_as_expected() -> None:
    agent = DirectSearch(gait((0.4, 0.4, 0.0)))
    swim(agent, lambda _action, t: 0.7 + 0.1 * np.sin(t))
    assert agent.events == []


def test_gaits_of_the_archive_act_alike_one_by_one_and_together() -> None:
    rng = np.random.default_rng(0)
    vectors = np.vstack([np.zeros(SIZE), 0.1 * rng.standard_normal(SIZE)])
    angles, seen = rng.uniform(-3, 3, (2, 3)), rng.uniform(-1, 1, (3, 2, 9))
    together = Varied(vectors)
    together.reset({"fin_angles": angles})
    first = load_library()[0]
    alone = [varied(first, x).policy(a) for x, a in zip(vectors, angles, strict=True)]
    for t, observations in enumerate(seen):
        actions = together.act(observations)
        for policy, one, action in zip(alone, observations, actions, strict=True):
            assert policy(one, 0.2 * t) == pytest.approx(action, abs=1e-6)
    assert (varied(first, vectors[0]).weights == first.weights).all()


def test_an_archive_keeps_the_best_of_each_cell() -> None:
    empty = Archive(np.empty(0), np.empty((0, 3)), np.empty((0, 1)))
    one = empty.add(
        np.array([0.1, 0.3]), np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]), np.eye(2)[:, :1]
    )
    two = one.add(
        np.array([0.2, 0.2]), np.array([[0.01, 0.0, 0.0], [0.99, 1.0, 1.0]]), np.ones((2, 1))
    )
    assert two.paces.tolist() == [0.2, 0.3]


def test_a_gaussian_process_agrees_with_what_was_tried() -> None:
    prior = np.linspace(0.2, 0.7, len(GRID))
    mean, deviation = predict(prior, GRID, [3, 20], [0.1, 0.6])
    assert mean[[3, 20]] == pytest.approx([0.1, 0.6], abs=0.01)
    assert deviation[3] < 0.1 < deviation.max() <= 1.0
    none, sure = predict(prior, GRID, [], [])
    assert none == pytest.approx(prior)
    assert sure == pytest.approx(1.0)


def test_direct_search_keeps_the_better_of_two_gaits() -> None:
    agent = DirectSearch(gait((0.4, 0.4, 0.0)))
    agent.begin((0.0, 0.0, 0.0))
    agent.restart(0.3)
    worse = agent.propose()
    agent.learn(0.2)
    assert (agent.best()[0].bias != worse.bias).any()
    assert agent.best()[1] == 0.3
    better = agent.propose()
    agent.learn(0.4)
    assert agent.best()[1] == 0.4
    assert (agent.best()[0].bias == better.bias).all()


def test_the_archive_holds_gaits_of_many_descriptors() -> None:
    gaits, paces, descriptors, offline = load_archive(MADE / "archive.json")
    assert len(gaits) == len(paces) == len(descriptors) > 300
    assert paces.max() > 0.5
    assert np.ptp(descriptors, axis=0).min() > 0.5
    assert offline.steps > 5e8


@pytest.mark.parametrize("twin", TWINS)
def test_a_file_of_weights_is_a_policy_that_reacts(twin: str) -> None:
    student = Student.load(MADE / f"policies/student-{twin}.json")
    assert student.offline.steps == 20 * student.curve[-1][0]
    assert student.teacher.offline["steps"] > 1e9
    assert (MADE / f"policies/student-{twin}.json").stat().st_size < 300_000
    agent = StudentAgent(student)
    agent.begin((0.1, -0.2, 0.3))
    first = agent.act(np.zeros(9))
    assert np.abs(first).max() <= 1.0
    assert (agent.act(np.full(9, 0.5)) != first).any()


@pytest.fixture
def small_trainings(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a round of training take a second."""
    teachers = pytest.importorskip("experiments.league.teachers")
    from experiments.league import students

    for module, name, value in (
        (teachers, "ROBOTS", 12), (teachers, "UPDATES", 2), (teachers, "BATCH", 60),
        (students, "ROBOTS", 12), (students, "UPDATES", 1), (students, "BATCH", 6),
        (teachers, "HORIZON", 5), (teachers, "TEST_ROBOTS", 4),
        (students, "TEST_SECONDS", 25.0), (students, "TEST_ROBOTS", 4),
    ):  # fmt: skip
        monkeypatch.setattr(module, name, value)
    for module in (teachers, students):
        monkeypatch.setattr(module, "Plan", partial(module.Plan, rounds=2))


@pytest.mark.slow
@pytest.mark.usefixtures("small_trainings")
def test_a_training_that_was_interrupted_gives_the_same_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from experiments.league import students, teachers

    names = ("teacher-0", "student-0", "teacher-any-water")
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    Policies(whole, names).execute()
    for module in (teachers, students):
        learn_round = module.learn_round

        def interrupted(plan: Any, number: int, *rest: Any, learn_round: Any = learn_round) -> Any:
            if number == 1 and (plan.any_water, learn_round) not in stopped:
                stopped.add((plan.any_water, learn_round))
                raise KeyboardInterrupt
            return learn_round(plan, number, *rest)

        monkeypatch.setattr(module, "learn_round", interrupted)
    stopped = set[tuple[bool, Any]]()
    for _ in names:
        with pytest.raises(KeyboardInterrupt):
            Policies(parts, names).execute()
    Policies(parts, names).execute()
    for name in names:
        one, other = (read_document(folder / f"{name}.json") for folder in (whole, parts))
        for document in (one, other, one.get("teacher", {}), other.get("teacher", {})):
            document.pop("offline", None)  # CPU times differ
        assert one == other
    assert is_drawn(parts / "curves.png")


@pytest.mark.usefixtures("small_trainings")
def test_numpy_evaluates_a_student_as_torch_does() -> None:
    from experiments.league import students, teachers

    torch = teachers.torch
    teacher = teachers.weights(teachers.learn_round(teachers.Plan(), 0, None, None))
    learned = students.learn_round(students.Plan(), 0, teacher, None)
    with torch.random.fork_rng():
        torch.manual_seed(3)
        torch.nn.init.normal_(learned["student"]["estimate.weight"], std=0.1)
    net = students.Student(teachers.actor(teacher))
    net.load_state_dict(learned["student"])
    copy = Teacher(students.acting(learned), Offline()._asdict())
    assert (copy.weights["w1"] != teacher["w1"]).any()
    agent = StudentAgent(Student(copy, students.weights(learned), Offline()))
    robots = TrainingRobots(1, Conditions(noise=0.01), 5)
    robots.start()
    agent.begin(robots._reckoned.fin_angles[0])
    cells, before = torch.zeros(1, 1, CELLS), robots.sensed()
    for _ in range(12):
        now = robots.sensed()
        with torch.no_grad():
            wanted, _, cells = net(torch.from_numpy(np.hstack([now, before]))[None], cells)
        before = now
        action = agent.act(robots._readings[0])
        assert action == pytest.approx(wanted[0, 0].numpy().clip(-1, 1), abs=1e-5)
        robots.step(action[None].astype(np.float32))


def test_robots_that_learn_begin_one_group_after_another() -> None:
    robots = TrainingRobots(12, Conditions(any_water=True, unknown_share=0.5), 0)
    observed = robots.reset()
    assert observed.shape == (12, 38)
    begun = []
    for _ in range(150):
        observed, _, done, infos = robots.step(np.zeros((12, 3), np.float32))
        begun.append(robots.begun.sum())
        assert (done == robots.begun).all()
        assert all(infos[i]["TimeLimit.truncated"] for i in np.flatnonzero(done))
    assert sorted(begun)[-6:] == [2] * 6
    assert sum(begun) == 12
    assert np.isfinite(observed).all()
    # An action far beyond what servos obey costs reward, and moves no robot otherwise.
    ones = np.ones((12, 3), np.float32)
    twins = [TrainingRobots(12, Conditions(any_water=True), 0) for _ in range(2)]
    for twin in twins:
        twin.start()
    (one, reward, *_), (other, less, *_) = twins[0].step(ones), twins[1].step(3.0 * ones)
    assert (one == other).all()
    assert reward - less == pytest.approx(0.02 * 3 * 1.5**2, abs=1e-6)


def test_a_student_without_its_teacher_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidArgumentError, match="must have teacher-0 before student-0"):
        Policies(tmp_path, ("student-0",)).execute()
    with pytest.raises(InvalidArgumentError, match="must have teacher-0 before teacher-any-water"):
        Policies(tmp_path, ("teacher-any-water",)).execute()


def test_only_an_entrant_with_measure_is_told_its_position(monkeypatch: pytest.MonkeyPatch) -> None:
    class Measuring:
        """Holds still, and counts."""

        def begin(self, _fin_angles: ArrayLike) -> None:
            self.heard: list[float] = []
            agents.append(self)

        def act(self, _observation: ArrayLike) -> ArrayLike:
            return (0.0, 0.0, -1.0)

        def measure(self, y_position: float) -> None:
            self.heard.append(y_position)

    agents: list[Measuring] = []
    monkeypatch.setitem(ENTRANTS, "measuring", Entry(lambda **_: Measuring()))
    found = play(Episode("measuring", "none", 0, 0.0, "still"))
    assert agents[0].heard == pytest.approx(found["way"][1:], abs=1e-6)
    still = play(Episode("still", "none", 0, 0.0, "still"))
    assert still["way"] == found["way"]
    assert ENTRANTS["still"].offline() == Offline()


def test_an_entrant_knows_what_was_spent_on_it() -> None:
    for name in ("PPO, fins", "RMA", "trial and error", "self-model"):
        steps, seconds = ENTRANTS[name].offline()
        assert steps > 1e7, name
        assert seconds > 10.0, name


def test_an_entrant_may_have_several_seeds_of_training() -> None:
    """Episode i is played by the (i mod N)-th."""
    twins = (0, ANY_WATER)
    entry = _rma(*twins)
    known, other, again = (entry.make(seed=number)._student.weights for number in range(3))  # type: ignore[attr-defined]
    assert (known["mix_w"] == again["mix_w"]).all()
    assert (known["mix_w"] != other["mix_w"]).any()
    alone = [_rma(twin).offline().seconds for twin in twins]
    assert entry.offline().seconds == pytest.approx(sum(alone) / len(alone), abs=0.2)
