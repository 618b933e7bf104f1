"""The cache of compiled kernels in the user's cache folder, never in the installation.

The folder is ``aquafish`` in ``NUMBA_CACHE_DIR`` if that is set, otherwise in the system's cache
folder of the user. Each kernel has files of its own, named by a hash of its sources, the types of
its arguments, the processor, and the versions of Python and numba. So processes, versions and
machines may share the folder. When the folder is too large, the least recently used files are
removed.
"""

from __future__ import annotations

import functools
import hashlib
import inspect
import os
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from types import CodeType
from typing import Any

import numba
import numpy as np
from numba.core.caching import (
    CompileResultCacheImpl,
    FunctionCache,
    IndexDataCacheFile,
    _CacheLocator,
)
from platformdirs import user_cache_path

MAXIMUM_CACHE_BYTES = 256 * 2**20  # of kernels on disk; one version takes about 10 MB
KEPT_SECONDS = 3600.0  # younger files are never removed
ADVICE = "set NUMBA_CACHE_DIR to a folder that can be written"


def cache_folder() -> Path:
    """Return the folder of compiled code, which may not exist."""
    if numba.config.CACHE_DIR:
        return Path(numba.config.CACHE_DIR) / "aquafish"
    return user_cache_path("aquafish", appauthor=False) / "kernels"


@functools.cache
def why_nothing_is_kept(folder: Path) -> str:
    """Return the reason why a folder takes no files, or ""; a missing folder is created."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return ""
    except OSError as error:
        return f"{folder} cannot be written ({error.strerror})"


def module_source(module: Any) -> bytes:
    """Return the source of a module, from a file or a zip.

    It is the present source of the module's file, or its bytecode without a source. A module
    without a file, such as that of ``python -c``, has an empty source.
    """
    name = getattr(module, "__file__", None)
    loader = getattr(module, "__loader__", None)
    if name is None:
        return b""
    if loader is not None and hasattr(loader, "get_data"):
        return bytes(loader.get_data(name))
    return Path(name).read_bytes()


def module_values(module: Any) -> bytes:
    """Return a hash of what compiled code freezes of a module as it is in this process.

    That is its numbers, arrays and functions. They differ from the file's if the file was edited
    after the import, or if a program has set a constant.
    """
    digest = hashlib.sha256()
    for name, value in sorted(vars(module).items()):
        if not name.startswith("__"):
            for text in _frozen(value, module.__name__, set()):
                digest.update(f"{name} {text}\n".encode())
    return digest.digest()


def _frozen(value: Any, module: str, seen: set[int]) -> Iterator[str]:
    """Yield texts of what compiled code may freeze of a value, the same in every process."""
    value = inspect.unwrap(value) if callable(value) else value
    if isinstance(value, bool | int | float | complex | np.generic):
        yield repr(value)
    elif isinstance(value, np.ndarray) and not value.dtype.hasobject:
        yield f"{value.dtype} {value.shape} {hashlib.sha256(value.tobytes()).hexdigest()}"
    elif isinstance(value, tuple):
        yield f"tuple {len(value)}"
        for each in value:
            yield from _frozen(each, module, seen)
    elif inspect.isfunction(value) and id(value) not in seen:
        seen.add(id(value))
        yield _code_text(value.__code__)
        yield from _frozen(value.__defaults__ or (), module, seen)
        for cell in value.__closure__ or ():
            with suppress(ValueError):  # an empty cell
                yield from _frozen(cell.cell_contents, module, seen)
    elif inspect.isclass(value) and value.__module__ == module and id(value) not in seen:
        seen.add(id(value))
        for name, member in sorted(vars(value).items()):
            if not name.startswith("__"):
                own = getattr(member, "__func__", member)  # of a static method
                for text in _frozen(own, module, seen):
                    yield f"{name} {text}"


@functools.cache
def _code_text(code: CodeType) -> str:
    """Return a text of a function's code, without its place in a file."""
    constants = [
        _code_text(x)
        if isinstance(x, CodeType)
        else repr(sorted(map(repr, x)) if isinstance(x, frozenset) else x)
        for x in code.co_consts
    ]
    return repr((code.co_code, constants, code.co_names, code.co_varnames, code.co_freevars))


