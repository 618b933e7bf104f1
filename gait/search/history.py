"""The history of a search: its generations, its best controller, and its checkpoint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.utils.storage import DamagedFileError, read_document, write_document
from aquafish_gym.utils.validation import InvalidArgumentError
from gait.controllers.controller import Controller
from gait.files import CONTROLLER_FILE, write_rows
from gait.search.ask_tell import Proposal
from gait.search.config import Choices

# Fitness from random poses is noisy, and the best of many controllers is the luckiest. So the
# leaders of each generation swim again, from poses that are fixed for the run.
FINALISTS = 8
HISTORY_FILE, CHECKPOINT_FILE = "history.csv", "checkpoint.json"
FILES = (CHECKPOINT_FILE, CONTROLLER_FILE, HISTORY_FILE)  # and a sample's bodies.json
CHECKPOINT_SCHEMA = "gait.checkpoint/7"
MAXIMUM_CHECKPOINT_BYTES = 64 * 2**20  # three million fitness values


@dataclass(frozen=True)
class Generation:
    """One row of ``history.csv``; ``gait evolve --help`` explains the columns."""

    generation: int
    best: float
    mean: float
    species: int
    final: float
    distance: float
    nodes: int
    connections: int


class Scores(NamedTuple):
    """The results of a generation's swims, which replay it."""

    fitness: list[float]  #: Of each controller.
    winner: int = 0  #: Index among the finalists.
    final: float = 0.0  #: Fitness of the winner over the run's fixed swims.
    distance: float = 0.0  #: Of the winner from the zero pose on the first body.


class History:
    """The generations so far, and the best controller among their winners."""

    best: Controller
    winner: Controller  # of the last generation with finalists

    def __init__(self, sample: str | None) -> None:
        self.rows: list[Generation] = []
        self.fitness = -np.inf  # of the best
        self._sample, self._scores = sample, list[Scores]()

    def record(self, proposal: Proposal, scores: Scores) -> Generation:
        """Append a generation, and return its row."""
        fitness = np.array(scores.fitness)
        finalists = finalists_of(proposal, fitness)
        if finalists:
            self.winner = finalists[scores.winner]
            if scores.final > self.fitness:
                best = self.winner
                self.best = replace(best, sample=self._sample) if self._sample else best
                self.fitness = scores.final
        else:
            scores = scores._replace(final=self.rows[-1].final, distance=self.rows[-1].distance)
        row = Generation(
            generation=len(self.rows),
            best=float(fitness.max()),
            mean=float(fitness.mean()),
            species=proposal.species or 1,
            final=scores.final,
            distance=scores.distance,
            nodes=self.winner.nodes,
            connections=self.winner.connections,
        )
        self._scores.append(scores)
        self.rows.append(row)
        return row

    def save(self, folder: Path) -> None:
        """Write the checkpoint, and then the results."""
        checkpoint = {"generations": self._scores}
        write_document(folder / CHECKPOINT_FILE, checkpoint, CHECKPOINT_SCHEMA)
        self.best.save(folder / CONTROLLER_FILE)
        write_rows(folder / HISTORY_FILE, self.rows)


def finalists_of(proposal: Proposal, fitness: NDArray[np.float64]) -> Sequence[Controller]:
    """Return the candidates for a generation's winner."""
    if proposal.finalists is not None:
        return proposal.finalists
    return [proposal.controllers[i] for i in np.argsort(-fitness, kind="stable")[:FINALISTS]]


def read_checkpoint(folder: Path, choices: Choices) -> list[Scores]:
    """Return the scores of the generations that a folder holds."""
    path = folder / CHECKPOINT_FILE
    if not path.exists():
        return []
    try:
        document = read_document(path, CHECKPOINT_SCHEMA, "out", MAXIMUM_CHECKPOINT_BYTES)
        recorded = [Scores(*row) for row in document["generations"]]
    except (DamagedFileError, KeyError, TypeError) as error:
        reason = error if isinstance(error, DamagedFileError) else f"out: {path} lacks something"
        raise DamagedFileError(f"{reason}; delete it to start again") from None
    if len(recorded) > choices.rows:
        name = "cma_generations" if choices.cma_generations else "generations"
        given: int = getattr(choices, name)
        raise InvalidArgumentError(
            f"{name} must be at least the {given + len(recorded) - choices.rows} that out already "
            f"holds; got {given}"
        )
    return recorded
