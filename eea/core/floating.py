"""Floating-point errors: what a caller asks numpy to do with them holds for the caller's code.

A search underflows where a fit is hopeless, and divides by zero where an answer is infinite. By
``np.seterr(all="raise")`` each of these would end it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import wraps
from typing import Any, ParamSpec, TypeVar

import numpy as np

_P = ParamSpec("_P")
_R = TypeVar("_R")
_CALLERS: ContextVar[dict[str, Any] | None] = ContextVar("_CALLERS", default=None)


def own_errors(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Return a function that runs with numpy's default handling of errors."""

    @wraps(function)
    def inside(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        if _CALLERS.get() is not None:
            return function(*args, **kwargs)
        before = _CALLERS.set(dict(np.geterr()))
        try:
            with np.errstate(divide="warn", over="warn", under="ignore", invalid="warn"):
                return function(*args, **kwargs)
        finally:
            _CALLERS.reset(before)

    return inside


@contextmanager
def callers_errors() -> Iterator[None]:
    """Handle errors as the caller of ``own_errors`` does; what is set meanwhile ends with it."""
    with np.errstate(**(_CALLERS.get() or {})):
        yield
