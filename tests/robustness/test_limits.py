"""What is just outside of an argument's range is refused by its name: the ranges stay as they are.

``test_arguments.py`` has values of a wrong kind.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import aquafish_gym
from aquafish_gym.envs.env import AquaFishEnv
from aquafish_gym.envs.tasks import HoldStation, ReachWaypoints, ReturnToBuoys, SwimForward
from aquafish_gym.envs.vector import AquaFishVectorEnv
from aquafish_gym.utils.validation import InvalidArgumentError


def simulate(**arguments: Any) -> object:
    return aquafish_gym.simulate(**{"morphologies": None, "commands": (0.1,) * 3} | arguments)


def env(**arguments: Any) -> object:
    return AquaFishEnv(engine="numba", **arguments)


def batch(**arguments: Any) -> object:
    return AquaFishVectorEnv(**{"num_envs": 2} | arguments)


#: A function, an argument, its least and its greatest value, and how many numbers it has.
LIMITS: list[tuple[Callable[..., object], str, float, float, int | None]] = [
    (simulate, "morphologies", 0.0, 2.0, 9),
    (simulate, "commands", -0.5, 1.0, 3),
    (simulate, "steps", 1, 1_000_000, None),
    (simulate, "substeps", 1, 64, None),
    (simulate, "threads", 1, 1024, None),
    (simulate, "interval", 1, 1_000_000, None),
    (simulate, "begun", 0, 1_000_000, None),
    (simulate, "current", -20.0, 20.0, 3),
    (simulate, "velocity", -20.0, 20.0, 3),
    (simulate, "spin", -100.0, 100.0, 3),
    (simulate, "drag", 0.0, 10.0, 2),
    (simulate, "servo_gain", -2.0, 2.0, 3),
    (simulate, "lag", 0.0, 1.0, None),
    (env, "morphology", 0.0, 2.0, 9),
    (env, "current", -20.0, 20.0, 3),
    (env, "frame_skip", 1, 2000, None),
    (batch, "num_envs", 1, 1_000_000, None),
    (batch, "frame_skip", 1, 2000, None),
    (batch, "current", -20.0, 20.0, 3),
    (batch, "threads", 1, 1024, None),
    (SwimForward, "seconds", 0.01, 3600.0, None),
    (SwimForward, "forward_weight", -1e6, 1e6, None),
    (HoldStation, "fastest", 0.1, 20.0, None),
    (HoldStation, "half", 1e-3, 1e6, None),
    (ReachWaypoints, "reached_weight", -1e6, 1e6, None),
    (ReturnToBuoys, "spare", 0.0, 0.99, None),
    (ReturnToBuoys, "pace", 1e-3, 20.0, None),
]


@pytest.mark.parametrize(
    ("function", "name", "low", "high", "count"),
    LIMITS,
    ids=[f"{function.__name__}-{name}" for function, name, *_ in LIMITS],
)
def test_what_is_just_outside_is_refused(
    function: Callable[..., object], name: str, low: float, high: float, count: int | None
) -> None:
    whole = isinstance(low, int)
    outside = (
        [low - 1, high + 1] if whole else [np.nextafter(low, -np.inf), np.nextafter(high, 1e9)]
    )
    wrong: list[Any] = list(outside)
    if count is not None:
        rows = np.full((len(outside), count), (low + high) / 2)
        rows[:, -1] = outside
        wrong = [*rows.tolist(), [low] * (count + 1), [low] * (count - 1)]
    for value in wrong:
        with pytest.raises(InvalidArgumentError, match=name.rstrip("s")):
            function(**{name: value})
