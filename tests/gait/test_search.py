"""Searches by ask and tell: they climb, keep the best, and depend on their seed alone."""

from __future__ import annotations

import contextlib
from dataclasses import replace
from itertools import combinations, product
from typing import Any

import numpy as np
import pytest

from aquafish_gym.morphology import Morphology
from aquafish_gym.utils.validation import InvalidArgumentError
from gait.controllers.controller import Controller
from gait.controllers.network import Senses
from gait.search.ask_tell import Proposal, Relay, Search, halve
from gait.search.cma import multistart
from gait.search.evolve import EvolveConfig, make_search
from gait.search.history import Generation
from gait.search.templates import Template
from gait_fakes import WeightScorer, evolve_with

BODY = Morphology.nominal()


def climb(search: Search, peak: np.ndarray[Any, Any], rows: int) -> list[float]:
    """Let a search climb a hill in the space of its weights; return its generations' finals."""
    finals: list[float] = []
    for _ in range(rows):
        proposal = search.ask()
        fitness = [-float(((c.weights - peak) ** 2).sum()) for c in proposal.controllers]
        if proposal.finalists != []:
            winner = (proposal.finalists or [proposal.controllers[int(np.argmax(fitness))]])[0]
            finals.append(-float(((winner.weights - peak) ** 2).sum()))
        search.tell(fitness, winner, finals[-1])
    return finals


def test_cma_climbs_a_hill() -> None:
    template = Template.of_class("linear", Senses(), 0)
    rng = np.random.default_rng(3)
    peak = np.where(template.free, rng.normal(size=template.free.shape), 0.0)
    silent = template.silent(0.7, BODY, 0)
    build = lambda vectors: template.controllers(vectors, silent)  # noqa: E731
    finals = climb(Relay(multistart(template.random(50, rng), build, 24, 6, 6, rng)), peak, 1201)
    assert finals[0] < -5.0
    assert finals[-1] > -0.01


@pytest.mark.parametrize("search", ["cma", "neat"])
def test_told_fitness_restores_a_search(search: Any) -> None:
    few = {"random_candidates": 20} if search == "cma" else {"cma_generations": 60}
    config = EvolveConfig(search=search, restarts=2, generations=60, population=10, **few)
    first, second = (make_search(config, BODY) for _ in range(2))
    rng = np.random.default_rng(0)
    for _ in range(130):
        np.random.seed(0)  # noqa: NPY002  # the global generator has no influence
        asked = [search.ask() for search in (first, second)]
        ours, theirs = ([c.genes().tobytes() for c in one.controllers] for one in asked)
        assert ours == theirs
        fitness = rng.normal(size=len(ours)).tolist()
        for proposal, each in zip(asked, (first, second), strict=True):
            each.tell(fitness, proposal.controllers[int(np.argmax(fitness))], max(fitness))


class Constant:
    """A search whose best controller has a known fitness."""

    def __init__(self, value: float) -> None:
        self.value, self.final = value, -np.inf

    def ask(self) -> Proposal:
        return Proposal([])

    def tell(self, _fitness: Any, _winner: Any, final: float) -> None:
        self.final = final


def test_successive_halving_keeps_the_best() -> None:
    searches = [Constant(value) for value in (1.0, 3.0, 2.0)]
    halving, turns = Relay(halve(searches, [(3, 2), (2, 1), (1, 2)])), []
    for _ in range(10):
        alive = halving.ask().species
        value = halving._search.value  # type: ignore[attr-defined]
        halving.tell([], None, value)  # type: ignore[arg-type]
        turns.append((value, alive))
    assert turns[:6] == [(1.0, 3)] * 2 + [(3.0, 3)] * 2 + [(2.0, 3)] * 2
    assert turns[6:] == [(3.0, 2), (2.0, 2), (3.0, 1), (3.0, 1)]


def test_tuning_begins_with_neats_best_network_and_gains() -> None:
    history: list[Generation] = []
    config = EvolveConfig(
        seed=7, search="neat", restarts=2, generations=16, cma_generations=6, population=20, poses=1
    )
    evolve_with(WeightScorer(), None, config, on_generation=history.append)
    assert history[32].final == pytest.approx(max(row.final for row in history[:16]))
    best = max(row.final for row in history[:32])
    assert max(row.final for row in history[32:]) > best


@pytest.mark.parametrize("name", ["linear", "mlp", "recurrent"])
def test_controller_is_its_vector(name: str) -> None:
    template = Template.of_class(name, Senses(fins=True), 4)
    vector = 0.5 * np.random.default_rng(1).standard_normal(template.size)
    controller = template.controller(vector, 0.7, BODY, 0)
    np.testing.assert_array_equal(template.vector(controller)[1:], vector[1:])
    assert controller.clock == pytest.approx(0.7 * 2.0 ** vector[0])
    assert controller.memory is (name == "recurrent")
    first = template.controller(template.random(1, np.random.default_rng(0))[0], 0.7, BODY, 0)
    assert not first.memory


