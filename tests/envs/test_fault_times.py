"""Late, slow and scaled channels: of any environment and of the fish, singly and in batches."""

from __future__ import annotations

import math
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from fault_fakes import Echo, play, swim
from gymnasium.vector import AutoresetMode
from hypothesis import given, settings
from hypothesis import strategies as st

from aquafish_gym import FaultWrapper
from aquafish_gym.damage import TIERS, Chance, Damage, Tier
from aquafish_gym.damage.side import Side
from aquafish_gym.envs.env import AquaFishEnv
from aquafish_gym.envs.vector import AquaFishVectorEnv
from aquafish_gym.utils.validation import InvalidArgumentError, UnknownNameError
from eea.fish.target import EngineTarget

WHOLE, _ = play(Echo())
ASKED = WHOLE[1:, 3:]


@pytest.mark.parametrize(
    ("text", "rows"),
    [
        ("delay=2", [0, 0, 0, 1, 2, 3, 4, 5, 6]),
        ("delay=2@4", [0, 1, 2, 3, 2, 3, 4, 5, 6]),
        ("delay=2@4+2", [0, 1, 2, 3, 2, 3, 6, 7, 8]),
        ("delay=3@1", [0, 0, 0, 0, 1, 2, 3, 4, 5]),
        ("hold=3", [0, 0, 0, 3, 3, 3, 6, 6, 6]),
        ("hold=3@1+5", [0, 1, 1, 1, 4, 4, 6, 7, 8]),
        ("hold=2.5", [0, 0, 0, 3, 3, 5, 5, 5, 8]),
        ("hold=2@1; observation_0:delay=1@1", [0, 0, 1, 1, 3, 3, 5, 5, 7]),
        ("delay=1; observation_0:delay=2", [0, 0, 0, 0, 1, 2, 3, 4, 5]),
        ("delay=2; observation_0:stuck@5", [0, 0, 0, 1, 2, 3, 3, 3, 3]),
    ],
)
def test_a_late_sensor_says_what_it_measured_then(text: str, rows: list[int]) -> None:
    found, infos = play(FaultWrapper(Echo(), f"observation_0:{text}", dt=1))
    want = WHOLE.copy()
    want[:, 0] = WHOLE[rows, 0]
    np.testing.assert_array_equal(found, want)
    assert any(info["observation_delay"][0] or info["observation_hold"][0] for info in infos)


@pytest.mark.parametrize(
    ("text", "rows"),
    [
        ("delay=2", [None, None, 0, 1, 2, 3, 4, 5]),
        ("delay=2@4+2", [0, 1, 2, 3, 2, 3, 6, 7]),
        ("hold=3", [0, 0, 0, 3, 3, 3, 6, 6]),
        ("delay=1@2; action_0:hold=2@2", [0, 1, 1, 2, 2, 4, 4, 6]),
        ("delay=2; action_0:seized@5", [None, None, 0, 1, 2, 2, 2, 2]),
    ],
)
def test_a_late_actuator_does_what_was_asked_then(text: str, rows: list[int | None]) -> None:
    found, _ = play(FaultWrapper(Echo(), f"action_0:{text}", dt=1, neutral=[0.5, 0.0]))
    want = ASKED.copy()
    want[:, 0] = [0.5 if row is None else ASKED[row, 0] for row in rows]
    np.testing.assert_array_equal(found[1:, 3:], want)


def test_scale_multiplies_and_joins_others() -> None:
    text = "observation_1:scale=-2@2+3; observation_1:bias=1; action_1:scale=0.5; action:weak=0.5"
    found, infos = play(FaultWrapper(Echo(), text, dt=1))
    factors = np.where([2 <= step < 5 for step in range(9)], -2.0, 1.0)
    np.testing.assert_array_equal(found[:, 1], factors * WHOLE[:, 1] + 1.0)
    np.testing.assert_array_equal(found[1:, 3:], ASKED * np.float32([0.5, 0.25]))
    assert [info["observation_scale"][1] for info in infos] == factors.tolist()
    assert infos[0]["action_scale"].tolist() == [1.0, 0.5]
    assert infos[0]["action_gain"].tolist() == [0.5, 0.5]
    huge = ";".join(["observation_0:scale=1e30"] * 50 + ["action_0:scale=1e30"] * 50)
    seen, _ = play(FaultWrapper(Echo(), huge))
    assert seen[0, 0] == 0.0
    assert (seen[1:, 0] == 40.0).all()
    assert (np.abs(seen[1:, 3]) == 10.0).all()


def test_whole_channels_have_no_more_information_than_before() -> None:
    _, infos = play(FaultWrapper(Echo(), "action_0:dead"))
    assert not any("delay" in name or "scale" in name for info in infos for name in info)


@given(
    delays=st.lists(st.integers(0, 6), min_size=12, max_size=12),
    periods=st.lists(st.sampled_from([0.0, 1.5, 2.0, 3.7]), min_size=12, max_size=12),
    ends=st.sets(st.integers(1, 11)),
)
@settings(max_examples=60)
def test_late_and_slow_channels_are_what_they_say(
    delays: list[int], periods: list[float], ends: set[int]
) -> None:
    """Against lists, with new delays and holds in every step, and episodes that end."""
    lines, rows = Side(3, 1, dt=1.0), np.array([1])
    lines.remember(6)
    kept: list[float] = []
    began, before = 0, 0.0
    for step, (delay, period) in enumerate(zip(delays, periods, strict=True)):
        if step in ends:
            lines.start(rows)
            kept, before = [], 0.0
        began = began if period == before and kept else len(kept)
        before = period
        lines.update(rows, {"delay": np.array([[delay]]), "hold": np.array([[period]])})
        number = float(step)
        if period:
            since = len(kept) - began
            if math.floor(since / period + 1e-9) == math.floor((since - 1) / period + 1e-9):
                number = kept[-1]
        kept.append(number)
        (found,) = lines.carry(np.array([[float(step)]]), rows)
        assert found[0] == kept[max(0, len(kept) - 1 - delay)]


