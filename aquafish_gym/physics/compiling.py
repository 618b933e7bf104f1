"""Compile the physics, the same function objects that plain Python runs, and cache it on disk.

A kernel is compiled when it is first called. On a new machine a command compiles one to six
kernels of about 4 s of CPU time each; one message on stderr announces all of them. numba keeps
compiled code beside the sources, and the next process loads it from there in under a second.
"""

from __future__ import annotations

import _thread
import ast
import functools
import hashlib
import inspect
import multiprocessing
import pkgutil
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

from numba import njit
from numba.core import event
from numba.core.caching import FunctionCache, IndexDataCacheFile

from aquafish_gym.physics.simd import PRIMITIVES, inlined

# All except the two that compile the others.
PHYSICS_MODULES = [
    import_module(f"{__package__}.{found.name}")
    for found in pkgutil.iter_modules([str(Path(__file__).parent)])
    if found.name not in ("simd", "compiling")
]


@functools.cache
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
def compiled_function(function: Callable[..., Any], slow: bool = False, **options: Any) -> Any:
    """Return a module's function as :func:`compiled`, tied to the sources of the physics."""
    register()
    inlined(function)
    stamp = source_stamp(function)

    def call(*args: Any) -> Any:
        stamp  # noqa: B018  # part of the cache's key; see source_stamp
        return function(*args)

    return compiled(call, slow, **options)


@functools.cache
def register() -> None:
    """Let compiled code call the physics."""
    for module in PHYSICS_MODULES:
        register_module(module)


def compiled(function: Callable[..., Any], slow: bool = False, **options: Any) -> Any:
    """Return a function that is compiled on its first call and cached on disk where possible.

    The first compilation of a ``slow`` function in a process prints a notice on stderr.
    ``options`` are those of ``numba.njit``.
    """
    found = njit(**options)(function)
    with suppress(RuntimeError):  # nowhere to keep a cache: compile in every process
        found._cache = _Cache(function)
    if slow:
        _slow.add(function)
        _listen()
    return found


class _Cache(FunctionCache):  # type: ignore[misc]
    """A cache whose kernels have an index each, so that processes may compile at the same time.

    numba keeps one index for all kernels that are defined at one line. Two processes that add to
    it at once may give their kernels the same file, and one is then called as the other.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._cache_file = _IndexOfEach(
            self.cache_path, self._impl.filename_base, self._impl.locator.get_source_stamp()
        )


class _IndexOfEach(IndexDataCacheFile):  # type: ignore[misc]
    def save(self, key: Any, data: Any) -> None:
        self._of(key).save(key, data)

    def load(self, key: Any) -> Any:
        return self._of(key).load(key)

    def _of(self, key: Any) -> IndexDataCacheFile:
        name = hashlib.sha256(repr((self._source_stamp, key)).encode()).hexdigest()[:16]
        base = self._index_name.removesuffix(".nbi")
        return IndexDataCacheFile(self._cache_path, f"{base}.{name}", self._source_stamp)


NOTICE = "compiling the physics for this machine, once: up to a minute in all ..."
_slow: set[Callable[..., Any]] = set()


def _ask_again(found: Any) -> None:
    """Interrupt again after a Ctrl-C during a callback of LLVM, which drops it."""
    if isinstance(found.exc_value, KeyboardInterrupt):
        threading.Timer(0.05, _thread.interrupt_main).start()
    else:
        sys.__unraisablehook__(found)


class _Announcer(event.Listener):  # type: ignore[misc]
    """Prints ``NOTICE`` before the first slow compilation, except in worker processes.

    No Ctrl-C is lost during a compilation.
    """

    def __init__(self) -> None:
        self._hooks: list[Any] = []

    def on_start(self, started: Any) -> None:
        self._hooks.append(sys.unraisablehook)
        sys.unraisablehook = _ask_again
        if started.data["dispatcher"].py_func in _slow:
            _announce()

    def on_end(self, ended: Any) -> None:  # noqa: ARG002
        sys.unraisablehook = self._hooks.pop()


@functools.cache
def _announce() -> None:
    if sys.stderr is not None and multiprocessing.parent_process() is None:
        print(NOTICE, file=sys.stderr, flush=True)


@functools.cache
def _listen() -> None:
    event.register("numba:compile", _Announcer())


def source_stamp(*functions: Any) -> str:
    """Return a hash of the sources of the physics, of this file and of ``functions``.

    It includes all that they import from their packages, because compiled code freezes the
    constants there, such as the servos' bounds. numba's cache watches only the file of the cached
    function, but a function's closure is part of the cache's key. Kernels close over this stamp,
    so none is older than its physics.
    """
    todo = [*PHYSICS_MODULES, *(sys.modules[f.__module__] for f in (source_stamp, *functions))]
    packages = {m.__name__.partition(".")[0] for m in todo}
    sources: dict[str, bytes] = {}
    while todo:
        module = todo.pop()
        if module.__file__ is None or module.__name__ in sources:
            continue
        source = sources[module.__name__] = Path(module.__file__).read_bytes()
        found = {name for name in _imported(source) if name.partition(".")[0] in packages}
        todo += [sys.modules[name] for name in found if name in sys.modules]
    digest = hashlib.sha256()
    for name in sorted(sources):
        digest.update(sources[name])
    return digest.hexdigest()


@functools.cache
def _imported(source: bytes) -> frozenset[str]:
    """Return the names that a source imports; some may not be modules."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return frozenset(names)
