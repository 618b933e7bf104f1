"""Faults with a life of their own, in each of 1,024 environments that step tensors.

    python examples/answers/faults.py --out out/answers/faults.png

Arms of two joints draw a circle. In each arm something else breaks at a time of its own: an
actuator wears, a joint seizes, a command drops out, a sensor drifts or freezes. The policy observes
angles, rates and the target; what is broken is in ``info``, for who evaluates it. The arms have the
interface of an Isaac Lab environment, so :class:`PolicyGroup` fits these, too.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar

import gymnasium as gym
import numpy as np
import torch
import tyro
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from aquafish_gym import VectorFaultWrapper
from aquafish_gym.runs.command_line import run_command_line
from aquafish_gym.utils.storage import ensure_writable_directory
from aquafish_gym.utils.validation import integer, one_of

DT, EPISODE_STEPS = 0.02, 400  # s; 8 s an episode
LINK, MASS, TORQUE = 0.5, 1.0, 4.0  # m; kg at the end of each link; N m at an action of 1
CENTRE, RADIUS, PERIOD = (0.55, 0.0), 0.25, 4.0  # of the circle: m, m, s
STIFFNESS, DAMPING = 100.0, 20.0  # of the policy: 1/s^2, 1/s
KINDS = {
    "nothing breaks": "none",
    "an actuator wears": "action_{joint}:weak=0.1@{onset:.2f}~2",
    "a joint seizes": "action_{joint}:seized@{onset:.2f}",
    "commands drop out": "action_{joint}:dead@{onset:.2f}+0.5",
    "a sensor drifts": "observation_{joint}:bias=0.3@{onset:.2f}+2~2",
    "a sensor freezes": "observation_{joint}:stuck@{onset:.2f}+0.5",
}


class PolicyGroup(VectorEnv[Any, Any, Any]):
    """An environment of Isaac Lab, with the observations of its group "policy" alone."""

    def __init__(self, env: Any) -> None:
        self.metadata = {"autoreset_mode": AutoresetMode.SAME_STEP}
        base = env.unwrapped
        self.env, self.num_envs, self.dt = env, base.num_envs, base.step_dt
        self.single_action_space = base.single_action_space
        self.single_observation_space = base.single_observation_space["policy"]
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)

    def reset(self, *, seed: Any = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        """Begin all episodes."""
        seen, info = self.env.reset(seed=seed, options=options)
        return seen["policy"], info

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Take a step; environments whose episode is over begin the next one in it."""
        seen, *rest, info = self.env.step(actions)
        rewards, terminated, truncated = rest
        return seen["policy"], rewards, terminated, truncated, info


