"""Each argument of the public functions refuses values of a wrong kind by its name.

The tables ``arguments_*.py`` hold the functions, with arguments with which they work. What is just
outside of a range is refused, too, and a refused call changes nothing.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from strange_values import Call, cases, complaints, has_every_parameter

import aquafish.online
import aquafish_gym
import eea
import gait
from aquafish_gym.envs.env import AquaFishEnv
from aquafish_gym.envs.tasks import HoldStation, ReachWaypoints, ReturnToBuoys, SwimForward
from aquafish_gym.envs.vector import AquaFishVectorEnv
from aquafish_gym.utils.validation import InvalidArgumentError
from gait.learning.train import LearningConfig

TABLES = sorted(path.stem for path in Path(__file__).parent.glob("arguments_*.py"))
ROWS: list[Call] = [row for table in TABLES for row in import_module(table).ROWS]
#: What functions return, protocols, errors, and what takes no argument.
WITHOUT = {
    "Agent", "ConfigurationError", "Dimension", "Evaluation", "Evolved", "ImuLog", "LogCheck",
    "MorphologyEstimate", "Performed", "RecordedLog", "Result",
    "RevealingTarget", "Simulator", "Swim", "Target", "TargetError", "Trials",
}  # fmt: skip


@pytest.mark.parametrize(("call", "argument"), cases(ROWS))
def test_strange_values_are_refused_by_the_arguments_name(
    call: Call, argument: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert not complaints(call, argument)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("call", ROWS, ids=lambda call: call.name)
def test_row_has_every_parameter(call: Call) -> None:
    assert has_every_parameter(call)


@pytest.mark.parametrize("package", [aquafish_gym, aquafish.online, eea, gait])
def test_every_public_function_has_a_row(package: object) -> None:
    rows = {row.name.partition(".")[0] for row in ROWS}
    names = getattr(package, "__all__")  # noqa: B009
    public = {name for name in names if callable(getattr(package, name))}
    functions = {name for name in public if not inspect.ismodule(getattr(package, name))}
    assert functions - rows - WITHOUT == set()
    assert not rows & WITHOUT - {"MorphologyEstimate", "Result"}


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
    (gait.EvolveConfig, "population", 10, 10_000, None),
    (gait.EvolveConfig, "seconds", 0.01, 3600.0, None),
    (LearningConfig, "steps", 1, 10**10, None),
    (LearningConfig, "environments", 1, 1024, None),
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
