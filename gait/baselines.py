"""Reinforcement learning for comparison: stable-baselines3 on ``AquaFish-v0`` (extra ``rl``).

What was learned is kept as our own JSON and plain arrays. The library's own files hold
pickles, which run whatever they contain when they are loaded; none is written or read here.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.morphology import Morphology
from aquafish_gym.runs.arrays import read_arrays, write_arrays
from aquafish_gym.runs.storage import ensure_writable_directory, read_document, write_document
from aquafish_gym.utils.validation import InvalidArgumentError, brief, flag, integer, one_of
from gait.controller import check_fields
from gait.policy import Policy

SPEC_FILE = "baseline.json"
PARAMETERS_FILE = "parameters.npz"
SCHEMA = "gait.baseline/2"  # 1 had no checksum
MOST_LAYERS, MOST_NODES = 8, 1024  # what a file may ask this machine's memory for
ALGORITHMS = ("PPO", "SAC", "TD3")


class MissingExtraError(ImportError):
    """stable-baselines3 or torch is not installed; the message says how to get them."""


@dataclass(frozen=True, kw_only=True)
class BaselineConfig:
    """What to learn with."""

    algorithm: str = "PPO"
    """What learns: PPO, SAC or TD3."""
    steps: int = 200_000
    """Steps of the environment, of 0.05 s each, of all robots together."""
    environments: int = 8
    """How many robots learn side by side."""
    hidden: tuple[int, ...] = (64, 64)
    """Widths of the hidden layers."""
    seed: int = 0
    """The library's random numbers follow from it."""
    random_poses: bool = False
    """Whether episodes begin from random fin poses instead of the zero pose."""

    def __post_init__(self) -> None:
        one_of("algorithm", self.algorithm, ALGORITHMS)
        integer("steps", self.steps, 1, 10**10)
        integer("environments", self.environments, 1, 1024)
        integer("seed", self.seed, 0, 2**32 - 1)
        if not isinstance(self.hidden, list | tuple) or len(self.hidden) > MOST_LAYERS:
            raise InvalidArgumentError(
                f"hidden must be at most {MOST_LAYERS} widths in a row; got {brief(self.hidden)}"
            )
        widths = tuple(integer("hidden", width, 1, MOST_NODES) for width in self.hidden)
        object.__setattr__(self, "hidden", widths)
        flag("random_poses", self.random_poses)


class Baseline:
    """A policy that was, or is to be, trained on a body; MissingExtraError without the extra."""

    def __init__(self, morphology: Morphology, config: BaselineConfig) -> None:
        self.morphology = morphology
        self.config = config
        sb3, vec_env = _load("stable_baselines3"), _load("stable_baselines3.common.vec_env")
        poses = "random" if config.random_poses else "zero"
        lanes = _load("gait.sb3_env").LaneVecEnv(config.environments, morphology, poses)
        # The library's rollouts of 2048 steps are meant for one robot, not for each of many.
        rollout = {"n_steps": max(64, 4096 // config.environments)}
        self._model = getattr(sb3, config.algorithm)(
            "MlpPolicy",
            vec_env.VecMonitor(lanes),
            policy_kwargs={"net_arch": list(config.hidden)},
            seed=config.seed,
            device="cpu",
            **(rollout if config.algorithm == "PPO" else {}),
        )

    def train(self, on_step: Callable[[int], None] | None = None) -> None:
        """Learn for ``config.steps``; ``on_step`` is told how many have been taken."""

        def callback(seen: dict[str, Any], _globals: dict[str, Any]) -> bool:
            if on_step is not None:
                on_step(int(seen["self"].num_timesteps))
            return True

        # Networks this small lose more to a second thread than they gain.
        torch = _load("torch")
        threads = torch.get_num_threads()
        torch.set_num_threads(1)
        try:
            self._model.learn(total_timesteps=self.config.steps, callback=callback)
        finally:
            torch.set_num_threads(threads)

    def policy(self) -> Policy:
        """Return the learned policy, which always does what it likes best."""

        def act(observation: NDArray[np.float64], _time: float) -> NDArray[np.float32]:
            action, _ = self._model.predict(observation.astype(np.float32), deterministic=True)
            return np.asarray(action, np.float32)

        return act

    def parameters(self) -> dict[str, NDArray[np.float32]]:
        """Return the policy's tensors by name."""
        state = self._model.policy.state_dict()
        return {name: tensor.detach().cpu().numpy() for name, tensor in state.items()}

    def save(self, out: Path | str) -> None:
        """Write ``baseline.json`` and ``parameters.npz`` to a directory."""
        directory = ensure_writable_directory(out)
        write_arrays(directory / PARAMETERS_FILE, self.parameters())
        spec = {"morphology": self.morphology.to_dict(), "config": asdict(self.config)}
        write_document(directory / SPEC_FILE, spec, SCHEMA)

    @classmethod
    def load(cls, out: Path | str) -> Baseline:
        """Read what :meth:`save` wrote; InvalidArgumentError if a file is not that."""
        directory = Path(out)
        spec = read_document(directory / SPEC_FILE, SCHEMA, "baseline")
        spec = check_fields("baseline", spec, ("morphology", "config"))
        names = [f.name for f in fields(BaselineConfig)]
        config = BaselineConfig(**check_fields("baseline: config", spec["config"], names))
        baseline = cls(Morphology.from_json(json.dumps(spec["morphology"])), config)
        untrained = baseline.parameters()
        shapes = {name: array.shape for name, array in untrained.items()}
        most = 2**20 + 2 * sum(array.nbytes for array in untrained.values())
        arrays = read_arrays(directory / PARAMETERS_FILE, shapes, "baseline", most)
        torch = _load("torch")
        state = {name: torch.as_tensor(array) for name, array in arrays.items()}
        baseline._model.policy.load_state_dict(state)
        return baseline


def _load(module: str) -> Any:
    try:
        return import_module(module)
    except ImportError as error:
        raise MissingExtraError(
            f"baselines need stable-baselines3 and torch, which are not installed here ({error}): "
            'pip install -e ".[rl]" in a clone of the repository'
        ) from None
