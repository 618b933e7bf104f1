"""What each generation came to, in memory and in ``history.csv``."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

from aquafish_gym.runs.storage import write_bytes
from aquafish_gym.utils.validation import InvalidArgumentError

HISTORY_FILE = "history.csv"


@dataclass(frozen=True)
class Generation:
    """One row of the history. Distances are in units of 5 cm.

    Attributes
    ----------
    generation
        From 0.
    best, mean
        Fitness: the mean distance over the generation's poses, the zero pose among them.
    species
        How many species the generation falls into.
    final
        The generation's winner's mean distance over the zero pose and the run's fixed poses;
        equal to ``best`` if there are no random poses.
    distance
        The winner's distance from the zero pose.
    nodes, connections
        Of the winner's network.
    """

    generation: int
    best: float
    mean: float
    species: int
    final: float
    distance: float
    nodes: int
    connections: int


def read_history(path: Path | str) -> tuple[Generation, ...]:
    """Read a ``history.csv``.

    Raises
    ------
    InvalidArgumentError
        If it cannot be read or is no history.
    """
    names = [f.name for f in fields(Generation)]
    try:
        header, *lines = Path(path).read_text(encoding="utf-8").splitlines()
        if header != ",".join(names):
            raise ValueError("its first line is not the history's")
        rows = [[json.loads(cell) for cell in line.split(",")] for line in lines]
        return tuple(Generation(**dict(zip(names, row, strict=True))) for row in rows)
    except OSError as error:
        raise InvalidArgumentError(
            f"history: cannot read {path}: {error.strerror or error}"
        ) from None
    except ValueError as error:
        raise InvalidArgumentError(f"history: {path} is not a history: {error}") from None


def write_history(path: Path, history: Sequence[Generation]) -> None:
    """Write a ``history.csv``, whole or not at all; every number reads back exactly."""
    names = [f.name for f in fields(Generation)]
    lines = [",".join(names)]
    lines += [",".join(json.dumps(getattr(row, n)) for n in names) for row in history]
    write_bytes(path, ("\n".join(lines) + "\n").encode())
