"""Checks of arguments: errors name the expected value, the given value and the nearest choice.

Every public function checks its arguments with these few helpers. They raise InvalidArgumentError,
and every message names the argument.
"""

from __future__ import annotations

import difflib
import json
import math
import os
import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

LONGEST_FILE_NAME = 255  # bytes, in almost any file system
LONGEST_PATH = 4095  # bytes, on Linux
_MOST_PARTS = 2_000_000  # lists, objects and strings in a JSON text; each takes 70 bytes
Shape = tuple[int | None, ...]  # None is any length
_T = TypeVar("_T")


class InvalidArgumentError(ValueError):
    """An argument has the wrong type, shape or range; the message names it.

    The message may cite a file's name or content: a terminal can show its lines, see ``printable``.
    """

    def __init__(self, message: str) -> None:
        super().__init__("\n".join(map(printable, message.split("\n"))))


class UnknownNameError(InvalidArgumentError):
    """A name is not one of the known ones; the message offers the nearest."""


class MissingExtraError(ImportError):
    """A feature needs an extra that is not installed; the message names the command to get it."""


class EngineUnavailableError(ImportError):
    """An engine needs a package, a display or a compiler that this machine lacks."""


def install_advice(extra: str) -> str:
    """Return the command that installs an extra, also of a clone that was installed with -e."""
    return f'pip install "aquafish-gym[{extra}]"'


def one_of(argument: str, name: object, choices: Iterable[str]) -> str:
    """Return ``name`` if it is one of ``choices``; UnknownNameError offers the nearest."""
    known = list(choices)
    if isinstance(name, str) and name in known:
        return name
    said = name.lower() if isinstance(name, str) else ""
    lowered = {one.lower(): one for one in known}
    # Distant names are no help: "dead" shares two letters in three with "delay".
    close = difflib.get_close_matches(said, lowered, n=1, cutoff=0.7)
    close = close or [one for one in lowered if len(said) > 2 and said in one]
    hint = f"; did you mean {lowered[close[0]]!r}?" if close else ""
    # A name may contain commas.
    listed = ("; " if any("," in one for one in known) else ", ").join(known)
    raise UnknownNameError(f"{argument} must be one of {listed}; got {brief(name)}{hint}")


def finite_array(
    argument: str,
    value: ArrayLike,
    shape: Shape,
    low: ArrayLike | None = None,
    high: ArrayLike | None = None,
    unit: str = "",
    flat: bool = False,
    hint: str = "",
) -> NDArray[np.float64]:
    """Return ``value`` as a new float64 array of ``shape``, every entry in [``low``, ``high``].

    With ``flat``, a batch of one may be given without its leading axis. Numbers as text, booleans,
    spans of time and masked entries are refused. ``hint`` ends the messages about another shape.
    """
    array = real_array(argument, value, shape, hint)
    if flat and array.ndim == len(shape) - 1 and array.size:
        array = array[None]
    if not fits(array.shape, shape):
        raise InvalidArgumentError(
            f"{argument} must have shape {spelled(shape)}; got {array.shape}{hint}"
        )
    if not np.isfinite(array).all():
        raise InvalidArgumentError(f"{argument} must be finite; got {brief(value)}")
    if low is None and high is None:
        return array
    low = -np.inf if low is None else low
    high = np.inf if high is None else high
    outside = np.less(array, low) | np.greater(array, high)
    if outside.any():
        lows = np.broadcast_to(low, array.shape)
        highs = np.broadcast_to(high, array.shape)
        where = tuple(int(i) for i in np.argwhere(outside)[0])
        at = f"[{', '.join(map(str, where))}]" if where else ""
        raise InvalidArgumentError(
            f"{argument}{at} must lie in [{lows[where]:g}, {highs[where]:g}]"
            f"{' ' + unit if unit else ''}; got {array[where]:g}"
        )
    return array


def real_array(
    argument: str, value: object, wanted: Shape | str, hint: str = ""
) -> NDArray[np.float64]:
    """Return ``value`` as a new float64 array; entries may be NaN or infinite.

    Anything but numbers raises InvalidArgumentError with the ``wanted`` shape, which may be given
    in words, and the ``hint``.
    """
    try:
        return _real(value)
    except (TypeError, ValueError, OverflowError, RecursionError):
        words = wanted if isinstance(wanted, str) else spelled(wanted)
        raise InvalidArgumentError(
            f"{argument} must be numbers of shape {words}; got {brief(value)}{hint}"
        ) from None


def fits(shape: tuple[int, ...], wanted: Shape) -> bool:
    """Return whether a shape matches the wanted shape."""
    return len(shape) == len(wanted) and all(
        there in (None, here) for here, there in zip(shape, wanted, strict=True)
    )


def spelled(shape: Shape) -> str:
    """Return a shape in words, such as "(any, 3)"."""
    words = ["any" if n is None else str(n) for n in shape]
    return f"({words[0]},)" if len(words) == 1 else f"({', '.join(words)})"


def positive(argument: str, value: float) -> float:
    """Return ``value`` as a finite number above 0; a float takes a fast path."""
    if type(value) is float and 0.0 < value < math.inf:
        return value
    return float(finite_array(argument, value, (), math.ulp(0.0)))


def integer(argument: str, value: object, low: int, high: int | None = None) -> int:
    """Return ``value`` as an int in [``low``, ``high``]; booleans are not numbers here."""
    wanted = f"a whole number of at least {low}" + ("" if high is None else f" and at most {high}")
    # numpy treats spans of time as integers.
    if isinstance(value, int | np.integer) and not isinstance(value, bool | np.timedelta64):
        value = int(value)
        if value >= low and (high is None or value <= high):
            return value
    raise InvalidArgumentError(f"{argument} must be {wanted}; got {brief(value)}")


