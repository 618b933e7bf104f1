"""Random faults of channels are what they were, and the same in every batch, mode and library."""

from __future__ import annotations

import hashlib
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from random_faults import random_damages
from tensor_robots import Arms

from aquafish_gym import FaultWrapper, VectorFaultWrapper

MODES = list(AutoresetMode)
CASES, STEPS, ROBOTS = 150, 16, 3
#: Of all that 150 batches did, saw and told, by the imperative statement of 7f51f6b; and of those
#: with faults that grow, to five digits, as these grow by a number a step now.
HASHES = {
    ("NextStep", "float64"): "922aac3e f26f4533",
    ("NextStep", "float32"): "a254d392 7a930d27",
    ("SameStep", "float64"): "5f1127bc 94ae6ecd",
    ("SameStep", "float32"): "90c4545d 8b97fa54",
    ("Disabled", "float64"): "f9c11498 a8573614",
    ("Disabled", "float32"): "8c57517c 5d6c6193",
}
by_mode = pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.value)


def broken_arms(like: Any, mode: AutoresetMode, growing: bool, case: int) -> VectorFaultWrapper:
    """Return a batch with random faults."""
    damages = random_damages(np.random.default_rng([case, growing]), ROBOTS, growing)
    return VectorFaultWrapper(Arms(like, mode, ROBOTS, bounded=case % 3 > 0), damages, dt=1)


def played(envs: Any, mode: AutoresetMode, seed: int) -> list[Any]:
    """Return all that a batch did and saw, in some steps with random actions."""
    arms = envs.unwrapped
    rng = np.random.default_rng(seed)
    over = np.zeros(ROBOTS, np.bool_)
    found: list[Any] = [envs.reset(seed=seed)]
    for _ in range(STEPS):
        if mode is AutoresetMode.DISABLED and over.any():
            found.append(envs.reset(options={"reset_mask": arms.array(over.copy())}))
        actions = rng.uniform(-1.2, 1.2, (ROBOTS, 2)).astype(arms.single_action_space.dtype)
        seen, rewards, terminations, truncations, info = envs.step(arms.array(actions))
        over = np.asarray(terminations | truncations)
        found += [(arms.acted, {}), (seen, info), (rewards, {})]
    return found


def digest(mode: AutoresetMode, dtype: str, growing: bool) -> str:
    """Return a hash of what random faults do; 0 and -0 are the same."""
    found = hashlib.sha256()

    def note(numbers: Any) -> None:
        values = np.asarray(numbers, np.float64)
        found.update(((values.round(5) if growing else values) + 0.0).tobytes())

    for case in range(CASES):
        envs = broken_arms(np.zeros(1, dtype), mode, growing, case)
        for numbers, info in played(envs, mode, case):
            note(numbers)
            for name in sorted(info):
                if not name.startswith(("_", "final")):
                    note(info[name][info[f"_{name}"]])
    return found.hexdigest()[:8]


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@by_mode
def test_random_faults_are_what_they_were(mode: AutoresetMode, dtype: str) -> None:
    found = " ".join(digest(mode, dtype, growing) for growing in (False, True))
    assert found == HASHES[mode.value, dtype]


class Counter(gym.Env[Any, Any]):
    """Observes its step and what was done, in episodes of another length in turn."""

    def __init__(self, length: int) -> None:
        self.metadata: dict[str, Any] = {"render_modes": []}
        self.action_space = Box(-1.0, 1.0, (2,), np.float32)
        self.observation_space = Box(-30.0, 30.0, (4,), np.float32)
        self._length, self._episode = length, 0

    def reset(self, *, seed: Any = None, options: Any = None) -> Any:  # noqa: ARG002
        super().reset(seed=seed)
        self._episode, self._steps = self._episode + 1, 0
        return self._seen(np.zeros(2)), {}

    def _seen(self, action: Any) -> Any:
        return np.array([self._steps, -self._steps, *action], np.float32)

    def step(self, action: Any) -> Any:
        self._steps += 1
        over = self._steps >= self._length + self._episode % 2
        return self._seen(action), 0.0, False, over, {}


ANY_DAMAGE = [
    "random:moderate@1-4; observation:noise=0.1@1-2+3",
    "random:mild; action_0:delay=1",
    "none",
    "observation_1:noise=0.2; random:severe@0-3; observation_3:bias=1@1~3",
    "random:mild@2-3; random:severe",
]
SEED, MANY_STEPS = 11, 150  # more observations than a block of noise has