class Arms(gym.Env[Any, Any]):
    """B arms in a plane, with the interface of Isaac Lab's environments."""

    step_dt = DT

    def __init__(self, count: int, device: str = "cpu") -> None:
        self.num_envs, self.device = count, device
        self.single_action_space = Box(-1.0, 1.0, (2,))
        self.single_observation_space = gym.spaces.Dict({"policy": Box(-np.inf, np.inf, (8,))})
        self.steps = torch.zeros(count, dtype=torch.int32, device=device)
        self.angles = torch.zeros(count, 2, device=device)
        self.rates = torch.zeros(count, 2, device=device)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Place all arms on the circle."""
        super().reset(seed=seed, options=options)
        self._start(torch.ones_like(self.steps, dtype=torch.bool))
        return {"policy": self._observe()}, {}

    def step(self, action: torch.Tensor) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Turn the joints by torques for a step, in two half steps of semi-implicit Euler."""
        for _ in range(2):
            one, two = self.rates.T
            sine, cosine = torch.sin(self.angles[:, 1]), torch.cos(self.angles[:, 1])
            coupled = sine[:, None] * torch.stack([two * (2.0 * one + two), -one * one], 1)
            torques = TORQUE / (MASS * LINK**2) * action - 0.5 * self.rates + coupled
            a, b, c = 3.0 + 2.0 * cosine, 1.0 + cosine, 1.0
            first, second = torques.T
            gains = torch.stack([c * first - b * second, a * second - b * first], 1)
            self.rates = self.rates + 0.5 * DT * gains / (a * c - b * b)[:, None]
            self.angles = self.angles + 0.5 * DT * self.rates
        self.steps = self.steps + 1
        away = self.hands() - self._targets()[0]
        reward = -torch.linalg.vector_norm(away, dim=1)
        over = self.steps >= EPISODE_STEPS
        self._start(over)
        return {"policy": self._observe()}, reward, torch.zeros_like(over), over, {}

    def hands(self) -> torch.Tensor:
        """Return where the hands (B, 2) are, m."""
        turned = torch.cumsum(self.angles, 1)
        return LINK * torch.stack([torch.cos(turned).sum(1), torch.sin(turned).sum(1)], 1)

    def _start(self, over: torch.Tensor) -> None:
        self.steps = self.steps * ~over
        _, angles, rates = self._targets()
        self.angles = torch.where(over[:, None], angles, self.angles)
        self.rates = torch.where(over[:, None], rates, self.rates)

    def _targets(self) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Return where hands, angles and rates should be: (B, 2) each."""
        places, angles = zip(*(self._target(self.steps + back) for back in (0, 1)), strict=True)
        return places[0], angles[0], (angles[1] - angles[0]) / DT

    @staticmethod
    def _target(steps: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        phase = 2.0 * np.pi * DT / PERIOD * steps
        x = CENTRE[0] + RADIUS * torch.cos(phase)
        y = CENTRE[1] + RADIUS * torch.sin(phase)
        elbow = torch.acos((x * x + y * y) / (2.0 * LINK**2) - 1.0)
        return torch.stack([x, y], 1), torch.stack([torch.atan2(y, x) - 0.5 * elbow, elbow], 1)

    def _observe(self) -> torch.Tensor:
        _, angles, rates = self._targets()
        return torch.cat([self.angles, self.rates, angles, rates], 1)


def policy(observations: torch.Tensor) -> torch.Tensor:
    """Return the actions (B, 2) of a controller that knows of no fault."""
    angles, rates, target_angles, target_rates = observations.split(2, 1)
    wanted = STIFFNESS * (target_angles - angles) + DAMPING * (target_rates - rates)
    cosine = torch.cos(angles[:, 1])
    one, two = wanted.T
    torques = torch.stack(
        [(3.0 + 2.0 * cosine) * one + (1.0 + cosine) * two, (1.0 + cosine) * one + two], 1
    )
    return torch.clip(MASS * LINK**2 / TORQUE * torques, -1.0, 1.0)


@dataclass(frozen=True)
class Faults:
    """Break each of many environments in its own way, and show what that does to a policy."""

    example: ClassVar[str] = "--environments 64"

    environments: int = 1024
    """Number of environments."""
    device: str = "cpu"
    """Where PyTorch steps them: cpu, or cuda for a GPU."""
    seed: int = 0
    """Seed of what breaks, and when."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """A picture to write, such as out/answers/faults.png."""

    def execute(self) -> None:
        """Play an episode, and print the distances from the circle."""
        integer("environments", self.environments, len(KINDS), 10**6)
        integer("seed", self.seed, 0, 2**31)
        one_of("device", self.device, ("cpu", "cuda"))
        if self.out is not None:
            ensure_writable_directory(self.out.parent, "out")
        rng = np.random.default_rng(self.seed)
        onsets = np.sort(rng.uniform(1.0, 5.0, self.environments))
        kinds = rng.permutation(np.arange(self.environments) % len(KINDS))
        texts = [
            list(KINDS.values())[kind].format(joint=rng.integers(2), onset=onset)
            for kind, onset in zip(kinds, onsets, strict=True)
        ]
        away, active = play(texts, self.seed, self.device)
        print(table(away, active, kinds))
        if self.out is not None:
            draw(away, active, kinds, self.out)


def play(
    damages: list[str], seed: int, device: str
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return the distance of each hand from its target, m, and whether a fault is active: (T, B).

    Only the evaluator looks into ``info``, and copies its record to the host when all is over.
    """
    envs = VectorFaultWrapper(PolicyGroup(Arms(len(damages), device)), damages)
    observations, info = envs.reset(seed=seed)
    away, active = [], []
    for _ in range(EPISODE_STEPS - 1):
        active.append(info["faults"] > 0)
        observations, rewards, *_, info = envs.step(policy(observations))
        away.append(-rewards)
    return torch.stack(away).cpu().numpy(), torch.stack(active).cpu().numpy()


def table(away: NDArray[np.float32], active: NDArray[np.bool_], kinds: NDArray[np.int64]) -> str:
    """Return the distances of each kind of fault as lines of text, cm."""
    after = np.maximum.accumulate(active, axis=0) & ~active
    lines = [f"{'':18} environments  before  broken  after   cm from the circle, median"]
    for i, kind in enumerate(KINDS):
        mine = kinds == i
        broken, healed = active[:, mine], after[:, mine]
        cells = [
            f"{100 * np.median(away[:, mine][when]):6.1f}" if when.any() else " " * 6
            for when in (~broken & ~healed, broken, healed)
        ]
        lines.append(f"{kind:18} {mine.sum():12d}  {'  '.join(cells)}".rstrip())
    return "\n".join(lines)


def draw(
    away: NDArray[np.float32],
    active: NDArray[np.bool_],
    kinds: NDArray[np.int64],
    path: Path,
) -> None:
    """Draw when each environment is broken and how far its hand is away."""
    from matplotlib.colors import LogNorm
    from matplotlib.figure import Figure

    figure = Figure((9.0, 4.2), layout="constrained")
    order = np.argsort(kinds, kind="stable")
    seconds = DT * len(away)
    left, right = figure.subplots(1, 2, sharey=True)
    extent = (0.0, seconds, len(order), 0.0)
    left.imshow(active[:, order].T, aspect="auto", extent=extent, cmap="Greys", vmax=1.3)
    left.set_title("info: a fault is active", fontsize=10)
    shown = right.imshow(
        100 * away[:, order].T, aspect="auto", extent=extent, cmap="viridis", norm=LogNorm(0.1, 100)
    )
    right.set_title("how far the hand is from its target", fontsize=10)
    figure.colorbar(shown, ax=right, label="cm")
    ends = np.cumsum(np.bincount(kinds, minlength=len(KINDS)))
    middles = ends - 0.5 * np.diff(ends, prepend=0)
    left.set_yticks(middles, list(KINDS))
    left.tick_params(axis="y", length=0)
    for axes in (left, right):
        axes.set_xlabel("time, s")
        for end in ends[:-1]:
            axes.axhline(end, color="C3", lw=0.8)
    figure.savefig(path, dpi=120, metadata={"Software": None})


if __name__ == "__main__":
    sys.exit(run_command_line("faults", Faults))
