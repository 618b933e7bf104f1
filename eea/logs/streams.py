"""What a log holds: streams of rows, each with its own times."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.utils.validation import InvalidArgumentError, brief

Columns = dict[str, NDArray[Any]]
Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Stream:
    """Rows that were recorded together, T of them."""

    name: str  #: "" in a file of one table.
    columns: Columns  #: Name -> (T,) float64, or (T,) objects where a cell is no number.
    #: The columns that the format defines as times -> s per tick; the sensor's own is the first.
    clocks: Mapping[str, float] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)  #: Those that the file states.

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def full_name(self, column: str) -> str:
        """Return the name of a column, with that of its stream."""
        return f"{self.name}.{column}" if self.name else column

    def numbers(self, column: str, hint: str = "") -> Floats:
        """Return a column (T,) of numbers; the error names the first cell that is none."""
        cells = self.columns[column]
        if cells.dtype != object:
            return cells
        for number, cell in enumerate(cells, 1):
            if not _is_number(cell):
                found = brief(cell) if cell else "nothing"
                raise InvalidArgumentError(
                    f"row {number} must have numbers; {self.full_name(column)} is {found}{hint}"
                )
        return cells.astype(np.float64)


@dataclass(frozen=True, eq=False)
class Recording:
    """What a file holds."""

    format: str
    streams: list[Stream]
    remarks: list[str]  #: Sentences on what could not be read.


def _is_number(cell: Any) -> bool:
    try:
        return cell is not None and float(cell) is not None
    except (TypeError, ValueError):
        return False
