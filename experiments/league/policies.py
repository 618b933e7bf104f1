"""Train the learned rivals of the recovery league: PPO on damage, without and with memory.

    pip install ".[rl]" sb3-contrib
    python -m experiments.league.policies --out experiments/league/data/policies

Damage strikes at 15-30 s of a 60 s episode, as in the league, a third of the robots by each tier.
All begin as ``PPO, fins``, the gait of the whole robot, and learn what to add to its action: from
random weights PPO did not reach that gait's return in this time. They observe what it does, and
their previous action. ``plain`` has no memory, ``frames`` the last 8 observations and actions,
``lstm`` an LSTM (RecurrentPPO). Ten minutes on one core.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from tyro.conf import arg

from aquafish.online.gaits import read_library
from aquafish_gym.runs.command_line import Out, run_command_line
from aquafish_gym.utils.validation import one_of
from experiments.league.policy import INTERVAL, Offline, Policy
from gait.learning.train import GAMMA, isolated_rng, load_extra

ROBOTS = 256
HORIZON = 50  # actions of a robot between two updates
EPISODE = 300  # actions


@dataclass(frozen=True)
class Kind:
    """A policy's kind, and how PPO learns it."""

    actions: int  #: Of all robots together, rounded up to whole horizons.
    frames: int = 1
    cells: int = 0  #: Of an LSTM.
    hidden: tuple[int, ...] = (64, 64)
    batch: int = 1600
    epochs: int = 6
    rate: float = 5e-4  #: Learning rate; it falls linearly to a tenth.
    deviation: float = 0.1  #: Of the action at first.


KINDS = {
    "plain": Kind(1_400_000),
    "frames": Kind(2_200_000, frames=8),
    "lstm": Kind(1_400_000, cells=64, hidden=(64,), batch=2560),
}


def make_robots(seed: int) -> Any:
    """Return ROBOTS robots as a vector environment of stable-baselines3."""
    return load_extra("experiments.league.robots").ResidualVecEnv(ROBOTS, EPISODE, seed)


def train(kind: Kind, seed: int, tell: Callable[[int, float], None]) -> tuple[Policy, Any]:
    """Return a policy that PPO learned, and stable-baselines3's model of it."""
    torch = load_extra("torch")
    vec_env = load_extra("stable_baselines3.common.vec_env")
    began = time.process_time()
    robots = make_robots(seed)
    normal = vec_env.VecNormalize(robots, gamma=GAMMA, clip_obs=math.inf, epsilon=1e-4)
    seen = vec_env.VecFrameStack(normal, kind.frames) if kind.frames > 1 else normal
    size = ROBOTS * HORIZON
    actions = -(-kind.actions // size) * size
    curve = list[tuple[int, float]]()

    def callback(names: dict[str, Any], _globals: dict[str, Any]) -> bool:
        done = int(names["self"].num_timesteps)
        if done % size == 0 and np.isfinite(robots.earned).all():
            curve.append((done, round(float(robots.earned.mean()), 3)))
            tell(*curve[-1])
        return True

    net: dict[str, Any] = {
        "net_arch": list(kind.hidden),
        "activation_fn": torch.nn.Tanh,
        "log_std_init": math.log(kind.deviation),
    }
    if kind.cells:
        net |= {
            "lstm_hidden_size": kind.cells, "shared_lstm": True, "enable_critic_lstm": False
        }  # fmt: skip
        make = load_extra("sb3_contrib").RecurrentPPO
        name = "MlpLstmPolicy"
    else:
        make = load_extra("stable_baselines3").PPO
        name = "MlpPolicy"
    with isolated_rng():
        model = make(
            name, seen, gamma=GAMMA, n_steps=HORIZON, batch_size=kind.batch, n_epochs=kind.epochs,
            learning_rate=lambda left: kind.rate * (0.1 + 0.9 * left), policy_kwargs=net,
            seed=seed, device="cpu",
        )  # fmt: skip
        model.learn(actions, callback)
    first = read_library()["offline"]  # of the gait
    offline = Offline(
        (actions + EPISODE * ROBOTS) * INTERVAL + first["steps"][0],
        round(time.process_time() - began + first["seconds"][0], 1),
    )
    return Policy(numbers(model, normal), kind.frames, offline, tuple(curve)), model


def numbers(model: Any, normal: Any) -> dict[str, NDArray[np.float64]]:
    """Return a model's weights by the names of ``Policy``."""
    linear = load_extra("torch").nn.Linear
    parts = (model.policy.mlp_extractor.policy_net, model.policy.action_net)
    layers = [m for part in parts for m in part.modules() if isinstance(m, linear)]
    found = {f"w{i}": layer.weight for i, layer in enumerate(layers)}
    found |= {f"b{i}": layer.bias for i, layer in enumerate(layers)}
    if hasattr(model.policy, "lstm_actor"):
        lstm = model.policy.lstm_actor
        found |= {
            "w_in": lstm.weight_ih_l0, "w_back": lstm.weight_hh_l0,
            "b_in": lstm.bias_ih_l0 + lstm.bias_hh_l0,
        }  # fmt: skip
    moments = normal.obs_rms
    return {
        "mean": moments.mean,
        "scale": np.sqrt(moments.var + normal.epsilon),
        **{name: value.detach().numpy().astype(float) for name, value in found.items()},
    }


@dataclass(frozen=True)
class Policies:
    """Train the learned rivals of the recovery league; write NAME.json for each."""

    example: ClassVar[str] = "--kinds plain --out out/policies"

    out: Out = Path("out/policies")
    kinds: Annotated[tuple[str, ...], arg(metavar="KIND")] = tuple(KINDS)
    """Some of plain, frames and lstm."""
    seed: int = 0
    """Seed of everything random."""

    def execute(self) -> None:
        """Train one after another."""
        for name in self.kinds:
            kind = KINDS[one_of("kinds", name, KINDS)]

            def tell(done: int, earned: float, name: str = name) -> None:
                print(f"{name}: {done} actions, mean return {earned:.2f}", flush=True)

            policy, _ = train(kind, self.seed, tell)
            policy.save(self.out / f"{name}.json")
            print(f"{name}: {policy.offline.seconds} CPU s, {policy.offline.steps} robot steps")


if __name__ == "__main__":
    sys.exit(run_command_line("experiments.league.policies", Policies))
