"""The engines' verbs mean the same for one robot and for many, with servos that are late."""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from aquafish_gym.command import servo_speeds
from aquafish_gym.engines.api import simulate_scenario
from aquafish_gym.engines.compiled.lanes import LaneBatch
from aquafish_gym.engines.world_batch import WorldBatch
from aquafish_gym.engines.worlds import Swimmers, World, make_world
from aquafish_gym.morphology import Morphology
from aquafish_gym.physics.layout import layout
from aquafish_gym.plans import AQUAFISH
from aquafish_gym.rollout import rollout
from aquafish_gym.rollout.programs import act_alone
from aquafish_gym.scenario import TIMESTEP, Scenario
from aquafish_gym.sense import observe
from aquafish_gym.utils.validation import InvalidArgumentError
from gait.controllers.controller import program_of
from gait.controllers.network import Senses
from gait.search.templates import Template
from instruments.verification.trials import random_trials
from tests.scenarios import with_changes

ENGINES = ["numba", "pybullet"] if importlib.util.find_spec("pybullet") else ["numba"]
ROBOTS, STEPS = 3, 60
TRIALS = random_trials(ROBOTS, seed=8)
LONGEST = 0.2
# Among them none, less than a step, and whole steps: 0.29 s is a little less than 29 of them.
lags = st.one_of(st.sampled_from([0.0, 0.004, 0.03, 0.1]), st.floats(0.0, LONGEST))
gains = st.tuples(*[st.sampled_from([1.0, 0.0, -1.0, 0.6])] * 3)
seeds = st.integers(0, 2**32 - 1)


@st.composite
def scenarios(draw: st.DrawFn) -> Scenario:
    """Return robots with lags, whose servos, lags and bodies change in mid-swim."""
    start = replace(
        Scenario.create(TRIALS.morphologies, fin_angles=TRIALS.fin_angles),
        servo_lag=np.array(draw(st.lists(lags, min_size=ROBOTS, max_size=ROBOTS))),
        servo_gain=np.array(draw(st.lists(gains, min_size=ROBOTS, max_size=ROBOTS))),
    )
    changes = []
    now = start
    for step in sorted(draw(st.sets(st.integers(1, STEPS - 1), max_size=3))):
        rows = np.array(sorted(draw(st.sets(st.integers(0, ROBOTS - 1), min_size=1))))
        to = now.take(rows).copy()
        to.servo_lag[:] = [draw(lags) for _ in rows]
        to.servo_gain[:] = [draw(gains) for _ in rows]
        to.body[:, draw(st.integers(0, 8))] *= 0.7
        changes.append((step, rows, to))
        now = now.copy()
        for name, table in now.columns().items():
            table[rows] = vars(to)[name]
    return with_changes(start, changes)


def series(seed: int, count: int) -> np.ndarray:
    """Return commands (ROBOTS, count, 3)."""
    low = [-0.5, -0.5, 0.0]
    high = [0.5, 0.5, 1.0]
    return np.random.default_rng(seed).uniform(low, high, (ROBOTS, count, 3))


