"""Rollouts: the compiled loop, the plain loop on every engine and the environments agree."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from aquafish_gym.damage import Damage
from aquafish_gym.engines.packages import check_engine
from aquafish_gym.envs.tasks import (
    HoldStation,
    ReachWaypoints,
    ReturnToBuoys,
    SwimForward,
    Task,
)
from aquafish_gym.morphology import Morphology
from aquafish_gym.physics.layout import layout
from aquafish_gym.plans import AQUAFISH
from aquafish_gym.rollout import Trajectories, rollout
from aquafish_gym.rollout.programs import act_alone
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.validation import InvalidArgumentError
from gait.controllers.agents import ControllerAgent
from gait.controllers.controller import Controller, program_of
from gait.controllers.network import Senses
from gait.search.templates import Template
from gait.swims.poses import random_poses
from tests.scenarios import with_changes

ROBOTS, SECONDS, INTERVAL = 5, 4.0, 20
POSES = random_poses(ROBOTS, 1)
GAINS = (0.9, 1.0, 1.1)  # what the controllers believe of the servos


TASKS = (
    SwimForward(seconds=SECONDS),
    HoldStation(seconds=SECONDS, turning=0.3),
    ReachWaypoints(seconds=SECONDS, apart=0.6, radius=0.4),
    # Some get there, and swim on without reward.
    ReturnToBuoys(seconds=SECONDS, pace=0.003, slowest=0.0, fastest=0.001),
)


def make_controller(task: Task | None, seed: int = 3) -> Controller:
    goal = task is not None and task.has_goal
    template = Template.of_class("recurrent", Senses(fins=True, goal=goal), 5, INTERVAL)
    vector = 0.5 * np.random.default_rng(seed).standard_normal(template.size)
    return template.controller(vector, 0.7, Morphology.nominal(), 0)


def whole() -> Scenario:
    return Scenario.create(fin_angles=POSES)


def broken() -> Scenario:
    """Return robots whose bodies, servos and sensors break twice, the second time in mid-action."""
    start = Scenario.create(
        fin_angles=POSES, gyro_noise=[0.0, 0.3, 0.0, 0.1, 0.0], servo_gain=[1.0, 1.0, 0.7]
    )
    rows = np.array([1, 3, 4])
    first = start.take(rows).copy()
    first.servo_gain[:, 0] = 0.0
    first.sensor_stuck[1] = [True, False] * 4 + [True]
    first.gyro_noise[2] = 0.5
    second = first.take([1, 2]).copy()
    second.body[:, 0] *= 0.5
    second.sensor_bias[0, 2:8] = 0.2
    second.sensor_dropped[1, 3:] = True
    return with_changes(start, [(100, rows, first), (230, rows[1:], second)])


def late() -> Scenario:
    """Return robots whose sensors and servos become late, and one of whose sensors is scaled."""
    text = "gyro:delay=0.4@1; up_x:hold=0.6; north_x:scale=0.5@2+3; caudal:delay=0.6"
    return Damage.parse(f"{text}; left_pectoral:hold=0.4@2").edit(whole(), INTERVAL)


def swim(task: Task | None, scenario: Scenario, how: str = "compiled", **more: Any) -> Trajectories:
    """Roll out the same controller, compiled or in the plain loop of an engine."""
    program = program_of([make_controller(task)], ROBOTS)
    policy: Any = program
    if how == "compiled":
        more |= {"believed": POSES + 0.1, "believed_gain": GAINS}
    else:
        fins, gains = POSES + 0.1, np.array(GAINS)
        policy = [act_alone(program, b, fins[b], gains) for b in range(ROBOTS)]
        more["engine"] = how
    if task is None:
        more["seconds"] = SECONDS
    return rollout(
        policy, scenario, task, interval=INTERVAL,
        rngs=[np.random.default_rng(b) for b in range(ROBOTS)], **more,
    )  # fmt: skip


@pytest.mark.pybullet
@pytest.mark.parametrize("scenario", [whole, broken, late])
@pytest.mark.parametrize("task", [*TASKS, None], ids=lambda task: type(task).__name__)
def test_compiled_loop_agrees_with_the_plain_one_on_every_engine(
    task: Task | None, scenario: Callable[[], Scenario]
) -> None:
    robots = scenario()
    compiled = swim(task, robots)
    for engine in ("numba", "pybullet"):
        plain = swim(task, robots, engine)
        np.testing.assert_allclose(compiled.returns, plain.returns, atol=1e-9)
        np.testing.assert_allclose(compiled.end, plain.end, atol=1e-9)
        assert [len(path.gyro) for path in plain.paths] == [round(SECONDS / 0.01)] * ROBOTS
    single = swim(task, robots, dtype=np.float32)
    np.testing.assert_allclose(single.returns, compiled.returns, atol=5e-3)
    np.testing.assert_allclose(single.end, compiled.end, atol=5e-3)


@pytest.mark.parametrize("name", ["AquaFishStation-v0", "AquaFishWaypoint-v0"])
def test_returns_are_those_of_the_environment(name: str) -> None:
    env = gym.make_vec(name, num_envs=ROBOTS, dtype="float64", damage="gyro:noise=0.2;up_y:stuck@2")
    seen, info = env.reset(seed=5)
    task = env.unwrapped.task  # type: ignore[attr-defined]
    agent = ControllerAgent(make_controller(task))
    agent.reset(info)
    returns = np.zeros(ROBOTS)
    for _ in range(round(SECONDS / 0.2)):
        seen, rewards, *_ = env.step(agent.act(seen))
        returns += rewards
    rngs = [np.random.default_rng(5 + b) for b in range(ROBOTS)]
    poses = [rng.uniform(-np.pi, np.pi, 3) for rng in rngs]
    start = Scenario.create(fin_angles=poses, gyro_noise=0.2)
    stuck = start.copy()
    stuck.sensor_stuck[:, 1] = True
    found = rollout(
        program_of([make_controller(task)], ROBOTS),
        start.then(200, stuck),
        replace(task, seconds=SECONDS),
        rngs=rngs,
    )
    # Observations and actions of environments are rounded to single precision.
    np.testing.assert_allclose(found.returns, returns, atol=1e-3)


def test_result_depends_neither_on_threads_nor_on_other_robots() -> None:
    rows = np.tile(np.arange(ROBOTS), 9)
    program = program_of([make_controller(TASKS[1], seed) for seed in range(9)], ROBOTS)
    memory = np.random.default_rng(0).uniform(0.1, 0.3, (45, 3))
    scenario = whole().take(rows)
    one, two = (
        rollout(program, scenario, TASKS[1], memory=memory, threads=threads) for threads in (1, 2)
    )
    np.testing.assert_array_equal(one.returns, two.returns)
    some = rollout(
        replace(program, weights=program.weights[:, 7:9]), scenario.take([7, 8]), TASKS[1],
        memory=memory[7:9],
    )  # fmt: skip
    np.testing.assert_array_equal(some.returns, one.returns[7:9])


def test_divergence_is_noted_and_ends_the_return() -> None:
    scenario = replace(whole(), drag=np.full((ROBOTS, 2), 1e6))
    compiled, plain = swim(TASKS[0], scenario), swim(TASKS[0], scenario, "numba")
    assert compiled.diverged.all()
    assert plain.diverged.all()
    assert np.isnan(compiled.end).all()
    assert np.isfinite(compiled.returns).all()
    np.testing.assert_allclose(compiled.returns, plain.returns, rtol=1e-6)


@pytest.mark.parametrize("kind", ["program", "functions"])
def test_the_engine_auto_is_the_one_that_it_stands_for(kind: str) -> None:
    act: Any = [lambda _seen, _time: np.full(3, 0.3)] * ROBOTS
    policy = act if kind == "functions" else program_of([make_controller(None)], ROBOTS)
    found, named = (
        rollout(policy, whole(), seconds=1.0, engine=engine).end
        for engine in ("auto", check_engine("auto"))
    )
    np.testing.assert_array_equal(found, named)


def test_what_does_not_fit_is_refused() -> None:
    program = program_of([make_controller(TASKS[1])], ROBOTS)
    act: Any = [lambda _seen, _time: np.zeros(3)] * ROBOTS
    for name, value in (
        ("believed", POSES), ("believed_gain", GAINS), ("dtype", np.float32), ("threads", 1),
    ):  # fmt: skip
        with pytest.raises(InvalidArgumentError, match=f"{name} must not be given with"):
            rollout(act, whole(), seconds=1.0, **{name: value})
    with pytest.raises(InvalidArgumentError, match="memory must be None"):
        rollout(act, whole(), seconds=1.0, memory=np.zeros((ROBOTS, 3)))
    with pytest.raises(InvalidArgumentError, match="interval must be None or 20"):
        rollout(program, whole(), TASKS[1], interval=5)
    with pytest.raises(InvalidArgumentError, match="goal"):
        rollout(program, whole(), seconds=1.0)
    with pytest.raises(InvalidArgumentError, match=r"interval must divide the 410 steps.+got 20"):
        rollout(program, whole(), TASKS[1], seconds=4.1)
    with pytest.raises(InvalidArgumentError, match="one kind"):
        program_of([make_controller(TASKS[0]), make_controller(TASKS[1])], 1)


@pytest.mark.parametrize("engine", ["numba", "pybullet"])
def test_a_rollout_draws_the_angles_of_dead_servos(engine: str) -> None:
    robots = Damage.parse("caudal:dead").edit(Scenario.create([Morphology.nominal()] * 3))
    policies = [lambda *_: (0.3, -0.2, 1.0)] * 3
    with pytest.raises(InvalidArgumentError, match="the angles of dead servos; got 0"):
        rollout(policies, robots, engine=engine, seconds=0.5)
    rngs = [np.random.default_rng(seed) for seed in range(3)]
    found = rollout(policies, robots, engine=engine, seconds=0.5, rngs=rngs)
    assert not found.diverged.any()
    angles = [np.random.default_rng(seed).uniform(-np.pi, np.pi) for seed in range(3)]
    for path, angle in zip(found.paths, angles, strict=True):
        np.testing.assert_allclose(path.fin_angles[:, 2], angle)


def test_a_program_from_a_state_believes_the_angles_of_that_state() -> None:
    senses = Senses(fins=True)
    weights = np.zeros((3, len(senses.names()) + 3))
    weights[:, :-3] = np.random.default_rng(0).normal(size=(3, len(senses.names())))
    body = Morphology.nominal()
    program = program_of(
        [Controller(weights, np.zeros(3), np.ones(3), 0.7, body, 0, senses=senses)]
    )
    angles = np.array([(0.5, -0.4, 2.0)])
    there = rollout(program, Scenario.create(fin_angles=angles), seconds=2.0)
    dead = Damage.parse("caudal:dead").edit(Scenario.create())
    elsewhere = replace(dead, servo_gain=np.ones((1, 3)))
    start = layout(AQUAFISH).start(angles)
    np.testing.assert_array_equal(
        there.end, rollout(program, elsewhere, seconds=2.0, start=start).end
    )
