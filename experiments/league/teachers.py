"""Train a teacher: PPO of a policy that is told what broke (extra ``rl``).

The first phase of A. Kumar, Z. Fu, D. Pathak, J. Malik, RMA: Rapid Motor Adaptation for Legged
Robots, RSS 2021. There an encoder compresses what the policy is told of its surroundings; here it
is told nine sizes and three gains as they are. The critic also observes the velocity.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from importlib import import_module
from typing import Any

import numpy as np

from experiments.league.robots import Conditions, Numbers, TrainingRobots
from gait.learning.train import isolated_rng

torch: Any = import_module("torch")
nn: Any = torch.nn
sb3: Any = import_module("stable_baselines3")
policies: Any = import_module("stable_baselines3.common.policies")

ROBOTS = 2048
HORIZON = 25  # actions of a robot between two updates
UPDATES = 64  # in a round
BATCH = 3200
TOLD = 35
WIDTHS = 128, 64
GAMMA = 0.97
RATE = 1e-3  # learning rate, which falls linearly to a fortieth
LEAST_RATE_SHARE = 0.025
FIRST_DEVIATION = 0.9  # of an action; with a small one no other way to swim is found
LEAST_DEVIATIONS = (0.2, 0.2, 0.35)  # with smaller ones learning stops early
TEST_ROBOTS = 512
TEST_SEED = 10_000
TEST_ONSET = 5.0  # s


class Extractor(nn.Module):  # type: ignore[misc]
    """The hidden layers of actor and critic; only the critic observes the velocity."""

    def __init__(self) -> None:
        super().__init__()
        self.latent_dim_pi = self.latent_dim_vf = WIDTHS[-1]
        self.policy_net = hidden(TOLD)
        self.value_net = hidden(TOLD + 3)

    def forward(self, features: Any) -> tuple[Any, Any]:
        """Return what the last layers of actor and critic observe."""
        return self.forward_actor(features), self.forward_critic(features)

    def forward_actor(self, features: Any) -> Any:
        """Return the last hidden values of the actor."""
        return self.policy_net(features[:, :TOLD])

    def forward_critic(self, features: Any) -> Any:
        """Return the last hidden values of the critic."""
        return self.value_net(features)


def hidden(count: int) -> Any:
    """Return two hidden layers with ``count`` inputs."""
    first, last = WIDTHS
    return nn.Sequential(nn.Linear(count, first), nn.ELU(), nn.Linear(first, last), nn.ELU())


class ActorCritic(policies.ActorCriticPolicy):  # type: ignore[misc]
    """The policy of PPO whose actor observes less than its critic."""

    def _build_mlp_extractor(self) -> None:
        self.mlp_extractor = Extractor()


@dataclass(frozen=True)
class Plan:
    """How a teacher is trained.

    For ``any_water`` each episode has another water.
    """

    any_water: bool = False
    seed: int = 0
    rounds: int = 16  #: Of :func:`round_actions`.

    @property
    def conditions(self) -> Conditions:
        """What the robots swim in."""
        return Conditions(any_water=self.any_water)


def round_actions() -> int:
    """Return how many actions all robots together take in a round."""
    return ROBOTS * HORIZON * UPDATES


def learn_round(
    plan: Plan, number: int, _teacher: None, learned: dict[str, Any] | None
) -> dict[str, Any]:
    """Return what is learned after a round, from that before; None is nothing yet."""
    torch.set_num_threads(1)
    seed = 1000 * (plan.seed + 1) + number
    robots = TrainingRobots(ROBOTS, plan.conditions, seed)

    def rate(left: float) -> float:
        done = (number + 1.0 - left) / plan.rounds
        return RATE * (1.0 - (1.0 - LEAST_RATE_SHARE) * done)

    def callback(names: dict[str, Any], _globals: dict[str, Any]) -> bool:
        with torch.no_grad():
            deviation = names["self"].policy.log_std
            deviation.copy_(torch.maximum(deviation, torch.tensor(LEAST_DEVIATIONS).log()))
        return True

    with isolated_rng():
        model = sb3.PPO(
            ActorCritic, robots, n_steps=HORIZON, batch_size=BATCH, n_epochs=2, gamma=GAMMA,
            ent_coef=0.003, max_grad_norm=1.0, target_kl=0.03, learning_rate=rate,
            policy_kwargs={"log_std_init": math.log(FIRST_DEVIATION)}, seed=seed, device="cpu",
        )  # fmt: skip
        if learned is not None:
            model.policy.load_state_dict(learned["policy"])
            model.policy.optimizer.load_state_dict(learned["optimizer"])
        model.learn(round_actions(), callback)
    policy = model.policy
    return {"policy": policy.state_dict(), "optimizer": policy.optimizer.state_dict()}


def weights(learned: dict[str, Any]) -> dict[str, Numbers]:
    """Return the arrays of ``Teacher``."""
    names = {
        "w0": "mlp_extractor.policy_net.0.weight", "b0": "mlp_extractor.policy_net.0.bias",
        "w1": "mlp_extractor.policy_net.2.weight", "b1": "mlp_extractor.policy_net.2.bias",
        "w2": "action_net.weight", "b2": "action_net.bias",
    }  # fmt: skip
    return {name: learned["policy"][key].detach().numpy().copy() for name, key in names.items()}


def actor(arrays: dict[str, Numbers]) -> Any:
    """Return a module that maps what a teacher is told (..., 35) to actions, not clipped."""
    net = nn.Sequential(*hidden(TOLD), nn.Linear(WIDTHS[-1], 3))
    layers = [layer for layer in net if isinstance(layer, nn.Linear)]
    with torch.no_grad():
        for i, layer in enumerate(layers):
            layer.weight.copy_(torch.from_numpy(arrays[f"w{i}"]))
            layer.bias.copy_(torch.from_numpy(arrays[f"b{i}"]))
    return net


def test(learned: dict[str, Any], _teacher: None, plan: Plan) -> float:
    """Return the mean pace, units/s, of robots that break after 5 s of an episode."""
    net = actor(weights(learned))
    conditions = replace(plan.conditions, onset=str(TEST_ONSET))
    robots = TrainingRobots(TEST_ROBOTS, conditions, TEST_SEED)

    def act(observed: Numbers) -> Numbers:
        return np.asarray(net(torch.from_numpy(observed[:, :TOLD])))

    with torch.no_grad():
        return robots.pace(act, TEST_ONSET)
