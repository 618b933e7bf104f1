from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eea.core.genetic import crossover, evolve, mutate, next_generation, tournament

SEEDS = st.integers(0, 2**32 - 1)


def population(count: int, bits: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 2, (count, bits), dtype=np.uint8)


def test_the_fitter_half_wins_three_quarters_of_tournaments_of_two():
    fitness = np.arange(100.0)
    winners = tournament(fitness, 40_000, 2, np.random.default_rng(0))
    assert (winners >= 50).mean() == pytest.approx(0.75, abs=0.01)


@given(SEEDS, st.floats(0, 1), st.integers(1, 60))
def test_crossover_keeps_each_bit_of_a_pair_at_its_place(seed, rate, bits):
    mothers, fathers = population(8, bits, seed), population(8, bits, seed + 1)
    children = crossover(mothers, fathers, rate, np.random.default_rng(seed))
    assert np.array_equal(children[:8] + children[8:], mothers + fathers)


def test_crossover_rate_is_the_share_of_pairs_crossed():
    mothers, fathers = np.zeros((20_000, 45), np.uint8), np.ones((20_000, 45), np.uint8)
    rng = np.random.default_rng(0)
    children = crossover(mothers, fathers, 0.75, rng)[:20_000]
    assert children.mean() == pytest.approx(0.75 / 2, abs=0.01)
    assert not crossover(mothers, fathers, 0.0, rng)[:20_000].any()


def test_mutation_flips_one_bit_a_genome_on_average():
    flipped = mutate(np.zeros((20_000, 45), np.uint8), 1.0, np.random.default_rng(0))
    assert flipped.sum(axis=1).mean() == pytest.approx(1.0, abs=0.03)
    assert np.array_equal(mutate(flipped, 0.0, np.random.default_rng(0)), flipped)


@given(SEEDS, st.integers(2, 30))
def test_a_generation_keeps_its_size_its_elite_and_its_parents(seed, count):
    genomes = population(count, 12, seed)
    before = genomes.copy()
    fitness = np.random.default_rng(seed).random(count)
    after = next_generation(genomes, fitness, np.random.default_rng(seed))
    assert after.shape == genomes.shape
    assert set(np.unique(after)) <= {0, 1}
    assert np.array_equal(after[0], genomes[np.argmax(fitness)])
    assert np.array_equal(genomes, before)


def test_evolving_counts_ones_and_asks_for_no_genome_twice():
    asked: list[bytes] = []

    def ones(genomes: np.ndarray) -> np.ndarray:
        asked.extend(genome.tobytes() for genome in genomes)
        return genomes.sum(axis=1).astype(float)

    start = population(25, 20, 0)
    genome, fitness = evolve(start, 60, ones, np.random.default_rng(0))
    assert fitness == genome.sum() >= 19
    assert len(asked) == len(set(asked)) < 60 * 25
