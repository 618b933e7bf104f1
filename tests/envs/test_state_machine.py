"""Any order of calls on environments, on batches that reset in three ways, and on fault wrappers.

Each call goes to an environment and to its twin, a wrong call to the environment alone: both stay
equal only if a refusal changes nothing, a copy is whole, and a seed determines everything. A batch
also has a single environment for each robot, which must do the same.

STATE_MACHINE_EXAMPLES=40 plays more than four sequences of each kind.
"""

from __future__ import annotations

import copy
import json
import os
import pickle
from collections.abc import Callable
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.error import ResetNeeded
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

import aquafish_gym
from aquafish_gym.envs.tasks import SwimForward
from tests.comparing import assert_overwritten, assert_same, overwrite

EXAMPLES = int(os.environ.get("STATE_MACHINE_EXAMPLES", "4"))
COUNT = 3
OPTIONS: dict[str, dict[str, Any]] = {
    "plain": {},
    "fins": {"observe_fins": True, "current": (0.5, 0.0, -0.2), "frame_skip": 10},
    "late": {"observe_fins": "reckoned", "damage": "caudal:delay=0.4; gyro:noise=0.1"},
    "drawn": {"damage": "random:severe@0.2-0.8"},
    "sensors": {"damage": "gyro_x:stuck@0.4; up_z:bias=0.1; left_pectoral:seized@0.4+0.2"},
}
FAULTS = [
    "action_0:seized@0.4; observation_3-5:noise=0.01",
    "random:moderate@0.2-0.6",
    "action_2:delay=0.3",
]
RESETS: list[dict[str, Any] | None] = [
    None,
    {},
    {"fin_angles": "zero"},
    {"fin_angles": (1.0, -2.0, 0.5)},
    {"damage": "none"},
    {"morphology": aquafish_gym.Morphology.nominal()},
]
WRONG_ACTIONS: list[Any] = [
    None,
    "x",
    [0.0],
    np.nan,
    np.full(3, np.nan),
    np.full((COUNT, 3), np.inf),
    np.zeros((2, 2)),
    {},
    1j,
]
WRONG_RESETS: list[dict[str, Any]] = [
    {"seed": -1},
    {"seed": 1.5},
    {"seed": "x"},
    {"seed": [1]},
    {"options": []},
    {"options": {"nonsense": 1}},
    {"options": {"damage": "left_pectoral:length=nan"}},
    {"options": {"damage": "tail:lost"}},
    {"seed": 3, "options": {"fin_angles": [1, 2]}},
    {"seed": 3, "options": {"morphology": [1.0] * 4}},
    {"seed": 3, "options": {"damage": "action_99:dead"}},
    {"seed": 3, "options": {"reset_mask": np.zeros(COUNT, bool)}},
    {"seed": 3, "options": {"reset_mask": [True] * COUNT}},
]
COPIES: list[Callable[[Any], Any]] = [
    lambda env: pickle.loads(pickle.dumps(env)),
    copy.deepcopy,
]
STEPPED_TO_THE_END = (None, "Disabled")  # step after the end is refused
calls = 0


