"""What a run of evolution leaves: a row a generation, and its files."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from aquafish_gym.runs.storage import read_document, write_bytes
from aquafish_gym.utils.validation import InvalidArgumentError

CONTROLLER_FILE = "controller.json"
HISTORY_FILE = "history.csv"
CHECKPOINT_FILE = "checkpoint.json"
BODIES_FILE = "bodies.json"
# 1 drew from streams that were not this package's own, 2 had no schema of the storage's, 3 held
# NEAT's population
CHECKPOINT_SCHEMA = "gait.checkpoint/4"
FILES = (CHECKPOINT_FILE, CONTROLLER_FILE, HISTORY_FILE)  # and a sample's BODIES_FILE
MOST_CHECKPOINT_BYTES = 512 * 2**20  # a generation of 10,000 networks


@dataclass(frozen=True)
class Generation:
    """One row of ``history.csv``, whose columns ``gait evolve --help`` explains."""

    generation: int
    best: float
    mean: float
    species: int
    final: float
    distance: float
    nodes: int
    connections: int


def finished_generations(out: Path) -> tuple[Generation, ...]:
    """Return the generations that a directory's checkpoint holds; none if it cannot be read.

    ``history.csv`` may be one behind, if the run broke off in between.
    """
    try:
        return tuple(Generation(**row) for row in read_checkpoint(out)["history"])
    except (InvalidArgumentError, KeyError, TypeError):
        return ()


def read_checkpoint(directory: Path) -> dict[str, Any]:
    """Return what a directory's checkpoint holds, or raise DamagedFileError."""
    path = directory / CHECKPOINT_FILE
    return read_document(path, CHECKPOINT_SCHEMA, "out", MOST_CHECKPOINT_BYTES)


def write_history(path: Path, history: Sequence[Any]) -> None:
    """Write rows, dataclasses of one kind, as CSV, whole or not at all; numbers read back."""
    lines = [",".join(field.name for field in fields(history[0]))]
    lines += [",".join(map(json.dumps, asdict(row).values())) for row in history]
    write_bytes(path, ("\n".join(lines) + "\n").encode())
