"""A refused call changes nothing; ``test_arguments.py`` has what is refused."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from aquafish_gym.envs.vector import AquaFishVectorEnv
from aquafish_gym.utils.validation import InvalidArgumentError


@pytest.mark.parametrize("kind", ["single", "vector"])
def test_refused_call_changes_nothing(kind: str) -> None:
    """Neither the episode nor what is drawn next."""
    bodies = np.array([[0.4, length, 0.1, 0.4, 1.6, 0.1, 0.4, 1.4, 0.6] for length in (0.5, 1.5)])
    go = np.array([0.9, -0.2, 0.4], np.float32)

    def build() -> Any:
        if kind == "single":
            return gym.make("AquaFish-v0", morphology=bodies[1], engine="numba").unwrapped
        return AquaFishVectorEnv(2, morphology=bodies, threads=1)

    spoilt, calm = build(), build()
    action = go if kind == "single" else np.stack([go, go])
    for env in (spoilt, calm):
        env.reset(seed=1)
    wrong: list[Callable[[], object]] = [
        lambda: spoilt.step(action * np.nan),
        lambda: spoilt.reset(seed=-1),
        # It would fit the first of the two robots.
        lambda: spoilt.reset(seed=5, options={"damage": "left_pectoral:length=2"}),
        lambda: spoilt.reset(seed=5, options={"damages": "none"}),
    ]
    for attempt in wrong:
        with pytest.raises(InvalidArgumentError):
            attempt()
        found, expected = spoilt.step(action), calm.step(action)
        assert (found[0] == expected[0]).all()
        assert str(found[4]) == str(expected[4])
    assert str(spoilt.reset()) == str(calm.reset())
