"""The genetic algorithm of both phases, as free functions on arrays of bits (Sec. 4).

"Both genetic algorithms used tournament selection with a tournament size of two, a crossover
rate of 0.75 and a mean mutation rate of one gene per genome." The paper does not name the kind of
crossover, which is uniform by default, and no elite; see ``eea.core.config.GeneticConfig``.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from eea.core.config import Crossover, GeneticConfig
from eea.core.genome import Genomes

TOURNAMENT_SIZE = 2  # contestants for each parent


def tournament(
    fitness: NDArray[np.floating], count: int, size: int, rng: np.random.Generator
) -> NDArray[np.intp]:
    """Return the indices of ``count`` winners, shape (count,), each the best of ``size`` draws.

    Draws are with replacement. Among equals the first drawn wins.
    """
    drawn = rng.integers(0, len(fitness), size=(count, size))
    winner: NDArray[np.intp] = drawn[np.arange(count), np.argmax(fitness[drawn], axis=1)]
    return winner


def crossover(
    mothers: Genomes, fathers: Genomes, kind: Crossover, rate: float, rng: np.random.Generator
) -> Genomes:
    """Return two children of each pair of parents (N, bits), shape (2 N, bits).

    With probability ``rate`` a pair swaps bits, otherwise the children are copies: "uniform" swaps
    each bit with probability 1/2, "two-point" the bits between two random cuts.
    """
    pairs, bits = mothers.shape
    if kind == "two-point":
        # Two of the bits + 1 gaps around bits; equal ones swap nothing.
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
    parents = tournament(fitness, 2 * pairs, TOURNAMENT_SIZE, rng)
    mothers = genomes[parents[:pairs]]
    fathers = genomes[parents[pairs:]]
    children = crossover(mothers, fathers, config.crossover, config.crossover_rate, rng)
    children = mutate(children, config.mutations, rng)
    # The sort is stable: among equally fit genomes the earlier is the elite.
    elites = genomes[np.argsort(-fitness, kind="stable")[: config.elites]]
    return np.concatenate([elites, children])[:count]


def evolve(
    genomes: Genomes,
    generations: int,
    evaluate: Callable[[Genomes], NDArray[np.floating]],
    config: GeneticConfig,
    rng: np.random.Generator,
) -> tuple[Genomes, float]:
    """Evolve genomes (N, bits) under a constant fitness; return the final best and its fitness.

    ``evaluate`` takes distinct genomes (n, bits) and returns their fitness (n,); no genome is
    evaluated twice. ``generations`` includes the first.
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
