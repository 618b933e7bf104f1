"""Damage of any environment: what each word does, when, and that nobody else notices."""

from __future__ import annotations

import copy
import pickle
from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv
from hypothesis import given, settings
from hypothesis import strategies as st

from aquafish_gym import FaultWrapper, VectorFaultWrapper
from aquafish_gym.damage import TIERS, Chance, Damage, Tier
from aquafish_gym.envs.env import AquaFishEnv
from aquafish_gym.envs.vector import AquaFishVectorEnv
from aquafish_gym.utils.validation import InvalidArgumentError, UnknownNameError

MODES = list(AutoresetMode)
SPEEDS = ("left_pectoral", "right_pectoral")


class Echo(gym.Env[Any, Any]):
    """Observes how many steps were taken modulo 13, times 1, 2 and 3, and what was done."""

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012

    def __init__(self, low: float = -10.0, high: float = 10.0, length: int = 8) -> None:
        self.action_space = Box(low, high, (2,), np.float32)
        self.observation_space = Box(-40.0, 40.0, (5,), np.float32)
        self.length, self.steps = length, 0

    def reset(self, *, seed: Any = None, options: Any = None) -> Any:
        super().reset(seed=seed)
        self.options, self.steps = options, 0
        return self._see(np.zeros(2)), {}

    def _see(self, action: Any) -> Any:
        return np.array([*(np.arange(1, 4) * (self.steps % 13)), *action], np.float32)

    def step(self, action: Any) -> Any:
        self.steps += 1
        return self._see(action), 1.0, False, self.steps == self.length, {}


def play(env: gym.Env[Any, Any], steps: int = 8, seed: int = 0) -> tuple[Any, list[Any]]:
    """Take random actions; return the observations (steps + 1, ...) and infos."""
    rng, space = np.random.default_rng(seed), env.action_space
    seen, info = env.reset(seed=seed)
    found, infos = [seen], [info]
    for _ in range(steps):
        action = rng.uniform(-1.0, 1.0, space.shape).astype(space.dtype)
        seen, *_, info = env.step(action)
        assert env.observation_space.contains(seen)
        found.append(seen)
        infos.append(info)
    return np.array(found), infos


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


def swim(env: gym.Env[Any, Any], steps: int = 100, seed: int = 3) -> bytes:
    found, _ = play(env, steps, seed)
    return bytes(found.tobytes())


