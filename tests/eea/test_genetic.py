from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eea.core.config import GeneticConfig
from eea.core.genetic import crossover, evolve, mutate, next_generation, tournament

SEEDS = st.integers(0, 2**32 - 1)


def population(count: int, bits: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 2, (count, bits), dtype=np.uint8)


def test_the_fitter_half_wins_three_quarters_of_tournaments_of_two():
    fitness = np.arange(100.0)
    winners = tournament(fitness, 40_000, 2, np.random.default_rng(0))
    assert (winners >= 50).mean() == pytest.approx(0.75, abs=0.01)


KINDS = st.sampled_from(["uniform", "two-point"])


@given(SEEDS, KINDS, st.floats(0, 1), st.integers(1, 60))
def test_crossover_keeps_each_bit_of_a_pair_at_its_place(seed, kind, rate, bits):
    mothers, fathers = population(8, bits, seed), population(8, bits, seed + 1)
    children = crossover(mothers, fathers, kind, rate, np.random.default_rng(seed))
    assert np.array_equal(children[:8] + children[8:], mothers + fathers)


# Two of 46 gaps are (46 - 1/46) / 3 bits apart on average.
@pytest.mark.parametrize(("kind", "share"), [("uniform", 1 / 2), ("two-point", 1 / 3)])
def test_crossover_rate_is_the_share_of_pairs_crossed(kind, share):
    mothers, fathers = np.zeros((20_000, 45), np.uint8), np.ones((20_000, 45), np.uint8)
    rng = np.random.default_rng(0)
    children = crossover(mothers, fathers, kind, 0.75, rng)[:20_000]
    assert children.mean() == pytest.approx(0.75 * share, abs=0.015)
    assert not crossover(mothers, fathers, kind, 0.0, rng)[:20_000].any()


def test_two_point_crossover_swaps_one_stretch():
    mothers, fathers = np.zeros((500, 45), np.uint8), np.ones((500, 45), np.uint8)
    children = crossover(mothers, fathers, "two-point", 1.0, np.random.default_rng(0))[:500]
    edges = np.abs(np.diff(np.pad(children.astype(int), ((0, 0), (1, 1))), axis=1)).sum(axis=1)
    assert set(edges) == {0, 2}


def test_mutation_flips_one_bit_a_genome_on_average():
    flipped = mutate(np.zeros((20_000, 45), np.uint8), 1.0, np.random.default_rng(0))
    assert flipped.sum(axis=1).mean() == pytest.approx(1.0, abs=0.03)
    assert np.array_equal(mutate(flipped, 0.0, np.random.default_rng(0)), flipped)


@given(SEEDS, st.integers(2, 30), st.integers(0, 3))
def test_a_generation_keeps_its_size_its_elites_and_its_parents(seed, count, elites):
    genomes = population(count, 12, seed)
    before = genomes.copy()
    fitness = np.random.default_rng(seed).random(count)
    config = GeneticConfig(elites=elites)
    after = next_generation(genomes, fitness, config, np.random.default_rng(seed))
    assert after.shape == genomes.shape
    assert set(np.unique(after)) <= {0, 1}
    kept = min(elites, count)
    assert np.array_equal(after[:kept], genomes[np.argsort(-fitness, kind="stable")[:kept]])
    assert np.array_equal(genomes, before)


def test_evolving_counts_ones_and_asks_for_no_genome_twice():
    asked: list[bytes] = []

    def ones(genomes: np.ndarray) -> np.ndarray:
        asked.extend(genome.tobytes() for genome in genomes)
        return genomes.sum(axis=1).astype(float)

    start = population(25, 20, 0)
    genome, fitness = evolve(start, 60, ones, GeneticConfig(), np.random.default_rng(0))
    assert fitness == genome.sum() >= 19
    assert len(asked) == len(set(asked)) < 60 * 25