@settings(max_examples=8)
@given(scenario=scenarios(), seed=seeds, interval=st.sampled_from([1, 4, 15, STEPS]))
def test_engines_agree_on_open_loops(scenario: Scenario, seed: int, interval: int) -> None:
    commands = series(seed, -(-STEPS // interval))
    logs = [
        simulate_scenario(
            scenario, commands, STEPS, engine, "float64", record="pose", interval=interval
        )
        for engine in ENGINES
    ]
    for robot in range(ROBOTS):
        one = scenario.take(robot)
        world = make_world("numba", one)
        felt = []
        for begin, end, _, to in one.segments(STEPS):
            if to is not None:
                world.update(to)
            for t in range(begin, end):
                world.advance(tuple(commands[robot, t // interval].tolist()))
                felt.append(world.state().spin)
        assert_allclose(logs[0].gyro[robot], felt, rtol=0, atol=1e-11)  # type: ignore[index]
    for log in logs[1:]:
        for name in ("gyro", "position", "rpy"):
            assert_allclose(getattr(log, name), getattr(logs[0], name), rtol=0, atol=1e-9)


@settings(max_examples=12, deadline=None)
@given(scenario=scenarios())
def test_engines_agree_on_closed_loops(scenario: Scenario) -> None:
    template = Template.of_class("recurrent", Senses(fins=True), 5, 20)
    weights = np.random.default_rng(0).standard_normal(template.size)
    program = program_of([template.controller(weights, 0.7, Morphology.nominal(), 0)], ROBOTS)
    options: dict[str, Any] = {"seconds": STEPS * TIMESTEP, "interval": 20}
    compiled = rollout(program, scenario, **options)
    for engine in ENGINES:
        act = [act_alone(program, b, scenario.fin_angles[b], np.ones(3)) for b in range(ROBOTS)]
        plain = rollout(act, scenario, engine=engine, **options)
        assert_allclose(compiled.end, plain.end, rtol=0, atol=1e-9)


@pytest.mark.parametrize("late", [False, True])
def test_verbs_mean_the_same_for_one_robot_and_for_many(late: bool) -> None:
    """Some robots start again, change or meet a current; the others swim on."""
    rng = np.random.default_rng(4)

    def lag(count: int) -> np.ndarray:
        return rng.uniform(0.0, LONGEST, count) if late else np.zeros(count)

    def draw(rows: np.ndarray) -> Scenario:
        return Scenario.create(
            rng.uniform(0.2, 1.0, (len(rows), 9)) * TRIALS.morphologies[rows],
            fin_angles=rng.uniform(-3.0, 3.0, (len(rows), 3)),
            servo_gain=rng.uniform(-1.0, 1.0, (len(rows), 3)),
            current=rng.uniform(-0.3, 0.3, (len(rows), 3)),
            velocity=rng.uniform(-0.3, 0.3, (len(rows), 3)),
            spin=rng.uniform(-0.5, 0.5, (len(rows), 3)),
            servo_lag=lag(len(rows)),
        )

    everyone = np.arange(ROBOTS)
    start = replace(draw(everyone), servo_lag=np.full(ROBOTS, LONGEST if late else 0.0))
    many: list[Swimmers] = [LaneBatch(start, np.float64)]
    many += [WorldBatch(start, engine) for engine in ENGINES]
    alone: list[World] = [make_world("numba", start.take(robot)) for robot in everyone]
    for turn in range(12):
        rows = np.sort(rng.choice(ROBOTS, 2, replace=False))
        one = draw(rows)
        verb = ("start", "update", "update", "set_current")[turn % 4]
        if verb == "start":
            one = replace(one, servo_lag=np.full(len(rows), LONGEST if late else 0.0))
        current = rng.uniform(-0.3, 0.3, (ROBOTS, 3))
        action = rng.uniform(-1.0, 1.0, (3, ROBOTS))
        followed = (action[0], action[1], action[2])
        command = np.transpose(servo_speeds(AQUAFISH, followed))
        for swimmers in many:
            if verb == "set_current":
                swimmers.set_current(current)
            else:
                getattr(swimmers, verb)(one, rows)
            lost, seen, terms = swimmers.act(action, followed, 3 + 2 * turn)
            assert not lost.any()
            assert terms is None
            assert_allclose(seen, observe(swimmers.state()), rtol=0, atol=1e-9)
        for robot, world in enumerate(alone):
            if verb == "set_current":
                world.set_current(tuple(current[robot].tolist()))
            elif robot in rows:
                getattr(world, verb)(one.take(np.flatnonzero(rows == robot)))
            world.advance(tuple(command[robot].tolist()), 3 + 2 * turn)
        wanted = np.transpose([np.concatenate(np.atleast_1d(*w.state())) for w in alone])
        for swimmers in many:
            found = np.concatenate(np.atleast_2d(*swimmers.state()))
            assert_allclose(found, wanted, rtol=0, atol=1e-9)
            assert_array_equal(found, swimmers.states[: layout(AQUAFISH).state_numbers])
    for swimmers in many:
        swimmers.close()
        swimmers.close()


@pytest.mark.parametrize("make", [LaneBatch, lambda one: WorldBatch(one, "numba")])
def test_lags_that_no_robot_remembers_commands_for_are_refused(make: Any) -> None:
    start = Scenario.create(servo_lag=[0.0, 0.05, 0.1])
    swimmers = make(start)
    swimmers.update(Scenario.create(servo_lag=[0.05, 0.07]), np.array([1, 2]))
    for lag, rows in (([0.01], [0]), ([0.06], [1]), ([0.05, 0.2], [1, 2])):
        with pytest.raises(InvalidArgumentError, match="servo_lag must not grow beyond"):
            swimmers.update(Scenario.create(servo_lag=lag), np.array(rows))
    swimmers.start(Scenario.create(servo_lag=[0.3]), np.array([0]))
    swimmers.update(Scenario.create(servo_lag=[0.29]), np.array([0]))


def test_a_robot_without_a_lag_swims_alike_beside_a_late_one() -> None:
    scenario = Scenario.create(
        TRIALS.morphologies, fin_angles=TRIALS.fin_angles, servo_lag=[0.0, 0.15, 0.0]
    )
    mixed = LaneBatch(scenario)
    prompt = LaneBatch(replace(scenario, servo_lag=np.zeros(ROBOTS)))
    for command in series(0, 6).transpose(1, 0, 2):
        mixed.advance(command, 7)
        prompt.advance(command, 7)
    same = (mixed.states == prompt.states).all(axis=0)
    assert same.tolist() == [True, False, True]


def test_a_lag_that_comes_with_a_restart_leaves_the_others_as_they_were() -> None:
    """They remember their commands, though the lanes begin to remember more of them."""
    scenario = Scenario.create(
        TRIALS.morphologies, fin_angles=TRIALS.fin_angles, servo_lag=[0.033, 0.05, 0.0]
    )
    grown = LaneBatch(scenario)
    plain = LaneBatch(scenario)
    for turn, command in enumerate(series(0, 8).transpose(1, 0, 2)):
        if turn == 4:
            grown.start(replace(scenario.take(2), servo_lag=np.array([0.4])), np.array([2]))
        grown.advance(command, 5)
        plain.advance(command, 5)
    assert_array_equal(grown.states[:, :2], plain.states[:, :2])
