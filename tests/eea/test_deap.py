"""Our genetic algorithm against DEAP's: the same operators on the same problems end as well.

DEAP runs a loop of its own operators; ours is ``next_generation``. Both see the same fitness, so
that only selection, crossover, mutation and elitism can make a difference. Every seed is fixed.
"""

from __future__ import annotations

import random
from collections.abc import Callable

import numpy as np
import pytest
from scipy.stats import ks_2samp, ttest_ind

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
BODY = [
    (f"{fin}.{name}", high, bits)
    for fin in "lrc"
    for name, high, bits in (("width", 1.0, 5), ("length", 2.0, 6), ("thickness", 0.5, 4))
]
TRUTH = np.array([0.4, 0.8, 0.1, 0.4, 1.6, 0.1, 0.4, 1.4, 0.25])


def royal_road(genomes):
    """Score nine blocks of five bits: a whole block counts, part of one does not."""
    return genomes.reshape(len(genomes), -1, 5).all(axis=2).sum(axis=1, dtype=np.float64)


def deceptive(genomes):
    """Score nine traps of five bits: all ones are best, but fewer ones look better till then."""
    ones = genomes.reshape(len(genomes), -1, 5).sum(axis=2, dtype=np.float64)
    return np.where(ones == 5, 5.0, 4.0 - ones).sum(axis=1)


def rippled_body():
    """Score decoded sizes like Eq. 4, with a ripple that makes local optima."""
    layout = model_layout(BODY)

    def fitness(genomes):
        error = (layout.decode(genomes) - TRUTH) / layout.high
        return 1.0 - (np.abs(error) + 0.05 * (1 - np.cos(20 * np.pi * error))).mean(axis=1)

    return fitness


class Maximised(base.Fitness):
    weights = (1.0,)


class Individual(list):
    def __init__(self, bits):
        super().__init__(bits)
        self.fitness = Maximised()


def clone(individual):
    """Copy as DEAP's deep copy does, ten times as fast."""
    copy = Individual(individual)
    copy.fitness.values = individual.fitness.values
    return copy


def deap_run(fitness, seed):
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


def theirs(fitness):
    """Return fitnesses (seeds, generations, individuals)."""
    state = random.getstate()  # DEAP draws from the one generator that all share
    try:
        return np.array([deap_run(fitness, seed) for seed in range(THEIRS)])
    finally:
        random.setstate(state)


def ours(fitness):
    histories = []
    for seed in range(OURS):
        rng = np.random.default_rng([1, seed])
        genomes = rng.integers(0, 2, (POPULATION, BITS), dtype=np.uint8)
        history = [fitness(genomes)]
        while len(history) < GENERATIONS:
            genomes = next_generation(genomes, history[-1], GeneticConfig(), rng)
            history.append(fitness(genomes))
        histories.append(history)
    return np.array(histories)


def disagreements(a, b):
    """Return how far apart two algorithms are, each as a share of what chance would allow."""
    final = ks_2samp(a[:, -1].max(axis=1), b[:, -1].max(axis=1))
    apart = {"final distribution": 1e-3 / final.pvalue}
    for mark in (*MARKS, GENERATIONS):
        for name, of in (("best", np.max), ("mean", np.mean)):
            ends = (of(one[:, mark - 1], axis=1) for one in (a, b))
            steps = abs(ttest_ind(*ends, equal_var=False).statistic)
            apart[f"{name} after {mark} generations"] = steps / LIMIT
    return apart


# DEAP takes seconds a case: one stands here for all, the others are slow.
@pytest.mark.parametrize(
    "fitness",
    [
        royal_road,
        *(pytest.param(one, marks=pytest.mark.slow) for one in (deceptive, rippled_body())),
    ],
)
def test_search_is_as_good_as_deaps(fitness):
    apart = disagreements(ours(fitness), theirs(fitness))
    assert max(apart.values()) < 1.0, apart
