"""Strange values, and rows of a table: functions with the arguments that must refuse them by name.

Every parameter of a function must be in its row, and every strange value is tried on each. A new
public function needs a row, not a test.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest

from aquafish_gym.utils.validation import InvalidArgumentError
from eea.core.checks import ConfigurationError, TargetError


def deep_list() -> list[Any]:
    """Return lists in lists, deeper than numpy reads and Python prints."""
    inner: list[Any] = []
    for _ in range(3000):
        inner = [inner]
    return inner


#: Values that few arguments take, by name.
STRANGE: Mapping[str, Any] = MappingProxyType(
    {
        "none": None,
        "object": object(),
        "type": Path,
        "function": lambda: None,
        "true": True,
        "text": "no such thing",
        "empty text": "",
        "bytes": b"1",
        "complex": 1j,
        "nan": float("nan"),
        "infinity": float("inf"),
        "minus one": -1,
        "fraction": 0.123456,
        "big": 10**30,
        "huge": 10**400,
        "span": np.timedelta64(1, "s"),
        "empty list": [],
        "empty mapping": {},
        "mapping": {"a": 1.0},
        "set": {0.5},
        "list of None": [None],
        "list of text": ["0", "1"],
        "ragged": [[0.0, 0.1], [0.2]],
        "deep": deep_list(),
        "words": np.array(["0", "1"]),
        "cube": np.zeros((2, 2, 2)),
        "nans": np.full((1, 3), np.nan),
        "masked number": np.ma.masked,
        "objects": np.array([0.5, None], object),
        "dates": np.array(["2026-01-01"], "datetime64[D]"),
        "fields": np.zeros(1, [("x", np.float64)]),
    }
)
CALLABLE = "type, function"
NO_BODY = "none, empty mapping"  # a mapping without entries changes nothing in the nominal body
NO_DAMAGE = "none, empty text, empty list, empty mapping"
#: A message about a body says "morphology", and so do those that check many.
BODY_ARGUMENTS = ("morphology", "morphologies", "body", "bodies", "target", "native")


def options(**legal: str) -> dict[str, frozenset[str]]:
    """Return the legal strange values of each argument, from their names with commas."""
    return {argument: frozenset(names.split(", ")) for argument, names in legal.items()}


@dataclass(frozen=True)
class Call:
    """A function, arguments with which it works, and strange values that are legal, by argument.

    ``words`` are what a message calls an argument, if not by its name.
    """

    function: Callable[..., object]
    arguments: Mapping[str, Any]
    legal: Mapping[str, frozenset[str]] = field(default_factory=dict)
    words: Mapping[str, str] = field(default_factory=dict)

    @property
    def name(self) -> str:
        return self.function.__qualname__

    def wrong(self, argument: str) -> dict[str, Any]:
        """Return the strange values that an argument must refuse, by name."""
        legal = self.legal.get(argument, frozenset())
        assert legal <= set(STRANGE)
        return {name: value for name, value in STRANGE.items() if name not in legal}

    def masked(self, argument: str) -> dict[str, Any]:
        """Return an argument's own numbers with a masked entry, as one array and in a list."""
        value = self.arguments[argument]
        if not isinstance(value, np.ndarray | list | tuple):
            return {}
        with suppress(ValueError):  # ragged
            numbers = np.array(value)
            if numbers.ndim and numbers.size and numbers.dtype.kind in "iuf":
                first = np.arange(numbers.size).reshape(numbers.shape) == 0
                hidden = np.ma.array(numbers, mask=first)
                return {"masked": hidden, "list of masked": list(hidden)}
        return {}

    def refusal(self, argument: str, value: Any) -> Exception | None:
        """Return what the function raises for a value, or None if it takes it."""
        try:
            self.function(**{**self.arguments, argument: value})
        except Exception as error:  # of any type: it is what is judged
            return error
        return None

    def complaint(self, argument: str, error: Exception | None) -> str | None:
        """Return what is wrong with a refusal: it has one line that names the argument."""
        if error is None:
            return "is accepted"
        if not isinstance(error, InvalidArgumentError | ConfigurationError | TargetError):
            return f"raises {error!r}"
        said = str(error)
        names = [self.words.get(argument, argument.rstrip("s"))]
        if argument in BODY_ARGUMENTS:
            names.append("morpholog")
        if not any(name in said for name in names) or "\n" in said or len(said) > 500:
            return f"says {said!r}"
        return None


def cases(rows: Iterable[Call]) -> list[Any]:
    """Return each argument of each row as a test's parameters."""
    return [
        pytest.param(row, argument, id=f"{row.name}-{argument}")
        for row in rows
        for argument in row.arguments
    ]


def complaints(call: Call, argument: str) -> dict[str, str]:
    """Return the strange values that an argument does not refuse as it should, and why."""
    return {
        name: complaint
        for name, value in (call.wrong(argument) | call.masked(argument)).items()
        if (complaint := call.complaint(argument, call.refusal(argument, value)))
    }


def has_every_parameter(call: Call) -> bool:
    """Return whether a row has each parameter of its function."""
    named = inspect.signature(call.function).parameters.values()
    required = {p.name for p in named if p.kind not in (p.VAR_KEYWORD, p.VAR_POSITIONAL)}
    more = any(p.kind is p.VAR_KEYWORD for p in named)
    given = set(call.arguments)
    return required == given or (more and required < given)