class Calls(RuleBasedStateMachine):
    """Calls on one kind of environment."""

    mode: ClassVar[str | None] = None  # of autoreset; None is a single environment
    wrapped: ClassVar[bool] = False

    @initialize(
        options=st.sampled_from(sorted(OPTIONS)),
        faults=st.sampled_from(FAULTS),
        seed=st.integers(0, 2**32),
    )
    def begin(self, options: str, faults: str, seed: int) -> None:
        self.options = {"task": SwimForward(seconds=1.0), "engine": "numba", **OPTIONS[options]}
        self.faults = faults
        self.single = self.mode is None
        self.env = self.make()
        self.twin = self.make()
        self.robots: list[Any] = []
        self.given: list[Any] = []  # what the environment returned last
        if not self.single and not self.wrapped:
            self.robots = [gym.make("AquaFish-v0", **self.options) for _ in range(COUNT)]
        self.over = np.ones(1 if self.single else COUNT, bool)  # no episode has begun
        self.observation: Any = None
        self.rng = np.random.default_rng(seed)
        with pytest.raises(ResetNeeded):
            self.env.step(self.env.action_space.sample())
        self.reset(seed, None, False)

    def make(self) -> Any:
        if self.mode is None:
            env = gym.make("AquaFish-v0", **self.options)
            return aquafish_gym.FaultWrapper(env, self.faults) if self.wrapped else env
        envs = gym.make_vec(
            "AquaFish-v0", COUNT, autoreset_mode=self.mode, dtype="float64", threads=1,
            **self.options,
        )  # fmt: skip
        return aquafish_gym.VectorFaultWrapper(envs, self.faults) if self.wrapped else envs

    def both(self, call: Callable[[Any], Any]) -> Any:
        """Return what the environment answers, which must be what its twin does."""
        global calls
        calls += 1
        mine = call(self.env)
        assert_same(mine, call(self.twin))
        found = copy.deepcopy(mine)
        assert_overwritten(self.given)
        self.given = overwrite(mine)
        self.observation = found[0]
        return found

    def matches(self, i: int, observation: Any, info: Any, robot: tuple[Any, Any]) -> None:
        assert_same(observation[i], robot[0])
        for name, value in robot[1].items():
            assert_same(np.asarray(info[name][i]), np.asarray(value), at=name)

    @rule(
        seed=st.none() | st.integers(0, 2**40),
        options=st.sampled_from(RESETS),
        part=st.booleans(),
    )
    def reset(self, seed: int | None, options: dict[str, Any] | None, part: bool) -> None:
        if self.wrapped and options and "morphology" in options:
            options = None
        own = options
        mask = np.ones(COUNT, bool)
        if part and not self.single and self.observation is not None:
            mask = self.rng.random(COUNT) < 0.5
            mask[self.rng.integers(COUNT)] = True
            options = {**(options or {}), "reset_mask": mask}
        observation, info = self.both(
            lambda env: env.reset(seed=seed, options=options and dict(options))
        )
        self.over[mask[: len(self.over)]] = False
        for i, robot in enumerate(self.robots):
            if mask[i]:
                alone = robot.reset(seed=None if seed is None else seed + i, options=own)
                self.matches(i, observation, info, alone)

    @rule(scale=st.sampled_from([0.0, 1.0, 3.0]), dtype=st.sampled_from(["f4", "f8", "list"]))
    def step(self, scale: float, dtype: str) -> None:
        action = (scale * self.rng.uniform(-1, 1, self.env.action_space.shape)).astype("f4")
        action = action.tolist() if dtype == "list" else action.astype(dtype)
        if self.over.any() and self.mode in STEPPED_TO_THE_END:
            with pytest.raises(ResetNeeded):
                self.env.step(action)
            return
        observation, reward, terminated, truncated, info = self.both(
            lambda env: env.step(copy.copy(action))
        )
        assert np.isfinite(reward).all()
        ended = np.atleast_1d(terminated | truncated)
        for i, robot in enumerate(self.robots):
            if self.over[i]:
                self.matches(i, observation, info, robot.reset())
                continue
            seen, its_reward, end, cut, its_info = robot.step(action[i])
            assert (its_reward, end, cut) == (reward[i], terminated[i], truncated[i])
            if ended[i] and self.mode == "SameStep":
                assert_same(info["final_obs"][i], seen)
                seen, its_info = robot.reset()
            self.matches(i, observation, info, (seen, its_info))
        self.over = ended if self.mode != "SameStep" else np.zeros(COUNT, bool)

    @rule(action=st.sampled_from(WRONG_ACTIONS))
    def step_wrongly(self, action: Any) -> None:
        with pytest.raises((ValueError, TypeError, ResetNeeded)):
            self.env.step(action)
        self.unchanged()

    @rule(given=st.sampled_from(WRONG_RESETS))
    def reset_wrongly(self, given: dict[str, Any]) -> None:
        if not self.single and "morphology" in (given.get("options") or {}):
            given = {"options": {"morphology": [[1.0] * 4] * COUNT}}
        with pytest.raises((ValueError, TypeError)):
            self.env.reset(**copy.deepcopy(given))
        self.unchanged()

    def unchanged(self) -> None:
        """Copies of both go on alike, from where they are and by their own generators."""
        mine = copy.deepcopy(self.env)
        other = copy.deepcopy(self.twin)
        if not (self.over.any() and self.mode in STEPPED_TO_THE_END):
            action = np.full(self.env.action_space.shape, 0.5, "f4")
            assert_same(mine.step(action), other.step(action))
        assert_same(mine.reset(), other.reset())

    @rule(copied=st.sampled_from(COPIES), go_on=st.booleans())
    def replace(self, copied: Callable[[Any], Any], go_on: bool) -> None:
        old = self.env
        self.env = copied(old)
        if go_on:  # which must not change the copy
            old.reset(seed=99)
            old.step(old.action_space.sample())
        old.close()

    @rule()
    def close(self) -> None:
        """Close twice; a specification read from JSON makes the next environment."""
        spec = self.env.spec
        for env in (self.env, self.twin):
            env.close()
            env.close()
        self.env = self.make()
        if self.single:
            read = EnvSpec.from_json(spec.to_json())
            assert read == spec
            self.env = gym.make(read)
            assert json.loads(self.env.spec.to_json()) == json.loads(spec.to_json())
        self.twin = self.make()
        self.observation = None
        self.over[:] = True
        self.reset(int(self.rng.integers(1000)), None, False)

    @rule(seed=st.integers(0, 1000))
    def seeds_differ(self, seed: int) -> None:
        one, same, other = (
            copy.deepcopy(self.env).reset(seed=given)[1]["fin_angles"]
            for given in (seed, seed, seed + COUNT)
        )
        assert_same(one, same)
        assert not np.array_equal(one, other)

    @precondition(lambda self: self.observation is not None)
    @invariant()
    def observes_what_its_space_contains(self) -> None:
        assert self.env.observation_space.contains(self.observation)


@pytest.mark.parametrize("wrapped", [False, True], ids=["bare", "wrapped"])
@pytest.mark.parametrize("mode", [None, "NextStep", "SameStep", "Disabled"])
def test_any_order_of_calls(mode: str | None, wrapped: bool) -> None:
    before = calls
    kind = type("Calls", (Calls,), {"mode": mode, "wrapped": wrapped})
    case = kind.TestCase
    case.settings = settings(
        max_examples=EXAMPLES,
        stateful_step_count=20,
        deadline=None,
        derandomize=True,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    case("runTest").runTest()
    assert calls - before > 4 * EXAMPLES
