"""Compiling the physics: the very function objects that plain Python runs, kept on disk.

A kernel is compiled when it is first called, which takes a minute the first time on a machine and
is then said on stderr. numba keeps what it compiled beside the sources, and the next process
loads it from there in under a second.
"""

from __future__ import annotations

import ast
import functools
import hashlib
import inspect
import multiprocessing
import sys
from collections.abc import Callable, Iterator
from types import ModuleType
from typing import Any

from numba import njit
from numba.core import event

from aquafish_gym.physics import (
    added_mass,
    arithmetic,
    attitude,
    dynamics,
    hydrodynamics,
    kinematics,
    layout,
    reactive,
    robot,
)
from aquafish_gym.physics.simd import PRIMITIVES, inlined

PHYSICS_MODULES = (
    arithmetic,
    robot,
    kinematics,
    attitude,
    layout,
    hydrodynamics,
    dynamics,
    added_mass,
    reactive,
)


def register_module(module: ModuleType) -> None:
    """Let compiled code call every plain function that a module defines."""
    for function in vars(module).values():
        if (
            inspect.isfunction(function)
            and function.__module__ == module.__name__
            and function not in PRIMITIVES
        ):
            inlined(function)


@functools.cache
def register() -> None:
    """Let compiled code call the physics."""
    for module in PHYSICS_MODULES:
        register_module(module)


def compiled(function: Callable[..., Any], seconds: float = 0.0, **options: Any) -> Any:
    """Return a function compiled, and kept on disk where there is a place for that.

    Compilation itself is lazy. ``seconds`` is about how long it takes; of a function that takes
    some, it is said on stderr when it begins. ``options`` are those of ``numba.njit``.
    """
    try:
        found = njit(cache=True, **options)(function)
    except RuntimeError:  # nowhere to keep a cache: compile anew in every process
        found = njit(**options)(function)
    if seconds:
        _long_ones[function] = seconds
        _announce()
    return found


_long_ones: dict[Callable[..., Any], float] = {}


class _Announcer(event.Listener):  # type: ignore[misc]
    """Says that a minute of silence begins, in the process that the user looks at."""

    def on_start(self, begun: Any) -> None:
        seconds = _long_ones.get(begun.data["dispatcher"].py_func)
        if seconds and sys.stderr is not None and multiprocessing.parent_process() is None:
            print(f"compiling the physics once, about {seconds:.0f} s ...", file=sys.stderr)

    def on_end(self, ended: Any) -> None:
        """Say nothing: what was compiled goes on at once."""


@functools.cache
def _announce() -> None:
    event.register("numba:compile", _Announcer())


def source_stamp(*functions: Any) -> str:
    """Return a hash of the sources of the physics, of this file and of ``functions``.

    With them go the sources of all that they import, directly or not, from this package and
    from the packages of ``functions``: compiled code freezes the constants that it finds
    there, as a network does the servos' bounds.

    numba's cache watches only the file of the cached function itself. Kernels close over this
    stamp, and closures are part of the cache's key, so a kernel is never older than its
    physics.
    """
    modules = [*PHYSICS_MODULES, inspect.getmodule(source_stamp)]
    modules += [inspect.getmodule(f) for f in functions]
    todo = [m for m in modules if m is not None]
    packages = {m.__name__.partition(".")[0] for m in todo}
    sources: dict[str, bytes] = {}
    while todo:
        module = todo.pop()
        if module.__file__ is None or module.__name__ in sources:
            continue
        with open(module.__file__, "rb") as file:  # noqa: PTH123
            source = sources[module.__name__] = file.read()
        found = {name for name in _imported(source) if name.partition(".")[0] in packages}
        todo += [sys.modules[name] for name in found if name in sys.modules]
    digest = hashlib.sha256()
    for name in sorted(sources):
        digest.update(sources[name])
    return digest.hexdigest()


def _imported(source: bytes) -> Iterator[str]:
    """Yield the names of what a source imports, some of which may be no modules."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