@pytest.mark.parametrize(
    ("built_in", "channels"),
    [
        ("up_x:stuck@2+3; north_y:dropped@3; gyro_z:bias=0.5@1+9",
         "observation_0:stuck@2+3; observation_4:dropped@3; observation_8:bias=0.5@1+9"),
        ("gyro:noise=0.05@2+9", "observation_6-8:noise=0.05@2+9"),
        ("gyro:noise=0.05@2-9; gyro_x:bias=40@3-4",
         "observation_6-8:noise=0.05@2-9; observation_6:bias=40@3-4"),
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


def test_info_counts_the_environments_own_faults() -> None:
    env = FaultWrapper(AquaFishEnv(damage="caudal:missing", engine="numba"), "action:dead@1")
    _, infos = play(env, 5)
    assert [info["faults"] for info in infos] == [1] * 5 + [2]
    assert infos[-1]["servo_gain"].tolist() == [1, 1, 1]


NOISELESS = "action_0:weak=0.5@2+3; observation_0:stuck@1; observation_2:bias=1@4+2"


def batch(damages: list[str], mode: AutoresetMode, inside: bool) -> VectorEnv[Any, Any, Any]:
    def one(i: int) -> gym.Env[Any, Any]:
        env = Echo(length=5 + i)
        return FaultWrapper(env, damages[i], dt=1) if inside else env

    envs = SyncVectorEnv([lambda i=i: one(i) for i in range(3)], autoreset_mode=mode)
    return envs if inside else VectorFaultWrapper(envs, damages, dt=1)


def equal(one: Any, two: Any) -> None:
    if isinstance(one, dict):
        assert one.keys() == two.keys()
        for name in one:
            mask = one.get(f"_{name}", slice(None))
            if isinstance(one[name], dict):
                equal(one[name], two[name])
            else:
                equal(list(one[name][mask]), list(two[name][mask]))
    elif isinstance(one, tuple):
        for a, b in zip(one, two, strict=True):
            equal(a, b)
    else:
        np.testing.assert_array_equal(one, two)


@pytest.mark.parametrize("mode", MODES)
def test_batch_equals_single_environments(mode: AutoresetMode) -> None:
    damages = [NOISELESS, "none", "action:seized@3; observation:dropped@4; observation_1:stuck@2+1"]
    one, two = (batch(damages, mode, inside) for inside in (True, False))
    equal(one.reset(seed=0), two.reset(seed=0))
    rng, over = np.random.default_rng(0), np.zeros(3, np.bool_)
    ends = 0
    for _ in range(30):
        if mode is AutoresetMode.DISABLED and over.any():
            equal(*(envs.reset(options={"reset_mask": over.copy()}) for envs in (one, two)))
        actions = rng.uniform(-1, 1, (3, 2)).astype(np.float32)
        a, b = one.step(actions), two.step(actions)
        equal(a, b)
        over = a[2] | a[3]
        ends += over.sum()
        assert ("final_obs" in b[-1]) == (mode is AutoresetMode.SAME_STEP and over.any())
    assert ends > 9


@pytest.mark.parametrize("mode", MODES)
def test_batch_of_fish_has_the_same_faults_to_the_bit(mode: AutoresetMode) -> None:
    built_in = ["up_x:stuck@2+3; gyro_z:bias=0.5@1+9", "left_pectoral:reversed@4"]
    channels = ["observation_0:stuck@2+3; observation_8:bias=0.5@1+9", "action_0:reversed@4"]
    kwargs: dict[str, Any] = {"frame_skip": 100, "autoreset_mode": mode, "dtype": "float64"}
    one = AquaFishVectorEnv(2, damage=built_in, **kwargs)
    two = VectorFaultWrapper(AquaFishVectorEnv(2, **kwargs), channels)
    equal(one.reset(seed=0)[0], two.reset(seed=0)[0])
    rng = np.random.default_rng(0)
    for step in range(45):
        if mode is AutoresetMode.DISABLED and step in (20, 40):
            equal(one.reset()[0], two.reset()[0])
        actions = rng.uniform(-1, 1, (2, 3)).astype(np.float32)
        a, b = one.step(actions), two.step(actions)
        equal(a[:4], b[:4])
        equal(a[-1]["faults"], b[-1]["faults"])
        if "final_obs" in a[-1]:
            equal(list(a[-1]["final_obs"]), list(b[-1]["final_obs"]))
            equal(a[-1]["final_info"]["faults"], b[-1]["final_info"]["faults"])


def noisy(mode: AutoresetMode, seed: Any) -> bytes:
    envs = VectorFaultWrapper(
        SyncVectorEnv([Echo] * 3, autoreset_mode=mode),
        "random:mild@1-6; observation_3:noise=0.1", dt=1,
    )  # fmt: skip
    found = [envs.reset(seed=seed)[0]]
    for step in range(20):
        if mode is AutoresetMode.DISABLED and step in (8, 16):
            envs.reset()
        found.append(envs.step(np.zeros((3, 2), np.float32))[0])
    return np.array(found).tobytes()


@pytest.mark.parametrize("mode", MODES)
def test_same_seed_is_same_bytes(mode: AutoresetMode) -> None:
    assert noisy(mode, 0) == noisy(mode, 0) != noisy(mode, 1)
    assert noisy(mode, [0, 1, 2]) == noisy(mode, [0, 1, 2])
    assert noisy(mode, None) != noisy(mode, None)


def test_noise_is_no_copy_of_what_the_environment_draws() -> None:
    """The first environment has the same seed as the wrapper."""
    envs = VectorFaultWrapper(SyncVectorEnv([Echo]), "observation_0:noise=1")
    seen, _ = envs.reset(seed=5)
    assert seen[0, 0] != np.float32(np.random.default_rng(5).normal())


def test_onsets_and_tiers_are_drawn_in_each_episode() -> None:
    env = FaultWrapper(Echo(length=20), "random:severe@2-9", dt=1)
    env.reset(seed=0)
    found = set()
    for _ in range(30):
        env.reset()
        infos = [env.step(np.zeros(2, np.float32))[-1] for _ in range(12)]
        counts = [info["faults"] for info in infos]
        assert set(counts) == {0, 2}
        last = infos[-1]
        found.add((counts.index(2), *last["action_gain"], *last["observation_lost"]))
    assert len(found) > 15


def test_tier_of_ones_own_breaks_the_channels_that_it_names(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tier = Tier(2, (Chance("weak", 0.5, 0.1, 0.2, ("action_1",)), Chance("length", 0.5, 0.5, 1.0)))
    monkeypatch.setitem(TIERS, "tired", tier)
    _, info = FaultWrapper(Echo(), "random:tired").reset(seed=0)
    assert info["faults"] == 1  # the other way to break is the fish's
    assert info["action_gain"][0] == 1.0
    assert 0.1 <= info["action_gain"][1] <= 0.2


@pytest.mark.parametrize("part", ["action", "action_1", "observation_0-3"])
def test_text_of_channels_reads_back_exactly(part: str) -> None:
    word = "seized=-3.5" if part.startswith("action") else "noise=1e-05"
    for time in ("", "@1.5", "@1.0-2.0+0.1"):
        assert str(Damage.parse(f"{part}:{word}{time}")) == f"{part}:{word}{time}"


def test_damage_of_one_episode_comes_with_reset() -> None:
    env = FaultWrapper(Echo(), "action:dead", dt=1)
    _, info = env.reset(options={"damage": "observation:stuck", "own": 1})
    assert env.unwrapped.options == {"own": 1}
    assert (info["faults"], info["action_gain"].tolist()) == (1, [1, 1])
    assert env.reset()[1]["action_gain"].tolist() == [0, 0]
    envs = VectorFaultWrapper(SyncVectorEnv([Echo] * 2), "action:dead")
    _, info = envs.reset(options={"damage": ["none", "action:weak=0.5"]})
    assert info["action_gain"].tolist() == [[1, 1], [0.5, 0.5]]
    envs.step(np.zeros((2, 2)))
    mask = np.array([True, False])
    _, info = envs.reset(options={"reset_mask": mask})
    assert info["action_gain"][0].tolist() == [0, 0]
    assert info["_action_gain"].tolist() == [True, False]


class Camera(gym.Env[Any, Any]):
    """Observes noise, as bytes in two dimensions; acts in whole numbers."""

    observation_space = Box(5, 255, (4, 3), np.uint8)
    action_space = Box(-3, 3, (2, 2), np.int32)

    def reset(self, *, seed: Any = None, options: Any = None) -> Any:  # noqa: ARG002
        super().reset(seed=seed)
        return self.observation_space.low.copy(), {}

    def step(self, action: Any) -> Any:
        assert self.action_space.contains(action)
        return self.np_random.integers(5, 256, (4, 3)).astype(np.uint8), 0.0, False, False, {}


EVERYTHING = (
    "observation:noise=50; observation_0:bias=1e9; observation_1:dropped; observation_2:stuck;"
    "action:weak=0.4; action_0:reversed; action_1:seized"
)


@pytest.mark.filterwarnings("ignore:.*is different from the unwrapped version")
@pytest.mark.filterwarnings("ignore:.*value is -?infinity")
@pytest.mark.parametrize("make", [Camera, lambda: Echo(-1.0, 1.0), lambda: gym.make("Swimmer-v5")])
def test_observations_and_actions_stay_in_their_spaces(make: Any) -> None:
    env = FaultWrapper(make(), EVERYTHING)
    check_env(env, skip_render_check=True)
    rng = np.random.default_rng(0)
    seen, info = env.reset(seed=0)
    for _ in range(5):
        action = rng.uniform(-3, 3, env.action_space.shape).astype(env.action_space.dtype)
        seen, *_, info = env.step(action)
        assert seen.dtype == env.observation_space.dtype
        assert env.observation_space.contains(seen)
    assert info["observation_bias"].shape == env.observation_space.shape
    if make is Camera:
        assert (seen[0, 0], seen[0, 1], seen[0, 2]) == (255, 5, seen[0, 2])


def test_whole_channels_pass_unchanged_even_outside_of_their_space() -> None:
    env = FaultWrapper(Echo(), "action_0:dead; observation_0:dropped")
    env.reset(seed=0)
    seen, *_ = env.step(np.array([0.5, 99.0], np.float32))
    assert seen[4] == 99.0


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        ("motor:dead", "damage part must be one of .*action, observation; got 'motor'"),
        (
            "caudal:dead",
            "must be one of action, action_0 to action_1, observation, .* got 'caudal'",
        ),
        ("action_2:dead", "action_0 to action_1.*; got 'action_2'"),
        ("observation_3-9:stuck", "got 'observation_3-9'"),
        ("observation_3-1:stuck", "got 'observation_3-1'; did you mean 'observation_1-3'"),
        ("action_0:dead+3", "got 'action_0:dead[+]3'; did you mean 'action_0:dead@0[+]3'"),
        ("action_0:weak=0.5+3", "did you mean 'action_0:weak=0.5@0[+]3'"),
        ("action_0:stuck", "damage must be one of weak, reversed, seized, dead; got 'stuck'"),
        ("action_0:weak=nan", "must be finite"),
        ("action_0:weak", "needs a number"),
        ("action:seized=11", r"damage action:seized\[0\] must lie in \[-10, 10\]; got 11"),
        ("observation:noise=-1", "must lie in"),
        ("action_0:dead@1", "does not say how long a step is: give dt in s, or dt=1"),
        ("random:mild@1-2", "does not say how long a step is"),
        (["action:dead", "none"], "damage must be one text.*'action_0:dead'.*: join texts .* by ;"),
    ],
)
def test_damage_that_does_not_fit_is_refused(damage: Any, message: str) -> None:
    with pytest.raises(InvalidArgumentError, match=message):
        FaultWrapper(Echo(), damage)
    env = FaultWrapper(Echo())
    with pytest.raises(InvalidArgumentError, match=message):
        env.reset(options={"damage": damage})


def test_what_cannot_be_wrapped_is_refused() -> None:
    discrete, env = gym.make("CartPole-v1"), Echo()
    with pytest.raises(InvalidArgumentError, match="the action space must be a Box of numbers"):
        FaultWrapper(discrete)
    env.observation_space = gym.spaces.Dict(a=Discrete(2))  # type: ignore[assignment]
    with pytest.raises(InvalidArgumentError, match="the observation space must be a Box"):
        FaultWrapper(env)
    with pytest.raises(InvalidArgumentError, match="join the faults"):
        FaultWrapper(gym.wrappers.TimeLimit(FaultWrapper(Echo(), "action:dead"), 5))
    with pytest.raises(InvalidArgumentError, match="join the faults"):
        VectorFaultWrapper(VectorFaultWrapper(SyncVectorEnv([Echo])))
    with pytest.raises(InvalidArgumentError, match="join the faults"):
        VectorFaultWrapper(SyncVectorEnv([lambda: FaultWrapper(Echo())])).reset()
    with pytest.raises(InvalidArgumentError, match="before the episode ends at 40 s"):
        FaultWrapper(gym.make("Swimmer-v5"), "action:dead@40")
    for neutral in (11.0, [0.0], "no", np.nan):
        with pytest.raises(InvalidArgumentError, match="neutral"):
            FaultWrapper(Echo(), neutral=neutral)  # type: ignore[arg-type]
    for dt in (0.0, -1.0, "1"):
        with pytest.raises(InvalidArgumentError, match="dt must"):
            FaultWrapper(Echo(), dt=dt)  # type: ignore[arg-type]
    envs = SyncVectorEnv([Echo] * 2)
    with pytest.raises(InvalidArgumentError, match="damage must be one for all robots"):
        VectorFaultWrapper(envs, ["action:dead"] * 3)
    envs.metadata = {}
    with pytest.raises(InvalidArgumentError, match="autoreset_mode"):
        VectorFaultWrapper(envs)
    with pytest.raises(InvalidArgumentError, match="give it to FaultWrapper"):
        AquaFishEnv(damage="action_0:dead")


@pytest.mark.parametrize("action", [[0.0], [np.nan, 0.0], "up", None])
def test_bad_actions_are_refused(action: Any) -> None:
    env = FaultWrapper(Echo())
    env.reset()
    with pytest.raises(InvalidArgumentError, match="action must"):
        env.step(action)


def test_times_are_in_seconds_of_the_environment() -> None:
    for name, steps in (("Swimmer-v5", 25), ("Pendulum-v1", 20), ("MountainCarContinuous-v0", 30)):
        damage = "action_0:dead@1"
        _, infos = play(FaultWrapper(gym.make(name), damage), 31)
        assert [info["faults"] for info in infos].index(1) == steps
        envs = VectorFaultWrapper(gym.make_vec(name, 2, vectorization_mode="sync"), damage)
        envs.reset(seed=0)
        still = np.zeros(envs.action_space.shape, np.float32)
        counts = [envs.step(still)[-1]["faults"].tolist() for _ in range(31)]
        assert counts.index([1, 1]) == steps - 1


def test_specification_and_copies_make_the_same_environment() -> None:
    damage = Damage.parse("random:moderate@0.1-0.3; observation:noise=0.1; action_1:seized=0.3@0.2")
    wrapper = FaultWrapper.wrapper_spec(damage=str(damage), neutral=[0.1, 0.2])
    env = gym.make(replace(gym.spec("Swimmer-v5"), additional_wrappers=(wrapper,)))
    same = FaultWrapper(gym.make("Swimmer-v5"), damage, neutral=np.array([0.1, 0.2]))
    assert same.spec is not None
    again = gym.make(gym.envs.registration.EnvSpec.from_json(same.spec.to_json()))
    assert swim(env, 20) == swim(same, 20) == swim(again, 20)
    fish = FaultWrapper(AquaFishEnv(engine="numba"), "observation:noise=0.1; action_0:seized@1")
    play(fish, 7)
    for other in (copy.deepcopy(fish), pickle.loads(pickle.dumps(fish))):
        fish_too = copy.deepcopy(fish)
        for _ in range(5):
            seen = [env.step(np.ones(3, np.float32))[0] for env in (fish_too, other)]
            assert (seen[0] == seen[1]).all()


def test_nothing_that_is_returned_is_kept() -> None:
    envs = VectorFaultWrapper(SyncVectorEnv([Echo] * 2), "observation:stuck; action:seized")
    seen, info = envs.reset(seed=0)
    for array in (seen, *(value for value in info.values())):
        array[...] = 7
    seen, *_, info = envs.step(np.ones((2, 2), np.float32))
    assert (seen[:, :3] == 0.0).all()
    assert info["faults"].tolist() == [2, 2]


def test_a_step_is_as_long_in_every_vectorization_mode() -> None:
    """Pendulum's dt is 0.05 s, and its films have 30 frames a second."""
    for mode in ("sync", "async"):
        envs = gym.make_vec("Pendulum-v1", num_envs=2, vectorization_mode=mode)
        envs = VectorFaultWrapper(envs, "action_0:dead@0.1")
        envs.reset(seed=0)
        active = [envs.step(np.zeros((2, 1), np.float32))[-1]["faults"].tolist() for _ in range(3)]
        envs.close()
        assert active == [[0, 0], [1, 1], [1, 1]]


@pytest.mark.parametrize("part", ["action0", "actoin_0", "ACTION_0", "observation_3-"])
def test_a_mistyped_channel_is_answered_with_channels(part: str) -> None:
    with pytest.raises(
        InvalidArgumentError, match=r"damage part must be (action|observation), "
    ) as it:
        FaultWrapper(Echo(), f"{part}:dead")
    assert "caudal" not in str(it.value)
