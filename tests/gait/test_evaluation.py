"""Agents are scored on the episodes of the reference scores."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from aquafish_gym import Morphology
from aquafish_gym.utils.validation import InvalidArgumentError
from gait import Controller, evaluate
from gait.swims.evaluation import FIRST_SEED, interquartile_mean

ACTION = np.array([0.2, -0.2, 1.0], np.float32)


def constant(observations: Any) -> Any:
    return np.tile(ACTION, (len(observations), 1))


def test_returns_are_those_of_single_environments() -> None:
    found = evaluate(constant, "AquaFish-v0", episodes=2, dtype="float64", damage="random:severe")
    for i in range(2):
        env = gym.make("AquaFish-v0", engine="numba", damage="random:severe", fin_angles="random")
        env.reset(seed=FIRST_SEED + i)
        rewards, over, info = [], False, {}
        while not over:
            _, reward, terminated, truncated, info = env.step(ACTION)
            rewards.append(reward)
            over = terminated or truncated
        assert found.returns[i] == pytest.approx(sum(rewards), abs=1e-9)
        assert found.y_position[-1, i] == pytest.approx(info["y_position"], abs=1e-9)


def test_an_object_is_reset_and_acts_as_the_function_does() -> None:
    class Mine:
        started = 0

        def reset(self, info: dict[str, Any]) -> None:
            self.started = len(info["fin_angles"])

        def act(self, observations: Any) -> Any:
            return constant(observations)

    mine = Mine()
    found = evaluate(mine, "AquaFish-v0", episodes=3)
    assert mine.started == 3
    np.testing.assert_array_equal(found.returns, evaluate(constant, episodes=3).returns)
    envs = gym.make_vec("AquaFish-v0", 3)
    np.testing.assert_array_equal(found.returns, evaluate(constant, envs).returns)


def test_a_controller_acts_at_its_own_interval() -> None:
    body = Morphology.nominal()
    still = Controller(
        np.zeros((3, 14)), np.array([0.0, 0.0, -9.0]), np.ones(3), 1.0, body, seed=0, interval=10
    )
    with pytest.raises(InvalidArgumentError, match="frame_skip must be 10"):
        evaluate(still, episodes=2)
    found = evaluate(still, episodes=2, frame_skip=10)
    assert np.abs(found.returns).max() < 0.1


def test_the_distance_after_the_onset_is_counted_from_there() -> None:
    found = evaluate(constant, "AquaFishRecovery-v0", episodes=3)
    assert (found.onset > 0).all()
    way = [found.y_position[-1, i] - found.y_position[s, i] for i, s in enumerate(found.onset)]
    np.testing.assert_allclose(found.way_since(found.onset), way)


def test_the_interval_of_the_interquartile_mean_covers_it() -> None:
    runs = np.random.default_rng(1).normal(3.0, 1.0, (5, 100))
    middle, low, high = interquartile_mean(runs)
    assert low < middle < high
    assert middle == pytest.approx(3.0, abs=0.2)
    assert interquartile_mean([[5.0] * 4]) == (5.0, 5.0, 5.0)
