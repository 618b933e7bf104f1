"""Gaits of other fish than AquaFish: the chain from a search to a film and to C."""

from __future__ import annotations

import json
import runpy
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aquafish_gym import Morphology
from aquafish_gym.bodies import write_bodies
from aquafish_gym.envs.tasks import HoldStation, SwimForward
from aquafish_gym.plans import AQUAFISH, FOUR_FINS, TAIL_FISH, BodyPlan, plan_document
from aquafish_gym.utils.validation import InvalidArgumentError
from aquafish_gym.world_config import WorldConfig
from gait import (
    Controller,
    ControllerAgent,
    EvolveConfig,
    evaluate,
    evolve_gait,
    random_poses,
    scores,
    swim,
)
from gait.__main__ import main
from gait.controllers.network import Senses
from gait.learning.train import LearningConfig
from gait.search.templates import Template
from gait.swims.transfer import TransferConfig, transfer
from tests.plans import ODD, PLANS

SHORT: dict[str, Any] = {"population": 10, "restarts": 1, "generations": 1, "poses": 1,
                         "seconds": 1.0, "threads": 1}  # fmt: skip


def make(plan: BodyPlan, senses: Senses, seed: int = 0) -> Controller:
    """Return a random controller of a plan."""
    template = Template.of_class("recurrent", senses, 4, plan=plan)
    vector = 0.7 * np.random.default_rng(seed).standard_normal(template.size)
    return template.controller(vector, 0.7, Morphology.nominal(plan), seed)


def as_json(value: Any) -> Any:
    return json.loads(json.dumps(value))


TAIL = make(TAIL_FISH, Senses(fins=True))
AQUA = make(AQUAFISH, Senses(fins=True))
FOUR = make(FOUR_FINS, Senses(fins=True))
SLOW = pytest.mark.slow  # each plan has kernels of its own


@pytest.mark.parametrize(
    "plan", [FOUR_FINS, pytest.param(TAIL_FISH, marks=SLOW), pytest.param(ODD, marks=SLOW)]
)
def test_a_gait_is_evolved_and_read_back(plan: BodyPlan, tmp_path: Path) -> None:
    config = EvolveConfig(
        plan=plan, random_candidates=10, senses=("imu", "clock", "fins"), seed=1, **SHORT
    )
    evolved = evolve_gait(config=config, out=tmp_path)
    assert evolved.controller.plan == plan
    written = Controller.load(tmp_path / "controller.json")
    assert written.to_dict() == evolved.controller.to_dict()
    settings = json.loads((tmp_path / "settings.json").read_text())["settings"]
    assert settings["plan"] == as_json(plan_document(plan))
    resumed = evolve_gait(config=replace(config, generations=2), out=tmp_path)
    assert resumed.history[: len(evolved.history)] == evolved.history
    poses = random_poses(3, 0, plan)
    together = scores([written, make(plan, written.senses)], None, poses, 2.0, dtype="float64")
    alone = [swim(written, None, pose, "numba", 2.0).distance for pose in poses]
    np.testing.assert_allclose(together[0], alone, atol=1e-9)
    assert np.ptp(together) > 1e-3


@pytest.mark.parametrize("kind", [EvolveConfig, LearningConfig])
def test_a_configuration_reads_the_file_of_its_plan_once(kind: Any, tmp_path: Path) -> None:
    path = tmp_path / "odd.json"
    path.write_text(ODD.to_json())
    config = kind(plan=str(path))
    path.unlink()
    assert config.plan == replace(config, seed=1).plan == ODD
    assert kind(plan="four-fins").plan == "four-fins"  # as a command shows it


def test_neat_evolves_a_network_with_an_output_for_each_servo() -> None:
    evolved = evolve_gait(
        config=EvolveConfig(plan="four-fins", search="neat", cma_generations=1, **SHORT)
    )
    outputs = evolved.controller.to_dict()["outputs"]
    assert outputs == ["fore_left", "fore_right", "hind_left", "hind_right"]
    assert evolved.controller.nodes >= 4


@pytest.mark.parametrize("plan", PLANS)
def test_a_file_of_another_plan_says_so(plan: BodyPlan) -> None:
    data = as_json(make(plan, Senses(fins=True, goal=True)).to_dict())
    assert data.get("plan") == (None if plan == AQUAFISH else as_json(plan_document(plan)))
    assert data["inputs"][11:-3] == [f"{fin}_{x}" for fin in plan.names for x in ("sine", "cosine")]
    assert as_json(Controller.from_dict(data).to_dict()) == data
    data["plan"] = "four-fins" if plan == AQUAFISH else "aquafish"
    with pytest.raises(InvalidArgumentError, match=r"controller\.inputs must be"):
        Controller.from_dict(data)


