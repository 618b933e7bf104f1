"""Damage of batches that step arrays of another library: that of NumPy's batches, on the device."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box
from gymnasium.vector import VectorEnv
from tensor_robots import Arms

from aquafish_gym import VectorFaultWrapper
from aquafish_gym.envs.autoreset import AutoresetMode
from aquafish_gym.utils.validation import InvalidArgumentError

torch = pytest.importorskip("torch")
MODES = list(AutoresetMode)
#: Of every word, and of what grows, ends and overlaps.
EVERYTHING = (
    "random:severe@1-3; observation:noise=1;"
    "action_0:weak=0.5@2+2; observation_0:stuck@1; observation_2:bias=1@3+1;"
    "action_1:seized=0.3@1+2; action_1:seized@2; observation_3:scale=0.5;"
    "action:reversed@1; action_0:scale=2@2; action_1:weak=0.2@0~3; observation_1:dropped@2;"
    "action_0:delay=2; observation_1-2:delay=1@2; observation_3:hold=2;"
    "action_1:hold=2@1; action_1:delay=1@1; observation:delay=3; observation_0:stuck@3"
)


def tensors(damage: Any, mode: AutoresetMode = AutoresetMode.SAME_STEP, **more: Any) -> Any:
    envs = Arms(torch.zeros(1), mode, **more)
    return VectorFaultWrapper(envs, damage, dt=1)


def played(envs: Any, seed: Any, steps: int = 20) -> tuple[bytes, list[dict[str, Any]]]:
    seen, info = envs.reset(seed=seed)
    found, infos = [seen.numpy().tobytes()], [info]
    for _ in range(steps):
        seen, *_, info = envs.step(torch.full((envs.num_envs, 2), 0.5))
        found.append(seen.numpy().tobytes())
        infos.append(info)
    return b"".join(found), infos


def test_the_same_seed_is_the_same_bytes() -> None:
    def bytes_of(seed: int | None) -> bytes:
        return played(tensors("random:moderate@1-4; observation_3:noise=0.1"), seed)[0]

    assert bytes_of(0) == bytes_of(0) != bytes_of(1)
    assert bytes_of(None) != bytes_of(None)


def test_each_episode_of_each_environment_has_random_faults_of_its_own() -> None:
    envs = tensors("random:severe@1-4", count=64)
    _, infos = played(envs, 0, steps=23)
    ends = [info for info in infos if "final_info" in info]
    broken = [
        tuple(
            np.concatenate([info["final_info"][name][robot].float() for name in (
                "action_gain", "action_seized", "observation_lost")]).tolist()
        )
        for info in ends for robot in np.flatnonzero(info["final_info"]["_faults"])
    ]  # fmt: skip
    assert len(broken) > 200
    assert all(info["final_info"]["faults"].max() == 2 for info in ends)
    assert len(set(broken)) > 20
    mean = np.mean([one[4:] for one in broken], axis=0)
    assert (mean > 0.02).all(), "every sensor is lost in some episode"


def test_noise_has_its_size_and_is_white() -> None:
    envs = tensors("observation_0:noise=0.2; observation_1:noise=0.1", count=500)
    whole = Arms(torch.zeros(1), AutoresetMode.SAME_STEP, count=500)
    away = []
    for env in (envs, whole):
        env.reset(seed=0)
        away.append([env.step(torch.zeros(500, 2))[0].numpy() for _ in range(4)])
    noise = np.subtract(*away)
    np.testing.assert_allclose(noise.std(axis=(0, 1)), [0.2, 0.1, 0, 0], rtol=0.05)
    assert abs(np.corrcoef(noise[0, :, 0], noise[1, :, 0])[0, 1]) < 0.15
    assert abs(np.corrcoef(noise[0, :, 0], noise[0, :, 1])[0, 1]) < 0.15


def test_damage_of_the_option_is_for_the_first_episodes_only() -> None:
    envs = tensors(["action:dead", "none", "random:mild"])
    _, info = envs.reset(seed=0, options={"damage": "observation:dropped"})
    assert info["observation_lost"].all()
    assert (info["action_gain"] == 1).all()
    for _ in range(6):
        *_, info = envs.step(torch.zeros(3, 2))
    assert not info["observation_lost"].any()
    assert info["action_gain"][:2].tolist() == [[0, 0], [1, 1]]
    assert info["faults"].tolist() == [1, 0, 1]


@pytest.mark.parametrize(
    "mode", [MODES[0], *(pytest.param(mode, marks=pytest.mark.slow) for mode in MODES[1:])]
)
def test_nothing_is_copied_from_the_device(
    mode: AutoresetMode, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No number of a tensor decides what Python does next, which would wait for the device."""
    from torch.utils._python_dispatch import TorchDispatchMode

    class Watch(TorchDispatchMode):
        def __torch_dispatch__(
            self, func: Any, types: Any, args: Any = (), kwargs: Any = None
        ) -> Any:
            seen.add(func.__name__)
            return func(*args, **(kwargs or {}))

    seen: set[str] = set()
    robots = Tensors(64, mode)
    envs = VectorFaultWrapper(robots, [EVERYTHING] * 64, dt=1)
    envs.reset(seed=0)
    ended = torch.arange(64) % 3 == 0
    for name in ("numpy", "__array__", "cpu", "tolist", "item"):
        monkeypatch.setattr(torch.Tensor, name, None)
    with Watch():
        for _ in range(4):
            envs.step(robots.actions)
            envs.reset(options={"reset_mask": ended})
    assert "where.self" in seen
    waiting = ("_local_scalar_dense", "nonzero", "masked_select", "equal", "_to_cpu", "item")
    assert not [name for name in seen if name.startswith(waiting)]


class Tensors(VectorEnv[Any, Any, Any]):
    """Steps tensors, and copies none from their device."""

    def __init__(self, count: int, mode: AutoresetMode) -> None:
        self.metadata = {"autoreset_mode": mode}
        self.num_envs = count
        self.single_action_space = Box(-1.0, 1.0, (2,))
        self.single_observation_space = Box(-2.0, 2.0, (4,))
        self.actions, self.observations = torch.rand(count, 2), torch.rand(count, 4)
        self.ended = torch.arange(count) % 5 == 0

    def reset(self, *, seed: Any = None, options: Any = None) -> Any:  # noqa: ARG002
        return self.observations, {}

    def step(self, actions: Any) -> Any:  # noqa: ARG002
        seen = self.observations
        return seen, seen[:, 0], self.ended, ~self.ended & self.ended, {"final_obs": seen}


def test_what_cannot_be_broken_is_refused() -> None:
    envs = tensors("action:dead")
    envs.reset(seed=0)
    with pytest.raises(InvalidArgumentError, match=r"actions must be an array of shape \(3, 2\)"):
        envs.step(torch.zeros(3, 1))
    with pytest.raises(InvalidArgumentError, match="without a"):
        envs.reset(options={"damage": "none", "reset_mask": torch.ones(3, dtype=torch.bool)})

    class Lists(Arms):
        def array(self, values: Any) -> Any:
            return values.tolist()

    with pytest.raises(InvalidArgumentError, match="env must observe arrays of NumPy, PyTorch"):
        VectorFaultWrapper(Lists(torch.zeros(1), AutoresetMode.DISABLED), None).reset(seed=0)
