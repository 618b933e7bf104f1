"""Reinforcement learning for comparison: stable-baselines3 on ``AquaFish-v0`` (extra ``rl``).

What was learned is kept as our own JSON and plain arrays. The library's own files hold
pickles, which run whatever they contain when they are loaded; none is written or read here.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields
from importlib import import_module
from io import BytesIO
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from aquafish_gym.morphology import Morphology
from aquafish_gym.runs.storage import ensure_writable_directory, write_bytes, write_json
from aquafish_gym.utils.validation import InvalidArgumentError, finite_array, flag, integer, one_of
from gait.controller import read_json

SPEC_FILE = "baseline.json"
PARAMETERS_FILE = "parameters.npz"
SCHEMA = 1
KIND = "aquafish-baseline"
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
        integer("steps", self.steps, 1)
        integer("environments", self.environments, 1, 1024)
        integer("seed", self.seed, 0, 2**32 - 1)
        if not isinstance(self.hidden, list | tuple):
            raise InvalidArgumentError(f"hidden must be a row of widths; got {self.hidden!r}")
        widths = tuple(integer("hidden", width, 1, 4096) for width in self.hidden)
        object.__setattr__(self, "hidden", widths)
        flag("random_poses", self.random_poses)


class Baseline:
    """A learned policy for a body.

    Parameters
    ----------
    morphology
        The body it was, or is to be, trained on.
    config
        What to learn with.

    Raises
    ------
    MissingExtraError
        If stable-baselines3 or torch is not installed.
    """

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

    def evaluate(
        self, morphology: Morphology, fin_angles: NDArray[np.float64], engine: str = "numba"
    ) -> NDArray[np.float64]:
        """Return the distance (Q,) of an episode from each of the fin poses (Q, 3), in units.

        Raises
        ------
        InvalidArgumentError
            If the poses are not (Q, 3).
        """
        poses = finite_array("fin_angles", fin_angles, (None, 3), unit="rad")
        distances = np.zeros(len(poses))
        env = gym.make("AquaFish-v0", morphology=morphology.to_dict(), engine=engine)
        try:
            for i, pose in enumerate(poses.tolist()):
                observation, info = env.reset(options={"fin_angles": pose})
                over = False
                while not over:
                    action, _ = self._model.predict(observation, deterministic=True)
                    observation, _, terminated, truncated, info = env.step(action)
                    over = terminated or truncated
                distances[i] = info["y_position"]
        finally:
            env.close()
        return distances

    def parameters(self) -> dict[str, NDArray[np.float32]]:
        """Return the policy's tensors by name."""
        state = self._model.policy.state_dict()
        return {name: tensor.detach().cpu().numpy() for name, tensor in state.items()}

    def save(self, out: Path | str) -> None:
        """Write ``baseline.json`` and ``parameters.npz`` to a directory.

        Raises
        ------
        InvalidArgumentError
            If it cannot be written.
        """
        directory = ensure_writable_directory(out)
        buffer = BytesIO()
        np.savez(buffer, **self.parameters())  # type: ignore[arg-type]
        write_bytes(directory / PARAMETERS_FILE, buffer.getvalue())
        spec = {
            "kind": KIND,
            "schema": SCHEMA,
            "morphology": self.morphology.to_dict(),
            "config": asdict(self.config),
        }
        write_json(directory / SPEC_FILE, spec)

    @classmethod
    def load(cls, out: Path | str) -> Baseline:
        """Read what :meth:`save` wrote.

        Raises
        ------
        InvalidArgumentError
            If a file cannot be read, or does not fit.
        MissingExtraError
            If stable-baselines3 or torch is not installed.
        """
        directory = Path(out)
        spec = read_json(directory / SPEC_FILE, "baseline")
        if not isinstance(spec, dict) or (spec.get("kind"), spec.get("schema")) != (KIND, SCHEMA):
            raise InvalidArgumentError(
                f"baseline: {directory / SPEC_FILE} is not a baseline of schema {SCHEMA}"
            )
        settings = spec.get("config")
        names = {f.name for f in fields(BaselineConfig)}
        if not isinstance(settings, dict) or settings.keys() != names:
            raise InvalidArgumentError(
                f"baseline: config must have the fields {', '.join(sorted(names))}"
            )
        if not isinstance(spec.get("morphology"), dict):
            raise InvalidArgumentError(
                f"baseline: {directory / SPEC_FILE} does not say what body it was trained on"
            )
        body = Morphology.from_json(json.dumps(spec["morphology"]))
        baseline = cls(body, BaselineConfig(**settings))
        baseline._set_parameters(_read_arrays(directory / PARAMETERS_FILE))
        return baseline

    def _set_parameters(self, arrays: dict[str, NDArray[np.float32]]) -> None:
        torch = _load("torch")
        wanted = {name: array.shape for name, array in self.parameters().items()}
        if {name: array.shape for name, array in arrays.items()} != wanted:
            raise InvalidArgumentError(
                f"baseline: {PARAMETERS_FILE} does not fit the networks of {SPEC_FILE}"
            )
        self._model.policy.load_state_dict({n: torch.as_tensor(a) for n, a in arrays.items()})


def _read_arrays(path: Path) -> dict[str, NDArray[np.float32]]:
    try:
        with np.load(path, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except OSError as error:
        raise InvalidArgumentError(
            f"baseline: cannot read {path}: {error.strerror or error}"
        ) from None
    except (ValueError, AttributeError, zipfile.BadZipFile):
        raise InvalidArgumentError(f"baseline: {path} is not an archive of arrays") from None


def _load(module: str) -> Any:
    try:
        return import_module(module)
    except ImportError as error:
        raise MissingExtraError(
            f"baselines need stable-baselines3 and torch, which are not installed here ({error}): "
            'pip install -e ".[rl]" in a clone of the repository'
        ) from None
