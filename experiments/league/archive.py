"""Make the archive of Intelligent Trial and Error: gaits of the whole robot, by MAP-Elites.

    python -m experiments.league.archive --out experiments/league/data/archive.json

A. Cully, J. Clune, D. Tarapore, J.-B. Mouret, Robots that can adapt like animals, Nature 521, 2015.
The descriptor of a gait is how much it uses each servo: the mean of the servo's speed as a share of
its greatest one, as their duty factors are the shares of time in which legs are used. A gait
is ``PPO, fins`` with other biases and weights from the inputs to the outputs. Gaits vary along a
line between two elites (V. Vassiliades, J.-B. Mouret, Discovering the elite hypervolume, GECCO
2018). Three minutes on one core.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from tyro.conf import arg

import aquafish_gym  # noqa: F401  registers the environments
from aquafish.online.gaits import load_library, read_library
from aquafish_gym.command import scale_action
from aquafish_gym.plans import AQUAFISH
from aquafish_gym.runs.command_line import run_command_line
from aquafish_gym.runs.progress import show_progress, track
from aquafish_gym.utils.storage import write_document
from experiments.league.policy import DT, SENSES, Offline, begin_inputs, drive
from gait.controllers.agents import Agent, ControllerAgent
from gait.controllers.controller import Controller
from gait.controllers.network import OUTPUT_GAIN
from gait.swims.episode import transitions

Floats = NDArray[np.float64]

SCHEMA = "aquafish.archive/1"
CELLS = 10  # along each axis
SECONDS = 20.0
BATCH = 512  # controllers
REPEATS = 2  # random poses from which each controller swims
RANDOM = 4  # batches of random controllers
SPREAD = 0.1  # standard deviation of random gaits
ISO = 0.02  # standard deviation of the variation in every direction
LINE = 0.2  # standard deviation of the variation along the line between two elites
POSES = 16  # from which an elite's pace is measured in the end
SIZE = 3 * (1 + len(SENSES.names()))  # numbers of a gait


class Varied:
    """The gait ``PPO, fins`` with additions (B, D) to the biases and weights of its outputs.

    It is an agent of B robots. The additions are few, so this is faster than B controllers.
    """

    def __init__(self, vectors: Floats) -> None:
        self._gait = load_library()[0]
        self._bias = vectors[:, :3]
        self._weights = vectors[:, 3:].reshape(len(vectors), 3, -1)

    def reset(self, info: dict[str, Any]) -> None:
        """Begin an episode of each robot."""
        self._inputs = begin_inputs(info["fin_angles"])

    def act(self, observations: NDArray[np.float32]) -> Floats:
        """Return actions (B, 3)."""
        seen = self._inputs.observe(observations.astype(float))
        more = self._bias + np.einsum("bi,boi->bo", seen, self._weights)
        actions = np.clip(drive(self._gait, seen) + OUTPUT_GAIN * more, -1.0, 1.0)
        self._inputs.follow(actions)
        return np.asarray(actions)


def varied(gait: Controller, vector: Floats) -> Controller:
    """Return the gait of :class:`Varied`, which is ``PPO, fins``, with additions (D,)."""
    weights = gait.weights.copy()
    bias = gait.bias.copy()
    outputs = len(vector) // 3 - 1
    bias[-3:] += vector[:3]
    weights[-3:, :outputs] += vector[3:].reshape(3, -1)
    return replace(gait, weights=weights, bias=bias)


def swim(agent: Agent, envs: Any, seed: int) -> tuple[Floats, Floats]:
    """Return the paces (B,), units/s, and descriptors (B, 3) of a swim from random poses."""
    observations, info = envs.reset(seed=seed)
    agent.reset(info)
    usage = np.zeros((envs.num_envs, 3))
    lost = np.zeros(envs.num_envs, bool)
    steps = round(SECONDS / DT)
    for step in transitions(envs, agent.act, observations):
        usage += np.abs(scale_action(AQUAFISH, step.action)) / AQUAFISH.command_high / steps
        lost |= step.terminated
    return np.where(lost, -np.inf, step.info["y_position"] / SECONDS), usage


class Archive(NamedTuple):
    """Elites of the cells that have one: paces (N,), descriptors (N, 3) and vectors (N, D)."""

    paces: Floats
    descriptors: Floats
    vectors: Floats

    def add(self, paces: Floats, descriptors: Floats, vectors: Floats) -> Archive:
        """Return the archive with the best of each cell."""
        joined = [
            np.concatenate(pair) for pair in zip(self, (paces, descriptors, vectors), strict=True)
        ]
        cells = np.minimum((joined[1] * CELLS).astype(int), CELLS - 1) @ (CELLS**2, CELLS, 1)
        order = np.lexsort((-joined[0], cells))
        best = order[np.unique(cells[order], return_index=True)[1]]
        return Archive(*(table[best] for table in joined))


def map_elites(batches: int, seed: int) -> Iterator[Archive]:
    """Yield the archive after each batch."""
    rng = np.random.default_rng(seed)
    envs = make_robots(BATCH * REPEATS)
    archive = Archive(np.empty(0), np.empty((0, 3)), np.empty((0, SIZE)))
    for k in range(batches):
        if k < RANDOM:
            vectors = SPREAD * rng.standard_normal((BATCH, SIZE))
        else:
            one, other = archive.vectors[rng.integers(len(archive.paces), size=(2, BATCH))]
            line = LINE * rng.standard_normal((BATCH, 1)) * (other - one)
            vectors = one + ISO * rng.standard_normal(one.shape) + line
        archive = archive.add(*measured(vectors, REPEATS, envs, int(rng.integers(2**31))), vectors)
        yield archive


def measured(vectors: Floats, repeats: int, envs: Any, seed: int) -> tuple[Floats, Floats]:
    """Return the mean paces (N,) and descriptors (N, 3) of N controllers from random poses."""
    paces, usage = swim(Varied(np.repeat(vectors, repeats, axis=0)), envs, seed)
    return paces.reshape(-1, repeats).mean(axis=1), usage.reshape(-1, repeats, 3).mean(axis=1)


def make_robots(count: int) -> Any:
    """Return whole robots that start from random poses."""
    return gym.make_vec("AquaFish-v0", num_envs=count, fin_angles="random", threads=1)


@dataclass(frozen=True)
class MakeArchive:
    """Make the archive of Intelligent Trial and Error."""

    example: ClassVar[str] = "--batches 24 --out out/archive.json"

    out: Annotated[Path, arg(metavar="FILE")] = Path("out/archive.json")
    """The archive."""
    batches: int = 240
    """Of swims, each of which adds to the archive."""
    seed: int = 0
    """Seed of everything random."""

    def execute(self) -> None:
        """Write the archive."""
        began = time.process_time()
        for found in track(map_elites(self.batches, self.seed), "batches", self.batches):
            archive = found
        # The pace in the search is the best of many, so the luckiest: measure it again.
        count = len(archive.paces)
        robots = make_robots(POSES * count)
        with show_progress("measuring the elites", 1):
            paces, descriptors = measured(archive.vectors, POSES, robots, self.seed)
            first = swim(ControllerAgent(load_library()[0]), make_robots(POSES), self.seed)
        steps = (self.batches * BATCH * REPEATS + POSES * (count + 1)) * round(SECONDS / 0.01)
        library = read_library()["offline"]
        offline = Offline(
            steps + library["steps"][0],
            round(time.process_time() - began + library["seconds"][0], 1),
        )
        keep = np.flatnonzero(np.isfinite(paces))
        document = {
            "offline": offline._asdict(),
            "first": {"pace": first[0].mean(), "descriptor": first[1].mean(axis=0).tolist()},
            "paces": [round(one, 4) for one in paces[keep].tolist()],
            "descriptors": np.round(descriptors[keep], 3).tolist(),
            "vectors": np.round(archive.vectors[keep], 4).tolist(),
        }
        write_document(self.out, document, SCHEMA, indent=None)
        print(f"{len(keep)} gaits, the best {paces[keep].max():.3f} units/s; {offline}: {self.out}")


if __name__ == "__main__":
    sys.exit(run_command_line("experiments.league.archive", MakeArchive))
