from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eea.core.behavior import similarity
from eea.core.checks import ConfigurationError
from eea.core.fitness import (
    action_fitness,
    chance_level,
    mid_range_level,
    model_fitness,
    objective_fitness,
    quantisation_limit,
)
from fake_fish import MODELS, TRUTH


def naive_action_fitness(behaviors: np.ndarray) -> list[float]:
    """Eq. 1 as it is written."""
    scores = []
    for action in behaviors:
        pairs = list(combinations(range(len(action)), 2))
        total = sum(1 - similarity(action[i], action[j]) for i, j in pairs)
        scores.append(total / len(pairs))
    return scores


@given(
    st.integers(1, 4),
    st.integers(2, 12),
    st.integers(1, 9),
    st.sampled_from([np.float32, np.float64]),
    st.integers(0, 2**32 - 1),
)
def test_disagreement_is_the_double_loop(actions, models, size, dtype, seed):
    rng = np.random.default_rng(seed)
    real, imaginary = rng.normal(0, 80, size=(2, actions, models, size)).astype(dtype)
    behaviors = real + 1j * imaginary
    assert np.allclose(action_fitness(behaviors), naive_action_fitness(behaviors), rtol=1e-5)


def test_model_fitness_is_the_mean_over_experiments():
    assert model_fitness(np.array([[1.0, 0.5], [0.0, -1.0]])).tolist() == [0.75, -0.5]


def test_objective_fitness_is_one_less_the_mean_share_of_the_range():
    assert objective_fitness(TRUTH, TRUTH, MODELS) == 1.0
    off = TRUTH.copy()
    off[1] += 1.0  # half of the range [0, 2] in one of nine dimensions
    assert objective_fitness(off, TRUTH, MODELS) == pytest.approx(1 - 0.5 / 9)
    assert objective_fitness(np.stack([off, TRUTH]), TRUTH, MODELS).shape == (2,)
    assert objective_fitness(MODELS.high, MODELS.low, MODELS) == 0.0


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=10)
def test_chance_is_the_mean_over_random_genomes(seed):
    rng = np.random.default_rng(seed)
    target = rng.random(9) * MODELS.high
    bodies = MODELS.decode(MODELS.random(20_000, rng))
    assert chance_level(target, MODELS) == pytest.approx(
        objective_fitness(bodies, target, MODELS).mean(), abs=0.004
    )


@pytest.mark.parametrize("target", [[0.0] * 8, [np.nan] * 9])
def test_a_target_of_the_wrong_form_is_refused(target):
    with pytest.raises(ConfigurationError, match="target must"):
        objective_fitness(TRUTH, target, MODELS)
    for level in (chance_level, mid_range_level, quantisation_limit):
        with pytest.raises(ConfigurationError, match="target must"):
            level(target, MODELS)


def test_the_nearest_genome_is_the_most_that_can_be_found():
    levels = MODELS.decode(MODELS.random(1, np.random.default_rng(0)))[0]
    assert quantisation_limit(levels, MODELS) == pytest.approx(1.0)
    quantum = np.array([variable.quantum for variable in MODELS.variables])
    between = np.where(levels > MODELS.high / 2, levels - quantum / 3, levels + quantum / 3)
    share = quantum / (MODELS.high - MODELS.low)
    assert quantisation_limit(between, MODELS) == pytest.approx(1.0 - share.mean() / 3)
    others = MODELS.decode(MODELS.random(2000, np.random.default_rng(1)))
    assert objective_fitness(others, between, MODELS).max() <= quantisation_limit(between, MODELS)
