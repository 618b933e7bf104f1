"""The league's rivals: learned policies in numpy, and agents that try gaits on the robot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import ArrayLike

from aquafish.online.gaits import load_library
from aquafish_gym import Morphology
from experiments.league import policies
from experiments.league.archive import SIZE, Archive, Varied, varied
from experiments.league.entrants import ENTRANTS, MADE, Entry
from experiments.league.episodes import Episode, play
from experiments.league.policies import KINDS, make_robots, train
from experiments.league.policy import SENSES, Offline, Policy, PolicyAgent
from experiments.league.trials import DirectSearch, TrialAgent, TrialAndError, load_archive, predict
from gait import Controller

GRID = np.array([[x, y, 0.5] for x in np.linspace(0, 1, 6) for y in np.linspace(0, 1, 6)])


def gait(action: ArrayLike) -> Controller:
    """Return a gait whose action is constant."""
    weights, bias = np.zeros((3, len(SENSES.names) + 3)), np.asarray(action, float) / 2.5
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


@pytest.mark.parametrize("name", KINDS)
def test_a_file_of_weights_is_a_policy_that_reacts(name: str) -> None:
    policy = Policy.load(MADE / f"policies/{name}.json")
    assert policy.offline.steps >= 20 * KINDS[name].actions
    agent = PolicyAgent(policy)
    agent.begin((0.1, -0.2, 0.3))
    first = agent.act(np.zeros(9))
    assert np.abs(first).max() <= 1.0
    assert (agent.act(np.full(9, 0.5)) != first).any()


@pytest.mark.parametrize("name", KINDS)
def test_numpy_evaluates_a_policy_as_torch_does(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("sb3_contrib" if name == "lstm" else "stable_baselines3")
    for one, value in (("ROBOTS", 6), ("HORIZON", 4), ("EPISODE", 3)):
        monkeypatch.setattr(policies, one, value)
    policy, model = train(replace(KINDS[name], actions=24, batch=24, epochs=1), 0, lambda *_: None)
    policy.save(tmp_path / "policy.json")
    agent = PolicyAgent(Policy.load(tmp_path / "policy.json"))
    robots, state = make_robots(1), None
    robots.reset()
    seen = robots._begin(np.ones(6, bool), 5)  # all at once
    agent.begin(robots._inputs.fin_angles[0])
    w, begins = policy.weights, np.ones(6, bool)
    frames = np.zeros((6, policy.frames, 20))
    for _ in range(12):
        frame = ((seen - w["mean"]) / w["scale"])[:, None]
        frames = np.concatenate([frames[:, 1:], frame], axis=1)
        theirs, state = model.predict(
            frames.reshape(6, -1).astype(np.float32), state, begins, deterministic=True
        )
        mine = agent.act(robots.envs._seen[0])
        robots.step_async(theirs)
        assert mine == pytest.approx(robots._previous[0], abs=1e-3)
        seen, begins = robots.step_wait()[0], np.zeros(6, bool)


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
    assert ENTRANTS["still"].offline == Offline()


@pytest.mark.parametrize("name", ["PPO, fins", "PPO, damaged", "trial and error", "self-model"])
def test_an_entrant_knows_what_was_spent_on_it(name: str) -> None:
    steps, seconds = ENTRANTS[name].offline
    assert steps > 1e7
    assert seconds > 10.0
