"""Symbols: numbers that are not known yet, a scalar backend of ``arithmetic.py``.

The physics runs on symbols as it runs on floats. The results are expressions, which
``printing.py`` prints. Operations of constants are computed here, in double precision, as plain
Python computes them, and what a constant of 0, 1 or -1 makes needless is left out: a hinge along
the body's axes costs no multiplication. Nothing else is simplified, so that the printed code rounds
as plain Python does; only the sign of a zero may differ.
"""

from __future__ import annotations

from itertools import count
from typing import Any

_serial_numbers = count()


class Symbol:
    """The result of an operation, or an entry of an array.

    Parameters
    ----------
    operation
        The operation's name, a key of ``printing.JAVASCRIPT.operations``, or "entry".
    operands
        Symbols and floats; of an entry, the array's name and the index.

    Attributes
    ----------
    serial
        A number that grows from symbol to symbol: that of an operand is smaller.
    """

    __slots__ = ("operands", "operation", "serial")

    __array_ufunc__ = None  # numpy's numbers leave operations with symbols to this class

    def __init__(self, operation: str, *operands: Any) -> None:
        self.operation = operation
        self.operands = operands
        self.serial = next(_serial_numbers)

    def __bool__(self) -> bool:
        raise TypeError("a symbol is neither true nor false: choose by where_less, not by a branch")

    def __add__(self, other: Any) -> Any:
        return operation("add", self, other)

    def __radd__(self, other: Any) -> Any:
        return operation("add", other, self)

    def __sub__(self, other: Any) -> Any:
        return operation("subtract", self, other)

    def __rsub__(self, other: Any) -> Any:
        return operation("subtract", other, self)

    def __mul__(self, other: Any) -> Any:
        return operation("multiply", self, other)

    def __rmul__(self, other: Any) -> Any:
        return operation("multiply", other, self)

    def __truediv__(self, other: Any) -> Any:
        return operation("divide", self, other)

    def __rtruediv__(self, other: Any) -> Any:
        return operation("divide", other, self)

    def __neg__(self) -> Any:
        return operation("negate", self)

    def __abs__(self) -> Any:
        return operation("abs", self)

    def __lt__(self, other: Any) -> Any:
        return operation("less", self, other)

    def __gt__(self, other: Any) -> Any:
        return operation("less", other, self)


def operation(name: str, *operands: Any) -> Any:
    """Return the symbol of an operation on symbols and numbers, or what a 0 or 1 leaves of it.

    Raises
    ------
    TypeError
        If an operand is neither.
    """
    for operand in operands:
        if not isinstance(operand, Symbol | float | int):
            raise TypeError(f"{name} takes symbols and numbers; got {type(operand).__name__}")
    given = [x if isinstance(x, Symbol) else float(x) for x in operands]
    match name, given:
        case ("add", [a, 0.0]) | ("add", [0.0, a]) | ("subtract", [a, 0.0]):
            return a
        case ("multiply", [_, 0.0]) | ("multiply", [0.0, _]):
            return 0.0
        case ("multiply" | "divide", [a, 1.0]) | ("multiply", [1.0, a]):
            return a
        case ("multiply", [a, -1.0]) | ("multiply", [-1.0, a]) | ("subtract", [0.0, a]):
            return -a
        case "negate", [Symbol(operation="negate", operands=(a,))]:
            return a
        case ("fma", [_, 0.0, c]) | ("fma", [0.0, _, c]):
            return c
        case "fma", [a, b, 0.0]:
            return a * b
        case ("fma", [a, 1.0, c]) | ("fma", [1.0, a, c]):
            return a + c
        case ("fma", [a, -1.0, c]) | ("fma", [-1.0, a, c]):
            return c - a
    return Symbol(name, *given)