class _Locator(_CacheLocator):  # type: ignore[misc]
    """Locates a function's kernels for numba, without access to the function's file."""

    def __init__(self, function: Callable[..., Any], file: str) -> None:
        self._function = function
        self._py_file = file

    @classmethod
    def from_function(cls, function: Callable[..., Any], file: str) -> _Locator:
        return cls(function, file)

    def ensure_cache_path(self) -> None:
        cache_folder().mkdir(parents=True, exist_ok=True)

    def get_cache_path(self) -> str:
        return str(cache_folder())

    def get_source_stamp(self) -> str:
        return ""  # KernelCache has one

    def get_disambiguator(self) -> str:
        return str(self._function.__code__.co_firstlineno)


class _Implementation(CompileResultCacheImpl):  # type: ignore[misc]
    _locator_classes = (_Locator,)


class KernelCache(FunctionCache):  # type: ignore[misc]
    """A cache with an index for each kernel, so that processes may compile at the same time.

    numba keeps one index for all kernels that are defined at one line. Two processes that write it
    at the same time may give their kernels the same file; one kernel then runs as the other.
    """

    _impl_class = _Implementation

    def __init__(
        self, function: Callable[..., Any], stamp: str, unkept: Callable[[str], None]
    ) -> None:
        """Make the cache of a function; ``stamp`` is a hash of its sources.

        ``unkept`` is called with the reason when a kernel cannot be saved.
        """
        super().__init__(function)
        self._unkept = unkept
        self._cache_file = _IndexOfEach(self.cache_path, self._impl.filename_base, stamp)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # the file is damaged: the kernel is compiled and written again
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Save a kernel, or report the reason if that fails, such as a full disk."""
        try:
            super().save_overload(sig, data)
        except OSError as error:
            self._unkept(f"{self.cache_path} cannot be written ({error.strerror})")
        else:
            prune(Path(self.cache_path))


class _IndexOfEach(IndexDataCacheFile):  # type: ignore[misc]
    def save(self, key: Any, data: Any) -> None:
        own = self._of(key)
        try:
            own.save(key, data)
        except OSError:
            raise
        except Exception:  # the index is damaged
            own.flush()
            own.save(key, data)

    def load(self, key: Any) -> Any:
        own = self._of(key)
        data = own.load(key)
        if data is not None:
            for name in (own._index_name, own._data_name(1)):
                with suppress(OSError):  # a shared folder may be read-only
                    os.utime(Path(self._cache_path) / name)
        return data

    def _of(self, key: Any) -> IndexDataCacheFile:
        whole = repr((self._source_stamp, numba.__version__, key))
        name = hashlib.sha256(whole.encode()).hexdigest()[:16]
        base = self._index_name.removesuffix(".nbi")
        return IndexDataCacheFile(self._cache_path, f"{base}.{name}", self._source_stamp)


def prune(folder: Path, most_bytes: int = MAXIMUM_CACHE_BYTES) -> None:
    """Remove the least recently used files until the others fit.

    A process that is about to read a removed file compiles its kernel instead.
    """
    files: list[tuple[float, int, str]] = []
    with suppress(OSError):
        for entry in os.scandir(folder):
            with suppress(OSError):  # another process has removed it
                status = entry.stat(follow_symlinks=False)
                files.append((status.st_mtime, status.st_size, entry.path))
    held = sum(size for _, size, _ in files)
    now = time.time()
    for used, size, path in sorted(files):
        if held <= most_bytes or now - used < KEPT_SECONDS:
            return
        with suppress(OSError):
            Path(path).unlink()
        held -= size