def test_variants_are_controllers_with_these_numbers() -> None:
    rng = np.random.default_rng(4)
    base = Controller(np.zeros((3, 14)), np.zeros(3), np.ones(3), 0.7, BODY, 5, output="clip")
    weights, bias = np.zeros((2, 3, 14)), rng.normal(size=(2, 3))
    weights[:, :, :11] = rng.normal(size=(2, 3, 11))
    found = base.variants(weights, bias, [0.5, 1.5])
    for one, w, b, clock in zip(found, weights, bias, (0.5, 1.5), strict=True):
        expected = replace(base, weights=w, bias=b, clock=clock)
        assert one.to_dict() == expected.to_dict()
        assert one.genes().tobytes() == expected.genes().tobytes()
        assert not one.weights.flags.writeable
    assert base.variants(weights[:0], bias[:0], []) == []


@pytest.mark.parametrize(
    ("place", "value", "words"),
    [
        ((1, 2, 0), np.nan, "controller.weights must be finite"),
        ((1, 2, 0), 1e31, "node 2 reaches"),
        ((1, 0, 12), 1.0, "must be zero from a node to itself or an earlier one"),
    ],
)
def test_variants_are_checked(place: tuple[int, ...], value: float, words: str) -> None:
    base = Controller(np.zeros((3, 14)), np.zeros(3), np.ones(3), 0.7, BODY, 5)
    weights = np.zeros((2, 3, 14))
    weights[place] = value
    with pytest.raises(InvalidArgumentError, match=words):
        base.variants(weights, np.zeros((2, 3)), [0.7, 0.7])
    with pytest.raises(InvalidArgumentError, match=r"controller\.clock"):
        base.variants(np.zeros((2, 3, 14)), np.zeros((2, 3)), [0.7, 51.0])


FEW = {"restarts": 1, "generations": 1, "population": 10, "random_candidates": 2, "seconds": 0.1}
OPTIONS: dict[str, list[Any]] = {
    "search": [None, "cma", "neat"],
    "paper": [False, True],
    "controller": [None, "recurrent", "mlp", "linear"],
    "senses": [("imu",), ("clock",), ("imu", "clock", "fins")],
    "task": ["forward", "waypoint", "recovery"],
    "interval": [5, 7, 10, 20, 1000, 2000],
    "hidden": [None, 1, 3],
    "harmonics": [None, 1, 3],
    "restarts": [1, 2, 3],
    "generations": [1, 3],
    "random_candidates": [None, 1, 2],
    "cma_generations": [None, 0, 1],
    "poses": [0, 1],
    "clock": [None, 0.0, 1.0],
    "seconds": [0.01, 0.05, 0.07, 0.37, 20.0],
}


def test_settings_fit_each_other_or_are_refused_in_a_sentence() -> None:
    for two in combinations(OPTIONS, 2):
        for values in product(*(OPTIONS[name] for name in two)):
            with contextlib.suppress(InvalidArgumentError):
                config = EvolveConfig(**{**FEW, **dict(zip(two, values, strict=True))})
                assert config.choices.rows > 0, (two, values)
                assert config.settings


@pytest.mark.parametrize(
    ("setting", "sentence"),
    [
        ({"seconds": 5.0, "task": "station"}, "seconds has an effect only"),
        ({"controller": "mlp", "search": "neat"}, "controller has an effect only"),
        ({"hidden": 6, "search": "neat"}, "hidden has an effect only"),
        ({"random_candidates": 3}, "random_candidates must"),
        ({"random_candidates": 10, "search": "neat"}, "random_candidates has an effect only"),
        ({"random_candidates": 10, "paper": True}, "random_candidates has an effect only"),
        ({"clock": 0.7, "senses": ("imu", "fins")}, "clock has an effect only"),
        ({"seconds": 0.37, "interval": 10}, "interval must be 5 for .* divides 37 steps"),
        ({"task": "waypoint", "interval": 2000}, "interval .* got 2000; the nearest is 1000"),
    ],
    ids=str,
)
def test_settings_that_contradict_each_other_are_refused(
    setting: dict[str, Any], sentence: str
) -> None:
    """``tests/test_refused_commands.py`` has others."""
    with pytest.raises(InvalidArgumentError, match=f"^{sentence}"):
        EvolveConfig(**setting)


def test_an_interval_is_chosen_that_an_episode_has() -> None:
    for seconds in (0.05, 0.37, 0.01):
        assert EvolveConfig(seconds=seconds).interval == 5
