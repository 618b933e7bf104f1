"""Every public function refuses wrong arguments with one line, and a refusal changes nothing."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import aquafish_gym
from aquafish_gym.damage import Damage
from aquafish_gym.envs.tasks import HoldStation, ReachWaypoints, ReturnToBuoys, SwimForward
from aquafish_gym.morphology import Morphology
from aquafish_gym.utils.validation import InvalidArgumentError

# What no argument takes: no number, no array of numbers, no name.
STRANGERS: list[Any] = [
    object(), len, 1j, b"1", {"a": 1.0}, {0.0, 1.0}, np.ma.masked, np.timedelta64(1, "s"),
    [[0.0, 0.1], [0.2]], np.array(["0", "1"]), np.zeros(2, complex), [0.1, None], "no such thing",
]  # fmt: skip


def no_rows(count: int, low: float, high: float) -> st.SearchStrategy[Any]:
    """Return what are not ``count`` numbers in a range: of a wrong length, or with one outside."""
    wrong_length = st.lists(st.just(low), max_size=8).filter(lambda row: len(row) not in (count, 0))
    outside = [np.nextafter(low, -np.inf), np.nextafter(high, np.inf), np.nan, np.inf, "0"]
    spoiled = st.tuples(st.integers(0, count - 1), st.sampled_from(outside)).map(
        lambda at: [at[1] if i == at[0] else low for i in range(count)]
    )
    return wrong_length | spoiled


def no_number(low: float, high: float) -> st.SearchStrategy[Any]:
    return st.sampled_from(
        [np.nextafter(low, -np.inf), np.nextafter(high, np.inf), np.nan, -np.inf, "0.5", True, None]
    )


def no_whole(low: int, high: int) -> st.SearchStrategy[Any]:
    return st.sampled_from([low - 1, high + 1, low + 0.5, float(low), "3", True, 10**400])


NAMES = st.sampled_from(["", "numbas", 3, None, True, ("numba",)])
FLAGS = st.sampled_from([0, 1, "yes", None, [True]])
BODIES = no_rows(9, 0.0, 2.0) | st.sampled_from([{"tail": (0, 0, 0)}, {"caudal": (1, 1)}])
DAMAGE = st.sampled_from(
    ["caudal", "caudal:lenght=0.5", "tail:missing", "caudal:length", "caudal:length=-1", 3, [3]]
)
ENVIRONMENT = {
    "morphology": BODIES,
    "damage": DAMAGE,
    "engine": NAMES,
    "current": no_rows(3, -20.0, 20.0),
    "fin_angles": st.sampled_from(["one", [1.0], [np.nan] * 3, (0, 0, np.inf), 3.0]),
    "observe_fins": st.sampled_from([0, "yes", "reckon", None]),
    "frame_skip": no_whole(1, 2000) | st.just(3),
    "render_mode": st.sampled_from(["rgb", 3, ("human",)]),
    "task": st.sampled_from(["swim", 3, None, SwimForward]),
    "reactive": FLAGS,
}
SIMULATE = {
    "morphologies": BODIES,
    "commands": no_rows(3, -0.5, 1.0),
    "steps": no_whole(1, 1_000_000),
    "engine": NAMES,
    "dtype": NAMES.filter(lambda name: name is not None),
    "current": no_rows(3, -20.0, 20.0),
    "substeps": no_whole(1, 64),
    "threads": no_whole(1, 1024),
    "record": NAMES,
    "reactive": FLAGS,
    "drag": no_rows(2, 0.0, 10.0),
    "servo_gain": no_rows(3, -2.0, 2.0),
    "lag": no_number(0.0, 1.0),
    "interval": no_whole(1, 1_000_000),
    "begun": no_whole(0, 1_000_000),
    "velocity": no_rows(3, -20.0, 20.0),
    "spin": no_rows(3, -100.0, 100.0),
}
VECTOR = {
    **ENVIRONMENT,
    "frame_skip": no_whole(1, 2000),
    "num_envs": no_whole(1, 1_000_000),
    "dtype": NAMES,
    "threads": no_whole(1, 1024),
    "autoreset_mode": NAMES,
    "max_episode_steps": st.sampled_from([0, -1, 2.5, "3", True]),
}


def simulate(**arguments: Any) -> object:
    return aquafish_gym.simulate(
        **{"morphologies": None, "commands": (0.1, 0.1, 0.1), "steps": 1} | arguments
    )


def make(**arguments: Any) -> object:
    return gym.make("AquaFish-v0", **{"engine": "numba"} | arguments)


def make_vec(**arguments: Any) -> object:
    from aquafish_gym.envs.vector import AquaFishVectorEnv

    return AquaFishVectorEnv(**{"num_envs": 2} | arguments)


DOORS: list[tuple[Callable[..., object], dict[str, st.SearchStrategy[Any]]]] = [
    (simulate, SIMULATE),
    # gymnasium itself checks render_mode first, and copies what it is given.
    (make, {name: values for name, values in ENVIRONMENT.items() if name != "render_mode"}),
    (make_vec, VECTOR),
    (lambda value: Morphology.coerce(value), {"value": BODIES}),
    (lambda text: Morphology.from_json(text), {"text": st.sampled_from(["", "{}", "3", "[" * 99])}),
    (lambda value: Damage.coerce(value), {"value": DAMAGE}),
    (SwimForward, {"seconds": no_number(0.01, 3600), "forward_weight": no_number(-1e6, 1e6)}),
    (HoldStation, {"fastest": no_number(0.1, 20.0), "half": no_number(1e-3, 1e6)}),
    (ReachWaypoints, {"reached_weight": no_number(-1e6, 1e6)}),
    (ReturnToBuoys, {"spare": no_number(0.0, 0.99), "pace": no_number(1e-3, 20.0)}),
]
ROWS = [
    pytest.param(enter, name, values, id=f"{enter.__name__}-{name}-{i}")
    for i, (enter, arguments) in enumerate(DOORS)
    for name, values in arguments.items()
]


@pytest.mark.parametrize(("enter", "name", "values"), ROWS)
def test_wrong_argument_is_refused_with_one_line(
    enter: Callable[..., object], name: str, values: st.SearchStrategy[Any]
) -> None:
    strangers = STRANGERS if enter is not make else STRANGERS[2:6]
    if name == "threads" or (enter is make_vec and name == "dtype"):  # None is a choice
        values = values.filter(lambda value: value is not None)

    @settings(derandomize=True, database=None, deadline=None, max_examples=15,
              suppress_health_check=[HealthCheck.too_slow])  # fmt: skip
    @given(values | st.sampled_from(strangers))
    def refused(value: Any) -> None:
        with pytest.raises(InvalidArgumentError) as caught:
            enter(**{name: value})
        assert "\n" not in str(caught.value)
        assert len(str(caught.value)) < 500

    refused()


@pytest.mark.parametrize("kind", ["single", "vector"])
def test_refused_call_changes_nothing(kind: str) -> None:
    """Neither the episode nor what is drawn next."""
    bodies = np.array([[0.4, length, 0.1, 0.4, 1.6, 0.1, 0.4, 1.4, 0.6] for length in (0.5, 1.5)])
    go = np.array([0.9, -0.2, 0.4], np.float32)

    def build() -> Any:
        if kind == "single":
            return gym.make("AquaFish-v0", morphology=bodies[1], engine="numba").unwrapped
        return make_vec(morphology=bodies, threads=1)

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
