"""What each word does to the actuators and sensors of any environment, and to nothing else."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from fault_fakes import Echo, play, swim
from hypothesis import given, settings
from hypothesis import strategies as st

from aquafish_gym import FaultWrapper
from aquafish_gym.damage import TIERS, Damage
from aquafish_gym.envs.env import AquaFishEnv
from aquafish_gym.utils.validation import UnknownNameError


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


@pytest.mark.parametrize("word", ["weak=0.5", "reversed", "dead", "seized", "seized=-1"])
def test_swimmer_swims_otherwise_from_the_onset_on(word: str) -> None:
    env = gym.make("Swimmer-v5")
    whole, _ = play(env, 60)
    broken, infos = play(FaultWrapper(env, f"action_0:{word}@1+1"), 60)
    assert (broken[:26] == whole[:26]).all()  # 25 steps of 0.04 s
    assert (broken[26] != whole[26]).any()
    assert [info["faults"] for info in infos] == [0] * 25 + [1] * 25 + [0] * 11


@pytest.mark.parametrize("word", ["noise=0.1", "bias=0.2", "stuck", "dropped"])
def test_swimmer_senses_otherwise_and_swims_on(word: str) -> None:
    env = gym.make("Swimmer-v5")
    whole, _ = play(env, 60)
    broken, _ = play(FaultWrapper(env, f"observation_3:{word}@1+1"), 60)
    away = broken != whole
    assert away[26:50, 3].all()
    assert away.sum() == away[25:50, 3].sum()


@pytest.mark.parametrize(
    ("built_in", "channels"),
    [
        ("up_x:stuck@2+3; north_y:dropped@3; gyro_z:bias=0.5@1+9",
         "observation_0:stuck@2+3; observation_4:dropped@3; observation_8:bias=0.5@1+9"),
        ("gyro_y:bias=0.05@2+9; gyro_x:bias=40@3",
         "observation_7:bias=0.05@2+9; observation_6:bias=40@3"),
        ("left_pectoral:reversed@4+8", "action_0:reversed@4+8"),
        ("right_pectoral:weak=0.5", "action_1:weak=0.5"),
        ("left_pectoral:seized@4+8", "action_0:dead@4+8"),
        ("caudal:seized@5", "action_2:dead@5"),
    ],
)  # fmt: skip
def test_fish_has_the_same_faults_to_the_bit(built_in: str, channels: str) -> None:
    whole = AquaFishEnv(engine="numba")
    wrapped = FaultWrapper(whole, channels, neutral=[0.0, 0.0, -1.0])
    assert swim(wrapped) == swim(AquaFishEnv(damage=built_in, engine="numba")) != swim(whole)


@pytest.mark.parametrize("part", ["action", "action_1", "observation_0-3"])
def test_text_of_channels_reads_back_exactly(part: str) -> None:
    word = "seized=-3.5" if part.startswith("action") else "noise=1e-05"
    for time in ("", "@1.5", "@1.0-2.0+0.1"):
        assert str(Damage.parse(f"{part}:{word}{time}")) == f"{part}:{word}{time}"
