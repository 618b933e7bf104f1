"""The one comparer of what environments return: observations, rewards, flags and info."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Where one robot of a batch may be late, the batch says of every robot how late it is.
SAID_OF_ALL = frozenset(
    f"{side}_{word}"
    for side in ("sensor", "servo", "observation", "action")
    for word in ("scale", "delay", "hold")
)


def assert_same(found: Any, want: Any, atol: float = 0.0, at: str = "") -> None:
    """Refuse any difference of two steps, resets, infos or arrays.

    Arrays have equal shapes and types of numbers; with ``atol``, they have equal kinds of numbers,
    and differ by at most that. Of an entry of an info, only the robots under its mask ``_NAME`` are
    compared. Tensors are compared as arrays, and an array of observations with a list of them in
    which None stands for what has none.
    """
    if isinstance(want, dict):
        _assert_same_info(found, want, atol, at)
    elif isinstance(want, tuple | list) or _holds_objects(want):
        assert len(found) == len(want), at
        for i, (mine, other) in enumerate(zip(found, want, strict=True)):
            if other is None:
                assert mine is None or not _holds_objects(found), f"{at}[{i}]"
            else:
                assert_same(mine, other, atol, f"{at}[{i}]")
    else:
        mine, other = np.asarray(found), np.asarray(want)
        types = [one.dtype.kind if atol else one.dtype for one in (mine, other)]
        assert types[0] == types[1], at
        assert mine.shape == other.shape, at
        if atol and mine.dtype.kind == "f":
            np.testing.assert_allclose(mine, other, 0.0, atol, err_msg=at)
        else:
            np.testing.assert_array_equal(mine, other, at)


def overwrite(found: Any) -> list[NDArray[Any]]:
    """Write into all arrays that were returned, as their reader may, and return them."""
    if isinstance(found, np.ndarray) and found.dtype.kind != "O":
        found[...] = found.dtype.type(7)
        return [found]
    parts: Any = ()
    if isinstance(found, dict):
        parts = list(found.values())
        found.clear()
    elif isinstance(found, tuple | list | np.ndarray):
        parts = found
    return [array for part in parts for array in overwrite(part)]


def assert_overwritten(arrays: list[NDArray[Any]]) -> None:
    """Refuse arrays into which something was written since :func:`overwrite`."""
    assert all((array == array.dtype.type(7)).all() for array in arrays)


def _assert_same_info(found: Any, want: dict[str, Any], atol: float, at: str) -> None:
    assert isinstance(found, dict), at
    more = set(found) - set(want)
    assert {name.removeprefix("_") for name in more} <= SAID_OF_ALL, f"{at} has {more}"
    assert not set(want) - set(found), f"{at} lacks {set(want) - set(found)}"
    for name in SAID_OF_ALL & set(found):
        if name not in want or f"_{name}" in want:
            _assert_not_late(name, found, want, at)
    for name, value in want.items():
        mask = want.get(f"_{name}")
        if name.startswith("_") and name[1:] in SAID_OF_ALL:
            assert np.asarray(found[name])[np.asarray(value)].all(), f"{at}[{name!r}]"
        elif mask is None or isinstance(value, dict):
            assert_same(found[name], value, atol, f"{at}[{name!r}]")
        else:
            rows: NDArray[np.bool_] = np.asarray(mask)
            mine, other = np.asarray(found[name])[rows], np.asarray(value)[rows]
            assert_same(mine, other, atol, f"{at}[{name!r}]")


def _assert_not_late(name: str, found: dict[str, Any], want: dict[str, Any], at: str) -> None:
    """Refuse a scale, delay or hold of a robot of which the other face says nothing."""
    mine = np.asarray(found[name])
    said = np.asarray(found.get(f"_{name}", np.ones(len(mine), np.bool_)))
    others = said & ~np.asarray(want.get(f"_{name}", np.zeros(len(mine), np.bool_)))
    neutral = 1.0 if name.endswith("scale") else 0.0
    np.testing.assert_array_equal(mine[others], neutral, f"{at}[{name!r}] of whom is not late")


def _holds_objects(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype.kind == "O"
