"""Binary genomes: strings of bits that encode the values of variables (Sec. 3.2).

A genome is a row of 0s and 1s, the most significant bit of each variable first, by default in Gray
code: neighbouring values differ in one bit, so that a mutation can always take the smallest step. A
variable of n bits that decode to the whole number k has the value
``low + (high - low) * k / (2^n - 1)``, so that both ends of its range are reachable. A periodic
variable has ``low + (high - low) * k / 2^n``, because its ends are the same point.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eea.core.checks import (
    ConfigurationError,
    all_of,
    brief,
    choice,
    finite,
    flag,
    instance,
    real,
    text,
    whole,
)
from eea.core.config import Coding

Genomes = NDArray[np.uint8]

ACTION_BITS = 6  # bits for each servo
POSE_BITS = 8  # bits for each hidden angle
MAXIMUM_GENOMES = 10**6  # of one draw
MAXIMUM_BITS = 24  # of a variable, because levels of chance list all its values


@dataclass(frozen=True)
class Variable:
    """One encoded quantity: its name, number of bits and range.

    Examples
    --------
    >>> Variable("length", 2, 0.0, 3.0).levels
    array([0., 1., 2., 3.])
    """

    name: str
    bits: int
    low: float
    high: float
    periodic: bool = False

    def __post_init__(self) -> None:
        text("name", self.name)
        whole(f"bits of {self.name}", self.bits, 1, MAXIMUM_BITS)
        real(f"low of {self.name}", self.low, -np.inf)
        real(f"high of {self.name}", self.high, np.nextafter(self.low, np.inf))
        flag(f"periodic of {self.name}", self.periodic)

    @property
    def quantum(self) -> float:
        """The distance between neighbouring values."""
        steps: int = 2**self.bits if self.periodic else 2**self.bits - 1
        return (self.high - self.low) / steps

    @property
    def levels(self) -> NDArray[np.float64]:
        """Every value the bits can give, in order, shape (2^bits,)."""
        return np.minimum(self.low + self.quantum * np.arange(2**self.bits), self.high)


class BitLayout:
    """The code between a genome's bits and the values of its variables.

    ``variables`` are in the order of their bits.

    Examples
    --------
    >>> layout = BitLayout([Variable("speed", 2, 0.0, 3.0)])
    >>> layout.decode([[1, 1]])
    array([[2.]])
    """

    coding: Coding = "gray"  #: See :meth:`with_coding`.

    def __init__(self, variables: Sequence[Variable]) -> None:
        self.variables: tuple[Variable, ...] = all_of("variables", variables, Variable)
        whole("the number of variables", len(variables), 1)
        self.bits: int = sum(v.bits for v in self.variables)
        self.low: NDArray[np.float64] = np.array([v.low for v in self.variables])
        self.high: NDArray[np.float64] = np.array([v.high for v in self.variables])
        self._quantum = np.array([v.quantum for v in self.variables])
        # Gray bits become binary bits by a running parity within each variable, and whole
        # numbers by place values: two exact matrix products.
        self._parity = np.zeros((self.bits, self.bits))
        self._place = np.zeros((self.bits, len(self.variables)))
        start = 0
        for column, variable in enumerate(self.variables):
            stop = start + variable.bits
            self._parity[start:stop, start:stop] = np.triu(np.ones((variable.bits, variable.bits)))
            self._place[start:stop, column] = 2.0 ** np.arange(variable.bits - 1, -1, -1)
            start = stop

    def with_coding(self, coding: Coding) -> BitLayout:
        """Return the layout of the same variables in a code, as ``GeneticConfig.coding`` names it.

        The EEA gives the layouts of its problem the code of its settings.
        """
        choice("coding", coding, get_args(Coding))
        layout = BitLayout(self.variables)
        layout.coding = coding
        return layout

    def __len__(self) -> int:
        return len(self.variables)

    @property
    def span(self) -> NDArray[np.float64]:
        """The widths of the variables' ranges, shape (variables,)."""
        return self.high - self.low

    @property
    def names(self) -> tuple[str, ...]:
        """The variables' names."""
        return tuple(v.name for v in self.variables)

    def decode(self, genomes: ArrayLike) -> NDArray[np.float64]:
        """Return the values of genomes (N, bits) as an array (N, variables)."""
        bits = finite("genomes", genomes, (None, self.bits))
        if self.coding == "gray":
            bits = (bits @ self._parity) % 2.0
        # The greatest k may round to just above the range.
        return np.minimum(self.low + self._quantum * (bits @ self._place), self.high)

    def encode(self, values: ArrayLike) -> Genomes:
        """Return the genomes (N, bits) nearest to values (N, variables).

        Periodic variables wrap; other variables are clipped to their range.
        """
        array = finite("values", values, (None, len(self.variables)))
        columns: list[Genomes] = []
        for i, variable in enumerate(self.variables):
            k = np.rint((array[:, i] - variable.low) / variable.quantum).astype(np.int64)
            size = 2**variable.bits
            k = k % size if variable.periodic else np.clip(k, 0, size - 1)
            if self.coding == "gray":
                k ^= k >> 1
            columns.append((k[:, None] >> np.arange(variable.bits - 1, -1, -1) & 1).astype("u1"))
        return np.concatenate(columns, axis=1)

    def random(self, count: int, rng: np.random.Generator) -> Genomes:
        """Return ``count`` uniform random genomes, shape (count, bits)."""
        whole("count", count, 0, MAXIMUM_GENOMES)
        instance("rng", rng, np.random.Generator)
        return rng.integers(0, 2, size=(count, self.bits), dtype=np.uint8)


def model_layout(table: Iterable[tuple[str, float, int]]) -> BitLayout:
    """Return a layout for models from rows of (name, maximum, bits), each range [0, maximum]."""
    rows = _rows(table, "(name, maximum, bits)")
    return BitLayout([Variable(name, bits, 0.0, high) for name, high, bits in rows])


def action_layout(table: Iterable[tuple[str, float, float]]) -> BitLayout:
    """Return a layout for actions from rows of (servo, lowest, highest speed): 6 bits each."""
    rows = _rows(table, "(servo, lowest, highest speed)")
    return BitLayout([Variable(name, ACTION_BITS, low, high) for name, low, high in rows])


def _rows(table: Iterable[tuple[Any, ...]], wanted: str) -> list[tuple[Any, ...]]:
    """Return the rows of three of a table."""
    try:
        rows = list(table)
    except TypeError:  # also of an array without dimensions, which is iterable by name
        rows = []
    if not rows or not all(isinstance(row, list | tuple) and len(row) == 3 for row in rows):
        raise ConfigurationError(f"table must be rows of {wanted}; got {brief(table)}")
    return rows


def pose_layout(angles: int) -> BitLayout:
    """Return a layout for hidden angles, each over the whole turn [-pi, pi)."""
    return BitLayout([Variable("angle", POSE_BITS, -np.pi, np.pi, periodic=True)] * angles)
