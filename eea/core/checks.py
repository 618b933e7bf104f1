"""Checks of settings; messages name the setting, the expected value and the given value.

The core contains no robot, so it cannot use ``aquafish_gym.utils.validation``.
"""

from __future__ import annotations

import difflib
import math
import numbers
import sys
from collections.abc import Iterable, Mapping
from dataclasses import field, fields, is_dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


class ConfigurationError(ValueError):
    """A setting or an argument of the EEA is wrong; the message names it.

    Examples
    --------
    >>> whole("rounds", 2.5, 1)
    Traceback (most recent call last):
    eea.core.checks.ConfigurationError: rounds must be a whole number of at least 1; got 2.5
    """


class TargetError(RuntimeError):
    """A target or a simulator violated its protocol."""


def brief(value: object) -> str:
    """Return the ``repr`` of a value on one line, at most 80 characters."""
    try:
        text = " ".join(repr(value).split())
    except (ValueError, RecursionError):  # a number of too many digits, or nested too deep
        text = f"a {type(value).__name__} too long to show"
    return text if len(text) <= 80 else text[:77] + "..."


def _require(sound: bool, argument: str, expected: str, value: object, hint: str = "") -> None:
    if not sound:
        raise ConfigurationError(f"{argument} must be {expected}; got {brief(value)}{hint}")


def choice(argument: str, value: object, choices: Iterable[str]) -> None:
    """Refuse ``value`` unless it is one of ``choices``; the message offers the nearest."""
    known = list(choices)
    if isinstance(value, str) and value in known:
        return
    said = value[:80] if isinstance(value, str) else ""
    close = difflib.get_close_matches(said, known, n=1, cutoff=0.4)
    hint = f"; did you mean {close[0]!r}?" if close else ""
    expected = f"one of {', '.join(known)}" if known else "left out, as there is none"
    _require(False, argument, expected, value, hint)


def flag(argument: str, value: object) -> None:
    """Refuse ``value`` unless it is True or False."""
    _require(isinstance(value, bool), argument, "True or False", value)


def instance(argument: str, value: object, kind: type) -> None:
    """Refuse ``value`` unless it is a ``kind``."""
    _require(isinstance(value, kind), argument, f"of type {kind.__name__}", value)


def text(argument: str, value: object, *, empty: bool = False) -> None:
    """Refuse ``value`` unless it is text; empty text needs ``empty``."""
    sound = isinstance(value, str) and (empty or value != "")
    _require(sound, argument, "text" if empty else "text that is not empty", value)


def callback(argument: str, value: object) -> None:
    """Refuse ``value`` unless it is a function or None."""
    _require(value is None or callable(value), argument, "a function or None", value)


def all_of(argument: str, value: Any, kind: type) -> tuple[Any, ...]:
    """Return a list or tuple of instances of ``kind`` as a tuple; refuse anything else."""
    sound = isinstance(value, list | tuple) and all(isinstance(one, kind) for one in value)
    _require(sound, argument, f"a list or tuple of {_plural(kind)}", value)
    return tuple(value)


def mapping(argument: str, value: object, kind: type) -> None:
    """Refuse ``value`` unless it is a mapping from names to instances of ``kind``."""
    sound = isinstance(value, Mapping) and all(
        isinstance(name, str) and isinstance(one, kind) for name, one in value.items()
    )
    _require(sound, argument, f"a mapping from names to {_plural(kind)}", value)


def _plural(kind: type) -> str:
    """Return what some values of a type are called."""
    names: dict[type, str] = {str: "text", numbers.Real: "numbers"}
    return names.get(kind, kind.__name__)


def at_most(argument: str, value: float, bound: str, limit: float) -> None:
    """Refuse a ``value`` above ``limit``, the value of the setting ``bound``."""
    _require(value <= limit, argument, f"at most {bound}, {limit}", value)


def whole(argument: str, value: Any, low: int, high: int | None = None) -> None:
    """Refuse ``value`` unless it is a whole number in [``low``, ``high``]."""
    number = isinstance(value, int | np.integer) and not isinstance(value, bool | np.timedelta64)
    sound = number and low <= value and (high is None or value <= high)
    most = "" if high is None else f" and at most {high}"
    _require(sound, argument, f"a whole number of at least {low}{most}", value)


def real(argument: str, value: Any, low: float, high: float = math.inf) -> None:
    """Refuse ``value`` unless it is a finite number in [``low``, ``high``]."""
    number = isinstance(value, numbers.Real) and not isinstance(value, bool | np.timedelta64)
    value = float(value) if isinstance(value, np.floating) else value
    sound = number and abs(value) <= sys.float_info.max and low <= value <= high
    span = f"of at least {low:g}" if math.isinf(high) else f"in [{low:g}, {high:g}]"
    _require(sound, argument, f"a finite number {span}", value)


def real_or_infinite(argument: str, value: Any, low: float) -> None:
    """Refuse ``value`` unless it is a number of at least ``low``, which may be infinite."""
    if not (isinstance(value, float) and math.isinf(value) and value >= low):
        real(argument, value, low)


def whole_field(default: int | None, low: int, high: int) -> Any:
    """Return a field of settings whose value :func:`check_fields` checks by :func:`whole`."""
    return field(default=default, metadata={"check": partial(whole, low=low, high=high)})


def real_field(default: float | None, low: float, high: float = math.inf) -> Any:
    """Return a field of settings whose value :func:`check_fields` checks by :func:`real`."""
    return field(default=default, metadata={"check": partial(real, low=low, high=high)})


def check_fields(settings: Any, prefix: str = "") -> None:
    """Check the values of settings, a dataclass; dataclasses in its fields check their own.

    None is accepted where it is the default.
    """
    for each in fields(settings):
        name = prefix + each.name
        value = getattr(settings, each.name)
        if is_dataclass(each.default):
            instance(name, value, type(each.default))
        elif "check" in each.metadata and not (value is None is each.default):
            each.metadata["check"](name, value)


def real_numbers(argument: str, value: object) -> NDArray[np.float64]:
    """Return numbers as a new float64 array, of any shape; entries may be NaN or infinite.

    Text, booleans, spans of time and masked entries are refused.
    """
    given = as_array(value)
    _require(given.dtype.kind in "iuf", argument, "numbers", value)
    with np.errstate(over="ignore"):  # a longer float becomes infinite
        return np.array(given, dtype=np.float64)


def as_array(value: object) -> NDArray[Any]:
    """Return what numpy makes of a value; None where it can make nothing, or entries are masked."""
    try:
        return np.array(None) if masked(value) else np.asarray(value)
    except (TypeError, ValueError, RuntimeError):  # the last of tensors, and of deep lists
        return np.array(None)


def masked(value: object) -> bool:
    """Return whether an entry of an array, or of arrays in lists, is masked.

    numpy reads the number behind the mask.
    """
    if isinstance(value, list | tuple):
        return any(map(masked, value))
    return isinstance(value, np.ma.MaskedArray) and bool(np.ma.is_masked(value))


def finite(argument: str, value: ArrayLike, shape: tuple[int | None, ...]) -> NDArray[np.float64]:
    """Return ``value`` as a finite float64 array of ``shape``; ``None`` is any length."""
    array = real_numbers(argument, value)
    fits = array.ndim == len(shape) and all(
        n in (None, m) for n, m in zip(shape, array.shape, strict=True)
    )
    wanted = str(tuple("any" if n is None else n for n in shape)).replace("'", "")
    if not fits:
        raise ConfigurationError(f"{argument} must have shape {wanted}; got {array.shape}")
    _require(bool(np.isfinite(array).all()), argument, "finite", array)
    return array
