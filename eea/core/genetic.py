"""The genetic algorithm of both phases, as free functions on arrays of bits (Sec. 4).

"Both genetic algorithms used tournament selection with a tournament size of two, a crossover
rate of 0.75 and a mean mutation rate of one gene per genome." The kind of crossover and the
elite are not in the paper.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from eea.core.bits import Coding, Genomes
from eea.core.checks import choice, real, whole

Crossover = Literal["two_point", "uniform"]
# Far beyond what any search here needs; a slip of the keyboard is refused at once.
MAXIMUM_POPULATION = 10**6
MAXIMUM_GENERATIONS = 10**6


@dataclass(frozen=True)
class GeneticConfig:
    """How the next generation is made."""

    tournament_size: int = 2  #: Contestants for each parent.
    #: What two parents swap: "uniform" each bit with probability one half, "two_point" one stretch
    #: of bits.
    crossover: Crossover = "uniform"
    crossover_rate: float = 0.75  #: Probability that a pair of parents is crossed at all.
    mutations: float = 1.0  #: Mean number of flipped bits a genome.
    elites: int = 1  #: How many of the best pass on unchanged.
    coding: Coding = "gray"  #: How bits encode numbers.

    def __post_init__(self) -> None:
        whole("genetic.tournament_size", self.tournament_size, 1, MAXIMUM_POPULATION)
        choice("genetic.crossover", self.crossover, ("two_point", "uniform"))
        real("genetic.crossover_rate", self.crossover_rate, 0.0, 1.0)
        real("genetic.mutations", self.mutations, 0.0)
        whole("genetic.elites", self.elites, 0, MAXIMUM_POPULATION)
        choice("genetic.coding", self.coding, ("gray", "binary"))


def tournament(
    fitness: NDArray[np.floating], count: int, size: int, rng: np.random.Generator
) -> NDArray[np.intp]:
    """Return the indices of ``count`` winners, shape (count,), each the best of ``size`` draws.

    Draws are with replacement; of equals the first drawn wins.
    """
    drawn = rng.integers(0, len(fitness), size=(count, size))
    winner: NDArray[np.intp] = drawn[np.arange(count), np.argmax(fitness[drawn], axis=1)]
    return winner


def crossover(
    mothers: Genomes, fathers: Genomes, kind: Crossover, rate: float, rng: np.random.Generator
) -> Genomes:
    """Return two children a pair of parents (N, bits), shape (2 N, bits).

    With probability ``rate`` a pair's children have bits swapped, otherwise they are copies.
    """
    pairs, bits = mothers.shape
    if kind == "two_point":
        # Two of the bits + 1 gaps between bits; equal ones swap nothing.
        cuts = np.sort(rng.integers(0, bits + 1, size=(pairs, 2)), axis=1)
        position = np.arange(bits)
        swap = (position >= cuts[:, :1]) & (position < cuts[:, 1:])
    else:
        swap = rng.random((pairs, bits)) < 0.5
    swap &= rng.random((pairs, 1)) < rate
    return np.concatenate([np.where(swap, fathers, mothers), np.where(swap, mothers, fathers)])


def mutate(genomes: Genomes, mutations: float, rng: np.random.Generator) -> Genomes:
    """Return genomes (N, bits) with a mean of ``mutations`` bits flipped in each."""
    flips = rng.random(genomes.shape) < mutations / genomes.shape[1]
    mutated: Genomes = genomes ^ flips.astype(np.uint8)
    return mutated


def next_generation(
    genomes: Genomes, fitness: NDArray[np.floating], config: GeneticConfig, rng: np.random.Generator
) -> Genomes:
    """Return the next population, shape (N, bits), the elites first."""
    count = len(genomes)
    pairs = (count + 1) // 2
    parents = tournament(fitness, 2 * pairs, config.tournament_size, rng)
    children = crossover(
        genomes[parents[:pairs]],
        genomes[parents[pairs:]],
        config.crossover,
        config.crossover_rate,
        rng,
    )
    children = mutate(children, config.mutations, rng)
    # A stable sort, so that of equally fit genomes the earlier is the elite.
    elites = genomes[np.argsort(-fitness, kind="stable")[: config.elites]]
    return np.concatenate([elites, children])[:count]


def evolve(
    genomes: Genomes,
    generations: int,
    evaluate: Callable[[Genomes], NDArray[np.floating]],
    config: GeneticConfig,
    rng: np.random.Generator,
) -> tuple[Genomes, float]:
    """Evolve genomes (N, bits) under a fitness that stands still; return the final best one.

    ``evaluate`` takes genomes (n, bits), all different, and returns their fitness (n,); none is
    asked for twice. ``generations`` counts the first.
    """
    known: dict[bytes, float] = {}
    fitness = np.empty(0)
    for generation in range(generations):
        if generation:
            genomes = next_generation(genomes, fitness, config, rng)
        keys = [genome.tobytes() for genome in genomes]
        fresh = {key: i for i, key in enumerate(keys) if key not in known}
        if fresh:
            scores = evaluate(genomes[list(fresh.values())])
            known.update(zip(fresh, scores.tolist(), strict=True))
        fitness = np.array([known[key] for key in keys])
    best = int(np.argmax(fitness))
    return genomes[best], float(fitness[best])
