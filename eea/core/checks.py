"""Refusing bad settings in sentences that name them; the core cannot borrow the fish's checks."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterable

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
    """A target or a simulator did not answer as its protocol promises."""


def brief(value: object) -> str:
    """Return what came, for a message: its ``repr`` on one line, cut short."""
    try:
        text = re.sub(r"\n\s*", " ", repr(value))
    except (ValueError, RecursionError):  # too many digits, too deep
        text = f"a {type(value).__name__} too long to show"
    return text if len(text) <= 80 else text[:77] + "..."


def choice(argument: str, value: object, choices: Iterable[str]) -> None:
    """Refuse ``value`` unless it is one of ``choices``; the nearest one is offered."""
    known = list(choices)
    if isinstance(value, str) and value in known:
        return
    close = difflib.get_close_matches(str(value)[:80], known, n=1, cutoff=0.4)
    hint = f"; did you mean {close[0]!r}?" if close else ""
    raise ConfigurationError(
        f"{argument} must be one of {', '.join(known)}; got {brief(value)}{hint}"
    )


def flag(argument: str, value: object) -> None:
    """Refuse ``value`` unless it is True or False."""
    if not isinstance(value, bool):
        raise ConfigurationError(f"{argument} must be True or False; got {brief(value)}")


def instance(argument: str, value: object, kind: type) -> None:
    """Refuse ``value`` unless it is a ``kind``."""
    if not isinstance(value, kind):
        raise ConfigurationError(f"{argument} must be of type {kind.__name__}; got {brief(value)}")


def at_most(argument: str, value: float, bound: str, limit: float) -> None:
    """Refuse a ``value`` above the ``limit`` that another setting, ``bound``, is for it."""
    if value > limit:
        raise ConfigurationError(f"{argument} must be at most {bound}, {limit}; got {brief(value)}")


def whole(argument: str, value: object, low: int, high: int | None = None) -> None:
    """Refuse ``value`` unless it is a whole number in [``low``, ``high``]."""
    # numpy counts spans of time among its integers.
    number = isinstance(value, int | np.integer) and not isinstance(value, bool | np.timedelta64)
    if not number or value < low or (high is not None and value > high):  # type: ignore[operator]
        most = "" if high is None else f" and at most {high}"
        raise ConfigurationError(
            f"{argument} must be a whole number of at least {low}{most}; got {brief(value)}"
        )


def real(argument: str, value: object, low: float, high: float = math.inf) -> None:
    """Refuse ``value`` unless it is a finite number in [``low``, ``high``]."""
    kinds = int | float | np.integer | np.floating
    try:
        number = isinstance(value, kinds) and not isinstance(value, bool | np.timedelta64)
        sound = number and math.isfinite(value) and low <= value <= high  # type: ignore[arg-type,operator]
    except OverflowError:  # a whole number beyond every float
        sound = False
    if not sound:
        span = f"of at least {low:g}" if math.isinf(high) else f"in [{low:g}, {high:g}]"
        raise ConfigurationError(f"{argument} must be a finite number {span}; got {brief(value)}")


def finite(argument: str, value: ArrayLike, shape: tuple[int | None, ...]) -> NDArray[np.float64]:
    """Return ``value`` as a finite float64 array of ``shape``; ``None`` is any length."""
    try:
        given = np.asarray(value)
        if given.dtype.kind not in "iuf" or np.ma.is_masked(value):
            raise TypeError
        array = np.array(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise ConfigurationError(f"{argument} must be numbers; got {brief(value)}") from None
    words = ["any" if n is None else str(n) for n in shape]
    wanted = f"({words[0]},)" if len(words) == 1 else f"({', '.join(words)})"
    if array.ndim != len(shape) or any(
        n is not None and n != m for n, m in zip(shape, array.shape, strict=True)
    ):
        raise ConfigurationError(f"{argument} must have shape {wanted}; got {array.shape}")
    if not np.isfinite(array).all():
        raise ConfigurationError(f"{argument} must be finite; got {brief(array)}")
    return array
