"""Compile the physics, the same function objects that plain Python runs, and cache it on disk.

A kernel is compiled when it is first called. On a new machine a command compiles one to six
kernels of about 4 s of CPU time each; one message on stderr announces all of them. The next process
loads them in under a second from the user's cache folder; see ``kernel_cache``.
"""

from __future__ import annotations

import ast
import contextlib
import functools
import hashlib
import inspect
import multiprocessing
import pkgutil
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

from numba import config, njit
from numba.core import event

from aquafish_gym.physics.simd import PRIMITIVES, inlined
from aquafish_gym.utils.interrupts import kept_interrupts
from aquafish_gym.utils.kernel_cache import (
    ADVICE,
    KernelCache,
    cache_folder,
    module_source,
    module_values,
    why_nothing_is_kept,
)
from aquafish_gym.utils.validation import EngineUnavailableError

# All except those that compile or print the others.
PHYSICS_MODULES = [
    import_module(f"{__package__}.{found.name}")
    for found in pkgutil.iter_modules([str(Path(__file__).parent)])
    if found.name not in ("simd", "compiling", "symbols", "printing", "law")
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
def _register_function(function: Callable[..., Any]) -> None:
    inlined(function)


def register_functions(*functions: Callable[..., Any]) -> None:
    """Let compiled code call functions, such as those of a plan's law."""
    for function in functions:
        _register_function(function)


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


def compiled(
    function: Callable[..., Any], slow: bool = False, stamp: str = "", **options: Any
) -> Any:
    """Return a function that is compiled on its first call and cached on disk where possible.

    The first compilation of a ``slow`` function in a process prints a notice on stderr. The cache's
    key has ``stamp``, a :func:`source_stamp` that the function's closure does not have.
    ``options`` are those of ``numba.njit``.
    """
    found = njit(no_cfunc_wrapper=True, **options)(function)
    stamp = _module_stamp(function.__module__) + stamp
    found._cache = KernelCache(function, stamp, _say_unkept)
    if slow:
        _slow.add(function)
        _listen()
    return found


def check_compiler() -> None:
    """Raise EngineUnavailableError if numba does not compile: lanes do not exist in Python."""
    if config.DISABLE_JIT:
        raise EngineUnavailableError(
            "the compiled engine and controllers need numba's compiler, which NUMBA_DISABLE_JIT "
            "turns off; unset it"
        )


NOTICE = "compiling the physics for this machine, once: up to a minute in all ..."
NOTICE_UNKEPT = (
    "compiling the physics, in every process: up to a minute in all; nothing is kept, because "
    f"{{reason}}: {ADVICE} ..."
)
_slow: set[Callable[..., Any]] = set()


class _Announcer(event.Listener):  # type: ignore[misc]
    """Prints ``NOTICE`` before the first slow compilation, except in worker processes.

    No Ctrl-C is lost during a compilation.
    """

    def __init__(self) -> None:
        self._kept: list[contextlib.ExitStack] = []

    def on_start(self, started: Any) -> None:
        self._kept.append(contextlib.ExitStack())
        self._kept[-1].enter_context(kept_interrupts())
        if started.data["dispatcher"].py_func in _slow:
            _announce()

    def on_end(self, ended: Any) -> None:  # noqa: ARG002
        self._kept.pop().close()


@functools.cache
def _announce() -> None:
    reason = why_nothing_is_kept(cache_folder())
    say(NOTICE_UNKEPT.format(reason=reason) if reason else NOTICE)


@functools.cache
def _say_unkept(reason: str) -> None:
    """Say once that a kernel could not be saved, unless that has been announced."""
    if not why_nothing_is_kept(cache_folder()):
        say(f"the compiled physics is not kept, because {reason}: {ADVICE}")


def say(sentence: str) -> None:
    """Print a sentence on stderr, except in worker processes."""
    if sys.stderr is not None and multiprocessing.parent_process() is None:
        print(sentence, file=sys.stderr, flush=True)


@functools.cache
def _listen() -> None:
    event.register("numba:compile", _Announcer())


def source_stamp(*functions: Any) -> str:
    """Return a hash of the physics, of this file and of the modules of ``functions``.

    It includes all that they import from their packages, because compiled code freezes the
    constants there, such as the servos' bounds. It covers the files, and the functions and
    constants that this process has: a file may be edited after its import. numba's cache watches
    only the file of the cached function, but a function's closure is part of the cache's key.
    Kernels close over this stamp, so none is of other physics than the process that asks for it.
    """
    return _stamp(*(sys.modules[function.__module__] for function in functions))


def _stamp(*modules: ModuleType) -> str:
    """Return :func:`source_stamp` for modules."""
    todo = [*PHYSICS_MODULES, sys.modules[__name__], *modules]
    packages = {m.__name__.partition(".")[0] for m in todo}
    stamps: dict[str, bytes] = {}
    while todo:
        module = todo.pop()
        if getattr(module, "__file__", None) is None or module.__name__ in stamps:
            continue
        source = module_source(module)
        stamps[module.__name__] = source + module_values(module)
        found = {name for name in _imported(source) if name.partition(".")[0] in packages}
        todo += [sys.modules[name] for name in found if name in sys.modules]
    digest = hashlib.sha256()
    for name in sorted(stamps):
        digest.update(stamps[name])
    return digest.hexdigest()


@functools.cache
def _module_stamp(module: str) -> str:
    """Return the stamp of the sources of a module's functions, as they were at first."""
    return _stamp(sys.modules[module])


@functools.cache
def _imported(source: bytes) -> frozenset[str]:
    """Return the names that a source imports when it is imported; some may not be modules.

    Imports within functions and for type checkers are left out: compiled code freezes nothing of
    theirs, and whether they are loaded depends on what a process did before.
    """
    try:
        todo: list[ast.AST] = [ast.parse(source)]
    except (SyntaxError, ValueError):  # bytecode without its source
        return frozenset(sys.modules)
    names: set[str] = set()
    while todo:
        node = todo.pop()
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        elif isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            todo += node.orelse
        elif not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            todo += ast.iter_child_nodes(node)
    return frozenset(names)
