"""What the gait tests share."""

from __future__ import annotations

import json
import random
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from unittest.mock import patch

import neat
import numpy as np
from numpy.typing import NDArray

from aquafish_gym.morphology import Morphology
from aquafish_gym.plans import BodyPlan
from gait.controllers.controller import Controller
from gait.controllers.network import Senses
from gait.search.evolve import Evolved, evolve_gait
from gait.search.history import Generation
from gait.search.neat import genome_to_controller, load_config

INPUT_COUNT = len(Senses().names())


def random_genome(seed: int, mutations: int, feed_forward: bool = True) -> tuple[Any, Any]:
    """Return neat-python's configuration and a genome after some mutations."""
    config = load_config(10)
    genome_config = config.genome_config
    genome_config.feed_forward = feed_forward
    # Quicker growth, and responses too, so that a few mutations reach every kind of network.
    genome_config.conn_add_prob = genome_config.node_add_prob = 0.5
    genome_config.conn_delete_prob = 0.2
    genome_config.enabled_mutate_rate = 0.1
    genome_config.response_mutate_rate = 0.5
    genome_config.response_mutate_power = 0.5
    genome_config.innovation_tracker = neat.InnovationTracker()
    others = random.getstate()
    random.seed(seed)
    try:
        genome = neat.DefaultGenome(1)
        genome.configure_new(genome_config)
        for _ in range(mutations):
            genome.mutate(genome_config)
    finally:
        random.setstate(others)
    return config, genome


def make_controller(seed: int = 3, mutations: int = 12) -> Controller:
    """Return a small network with hidden nodes."""
    _, genome = random_genome(seed, mutations)
    return genome_to_controller(genome, 1.0, Morphology.nominal(), seed)


class WeightScorer:
    """Stands in for the water: a distance that depends on every gene, pose and body.

    Bodies that are as wide as the nominal one swim alike.
    """

    def __init__(self, interrupt_at: int | None = None) -> None:
        self.calls = 0
        self.interrupt_at = interrupt_at

    def __call__(
        self,
        _plan: BodyPlan,
        controllers: Sequence[Controller],
        bodies: NDArray[np.float64],
        fin_angles: NDArray[np.float64],
        *_: Any,
        **__: Any,
    ) -> NDArray[np.float64]:
        self.calls += 1
        if self.calls == self.interrupt_at:
            raise KeyboardInterrupt
        worth = [float(np.sin(c.weights.sum()) - np.abs(c.bias).sum()) for c in controllers]
        easy = bodies[:, 0] - Morphology.nominal().to_array()[0]
        return np.add.outer(np.array(worth), np.sin(fin_angles).sum(axis=1) + easy)


def evolve_with(scorer: WeightScorer, *arguments: Any, **options: Any) -> Evolved:
    """Evolve a gait, with a scorer in place of the water."""
    with patch("gait.swims.scores._distances", scorer):
        return evolve_gait(*arguments, **options)


def read_history(path: Path) -> tuple[Generation, ...]:
    """Return the rows of a ``history.csv``."""
    header, *lines = path.read_text(encoding="utf-8").splitlines()
    rows = [[json.loads(cell) for cell in line.split(",")] for line in lines]
    return tuple(Generation(**dict(zip(header.split(","), row, strict=True))) for row in rows)


def contents(directory: Path) -> dict[str, bytes]:
    """Return every file's content."""
    return {path.name: path.read_bytes() for path in directory.iterdir()}
