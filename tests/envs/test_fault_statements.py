"""Random faults of channels, carried out in two ways, are the same numbers."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from random_faults import random_damages
from tensor_robots import Arms

from aquafish_gym import VectorFaultWrapper

MODES = list(AutoresetMode)
CASES, STEPS, ROBOTS = 150, 16, 3
#: Of all that 150 batches did, saw and told, by the imperative statement of 7f51f6b.
HASHES = {
    ("NextStep", "float64"): "960cfdc634be7bb6",
    ("NextStep", "float32"): "5fb288a7c7903742",
    ("SameStep", "float64"): "733d5900522f4b06",
    ("SameStep", "float32"): "0dc1522a9ddecfa0",
    ("Disabled", "float64"): "9b08f3173aae99ac",
    ("Disabled", "float32"): "dfa4ce0cdd28beaf",
}


class PlainArms(Arms):
    """Arms whose ``final_obs`` is an array (B, ...), as of batches on a device."""

    def step(self, actions: Any) -> Any:
        *found, info = super().step(actions)
        if "final_obs" in info:
            info["final_obs"] = np.array([*info["final_obs"]])
        return *found, info


class ByTables(VectorFaultWrapper):
    """The wrapper whose faults are looked up in tables, as on a device."""

    def reset(self, *, seed: Any = None, options: Any = None) -> Any:
        seen, info = self.env.reset(seed=seed, options=options)
        mask = (options or {}).get("reset_mask")
        return self._reset_arrays(seen, info, self._damages, mask)


def same(found: Any, want: Any) -> None:
    np.testing.assert_array_equal(np.asarray(found), np.asarray(want))


def same_info(found: dict[str, Any], want: dict[str, Any]) -> None:
    """Where masks say so; the tables may show more of what is late."""
    for name, value in want.items():
        mask = np.asarray(want.get(f"_{name}", slice(None)))
        if name == "final_info":
            same_info(found[name], value)
        elif name == "final_obs":
            ended = want["final_info"]["_faults"]
            same(np.asarray(found[name])[ended], np.array([*value[ended]]))
        elif not name.startswith("_"):
            same(np.asarray(found[name])[mask], value[mask])


def played(envs: Any, mode: AutoresetMode, seed: int) -> list[Any]:
    """Return all that a batch did and saw, in some steps with random actions."""
    envs_of = envs.unwrapped
    rng = np.random.default_rng(seed)
    over = np.zeros(ROBOTS, np.bool_)
    found: list[Any] = [envs.reset(seed=seed)]
    for _ in range(STEPS):
        if mode is AutoresetMode.DISABLED and over.any():
            found.append(envs.reset(options={"reset_mask": over.copy()}))
        actions = rng.uniform(-1.2, 1.2, (ROBOTS, 2)).astype(envs_of.single_action_space.dtype)
        seen, rewards, terminations, truncations, info = envs.step(actions)
        over = terminations | truncations
        found += [(envs_of.acted, {}), (seen, info), (rewards, {})]
    return found


def batches(mode: AutoresetMode, dtype: str, growing: bool, case: int) -> tuple[Any, ...]:
    """Return a batch with random faults, singly stated and by tables."""
    damages = random_damages(np.random.default_rng([case, growing]), ROBOTS, growing)
    bounded = case % 3 > 0
    like = np.zeros(1, dtype)
    return (
        VectorFaultWrapper(Arms(like, mode, ROBOTS, bounded), damages, dt=1),
        ByTables(PlainArms(like, mode, ROBOTS, bounded), damages, dt=1),
    )


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.value)
def test_both_statements_are_the_same_to_the_bit(mode: AutoresetMode) -> None:
    for case in range(CASES):
        one, other = batches(mode, "float64", True, case)
        pairs = zip(played(one, mode, case), played(other, mode, case), strict=True)
        for (want, told), (found, shown) in pairs:
            same(found, want)
            same_info(shown, told)


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.value)
def test_faults_that_do_not_grow_are_what_they_were(mode: AutoresetMode, dtype: str) -> None:
    digest = hashlib.sha256()
    for case in range(CASES):
        one, _ = batches(mode, dtype, False, case)
        for numbers, info in played(one, mode, case):
            digest.update(np.asarray(numbers).tobytes())
            for name in sorted(info):
                if not name.startswith(("_", "final")):
                    digest.update(info[name][info[f"_{name}"]].tobytes())
    assert digest.hexdigest()[:16] == HASHES[mode.value, dtype]
