"""Our genetic algorithm against DEAP's: the same operators on the same problems end as well.

DEAP runs a loop of its own operators; ours is ``next_generation``. Both see the same fitness, so
that only selection, crossover, mutation and elitism can make a difference. Every seed is fixed.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from eea.core.config import GeneticConfig
from eea.core.genetic import next_generation
from eea.core.genome import model_layout

pytest.importorskip("deap", reason="DEAP comes with the extra named test")
from deap import base, tools

POPULATION, BITS, GENERATIONS = 25, 45, 100  # the estimation phase's
THEIRS, OURS = 40, 160  # seeds; ours cost less, so the error is mostly that of theirs
MARKS = (10, 25, 50)  # generations at which the curves are compared too
LIMIT = 3.0  # standard errors of a difference

Fitness = Callable[[np.ndarray], np.ndarray]

TABLE = [("width", 1.0, 5), ("length", 2.0, 6), ("thickness", 0.5, 4)]
BODY = [(f"{fin}.{name}", high, bits) for fin in "lrc" for name, high, bits in TABLE]
TRUTH = np.array([0.4, 0.8, 0.1, 0.4, 1.6, 0.1, 0.4, 1.4, 0.25])


def royal_road(genomes: np.ndarray) -> np.ndarray:
    """Score nine blocks of five bits: a whole block counts, part of one does not."""
    return genomes.reshape(len(genomes), -1, 5).all(axis=2).sum(axis=1, dtype=np.float64)


def deceptive(genomes: np.ndarray) -> np.ndarray:
    """Score nine traps of five bits: all ones are best, but fewer ones look better till then."""
    ones = genomes.reshape(len(genomes), -1, 5).sum(axis=2, dtype=np.float64)
    return np.where(ones == 5, 5.0, 4.0 - ones).sum(axis=1)


def rippled_body() -> Fitness:
    """Score decoded sizes like Eq. 4, with a ripple that makes local optima."""
    layout = model_layout(BODY)

    def fitness(genomes: np.ndarray) -> np.ndarray:
        error = (layout.decode(genomes) - TRUTH) / layout.high
        return 1.0 - (np.abs(error) + 0.05 * (1 - np.cos(20 * np.pi * error))).mean(axis=1)

    return fitness


PROBLEMS: dict[str, Fitness] = {
    "royal road": royal_road,
    "deceptive": deceptive,
    "body": rippled_body(),
}


@dataclass
class Curves:
    """Fitness of the best and the mean of a population, by seed and generation."""

    best: np.ndarray
    mean: np.ndarray


def curves(fitness: list[list[np.ndarray]]) -> Curves:
    values = np.array(fitness)  # (seeds, generations, individuals)
    return Curves(values.max(axis=2), values.mean(axis=2))


class Maximised(base.Fitness):
    weights = (1.0,)


class Individual(list):
    def __init__(self, bits: list[int]) -> None:
        super().__init__(bits)
        self.fitness = Maximised()


def clone(individual: Individual) -> Individual:
    """What DEAP's deep copy does to these, ten times as fast."""
    copy = Individual(individual)
    copy.fitness.values = individual.fitness.values
    return copy


def deap_run(fitness: Fitness, seed: int) -> list[np.ndarray]:
    random.seed(seed)
    start = np.random.default_rng(seed).integers(0, 2, (POPULATION, BITS))
    population = [Individual(row) for row in start.tolist()]
    history: list[np.ndarray] = []
    for generation in range(GENERATIONS):
        if generation:
            elite = [clone(i) for i in tools.selBest(population, 1)]
            parents = tools.selTournament(population, POPULATION - 1, tournsize=2)
            children = [clone(parent) for parent in parents]
            for mother, father in zip(children[::2], children[1::2], strict=True):
                if random.random() < 0.75:
                    tools.cxUniform(mother, father, indpb=0.5)
            for child in children:
                tools.mutFlipBit(child, indpb=1.0 / BITS)
            population = elite + children
        values = fitness(np.array(population))
        for individual, value in zip(population, values.tolist(), strict=True):
            individual.fitness.values = (value,)
        history.append(values)
    return history


def theirs(problem: str) -> Curves:
    state = random.getstate()  # DEAP draws from the one generator that all share
    try:
        return curves([deap_run(PROBLEMS[problem], seed) for seed in range(THEIRS)])
    finally:
        random.setstate(state)


def ours(problem: str) -> Curves:
    fitness = PROBLEMS[problem]
    histories: list[list[np.ndarray]] = []
    for seed in range(OURS):
        rng = np.random.default_rng([1, seed])
        genomes = rng.integers(0, 2, (POPULATION, BITS), dtype=np.uint8)
        history = [fitness(genomes)]
        while len(history) < GENERATIONS:
            genomes = next_generation(genomes, history[-1], GeneticConfig(), rng)
            history.append(fitness(genomes))
        histories.append(history)
    return curves(histories)


def standard_errors_apart(a: np.ndarray, b: np.ndarray) -> float:
    """The difference of two samples' means in its own standard errors (Welch's t)."""
    error = np.sqrt(a.var(ddof=1) / len(a) + b.var(ddof=1) / len(b))
    return float(abs(a.mean() - b.mean()) / error)


def distance_of_distributions(a: np.ndarray, b: np.ndarray) -> float:
    """The two-sample Kolmogorov-Smirnov statistic in units of its 0.1% point."""
    at = np.concatenate([a, b])
    gap = np.abs((a[:, None] <= at).mean(axis=0) - (b[:, None] <= at).mean(axis=0)).max()
    return float(gap / (1.95 * np.sqrt(1 / len(a) + 1 / len(b))))


def disagreements(a: Curves, b: Curves) -> dict[str, float]:
    """How far apart two algorithms are, each as a share of what chance would allow."""
    apart = {"final distribution": distance_of_distributions(a.best[:, -1], b.best[:, -1])}
    for mark in (*MARKS, GENERATIONS):
        for name, x, y in (("best", a.best, b.best), ("mean", a.mean, b.mean)):
            steps = standard_errors_apart(x[:, mark - 1], y[:, mark - 1])
            apart[f"{name} after {mark} generations"] = steps / LIMIT
    return apart


# DEAP takes seconds a case: one stands here for all, the others are slow.
@pytest.mark.parametrize(
    "problem",
    ["royal road", *(pytest.param(one, marks=pytest.mark.slow) for one in ("deceptive", "body"))],
)
def test_search_is_as_good_as_deaps(problem):
    apart = disagreements(ours(problem), theirs(problem))
    assert max(apart.values()) < 1.0, apart
