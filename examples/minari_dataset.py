"""A Minari dataset of damaged swimming, for offline learning.

    python examples/minari_dataset.py out/gait/controller.json --episodes 100

A controller, as ``aquafish evolve`` and ``aquafish baseline`` write it, swims episodes in which
something breaks; its observations, actions and rewards, and the truth in ``info``, become a
dataset. It needs ``pip install "minari[hdf5,create]"``.
"""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import gymnasium as gym
import numpy as np
import tyro
from numpy.typing import NDArray

from aquafish_gym import IDS
from aquafish_gym.runs.command_line import BAD_INPUT, run_command_line
from aquafish_gym.runs.progress import track
from aquafish_gym.utils.validation import InvalidArgumentError, finite_array, integer, one_of
from gait.controllers.agents import ControllerAgent
from gait.controllers.controller import Controller
from gait.swims.episode import transitions


@dataclass(frozen=True)
class MinariDataset:
    """Have a controller swim damaged robots, and write a Minari dataset of it.

    Attributes
    ----------
    controller
        A controller.json, as evolve and baseline write it.
    """

    example: ClassVar[str] = "out/evolve/controller.json --episodes 5 --out out/minari"

    controller: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FILE")]
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("out/minari")
    """Folder of datasets."""
    name: str = "aquafish/damaged-v0"
    """What the dataset is called in it."""
    env: str = "AquaFish-v0"
    """Id of the environment."""
    damage: str = "random:moderate@2-10"
    """What breaks; see the page of damage."""
    noise: float = 0.1
    """Standard deviation of what is added to its actions, so that others are seen, too."""
    episodes: int = 20
    """Number of episodes."""
    seed: int = 0
    """Seed of everything random."""

    def execute(self) -> None:
        """Swim and write."""
        one_of("env", self.env, IDS)
        integer("episodes", self.episodes, 1, 10**6)
        integer("seed", self.seed, 0, 2**31)
        finite_array("noise", self.noise, (), 0.0, 2.0)
        os.environ["MINARI_DATASETS_PATH"] = str(self.out.resolve())
        try:
            from minari import DataCollector
        except ImportError:
            raise InvalidArgumentError(
                'Minari is not installed: pip install "minari[hdf5,create]"'
            ) from None
        if (self.out / self.name).exists():
            raise InvalidArgumentError(f"name must be a new one in {self.out}; got {self.name}")
        controller = Controller.load(self.controller)
        made = gym.make(
            self.env, engine="numba", damage=self.damage, frame_skip=controller.interval
        )
        collector = DataCollector(made, record_infos=True)
        agent = ControllerAgent(controller)
        rng = np.random.default_rng(self.seed)

        def act(seen: NDArray[np.float32]) -> NDArray[np.float64]:
            wanted = agent.act(seen) + rng.normal(0.0, self.noise, 3)
            return np.clip(wanted, -1.0, 1.0)

        returns = []
        for episode in track(range(self.episodes), "swimming", self.episodes):
            seen, info = collector.reset(seed=self.seed + episode)
            agent.reset(info)
            steps = transitions(collector, act, seen)
            returns.append(sum(float(step.reward) for step in steps))
        dataset = collector.create_dataset(
            dataset_id=self.name,
            algorithm_name=f"{self.controller.name}, noise {self.noise:g}",
            description=f"Swimming with damage {self.damage}; seeds from {self.seed}.",
            requirements=["aquafish-gym"],
        )
        collector.close()
        print(
            f"{dataset.total_episodes} episodes, {dataset.total_steps} steps, mean return "
            f"{np.mean(returns):.1f}: {self.name} in {self.out}"
        )


if __name__ == "__main__":
    sys.exit(run_command_line("minari_dataset", MinariDataset, None, BAD_INPUT))