def test_a_line_that_grows_keeps_the_order_of_its_numbers() -> None:
    lines, rows, found = Side(1, 1, dt=1.0), np.array([0]), []
    for number, delay in enumerate((2, 2, 2, 3, 3)):
        lines.update(rows, {"delay": np.array([[delay]]), "hold": np.zeros((1, 1))})
        found += lines.carry(np.array([[float(number)]]), rows)[0].tolist()
    assert found == [0.0, 0.0, 0.0, 0.0, 1.0]


def test_seconds_are_seconds_of_the_environment() -> None:
    for name, dt in (("Pendulum-v1", 0.05), ("AquaFish-v0", 0.2)):
        kwargs = {"engine": "numba"} if name.startswith("Aqua") else {}
        whole, _ = play(gym.make(name, **kwargs), 20)
        for steps in (1, 3):
            damage = f"observation_2:delay={steps * dt!r}@{5 * dt!r}"
            found, _ = play(FaultWrapper(gym.make(name, **kwargs), damage), 20)
            np.testing.assert_array_equal(found[5:, 2], whole[5 - steps : -steps, 2])
            np.testing.assert_array_equal(found[:5], whole[:5])


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        ("observation_0:delay=0.5", "delay must be at least a step, 1 s; got 0.5 s"),
        ("action:hold=1", "hold must be longer than a step, 1 s; got 1 s"),
        ("action:delay=1e5", "delay must be at most 10000 steps of 1 s"),
        ("action:delay=0", "damage action:delay must lie in"),
        ("observation:delay", "needs a number"),
        ("observation:scale=inf", "must be finite"),
    ],
)
def test_times_that_fit_no_step_are_refused(damage: str, message: str) -> None:
    with pytest.raises(InvalidArgumentError, match=message):
        FaultWrapper(Echo(), damage, dt=1)


def test_times_need_the_length_of_a_step() -> None:
    for damage in ("action:delay=1", "observation:hold=3"):
        with pytest.raises(InvalidArgumentError, match="does not say how long a step is"):
            FaultWrapper(Echo(), damage)
    FaultWrapper(Echo(), "action:scale=2")
    for make in (AquaFishEnv, AquaFishVectorEnv):
        with pytest.raises(InvalidArgumentError, match=r"at least a step, 0.2 s; got 0.1 s"):
            make(damage="gyro_x:delay=0.1@1")
        env: Any = make()
        with pytest.raises(InvalidArgumentError, match=r"longer than a step, 0.2 s; got 0.2 s"):
            env.reset(options={"damage": "caudal:hold=0.2@1-3"})
    with pytest.raises(InvalidArgumentError, match=r"RealityGap\(lag"):
        EngineTarget(None, "caudal:delay=0.2", engine="numba")


@pytest.mark.parametrize("word", ["late", "lag", "slow", "dealy", "stack"])
def test_only_a_near_word_is_offered(word: str) -> None:
    with pytest.raises(UnknownNameError) as refusal:
        Damage.parse(f"observation_0:{word}")
    near = {"dealy": "; did you mean 'delay'?", "stack": "; did you mean 'stuck'?"}.get(word, "")
    assert str(refusal.value).endswith(f"got {word!r}{near}")


def test_a_tier_of_ones_own_may_be_late(monkeypatch: pytest.MonkeyPatch) -> None:
    tier = Tier(1, (Chance("delay", 1.0, 0.2, 1.0, ("gyro_x", "caudal", "observation_3")),))
    monkeypatch.setitem(TIERS, "late", tier)
    env = AquaFishEnv(damage="random:late@1-5", engine="numba")
    found = set()
    for seed in range(8):
        _, infos = play(env, 40, seed)
        late = np.concatenate([infos[-1]["sensor_delay"], infos[-1]["servo_delay"]])
        assert np.count_nonzero(late) == 1
        found.add(round(float(late.max()), 3))
    assert len(found) > 4
    wrapped = FaultWrapper(gym.make("Pendulum-v1"), "observation_0-1:delay=0.1@0.5-1")
    assert swim(wrapped, 40) == swim(wrapped, 40)


def test_a_chance_of_being_late_is_in_every_info(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also of episodes in which none is drawn, and where another begins in the same step."""
    tier = Tier(1, (Chance("delay", 0.3, 1.0, 2.0, ("gyro_x",)), Chance("missing", 0.7)))
    monkeypatch.setitem(TIERS, "seldom", tier)
    envs = AquaFishVectorEnv(
        2, damage="random:seldom", frame_skip=100, autoreset_mode=AutoresetMode.SAME_STEP
    )
    _, info = envs.reset(seed=0)
    found = []
    for _ in range(100):
        found.append(info["sensor_delay"][:, 6] > 0.0)
        *_, info = envs.step(np.zeros((2, 3), np.float32))
    assert 0.05 < np.mean(found) < 0.6


def test_a_target_logs_late() -> None:
    def log(damage: str | None) -> Any:
        robot = EngineTarget(None, damage, np.random.default_rng(0), 64, engine="numba")
        return robot.perform(np.array([0.4, -0.3, 0.8])).gyro[0]

    whole, late = log(None), log("gyro:delay=0.05@0.2; gyro_z:scale=2")
    np.testing.assert_array_equal(late[20:, :2], whole[15:-5, :2])
    np.testing.assert_array_equal(late[:19], whole[:19] * [1, 1, 2])
