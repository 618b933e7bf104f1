"""Refusing bad input at the door: what was expected, what came, the nearest valid choice.

Every public function checks its arguments with these few helpers, so that every message
names the argument and reads alike.
"""

from __future__ import annotations

import difflib
import json
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


class InvalidArgumentError(ValueError):
    """An argument has the wrong type, shape or range; the message names it."""


class UnknownNameError(InvalidArgumentError):
    """A name is not one of the known ones; the message offers the nearest."""


class EngineUnavailableError(ImportError):
    """The engine asked for needs a package or a display that this machine lacks."""


def one_of(argument: str, name: object, choices: Iterable[str]) -> str:
    """Return ``name`` if it is one of ``choices``.

    Raises
    ------
    UnknownNameError
        With the nearest valid choice, if any resembles ``name``.
    """
    known = list(choices)
    if isinstance(name, str) and name in known:
        return name
    said = name if isinstance(name, str) else _brief(name)
    close = difflib.get_close_matches(said, known, n=1, cutoff=0.4)
    hint = f"; did you mean {close[0]!r}?" if close else ""
    raise UnknownNameError(
        f"{argument} must be one of {', '.join(known)}; got {_brief(name)}{hint}"
    )


def finite_array(
    argument: str,
    value: ArrayLike,
    shape: tuple[int | None, ...],
    low: ArrayLike = -np.inf,
    high: ArrayLike = np.inf,
    unit: str = "",
) -> NDArray[np.float64]:
    """Return ``value`` as a float64 array of ``shape`` with every entry in [``low``, ``high``].

    ``None`` in ``shape`` stands for any length. The array is always a copy.

    Raises
    ------
    InvalidArgumentError
        If it is not real numbers (text that spells them is not), has another shape, is not
        finite or leaves the range.
    """
    wanted = "(" + ", ".join("any" if n is None else str(n) for n in shape) + ")"
    try:
        array = _real(value)
    except (TypeError, ValueError, OverflowError, RecursionError):
        raise InvalidArgumentError(
            f"{argument} must be numbers of shape {wanted}; got {_brief(value)}"
        ) from None
    if len(array.shape) != len(shape) or any(
        n is not None and n != m for n, m in zip(shape, array.shape, strict=True)
    ):
        raise InvalidArgumentError(f"{argument} must have shape {wanted}; got {array.shape}")
    if not np.isfinite(array).all():
        raise InvalidArgumentError(f"{argument} must be finite; got {_brief(value)}")
    lows, highs = np.broadcast_to(low, array.shape), np.broadcast_to(high, array.shape)
    outside = (array < lows) | (array > highs)
    if outside.any():
        where = tuple(int(i) for i in np.argwhere(outside)[0])
        at = f"[{', '.join(map(str, where))}]" if where else ""
        raise InvalidArgumentError(
            f"{argument}{at} must lie in [{lows[where]:g}, {highs[where]:g}]"
            f"{' ' + unit if unit else ''}; got {array[where]:g}"
        )
    return array


def integer(argument: str, value: object, low: int, high: int | None = None) -> int:
    """Return ``value`` as an int in [``low``, ``high``].

    Raises
    ------
    InvalidArgumentError
        If it is not a whole number or leaves the range. Booleans are not numbers here.
    """
    wanted = f"a whole number of at least {low}" + ("" if high is None else f" and at most {high}")
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        raise InvalidArgumentError(f"{argument} must be {wanted}; got {_brief(value)}")
    if value < low or (high is not None and value > high):
        raise InvalidArgumentError(f"{argument} must be {wanted}; got {_brief(int(value))}")
    return int(value)


def flag(argument: str, value: object) -> bool:
    """Return ``value`` as a bool.

    Raises
    ------
    InvalidArgumentError
        If it is not True or False: ``"no"`` would count as True.
    """
    if not isinstance(value, bool | np.bool_):
        raise InvalidArgumentError(f"{argument} must be True or False; got {_brief(value)}")
    return bool(value)


def parse_json(argument: str, text: object) -> Any:
    """Return what a text in JSON holds.

    Raises
    ------
    InvalidArgumentError
        If it is not text or not JSON, or has more digits or deeper nesting than can be read.
    """
    if not isinstance(text, str | bytes | bytearray):
        raise InvalidArgumentError(f"{argument} must be text in JSON; got {_brief(text)}")
    try:
        return json.loads(text)
    except ValueError as error:  # of too many digits, too
        raise InvalidArgumentError(f"{argument} is not JSON: {error}") from None
    except RecursionError:
        raise InvalidArgumentError(f"{argument} is not JSON: it is nested too deep") from None


def _real(value: ArrayLike) -> NDArray[np.float64]:
    raw = np.asarray(value)
    # numpy would read text, and drop the imaginary parts of complex numbers.
    odd = str | bytes | np.complexfloating
    if raw.dtype.kind not in "biufO" or (
        raw.dtype.kind == "O" and any(isinstance(v, odd) for v in raw.flat)
    ):
        raise TypeError("not real numbers")
    return np.array(raw, dtype=np.float64)


def _brief(value: Any) -> str:
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # too many digits, too deep
        text = f"a {type(value).__name__} too long to show"
    return text if len(text) <= 80 else text[:77] + "..."
