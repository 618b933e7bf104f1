"""What each word does to the actuators and sensors of any environment, and to nothing else."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from fault_fakes import Echo, play, random_damages
from gymnasium.vector import SyncVectorEnv
from hypothesis import given, settings
from hypothesis import strategies as st
from tensor_robots import Arms

from aquafish_gym import FaultWrapper, VectorFaultWrapper
from aquafish_gym.damage import TIERS, Damage
from aquafish_gym.damage.side import Side
from aquafish_gym.envs.autoreset import AutoresetMode
from aquafish_gym.utils.validation import UnknownNameError
from eea.fish.target import EngineTarget


def done(found: Any) -> Any:
    """Return the actions (steps, 2) that Echo received."""
    return found[1:, 3:]


WHOLE, _ = play(Echo())
ASKED = done(WHOLE)


@pytest.mark.parametrize(
    ("word", "expected"),
    [
        ("weak=0.5", 0.5 * ASKED[2:5, 0]),
        ("reversed", -ASKED[2:5, 0]),
        ("dead", np.zeros(3)),
        ("seized", np.full(3, ASKED[1, 0])),
        ("seized=7.5", np.full(3, 7.5)),
    ],
)
def test_broken_actuator_does_what_its_word_says(word: str, expected: Any) -> None:
    found, infos = play(FaultWrapper(Echo(), f"action_0:{word}@2+3", dt=1))
    want = ASKED.copy()
    want[2:5, 0] = expected
    np.testing.assert_array_equal(done(found), want)
    assert [info["faults"] for info in infos] == [0, 0, 1, 1, 1, 0, 0, 0, 0]
    gain = {"weak=0.5": 0.5, "reversed": -1.0, "dead": 0.0}.get(word, 1.0)
    assert [info["action_gain"].tolist() for info in infos[1:3]] == [[1, 1], [gain, 1]]
    assert infos[2]["action_seized"].tolist() == [word.startswith("seized"), False]
    assert not infos[5]["action_seized"].any()


@pytest.mark.parametrize(
    ("word", "expected"),
    [
        ("bias=1.5", [5.5, 7.5, 9.5]),
        ("bias=100", [40.0, 40.0, 40.0]),
        ("stuck", [4.0, 4.0, 4.0]),
        ("dropped", [0.0, 0.0, 0.0]),
    ],
)
def test_broken_sensor_reads_what_its_word_says(word: str, expected: list[float]) -> None:
    found, infos = play(FaultWrapper(Echo(), f"observation_1:{word}@2+3", dt=1))
    want = WHOLE.copy()
    want[2:5, 1] = expected
    np.testing.assert_array_equal(found, want)
    lost = [info["observation_lost"].tolist() for info in infos]
    assert lost[2] == [False, word in ("stuck", "dropped"), False, False, False]
    assert [info["observation_bias"][1] for info in infos[2:6]] == [
        *[float(word.partition("=")[2] or 0)] * 3, 0.0
    ]  # fmt: skip


def test_noise_is_white_and_where_it_should_be() -> None:
    env = FaultWrapper(Echo(length=2000), "observation_3:noise=0.5@0+1000", dt=1)
    found, infos = play(env, 1500)
    away = found - play(Echo(length=2000), 1500)[0]
    noise = away[:1000, 3]
    assert noise.std() == pytest.approx(0.5, rel=0.1)
    assert abs(noise.mean()) < 0.05
    assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 0.1
    assert (away[1000:] == 0.0).all()
    assert (away[:, [0, 1, 2, 4]] == 0.0).all()
    assert infos[0]["observation_noise"].tolist() == [0, 0, 0, 0.5, 0]
    several = VectorFaultWrapper(
        SyncVectorEnv([lambda: Echo(length=2000)] * 2), "observation_0-1:noise=0.2"
    )
    several.reset(seed=0)
    still = np.zeros((2, 2), np.float32)
    away = np.array([several.step(still)[0][:, :2] for _ in range(1000)])
    away -= np.arange(1, 1001)[:, None, None] % 13 * np.array([1, 2])
    streams = away.reshape(1000, 4).T  # of two channels of two robots
    np.testing.assert_allclose(np.corrcoef(streams), np.eye(4), atol=0.15)


def test_faults_add_up_and_groups_are_inclusive() -> None:
    text = "action:weak=0.5; action_1:reversed; observation_0-1:bias=1; observation_1:bias=2"
    found, infos = play(FaultWrapper(Echo(), text))
    np.testing.assert_array_equal(done(found), ASKED * np.float32([0.5, -0.5]))
    np.testing.assert_array_equal(found[:, :3], WHOLE[:, :3] + [1, 3, 0])
    assert infos[0]["faults"] == 4


def test_seized_at_the_start_stands_at_neutral_and_later_where_it_was() -> None:
    found, _ = play(FaultWrapper(Echo(), "action_0:seized; action_1:weak=0.5; action_1:seized@3",
                                 dt=1, neutral=[2.0, 0.0]))  # fmt: skip
    assert (done(found)[:, 0] == 2.0).all()
    np.testing.assert_array_equal(done(found)[3:, 1], np.full(5, 0.5 * ASKED[2, 1]))


@pytest.mark.parametrize(("low", "neutral"), [(0.25, 0.25), (-10.0, 0.0)])
def test_neutral_is_the_action_closest_to_zero(low: float, neutral: float) -> None:
    found, _ = play(FaultWrapper(Echo(low), "action:dead"))
    assert (done(found) == neutral).all()


@given(
    part=st.sampled_from(["action", "action_0", "observation", "observation_2-4", "random"]),
    word=st.sampled_from(["weak=0.3", "reversed", "seized", "seized=0.5", "dead", "noise=0.7",
                          "bias=-3", "stuck", "dropped", *TIERS]),
    onset=st.integers(0, 7),
    duration=st.integers(1, 9),
)  # fmt: skip
@settings(max_examples=60)
def test_faults_touch_nothing_before_and_after(
    part: str, word: str, onset: int, duration: int
) -> None:
    try:
        env = FaultWrapper(Echo(), f"{part}:{word}@{onset}+{duration}", dt=1)
    except UnknownNameError:  # of the other side
        return
    found, infos = play(env)
    active = [onset <= step < onset + duration for step in range(9)]
    assert [info["faults"] > 0 for info in infos] == active
    whole = [step for step in range(9) if not active[step]]
    np.testing.assert_array_equal(found[whole, :3], WHOLE[whole, :3])
    asked = [step for step in range(8) if not active[step]]
    if part.startswith("action"):
        np.testing.assert_array_equal(done(found)[asked], ASKED[asked])


@pytest.mark.parametrize("part", ["action", "action_1", "observation_0-3"])
def test_text_of_channels_reads_back_exactly(part: str) -> None:
    word = "seized=-3.5" if part.startswith("action") else "noise=1e-05"
    for time in ("", "@1.5", "@1.0-2.0+0.1"):
        assert str(Damage.parse(f"{part}:{word}{time}")) == f"{part}:{word}{time}"


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


def test_a_target_logs_late() -> None:
    def log(damage: str | None) -> Any:
        robot = EngineTarget(None, damage, np.random.default_rng(0), 64, engine="numba")
        return robot.perform(np.array([0.4, -0.3, 0.8])).gyro[0]

    whole, late = log(None), log("gyro:delay=0.05@0.2; gyro_z:scale=2")
    np.testing.assert_array_equal(late[20:, :2], whole[15:-5, :2])
    np.testing.assert_array_equal(late[:19], whole[:19] * [1, 1, 2])


def played(case: int) -> Iterator[tuple[Any, dict[str, Any]]]:
    """Yield all that a batch with random faults did and saw, in 16 steps with random actions."""
    mode = list(AutoresetMode)[case % 3]
    dtype = ("float64", "float32")[case // 3 % 2]
    rng = np.random.default_rng(case)
    arms = Arms(np.zeros(1, dtype), mode, 3, bounded=case // 6 % 2 > 0)
    envs: Any = VectorFaultWrapper(arms, random_damages(rng, 3, case >= 36), dt=1)
    over = np.zeros(3, np.bool_)
    yield envs.reset(seed=case)
    for _ in range(16):
        if mode is AutoresetMode.DISABLED and over.any():
            yield envs.reset(options={"reset_mask": over})
        seen, rewards, terminations, truncations, info = envs.step(
            rng.uniform(-1.2, 1.2, (3, 2)).astype(dtype)
        )
        over = terminations | truncations
        yield seen, info
        yield np.column_stack([rewards, arms.acted]), {}


def test_random_faults_are_what_they_were() -> None:
    """A hash of the actions, observations and infos of batches, to five digits."""
    found = hashlib.sha256()
    for case in range(72):
        for numbers, info in played(case):
            names = sorted(name for name in info if not name.startswith(("_", "final")))
            told = [info[name][info[f"_{name}"]] for name in names]
            for values in (numbers, *told):
                # 0 and -0 are the same.
                found.update((np.asarray(values, np.float64).round(5) + 0.0).tobytes())
    assert found.hexdigest()[:8] == "d30e4588"
