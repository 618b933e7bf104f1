"""Genomes, angles, behaviors, fitnesses and the genetic operators, each against its definition."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from eea.core.angles import circular_distance, smallest_inclusive, wrap
from eea.core.behavior import modulus, similarity, summarize
from eea.core.checks import ConfigurationError, TargetError
from eea.core.config import GeneticConfig
from eea.core.experiment import RecordedLog
from eea.core.fitness import (
    action_fitness,
    chance_level,
    model_fitness,
    objective_fitness,
    quantisation_limit,
)
from eea.core.genetic import crossover, evolve, mutate, next_generation, tournament
from eea.core.genome import BitLayout, Variable, pose_layout
from fake_fish import MODELS, TRUTH

SEEDS = st.integers(0, 2**32 - 1)


def population(count, bits, seed):
    return np.random.default_rng(seed).integers(0, 2, (count, bits), dtype=np.uint8)


def test_the_fitter_half_wins_three_quarters_of_tournaments_of_two():
    fitness = np.arange(100.0)
    winners = tournament(fitness, 40_000, 2, np.random.default_rng(0))
    assert (winners >= 50).mean() == pytest.approx(0.75, abs=0.01)


@given(SEEDS, st.sampled_from(["uniform", "two-point"]), st.floats(0, 1), st.integers(1, 60))
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

    def ones(genomes):
        asked.extend(genome.tobytes() for genome in genomes)
        return genomes.sum(axis=1).astype(float)

    start = population(25, 20, 0)
    genome, fitness = evolve(start, 60, ones, GeneticConfig(), np.random.default_rng(0))
    assert fitness == genome.sum() >= 19
    assert len(asked) == len(set(asked)) < 60 * 25


NUMBERS = (st.integers(1, 9), st.floats(-10, 0), st.floats(0.01, 10), st.booleans())
VARIABLES = st.lists(st.builds(Variable, st.just("v"), *NUMBERS), min_size=1, max_size=5)


@given(VARIABLES, st.sampled_from(["gray", "binary"]), st.integers(0, 2**32 - 1))
def test_encoding_undoes_decoding(variables, coding, seed):
    layout = BitLayout(variables).with_coding(coding)
    genomes = layout.random(20, np.random.default_rng(seed))
    assert np.array_equal(layout.encode(layout.decode(genomes)), genomes)


def test_binary_code_is_place_values_and_gray_code_changes_one_bit_a_step():
    layout = BitLayout([Variable("v", 3, 0.0, 7.0)])
    values = np.arange(8.0)[:, None]
    binary = layout.with_coding("binary").encode(values)
    assert np.array_equal(binary @ [4, 2, 1], values[:, 0])
    assert (np.abs(np.diff(layout.encode(values).astype(int), axis=0)).sum(axis=1) == 1).all()
    both = BitLayout([*layout.variables, Variable("length", 6, 0.0, 2.0)])
    # 6 and 5 in Gray code, the most significant bit first.
    found = both.decode([[1, 0, 1, 0, 0, 0, 1, 1, 1]])[0]
    assert found == pytest.approx([6.0, 2.0 * 5 / 63])
    pose = pose_layout(3)
    assert pose.bits == 24
    assert np.allclose(pose.decode(pose.encode([[np.pi, -np.pi, 3 * np.pi]])), -np.pi)


@given(VARIABLES, st.integers(0, 2**32 - 1))
def test_values_stay_in_range_and_both_ends_are_reached(variables, seed):
    layout = BitLayout(variables)
    values = layout.decode(layout.random(50, np.random.default_rng(seed)))
    assert (values >= layout.low).all()
    assert (values <= layout.high).all()
    ends = layout.decode(layout.encode([layout.low, layout.high]))
    assert np.array_equal(ends[0], layout.low)
    for value, variable in zip(ends[1], variables, strict=True):
        # The end of a periodic variable is its beginning.
        assert value == pytest.approx(variable.low if variable.periodic else variable.high)
        assert value <= variable.high


@given(hnp.arrays(np.float64, (4, 9), elements=st.floats(0, 1)))
def test_encoding_takes_the_nearest_value(fractions):
    values = fractions * MODELS.high
    quanta = np.array([v.quantum for v in MODELS.variables])
    error = np.abs(MODELS.decode(MODELS.encode(values)) - values)
    assert (error <= quanta / 2 + 1e-12).all()


POSES = hnp.arrays(np.float64, st.tuples(st.integers(1, 6), st.just(3)), elements=st.floats(-9, 9))


@given(POSES)
def test_the_smallest_range_of_those_that_begin_at_a_pose_holds_every_pose(poses):
    low, high = smallest_inclusive(poses)
    assert ((low >= -np.pi) & (low < np.pi)).all()
    # A pose at the low end may come out just under a whole turn.
    beyond = (poses - low) % (2 * np.pi)
    beyond = np.where(beyond > 2 * np.pi - 1e-9, 0.0, beyond)
    assert (beyond <= high - low + 1e-9).all()
    begins = wrap(poses)
    ahead = (begins[None] - begins[:, None]) % (2 * np.pi)  # from each pose to every other
    ahead = np.where(ahead > 2 * np.pi - 1e-9, 0.0, ahead)
    assert np.allclose(high - low, ahead.max(axis=1).min(axis=0), atol=1e-8)


@given(st.floats(-50, 50), st.floats(-50, 50))
@example(np.nextafter(-np.pi, -4), 0.0)
def test_distance_is_the_shorter_way(a, b):
    expected = np.arccos(np.clip(np.cos(a - b), -1, 1))
    assert circular_distance(a, b) == pytest.approx(expected, abs=1e-6)
    assert -np.pi <= wrap(a) < np.pi


GYRO = np.random.default_rng(0).normal(size=(4, 16, 3))
LOG = RecordedLog(GYRO)


def test_behavior_is_the_transform_of_each_rate_in_degrees():
    found = summarize(LOG)
    assert found.shape == (4, 3 * 9)
    for axis in range(3):
        expected = np.fft.rfft(np.degrees(GYRO[2, :, axis]))
        assert np.allclose(found[2, 9 * axis : 9 * (axis + 1)], expected)
    with pytest.raises(TargetError, match="at least 2 steps"):
        summarize(RecordedLog(np.zeros((1, 3))))


def test_one_trial_is_a_batch_of_one_in_its_own_precision():
    assert np.array_equal(summarize(RecordedLog(GYRO[1])), summarize(LOG)[1:2])
    single = RecordedLog(GYRO.astype("f4"))
    assert summarize(single).dtype == np.complex64
    for i in range(4):
        alone = summarize(RecordedLog(single.gyro[i : i + 1]))
        assert np.array_equal(alone[0], summarize(single)[i])


def test_similarity_is_one_less_the_mean_difference_over_max():
    a, b = np.array([[3.0 + 4.0j, 0.0]]), np.array([[0.0j, 100.0]])
    assert similarity(a, b) == pytest.approx(1 - (5.0 + 100.0) / 2 / 100.0)


BEHAVIORS = hnp.arrays(
    np.complex128, (2, 7), elements=st.complex_numbers(max_magnitude=1e4, allow_nan=False)
)


@given(BEHAVIORS)
def test_similarity_is_symmetric_and_at_most_one(pair):
    a, b = pair
    assert similarity(a, b) == similarity(b, a) <= 1.0
    assert similarity(a, a) == 1.0
    assert np.allclose(modulus(a), np.abs(a))


@given(
    st.integers(1, 4),
    st.integers(2, 12),
    st.integers(1, 9),
    st.sampled_from([np.float32, np.float64]),
    SEEDS,
)
def test_disagreement_is_the_double_loop(actions, models, size, dtype, seed):
    """Eq. 1 as it is written."""
    rng = np.random.default_rng(seed)
    real, imaginary = rng.normal(0, 80, size=(2, actions, models, size)).astype(dtype)
    behaviors = real + 1j * imaginary
    expected = [
        np.mean([1 - similarity(action[i], action[j]) for i in range(models) for j in range(i)])
        for action in behaviors
    ]
    assert np.allclose(action_fitness(behaviors), expected, rtol=1e-5)


def test_model_fitness_is_the_mean_over_experiments():
    assert model_fitness(np.array([[1.0, 0.5], [0.0, -1.0]])).tolist() == [0.75, -0.5]


def test_objective_fitness_is_one_less_the_mean_share_of_the_range():
    assert objective_fitness(TRUTH, TRUTH, MODELS) == 1.0
    off = TRUTH.copy()
    off[1] += 1.0  # half of the range [0, 2] in one of nine dimensions
    assert objective_fitness(off, TRUTH, MODELS) == pytest.approx(1 - 0.5 / 9)
    assert objective_fitness(np.stack([off, TRUTH]), TRUTH, MODELS).shape == (2,)
    assert objective_fitness(MODELS.high, MODELS.low, MODELS) == 0.0
    for target in ([0.0] * 8, [np.nan] * 9):
        with pytest.raises(ConfigurationError, match="target must"):
            objective_fitness(TRUTH, target, MODELS)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=10)
def test_chance_is_the_mean_over_random_genomes(seed):
    rng = np.random.default_rng(seed)
    target = rng.random(9) * MODELS.high
    bodies = MODELS.decode(MODELS.random(20_000, rng))
    assert chance_level(target, MODELS) == pytest.approx(
        objective_fitness(bodies, target, MODELS).mean(), abs=0.004
    )


def test_the_nearest_genome_is_the_most_that_can_be_found():
    levels = MODELS.decode(MODELS.random(1, np.random.default_rng(0)))[0]
    assert quantisation_limit(levels, MODELS) == pytest.approx(1.0)
    quantum = np.array([variable.quantum for variable in MODELS.variables])
    between = np.where(levels > MODELS.high / 2, levels - quantum / 3, levels + quantum / 3)
    share = quantum / (MODELS.high - MODELS.low)
    assert quantisation_limit(between, MODELS) == pytest.approx(1.0 - share.mean() / 3)
    others = MODELS.decode(MODELS.random(2000, np.random.default_rng(1)))
    assert objective_fitness(others, between, MODELS).max() <= quantisation_limit(between, MODELS)
