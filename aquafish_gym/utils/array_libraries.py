"""Array libraries: NumPy, and others such as PyTorch and JAX on a device.

None of the others is a dependency, and none is imported here: a program that steps its arrays has
imported it.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import numpy as np

from aquafish_gym.utils.validation import InvalidArgumentError


class NumPyLibrary:
    """NumPy, whose arrays may be written to and looked at without waiting."""

    xp: Any = np  # of the class: a module is neither copied nor pickled
    on_host = True  #: Whether Python may look at numbers.

    def put(self, values: Any, dtype: str) -> Any:
        """Return numbers as an array of a type such as "float32"."""
        return np.asarray(values, dtype)

    def cast(self, array: Any, dtype: Any) -> Any:
        """Return an array of another type, rounded where that is of whole numbers."""
        if array.dtype == dtype:
            return array
        return (array if np.dtype(dtype).kind == "f" else np.rint(array)).astype(dtype)

    def rows(self, table: Any, indices: Any) -> Any:
        """Return the rows of a table that indices (B,) select."""
        return table.take(indices, axis=0)

    def put_at(self, table: Any, index: Any, rows: Any) -> Any:
        """Return a table (D, B, C) with rows (B, C) in the entry ``index``: one, or (B, 1)."""
        if isinstance(index, int):
            table[index] = rows
        else:
            table[index[:, 0], np.arange(len(index))] = rows
        return table

    def clip(self, numbers: Any, low: Any, high: Any) -> Any:
        """Return numbers within bounds."""
        return np.minimum(np.maximum(numbers, low), high)  # np.clip takes five times as long

    def copy(self, array: Any) -> Any:
        """Return a copy."""
        return np.array(array)

    def compiled(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return the function."""
        return function


class ArrayLibrary:
    """The library of an array and the device on which it lies, with the methods of NumPy's.

    Parameters
    ----------
    like
        An array.
    seed
        Of the random numbers, which are drawn on the device.

    Raises
    ------
    InvalidArgumentError
        If the array is of none of PyTorch, JAX, and the libraries of the array API standard that
        draw random numbers as NumPy does, such as CuPy.
    """

    on_host = False

    def __init__(self, like: Any, seed: int) -> None:
        self._device = getattr(like, "device", None)
        library = type(like).__module__.partition(".")[0]
        self._torch: Any = sys.modules["torch"] if library == "torch" else None
        # torch has no ``__array_namespace__``; its module has the functions that are needed here.
        namespace = getattr(like, "__array_namespace__", lambda: self._torch)()
        self._jax: Any = sys.modules["jax"] if library in ("jax", "jaxlib") else None
        if namespace is None or (not hasattr(namespace, "random") and self._jax is None):
            raise InvalidArgumentError(
                "env must observe arrays of NumPy, PyTorch, JAX or CuPy; "
                f"got {type(like).__module__}.{type(like).__name__}"
            )
        self.xp: Any = namespace
        self._generator: Any
        if self._torch is not None:
            self._generator = self._torch.Generator(self._device).manual_seed(seed)
        elif self._jax is not None:
            self._generator = self._jax.random.key(seed)
        else:
            self._generator = self.xp.random.default_rng(seed)

    def put(self, values: Any, dtype: str) -> Any:
        """Return numbers as an array on the device, of a type such as "float32"."""
        return self.xp.asarray(values, dtype=getattr(self.xp, dtype), device=self._device)

    def cast(self, array: Any, dtype: Any) -> Any:
        """Return an array of another type, rounded where that is of whole numbers."""
        if array.dtype == dtype:
            return array
        if "float" not in str(dtype):
            array = self.xp.round(array)
        return array.to(dtype) if self._torch is not None else array.astype(dtype)

    def rows(self, table: Any, indices: Any) -> Any:
        """Return the rows of a table that indices (B,) select."""
        # torch's own function takes a third of the time of its indexing.
        return table[indices] if self._torch is None else table.index_select(0, indices)

    def put_at(self, table: Any, index: Any, rows: Any) -> Any:
        """Return a table (D, B, C) with rows (B, C) in the entry ``index``."""
        if self._jax is not None:
            return table.at[index].set(rows)
        table[index] = rows
        return table

    def clip(self, numbers: Any, low: Any, high: Any) -> Any:
        """Return numbers within bounds."""
        return self.xp.clip(numbers, low, high)

    def copy(self, array: Any) -> Any:
        """Return a copy that may be written to; JAX's arrays cannot be."""
        if self._jax is not None:
            return array
        return array.clone() if self._torch is not None else array.copy()

    def normal(self, shape: tuple[int, ...]) -> Any:
        """Return standard normal numbers of single precision."""
        if self._torch is not None:
            return self._torch.randn(shape, generator=self._generator, device=self._device)
        if self._jax is not None:
            return self._jax.random.normal(self._next_key(), shape, "float32")
        return self._generator.standard_normal(shape, np.float32)

    def compiled(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return a function of arrays; JAX compiles it, since it is slow where nothing is."""
        found: Callable[..., Any] = function if self._jax is None else self._jax.jit(function)
        return found

    def _next_key(self) -> Any:
        self._generator, key = self._jax.random.split(self._generator)
        return key
