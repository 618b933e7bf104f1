"""Evolution from a first controller and from a state in mid-swim, within a time."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aquafish_gym import Morphology, WorldConfig
from aquafish_gym.damage import Damage
from aquafish_gym.envs.vector import AquaFishVectorEnv
from aquafish_gym.physics.layout import layout
from aquafish_gym.plans import AQUAFISH
from aquafish_gym.utils.validation import InvalidArgumentError
from gait.controllers.agents import ControllerAgent
from gait.controllers.controller import Controller
from gait.controllers.network import Senses
from gait.search.evolve import EvolveConfig, evolve_gait
from gait.search.templates import Template
from gait.swims.poses import spread_poses, stream, zero_pose
from gait.swims.scores import scores
from gait_fakes import contents, make_controller

HALF = Damage.parse("left_pectoral:length=0.5").apply(Morphology.nominal())
REVERSED = WorldConfig(servo_gain=(1.0, -1.0, 0.5))
MOVING = layout(AQUAFISH).start(
    np.array([[0.4, -1.0, 2.0]]), velocity=(0.0, 0.4, 0.1), spin=(0.1, 0.0, 0.3)
)
START = MOVING[:, 0]
SHORT = EvolveConfig(seed=5, generations=3, population=10, seconds=2.0, threads=1)


def random_gait(seed: int = 1, goal: bool = False, **changes: Any) -> Controller:
    """Return a random network that senses its fins, with an action for every 0.2 s."""
    template = Template.of_class("mlp", Senses(fins=True, goal=goal), 4, 20)
    vector = 0.4 * np.random.default_rng(seed).standard_normal(template.size)
    found = template.controller(vector, 0.7, Morphology.nominal(), seed)
    return Controller.from_dict(found.to_dict() | changes)


def test_first_controller_is_never_made_worse_at_rest() -> None:
    first = make_controller(2, 15)
    poses = np.vstack([zero_pose(), spread_poses(32, stream(SHORT.seed, 1))])
    before = scores([first], HALF, poses, SHORT.seconds).mean()
    found = evolve_gait(HALF, replace(SHORT, generations=9), first=first)
    assert found.history[0].final == pytest.approx(before, abs=1e-12)
    assert found.fitness >= before
    assert found.controller.morphology == HALF
    assert (found.controller.weights != 0.0)[~Template.like(first).free].sum() == 0


@pytest.mark.parametrize("changes", [{}, {"output": "clip"}])
def test_first_controller_is_made_better_from_a_state(changes: dict[str, str]) -> None:
    first = random_gait(**changes)
    config = replace(SHORT, generations=15)
    before = scores([first], HALF, seconds=2.0, world=REVERSED, start=START)[0, 0]
    found = evolve_gait(HALF, config, first=first, start=START, world=REVERSED)
    after = scores([found.controller], HALF, seconds=2.0, world=REVERSED, start=START)
    assert found.fitness == found.distances[0] == after[0, 0]
    assert found.fitness > before + 0.05
    assert (found.controller.output, found.controller.interval) == (first.output, 20)
    again = evolve_gait(HALF, replace(config, threads=2), first=first, start=START, world=REVERSED)
    assert again.controller.to_dict() == found.controller.to_dict()


def test_random_networks_are_searched_from_a_state() -> None:
    config = replace(SHORT, random_candidates=20, restarts=2)
    found = evolve_gait([HALF, Morphology.nominal()], config, start=START)
    far = scores([found.controller], [HALF, Morphology.nominal()], seconds=2.0, start=START)
    np.testing.assert_array_equal(found.distances, far[0])
    assert found.fitness == far.mean() == max(row.final for row in found.history)
    assert all(row.final >= row.best for row in found.history)


def test_swim_from_a_state_continues_an_episode() -> None:
    """An agent that knows its servo gains, and the simulation of it from the middle on."""
    envs = AquaFishVectorEnv(1, damage="right_pectoral:reversed; caudal:weak=0.5", threads=1)
    seen, info = envs.reset(seed=3)
    agent, gait = ControllerAgent(random_gait(4)), random_gait(6)
    agent.reset(info)
    for step in range(40):
        if step == 20:
            start, began = envs.states[:, 0], info["y_position"][0]
            agent = ControllerAgent(gait, REVERSED.servo_gain)
            agent.reset(info)
        seen, _, _, _, info = envs.step(agent.act(seen))
    assert np.abs(start[7:10]).max() > 0.01  # it is moving
    options: Any = {"seconds": 4.0, "world": REVERSED, "start": start}
    far = scores([gait], None, **options)[0, 0]
    assert far == pytest.approx(info["y_position"][0] - began, abs=1e-4)
    assert far == scores([gait], None, **options, believed_gain=REVERSED.servo_gain)[0, 0]
    assert abs(far - scores([gait], None, **options, believed_gain=(1.0, 1.0, 1.0))[0, 0]) > 1e-2


def test_gait_is_evolved_with_known_servo_gains() -> None:
    config = EvolveConfig(
        seed=2, generations=30, random_candidates=60, restarts=1, population=12, poses=2,
        seconds=4.0, senses=("imu", "clock", "fins"), interval=20, threads=1,
    )  # fmt: skip
    evolved = evolve_gait(HALF, config, world=REVERSED)
    poses = np.vstack([zero_pose(), spread_poses(32, stream(config.seed, 1))])
    known, unknown = (
        scores([evolved.controller], HALF, poses, 4.0, world=REVERSED, believed_gain=gain).mean()
        for gain in (REVERSED.servo_gain, (1.0, 1.0, 1.0))
    )
    assert evolved.fitness == pytest.approx(known, abs=1e-12)
    assert known > 1.5 * unknown > 0.0


def test_search_ends_when_its_time_is_used_up(tmp_path: Path) -> None:
    options: Any = {"first": random_gait(), "start": START}
    straight = evolve_gait(HALF, SHORT, out=tmp_path / "straight", **options)
    for done in range(1, 4):
        found = evolve_gait(HALF, SHORT, out=tmp_path / "parts", cpu_seconds=0.0, **options)
        assert found.history == straight.history[:done]
    assert contents(tmp_path / "parts") == contents(tmp_path / "straight")
    ample = evolve_gait(HALF, SHORT, cpu_seconds=1000.0, **options)
    assert ample.history == straight.history
    with pytest.raises(InvalidArgumentError, match="with start"):
        evolve_gait(HALF, SHORT, out=tmp_path / "parts", **{**options, "start": START + 0.1})


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"first": random_gait(goal=True)}, "first must not observe a goal"),
        ({"start": START, "config": EvolveConfig(task="station")}, "start has no effect with"),
        ({"start": START, "config": EvolveConfig(poses=1)}, "poses has no effect with start"),
        ({"config": EvolveConfig(search="neat")}, "search has no effect with first"),
        ({"config": EvolveConfig(hidden=6)}, "hidden has no effect with first"),
        ({"config": EvolveConfig(clock=0.7)}, "clock has no effect with first"),
        ({"config": EvolveConfig(senses=("imu",))}, "senses has no effect with first"),
        ({"config": EvolveConfig(restarts=2)}, "restarts has no effect with first"),
        (
            {"first": random_gait(interval=7), "config": EvolveConfig(task="station")},
            "first must hold its actions",
        ),
    ],
)
def test_bad_argument_is_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidArgumentError, match=message):
        evolve_gait(HALF, **{"config": SHORT, "first": random_gait(), **options})
