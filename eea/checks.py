"""Refusing bad settings at the door, in sentences that name the setting.

The EEA knows no robot and so cannot borrow ``aquafish_gym.validation``; these four helpers are
all it needs.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray


class ConfigurationError(ValueError):
    """A setting or an argument of the EEA is wrong; the message names it."""


class TargetError(RuntimeError):
    """A target or a simulator did not answer as its protocol promises."""


def choice(argument: str, value: object, choices: Iterable[str]) -> None:
    """Refuse ``value`` unless it is one of ``choices``; the nearest one is offered.

    Raises
    ------
    ConfigurationError
        If it is not.
    """
    known = list(choices)
    if value in known:
        return
    close = difflib.get_close_matches(str(value), known, n=1, cutoff=0.4)
    hint = f"; did you mean {close[0]!r}?" if close else ""
    raise ConfigurationError(f"{argument} must be one of {', '.join(known)}; got {value!r}{hint}")


def whole(argument: str, value: object, low: int) -> None:
    """Refuse ``value`` unless it is a whole number of at least ``low``.

    Raises
    ------
    ConfigurationError
        If it is not. Booleans are not numbers here.
    """
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < low:
        raise ConfigurationError(
            f"{argument} must be a whole number of at least {low}; got {value!r}"
        )


def real(argument: str, value: object, low: float, high: float = math.inf) -> None:
    """Refuse ``value`` unless it is a finite number in [``low``, ``high``].

    Raises
    ------
    ConfigurationError
        If it is not. Booleans are not numbers here.
    """
    number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
    if not number or not math.isfinite(value) or not low <= value <= high:  # type: ignore[arg-type,operator]
        span = f"of at least {low:g}" if math.isinf(high) else f"in [{low:g}, {high:g}]"
        raise ConfigurationError(f"{argument} must be a finite number {span}; got {value!r}")


def finite(argument: str, value: ArrayLike, shape: tuple[int | None, ...]) -> NDArray[np.float64]:
    """Return ``value`` as a finite float64 array of ``shape``; ``None`` is any length.

    Raises
    ------
    ConfigurationError
        If it is not numeric, not finite or of another shape.
    """
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise ConfigurationError(f"{argument} must be numbers; got {value!r}") from None
    wanted = "(" + ", ".join("any" if n is None else str(n) for n in shape) + ")"
    if array.ndim != len(shape) or any(
        n is not None and n != m for n, m in zip(shape, array.shape, strict=True)
    ):
        raise ConfigurationError(f"{argument} must have shape {wanted}; got {array.shape}")
    if not np.isfinite(array).all():
        raise ConfigurationError(f"{argument} must be finite; got {array!r}")
    return array
