"""Arrays as JSON, to the bit: how the state of a run is written down without pickle."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np

_KEYS = {"array", "dtype", "shape"}
_KINDS = "biufc"  # numbers only: from JSON nothing comes back that could do anything


def pack(value: Any) -> Any:
    """Return nested dicts, lists and arrays with the arrays as JSON objects.

    Examples
    --------
    >>> unpack(pack({"x": np.array([1j, np.nan], np.complex64)}))
    {'x': array([ 0.+1.j, nan+0.j], dtype=complex64)}
    """
    if isinstance(value, np.ndarray):
        content = base64.b64encode(np.ascontiguousarray(value).tobytes()).decode("ascii")
        return {"array": content, "dtype": value.dtype.str, "shape": list(value.shape)}
    if isinstance(value, dict):
        return {key: pack(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [pack(inner) for inner in value]
    return value


def unpack(value: Any) -> Any:
    """Return what ``pack`` was given; tuples come back as lists.

    Raises
    ------
    ValueError, TypeError
        If an array's description is not ``pack``'s.
    """
    if isinstance(value, list):
        return [unpack(inner) for inner in value]
    if not isinstance(value, dict):
        return value
    if value.keys() != _KEYS:
        return {key: unpack(inner) for key, inner in value.items()}
    dtype = np.dtype(value["dtype"])
    if dtype.kind not in _KINDS:
        raise ValueError(f"a packed array must hold numbers; its dtype is {dtype.str}")
    content = base64.b64decode(value["array"], validate=True)
    return np.frombuffer(content, dtype).reshape(value["shape"]).copy()