def alone(robot: int, mode: AutoresetMode, actions: Any) -> list[Any]:
    """Return what a batch of its mode would observe of a single robot, and be told."""
    env = FaultWrapper(Counter(4 + robot), ANY_DAMAGE[robot], dt=1)
    seen, info = env.reset(seed=SEED + robot)
    found: list[Any] = [(seen, info)]
    over = False
    for action in actions:
        if over and mode is AutoresetMode.DISABLED:
            found.append(env.reset())
            over = False
        if over and mode is AutoresetMode.NEXT_STEP:
            seen, info = env.reset()
            over = False
        else:
            seen, _, _, over, info = env.step(action)
        if over and mode is AutoresetMode.SAME_STEP:
            found.append((seen, info))
            seen, info = env.reset()
        found.append((seen, info))
    return found


def together(mode: AutoresetMode, actions: Any) -> list[list[Any]]:
    """Return the same of each robot of a batch."""
    count = len(ANY_DAMAGE)
    envs = SyncVectorEnv([lambda i=i: Counter(4 + i) for i in range(count)], autoreset_mode=mode)
    wrapped = VectorFaultWrapper(envs, ANY_DAMAGE, dt=1)
    found: list[list[Any]] = [[] for _ in range(count)]

    def note(seen: Any, info: dict[str, Any], rows: Any) -> None:
        for i in rows:
            own = {name: info[name][i] for name in info if not name.startswith(("_", "final"))}
            found[i].append((np.array(seen[i]), own))

    note(*wrapped.reset(seed=SEED), range(count))
    over = np.zeros(count, np.bool_)
    for action in actions:
        if over.any() and mode is AutoresetMode.DISABLED:
            mask = over.copy()
            note(*wrapped.reset(options={"reset_mask": mask}), np.flatnonzero(mask))
        seen, _, terminations, truncations, info = wrapped.step(
            np.tile(np.float32(action), (count, 1))
        )
        over = terminations | truncations
        if over.any() and mode is AutoresetMode.SAME_STEP:
            note(info["final_obs"], info["final_info"], np.flatnonzero(over))
        note(seen, info, range(count))
    return found


@by_mode
def test_a_robot_of_a_batch_is_the_single_one_of_its_seed(mode: AutoresetMode) -> None:
    """Noise and random damage included, to the bit."""
    actions = np.random.default_rng(0).uniform(-1, 1, (MANY_STEPS, 2)).astype(np.float32)
    batch = together(mode, actions)
    kinds = set()
    for robot, found in enumerate(batch):
        want = alone(robot, mode, actions)
        assert len(found) == len(want)
        for (seen, info), (own, told) in zip(found, want, strict=True):
            np.testing.assert_array_equal(seen, own)
            assert info.keys() >= told.keys()  # another robot may be late
            for name, value in told.items():
                np.testing.assert_array_equal(info[name], value)
            kinds.add((*told["observation_lost"], *told["action_gain"].round(1)))
    assert len(kinds) > 20


def test_noise_of_numpy_has_its_size_and_is_white() -> None:
    """As that of a device, and of another robot."""
    envs = VectorFaultWrapper(
        SyncVectorEnv([lambda: Counter(2000)] * 4),
        "observation_2:noise=0.2; observation_3:noise=0.1", dt=1,
    )  # fmt: skip
    envs.reset(seed=0)
    still = np.zeros((4, 2), np.float32)
    away = np.array([envs.step(still)[0][:, 2:] for _ in range(1000)])
    np.testing.assert_allclose(away.std(axis=0), [[0.2, 0.1]] * 4, rtol=0.1)
    pairs = [(away[1:, 0, 0], away[:-1, 0, 0]), (away[:, 0, 0], away[:, 1, 0]), away[:, 2].T]
    assert all(abs(np.corrcoef(*pair)[0, 1]) < 0.1 for pair in pairs)


def test_a_mask_begins_only_the_streams_of_its_robots() -> None:
    def batch() -> VectorFaultWrapper:
        envs = SyncVectorEnv([lambda: Counter(2000)] * 2, autoreset_mode=AutoresetMode.DISABLED)
        wrapped = VectorFaultWrapper(envs, "observation:noise=0.2")
        wrapped.reset(seed=[3, 4])
        return wrapped

    still = np.zeros((2, 2), np.float32)
    one, other = batch(), batch()
    mask = np.array([True, False])
    first = other.reset(seed=[3, 4], options={"reset_mask": mask})[0]
    np.testing.assert_array_equal(first[0], batch().reset(seed=[3, 4])[0][0])
    np.testing.assert_array_equal(other.step(still)[0][1], one.step(still)[0][1])
