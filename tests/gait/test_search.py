"""Searches and their races: same seed, same run, whoever draws and wherever it stopped."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aquafish_gym.morphology import Morphology
from aquafish_gym.utils.validation import InvalidArgumentError
from gait.evolve import EvolveConfig, evolve_gait
from gait.network import Senses
from gait.records import Generation
from gait.search import schedules
from gait.search.asking import Answer, Search
from gait.search.cma import race
from gait.search.templates import Template
from gait_fakes import WeightScorer, contents

CMA = EvolveConfig(
    seed=7, search="cma", controller="linear", generations=125, population=10, screened=30, poses=1
)
NEAT = EvolveConfig(seed=7, starts=2, generations=16, polish=6, population=20, poses=1)
BODY = Morphology.nominal()


@pytest.mark.parametrize("config", [CMA, NEAT], ids=["cma", "neat"])
def test_an_interrupted_run_ends_in_the_same_files(config: EvolveConfig, tmp_path: Path) -> None:
    straight = evolve_gait(None, config, out=tmp_path / "straight", scorer=WeightScorer())
    assert len(straight.history) == config.plan.rows
    # In scorings, of which a generation has one or two.
    for stop in (2, config.plan.rows // 3, config.plan.rows - 2):
        out = tmp_path / str(stop)
        np.random.seed(stop)  # noqa: NPY002  # nobody else's drawing counts
        with pytest.raises(KeyboardInterrupt):
            evolve_gait(None, config, out=out, scorer=WeightScorer(stop + 1))
        evolve_gait(None, config, out=out, scorer=WeightScorer())
        assert contents(out) == contents(tmp_path / "straight")


@pytest.mark.parametrize(("config", "last"), [(CMA, "generations"), (NEAT, "polish")])
def test_the_last_part_of_a_run_may_be_prolonged(
    config: EvolveConfig, last: str, tmp_path: Path
) -> None:
    changes: Any = {last: getattr(config, last) + 5}
    evolve_gait(None, config, out=tmp_path, scorer=WeightScorer())
    grown = evolve_gait(None, replace(config, **changes), out=tmp_path, scorer=WeightScorer())
    assert (
        grown.history
        == evolve_gait(None, replace(config, **changes), scorer=WeightScorer()).history
    )
    with pytest.raises(InvalidArgumentError, match=f"{last} must be at least the"):
        evolve_gait(None, config, out=tmp_path, scorer=WeightScorer())


def test_other_seeds_other_runs() -> None:
    found = {
        evolve_gait(
            None, replace(CMA, seed=seed, generations=3, starts=1), scorer=WeightScorer()
        ).controller.weights.tobytes()
        for seed in range(3)
    }
    assert len(found) == 3


def test_polishing_begins_where_evolution_ended_and_only_gains() -> None:
    history: list[Generation] = []
    evolve_gait(None, NEAT, scorer=WeightScorer(), on_generation=history.append)
    bred = NEAT.starts * NEAT.generations  # type: ignore[operator]
    first = max(row.final for row in history[: NEAT.generations])
    assert history[bred].final == pytest.approx(first)
    best = max(row.final for row in history[:bred])
    assert max(row.final for row in history[bred:]) > best


def climb(search: Search, peak: np.ndarray[Any, Any], rows: int) -> list[float]:
    """Let a search climb a hill in the space of its weights; return its generations' finals."""
    asked, finals = next(search), []
    for _ in range(rows):
        worth = [-float(((c.weights - peak) ** 2).sum()) for c in asked.controllers]
        if asked.finalists != []:
            winner = (asked.finalists or [asked.controllers[int(np.argmax(worth))]])[0]
            finals.append(-float(((winner.weights - peak) ** 2).sum()))
        asked = search.send(Answer(worth, winner, finals[-1]))
    return finals


def test_the_race_climbs_a_hill() -> None:
    template = Template.of_class("linear", Senses(), 0)
    rng = np.random.default_rng(3)
    peak = np.where(template.free, rng.normal(size=template.free.shape), 0.0)
    build = lambda x: template.controller(x, 0.7, BODY, 0)  # noqa: E731
    finals = climb(race(template.random(50, rng), build, 24, 6, rng), peak, 1201)
    assert max(finals[:1]) < -5.0
    assert finals[-1] > -0.01
    assert schedules.legs(6, 750) == [(6, 50), (3, 100), (1, 600)]


@pytest.mark.parametrize("name", ["linear", "mlp", "recurrent", "fourier"])
def test_a_controller_is_its_vector(name: str) -> None:
    senses = Senses(imu=False, clock=3) if name == "fourier" else Senses(fins=True)
    template = Template.of_class(name, senses, 4)
    vector = 0.5 * np.random.default_rng(1).standard_normal(template.size)
    controller = template.controller(vector, 0.7, BODY, 0)
    np.testing.assert_array_equal(template.vector(controller)[1:], vector[1:])
    assert controller.clock == pytest.approx(0.7 * 2.0 ** vector[0])
    assert controller.memory is (name == "recurrent")
    like = Template.like(controller)
    assert like.free[template.free].all()


def test_a_memory_is_nothing_at_first_and_comes_in_the_search() -> None:
    config = EvolveConfig(
        search="cma", generations=2, starts=1, screened=3, population=10, poses=0, seconds=1.0
    )
    template = Template.of_class("recurrent", config.plan.senses, config.hidden)
    first = template.controller(template.random(1, np.random.default_rng(0))[0], 0.7, BODY, 0)
    assert not first.memory
    assert np.count_nonzero(first.weights) == (template.free.sum() - config.hidden**2)
    asked: list[bool] = []

    def score(controllers: Any, _bodies: Any, poses: Any) -> Any:
        asked.extend(controller.memory for controller in controllers)
        return np.zeros((len(controllers), len(poses)))

    evolve_gait(None, config, scorer=score)
    assert asked.count(False) >= 3
    assert asked.count(True) == 20


def test_a_mean_swims_the_fixed_swims_now_and_then() -> None:
    """In between, a generation's row says what the last of them came to."""
    swims: list[int] = []
    inner = WeightScorer()

    def score(controllers: Any, bodies: Any, poses: Any) -> Any:
        swims.append(len(controllers))
        return inner(controllers, bodies, poses)

    found = evolve_gait(None, replace(CMA, generations=9, starts=1), scorer=score)
    assert swims == [30, 8, *([10, 1] + [10] * 3) * 2, 10, 1, 1]
    finals = [row.final for row in found.history]
    assert finals[1] == finals[4] != finals[5] == finals[8] != finals[9]
    assert found.fitness == max(finals)