@pytest.mark.parametrize(
    "refused",
    [
        lambda: swim(TAIL, Morphology.nominal(), engine="numba"),
        lambda: scores([TAIL], [Morphology.nominal()]),
        lambda: scores([AQUA, TAIL]),
        lambda: evaluate(TAIL, episodes=1),
        lambda: evaluate(ControllerAgent(AQUA), "TailFish-v0", episodes=1),
        lambda: transfer(TAIL, Morphology.nominal(), TransferConfig(poses=1)),
        lambda: evolve_gait(config=EvolveConfig(**SHORT), first=TAIL),
        lambda: evolve_gait(Morphology.nominal(), EvolveConfig(plan="tail-fish", **SHORT)),
    ],
)
def test_a_controller_of_another_plan_is_refused(refused: Callable[[], Any]) -> None:
    """Both have three fins, so that every shape fits."""
    words = r"must be of the plan (aquafish|tail-fish); got"
    with pytest.raises(InvalidArgumentError, match=words):
        refused()


def test_a_controller_acts_in_the_environments_of_its_plan() -> None:
    found = evaluate(FOUR, "FourFins-v0", episodes=3, frame_skip=5)
    starts = [float(x) for x in found.y_position[-1]]
    assert np.isfinite(starts).all()
    assert np.ptp(starts) > 1e-3


def test_the_commands_take_a_plan(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    gait = str(tmp_path / "controller.json")
    body = tmp_path / "body.json"
    write_bodies(body, {"hind_left": (0.2, 0.5, 0.1)}, FOUR_FINS)
    quick = ["--paper", "--generations", "1", "--population", "10", "--seconds", "1"]
    assert main(["evolve", "--plan", "four-fins", "--out", str(tmp_path), *quick]) == 0
    assert Controller.load(gait).plan == FOUR_FINS
    swims = ["--target-morphology", str(body), "--poses", "1", "--seconds", "1"]
    words = ["transfer", "--controller", gait, "--damage", "hind_left:length=0.5", *swims]
    assert main([*words, "--target-engine", "numba"]) == 0
    film = ["film", gait, "--damage", "none", "random:severe", "--seconds", "1"]
    assert main([*film, "--html", str(tmp_path / "swim.html"), "--engine", "numba"]) == 0
    assert main(["export", gait, "--c", str(tmp_path / "fish.c")]) == 0
    model = ["export", "--plan", "tail-fish", "--model", str(tmp_path / "model.c")]
    assert main(model) == 0
    capsys.readouterr()
    assert main(["export", gait, "--plan", "tail-fish", "--model", str(tmp_path / "x.c")]) == 2
    assert "a controller, which has a plan of its own" in capsys.readouterr().err


EXAMPLE = Path(__file__).parents[2] / "examples" / "evolving_plans.py"


def test_an_example_has_sixty_lines_and_draws_plans_whose_fins_are_outside() -> None:
    code = EXAMPLE.read_text(encoding="utf-8").rpartition('"""\n\nimport')[2]
    assert len([line for line in code.splitlines() if line.strip()]) <= 60
    example = runpy.run_path(str(EXAMPLE))
    for genome in example["GENES"].random(100, np.random.default_rng(0)):
        fish = example["fish_of"](genome)
        right = fish.plan.fins[1]
        assert right.hinge[0] - fish.right_pectoral[0] / 2 >= fish.plan.hull.radius - 1e-9


@pytest.mark.slow
def test_the_example_evolves_a_plan(tmp_path: Path) -> None:
    example = runpy.run_path(str(EXAMPLE))
    config = EvolveConfig(random_candidates=10, **SHORT)
    picture = tmp_path / "plan.png"
    far = example["main"](str(picture), count=1, rounds=1, short=config, long=config)
    assert np.isfinite(far).all()
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_episodes_may_be_in_water_with_added_mass() -> None:
    """With damage, of a task, or of a task of one's own; what else a world has is their own."""

    class Ahead(SwimForward):
        """Swims in a batched environment, one step after another."""

    cases: list[dict[str, Any]] = [
        {"damage": "caudal:length=0.9", "task": HoldStation()}, {"task": Ahead(seconds=2.0)},
    ]  # fmt: skip
    for of in cases:
        plain, reactive = (
            scores([AQUA], world=WorldConfig(reactive=added), threads=1, **of)
            for added in (False, True)
        )
        assert np.isfinite([plain, reactive]).all()
        assert abs(reactive - plain).min() > 0.1
    with pytest.raises(InvalidArgumentError, match="world has no effect on an episode"):
        scores([AQUA], damage="caudal:length=0.9", world=WorldConfig(lag=0.1))