def flag(argument: str, value: object) -> bool:
    """Return ``value``, which must be a bool, because ``"no"`` would count as True."""
    if not isinstance(value, bool | np.bool_):
        raise InvalidArgumentError(f"{argument} must be True or False; got {brief(value)}")
    return bool(value)


def instance(argument: str, value: object, kind: type[_T]) -> _T:
    """Return ``value`` if it is an instance of ``kind``; the error names both."""
    if not isinstance(value, kind):
        raise InvalidArgumentError(
            f"{argument} must be of type {kind.__name__}; got {brief(value)}"
        )
    return value


def sequence(argument: str, value: object) -> Sequence[Any]:
    """Return ``value`` if it is a list, a tuple or an array with a length, not text."""
    if isinstance(value, list | tuple) or (isinstance(value, np.ndarray) and value.ndim):
        return value  # type: ignore[return-value]
    raise InvalidArgumentError(f"{argument} must be a list or a tuple; got {brief(value)}")


def file_path(argument: str, value: object) -> Path:
    """Return the path of a text or a path that is not empty, nor too long for a file system."""
    if isinstance(value, str | os.PathLike):
        name = os.fspath(value)
        if isinstance(name, str) and name and "\0" not in name:
            path = Path(name)
            longest = max([len(part.encode(errors="replace")) for part in path.parts], default=0)
            if longest > LONGEST_FILE_NAME or len(name.encode(errors="replace")) > LONGEST_PATH:
                raise InvalidArgumentError(
                    f"{argument} must be a path of at most {LONGEST_PATH} bytes, and each name in "
                    f"it of at most {LONGEST_FILE_NAME}; got {brief(name)}, too long"
                )
            return path
    raise InvalidArgumentError(f"{argument} must be a path; got {brief(value)}")


def callback(argument: str, value: Callable[..., Any] | None) -> None:
    """Raise unless ``value`` can be called or is None."""
    if value is not None and not callable(value):
        raise InvalidArgumentError(f"{argument} must be a function or None; got {brief(value)}")


def utf8_text(argument: str, value: object) -> str:
    """Return text that UTF-8 can hold; raise for bytes of another encoding."""
    text = instance(argument, value, str)
    try:
        text.encode()
    except UnicodeEncodeError:
        raise InvalidArgumentError(
            f"{argument} must be text that UTF-8 can hold; got {brief(text)}"
        ) from None
    return text


def parse_json(argument: str, text: object) -> Any:
    """Return the value of a JSON text with finite numbers.

    Raises InvalidArgumentError, also if the value would take much more memory than the text.
    """
    if not isinstance(text, str | bytes | bytearray):
        raise InvalidArgumentError(f"{argument} must be text in JSON; got {brief(text)}")
    marks: tuple[Any, ...] = ("[", "{", '"') if isinstance(text, str) else (b"[", b"{", b'"')
    lists, objects, quotes = (text.count(mark) for mark in marks)
    if lists + objects + quotes // 2 > _MOST_PARTS:
        raise InvalidArgumentError(
            f"{argument} must have at most {_MOST_PARTS} lists, objects and strings; it has more"
        )
    try:
        return json.loads(text, parse_float=_finite, parse_constant=_finite)
    except RecursionError:
        raise InvalidArgumentError(f"{argument} is not JSON: it is nested too deep") from None
    except ValueError as error:  # also for numbers of too many digits
        reason = str(error).partition(";")[0]  # without Python's own advice
        raise InvalidArgumentError(f"{argument} is not JSON: {reason}") from None


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"the number {text} is not finite")
    return number


def _real(value: Any) -> NDArray[np.float64]:
    """Return numbers as a new array; text, booleans and masks raise TypeError or ValueError."""
    if _masked(value):
        raise TypeError("not all there")
    try:
        raw = np.asarray(value)
    except RuntimeError as error:  # a tensor of torch that requires a gradient
        raise TypeError("not an array") from error
    if raw.dtype.kind not in "iuf":
        raise TypeError("not real numbers")
    with np.errstate(over="ignore"):  # a longer float becomes infinite
        return np.array(raw, dtype=np.float64)


def _masked(value: Any) -> bool:
    """Return whether an entry is masked; numpy reads the number behind it."""
    if isinstance(value, list | tuple):
        return any(map(_masked, value))
    return isinstance(value, np.ma.MaskedArray) and np.ma.is_masked(value)


def printable(text: str) -> str:
    """Return text with escapes for characters that a terminal obeys instead of showing.

    These are control characters, which may clear lines or set the title, and those that change the
    direction of writing.

    Examples
    --------
    >>> print(printable("gyro\\x1b[2K \\u00b0/s"))
    gyro\\x1b[2K \u00b0/s
    """
    if text.isprintable():
        return text
    return "".join(one if one.isprintable() else ascii(one)[1:-1] for one in text)


def brief(value: Any) -> str:
    """Return the ``repr`` of a value for a message, on one line and cut short."""
    if isinstance(value, str | bytes | list | tuple) and len(value) > 100:
        value = value[:100]  # cut before megabytes are spelled
    try:
        text = re.sub(r"\n\s*", " ", repr(value))
    except (ValueError, RecursionError):  # a number of too many digits, or nested too deep
        text = f"a {type(value).__name__} too long to show"
    return text if len(text) <= 80 else text[:77] + "..."
