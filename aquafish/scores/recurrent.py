"""A policy with a memory: RecurrentPPO of sb3-contrib (extra ``rl``), whose LSTM is ours to run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.bodies import body_array
from aquafish_gym.engines.base import TIMESTEP
from gait.baselines import BaselineConfig
from gait.config import TaskName
from gait.inputs import inputs, reckoned
from gait.learner import GAMMA, apart, array, load
from gait.network import Senses

Floats = NDArray[np.float64]
DIGITS = 7  # of a weight, which is a float32


@dataclass(frozen=True, kw_only=True)
class RecurrentConfig:
    """How it learns. Senses, clock, interval and environments are ``gait baseline``'s."""

    steps: int = 600_000
    """Actions of all robots together, rounded up to whole horizons."""
    memory: int = 32
    """Cells of the LSTM."""
    hidden: int = 32
    """Nodes between it and the action."""
    horizon: int = 50
    """Actions of each robot from which something is learned at a time."""
    batches: int = 5
    """Into which those of all robots are cut."""
    epochs: int = 6
    learning_rate: float = 1e-3


@dataclass(frozen=True)
class Recurrent:
    """What was learned, as plain arrays.

    Attributes
    ----------
    senses, clock, dt
        What it feels, the frequency of its clock in Hz, and for how many s an action is held.
    weights
        ``mean`` and ``scale`` (I,) of the inputs; of the LSTM ``w_in`` (4M, I), ``w_back`` (4M, M)
        and ``bias`` (4M,), its gates in torch's order i, f, g, o; ``w1``, ``b1``, ``w2``, ``b2`` of
        the layers after it.
    """

    senses: Senses
    clock: float
    dt: float
    weights: dict[str, Floats]

    def player(self, fins: Floats) -> Remembering:
        """Return what acts for B robots whose fins stand at angles (B, 3), rad."""
        return Remembering(self, fins)

    def to_dict(self) -> dict[str, Any]:
        """Return all of it, ready for JSON."""
        rows = {
            name: [float(f"{x:.{DIGITS}g}") for x in value.ravel()]
            for name, value in self.weights.items()
        }
        shapes = {name: list(value.shape) for name, value in self.weights.items()}
        return {
            "inputs": list(self.senses.names), "clock": self.clock, "dt": self.dt,
            "shapes": shapes, "weights": rows,
        }  # fmt: skip


class Remembering:
    """Acts for B robots through an episode, and remembers it."""

    def __init__(self, controller: Recurrent, fins: Floats) -> None:
        self._of, self._fins = controller, np.array(fins)
        cells = controller.weights["w_back"].shape[1]
        self._hidden, self._cell = (np.zeros((len(fins), cells)) for _ in range(2))

    def act(self, observations: NDArray[np.float32], times: Floats) -> NDArray[np.float32]:
        """Return actions (B, 3) for observations (B, k) at so many s (B,) of the episode."""
        of, w = self._of, self._of.weights
        heard = inputs(of.senses, of.clock, observations, times, self._fins)
        gates = (heard - w["mean"]) / w["scale"] @ w["w_in"].T
        gates += self._hidden @ w["w_back"].T + w["bias"]
        enter, keep, new, show = np.split(gates, 4, axis=1)
        self._cell = _sigmoid(keep) * self._cell + _sigmoid(enter) * np.tanh(new)
        self._hidden = _sigmoid(show) * np.tanh(self._cell)
        between = np.tanh(self._hidden @ w["w1"].T + w["b1"])
        actions = np.clip(between @ w["w2"].T + w["b2"], -1.0, 1.0).astype(np.float32)
        self._fins = reckoned(self._fins, actions, of.dt)
        return actions


def _sigmoid(x: Floats) -> Floats:
    return np.asarray(0.5 + 0.5 * np.tanh(0.5 * x))


def learn_recurrent(
    config: RecurrentConfig,
    task: TaskName,
    seed: int,
    damage: str,
    tell: Callable[[str, float], None],
) -> tuple[Recurrent, list[tuple[int, float]]]:
    """Learn a policy for a task, while ``damage`` strikes.

    Returns
    -------
    tuple
        The policy, and after how many actions the robots had earned how much in their last whole
        episodes on average: a row each time that something was learned.

    Raises
    ------
    MissingExtraError
        If sb3-contrib is not installed.
    """
    like = BaselineConfig(task=task, seed=seed)
    contrib, torch = load("sb3_contrib"), load("torch")
    normalize = load("stable_baselines3.common.vec_env").VecNormalize
    robots = load("gait.sb3_env").LaneVecEnv(
        like.environments, body_array(None), like.felt, like.clock, like.interval, task, damage
    )
    normal = normalize(robots, gamma=GAMMA, clip_obs=inf, epsilon=1e-4)
    size = like.environments * config.horizon
    steps = -(-config.steps // size) * size
    curve: list[tuple[int, float]] = []

    def callback(names: dict[str, Any], _globals: dict[str, Any]) -> bool:
        earned, done = float(robots.earned.mean()), int(names["self"].num_timesteps)
        if np.isfinite(earned) and done % size == 0:
            curve.append((done, earned))
        tell(f"earned {earned:.1f}" if np.isfinite(earned) else "learning", done / steps)
        return True

    with apart():
        model = contrib.RecurrentPPO(
            "MlpLstmPolicy",
            normal,
            gamma=GAMMA,
            n_steps=config.horizon,
            batch_size=size // config.batches,
            n_epochs=config.epochs,
            learning_rate=config.learning_rate,
            policy_kwargs={
                "lstm_hidden_size": config.memory,
                "net_arch": [config.hidden],
                "activation_fn": torch.nn.Tanh,
            },
            seed=seed,
            device="cpu",
        )
        model.learn(steps, callback)
    lstm, policy = model.policy.lstm_actor, model.policy
    found = {
        "w_in": lstm.weight_ih_l0, "w_back": lstm.weight_hh_l0,
        "bias": lstm.bias_ih_l0 + lstm.bias_hh_l0,
        "w1": policy.mlp_extractor.policy_net[0].weight,
        "b1": policy.mlp_extractor.policy_net[0].bias,
        "w2": policy.action_net.weight, "b2": policy.action_net.bias,
    }  # fmt: skip
    weights = {name: array(value).astype(float) for name, value in found.items()}
    weights["mean"] = normal.obs_rms.mean
    weights["scale"] = np.sqrt(normal.obs_rms.var + normal.epsilon)
    return Recurrent(like.felt, like.clock, TIMESTEP * like.interval, weights), curve
