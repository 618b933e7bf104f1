"""What a search asks for, and what it is answered."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from gait.controller import Controller


@dataclass(frozen=True)
class Ask:
    """A generation of controllers whose fitness a search wants to know."""

    controllers: Sequence[Controller]
    #: Of which the best is this generation's winner; None for the leaders of ``controllers``. An
    #: empty row has no winner, and is answered with the last generation's that had one.
    finalists: Sequence[Controller] | None = None
    species: int = 1  #: Into how many the generation falls; or how many starts go on.
    poses: int | None = None  #: So few of the generation's are enough; None for all.


class Answer(NamedTuple):
    """What the controllers of a generation are worth."""

    fitness: list[float]  #: Of each.
    winner: Controller
    final: float  #: What it is worth over the run's fixed swims.


Search = Generator[Ask, Answer, None]
