"""Controllers in the environments' tasks: scores, and searches for them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aquafish_gym.damage import Damage
from aquafish_gym.envs.tasks import ReachWaypoints, ReturnToBuoys, SwimForward
from aquafish_gym.morphology import Morphology
from aquafish_gym.utils.validation import InvalidArgumentError
from gait.controllers.controller import Controller
from gait.controllers.network import Senses
from gait.search.config import EvolveConfig
from gait.search.evolve import evolve_gait
from gait.search.templates import Template
from gait.swims.poses import random_poses
from gait.swims.scores import scores
from gait_fakes import contents

BODY = Morphology.nominal()
POSES = random_poses(3, 1)


def make(senses: Senses, seed: int, interval: int = 20) -> Controller:
    template = Template.of_class("recurrent", senses, 5, interval)
    vector = 0.5 * np.random.default_rng(seed).standard_normal(template.size)
    return template.controller(vector, 0.7, BODY, 0)


def test_score_of_swimming_forward_is_the_distance() -> None:
    """Without the small price of effort."""
    controllers = [make(Senses(fins=True), seed) for seed in range(2)]
    task = SwimForward(seconds=4.0, ctrl_weight=0.0)
    found = scores(controllers, BODY, POSES, task=task)
    np.testing.assert_allclose(found, scores(controllers, BODY, POSES, 4.0), atol=1e-4)
    assert np.ptp(found) > 0.1


def test_episodes_follow_from_the_seed_and_are_shared() -> None:
    controllers = [make(Senses(goal=True), seed) for seed in (0, 0, 1)]
    one, again, other = (
        scores(controllers, BODY, POSES, task="waypoint", damage="random:severe", seed=seed)
        for seed in (5, 5, 9)
    )
    np.testing.assert_array_equal(one, again)
    np.testing.assert_array_equal(one[0], one[1])
    assert (one[0] != one[2]).all()
    assert (one != other).all()
    with pytest.raises(InvalidArgumentError, match="equally many, or one for all; got 2 and 3"):
        scores(controllers, [BODY, BODY], POSES, task="waypoint")


class MyForward(SwimForward):
    """A subclass, which no compiled loop knows."""


class MyWaypoints(ReachWaypoints):
    """The same, with a goal."""


class MyReturn(ReturnToBuoys):
    """The same, which can end in success."""


@pytest.mark.pybullet
@pytest.mark.parametrize("damage", [None, "random:moderate@1-3", "gyro:noise=0.1; caudal:dead"])
@pytest.mark.parametrize(
    "mine",
    [MyForward, *(pytest.param(one, marks=pytest.mark.slow) for one in (MyWaypoints, MyReturn))],
)
def test_a_task_of_ones_own_scores_as_the_compiled_one(mine: Any, damage: str | None) -> None:
    """Controllers of two kinds, on a body each."""
    task = mine(seconds=6.0)
    senses = Senses(fins=True, goal=task.has_goal)
    controllers = [make(senses, 1), make(senses, 2, interval=30), make(senses, 3)]
    broken = ("caudal:length=0.5", "left_pectoral:missing")
    bodies = [BODY, *(Damage.parse(damage).apply(BODY) for damage in broken)]
    options: dict[str, Any] = {"damage": damage, "seed": 3, "dtype": "float64"}
    built_in = mine.__mro__[1](seconds=6.0)
    expected = scores(controllers, bodies, POSES, task=built_in, **options)
    found = scores(controllers, bodies, POSES, task=task, **options)
    np.testing.assert_allclose(found, expected, rtol=1e-3, atol=1e-3)
    assert np.ptp(found) > 0.1
    bullet = scores(controllers[:1], bodies, POSES, task=task, engine="pybullet", **options)
    np.testing.assert_allclose(bullet, found[:1], rtol=1e-3, atol=1e-3)


def test_a_task_of_ones_own_needs_its_goal_and_its_steps() -> None:
    with pytest.raises(InvalidArgumentError, match="must not sense a goal"):
        scores([make(Senses(goal=True), 1)], task=MyForward())
    with pytest.raises(InvalidArgumentError, match="frame_skip must divide"):
        scores([make(Senses(), 1, interval=7)], task=MyForward())
    with pytest.raises(InvalidArgumentError, match="interval must divide 33"):
        EvolveConfig(task=MyForward(seconds=0.33))
    with pytest.raises(InvalidArgumentError, match="task must be a Task or one of"):
        EvolveConfig(task=3)  # type: ignore[arg-type]


FEW = EvolveConfig(
    search="cma", controller="linear", task=MyForward(seconds=2.0), interval=20, restarts=1,
    random_candidates=3, generations=3, population=10, poses=1,
)  # fmt: skip


def test_a_search_in_a_task_of_ones_own_resumes_to_the_same_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = evolve_gait(None, FEW, out=tmp_path / "all")
    built_in = evolve_gait(None, replace(FEW, task=SwimForward(seconds=2.0)))
    assert found.fitness == pytest.approx(built_in.fitness, abs=1e-2)

    def stop(row: Any) -> None:
        if row.generation == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        evolve_gait(None, FEW, out=tmp_path / "parts", on_generation=stop)
    evolve_gait(None, FEW, out=tmp_path / "parts")
    assert contents(tmp_path / "parts") == contents(tmp_path / "all")
    for task, what in (
        (MyForward(seconds=4.0), "task.fields.seconds"),
        (SwimForward(seconds=2.0), "task.class"),
        ("forward", "task"),
    ):
        with pytest.raises(InvalidArgumentError, match=f"holds a gait with {what}"):
            evolve_gait(None, replace(FEW, task=task), out=tmp_path / "all")
    monkeypatch.setattr("gait.search.evolve.code_hash", lambda _: "other")
    with pytest.raises(InvalidArgumentError, match="holds a gait with task_code"):
        evolve_gait(None, FEW, out=tmp_path / "all")


def test_a_task_that_no_file_can_state_is_searched_without_out(tmp_path: Path) -> None:
    class Local(SwimForward):
        pass

    config = replace(FEW, task=Local(seconds=2.0), generations=1)
    assert (
        evolve_gait(None, config).fitness
        == evolve_gait(None, replace(config, task=MyForward(seconds=2.0))).fitness
    )
    with pytest.raises(InvalidArgumentError, match="out must be None with this task: task cannot"):
        evolve_gait(None, config, out=tmp_path / "out")
    assert not list(tmp_path.iterdir())
