"""A log is read in a process of its own, whose memory and time are limited.

The libraries that read logs take what a file states: a few kilobytes can fill any memory, or keep a
loop busy for hours. A limit in our code would miss the next such loop of theirs. The process ends
with its parent. It answers on its standard output: a line of JSON for each stream, followed by the
bytes of its columns, and a line with the remarks or the error.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any, BinaryIO, NoReturn

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.utils.storage import DamagedFileError
from aquafish_gym.utils.validation import InvalidArgumentError
from eea.logs.streams import ADVICE, Stream, most_memory, most_seconds

MOST_TEXTS = 2**18  # different texts in all columns together; a column with more is left out
LONGEST_TEXT = 100  # characters of a cell; an error shows fewer
MOST_REMARKS = 100
LONGEST_REMARK = 500  # characters
PARENT_SECONDS = 10.0  # after the deadline, the process ends itself
NEARLY_ALL = 0.9  # of the memory
#: The packages are not run: they load Gymnasium, which takes longer than most logs.
PROGRAM = """
import sys, types
for name, place in zip(("aquafish_gym", "eea"), sys.argv[1:3]):
    sys.modules[name] = types.ModuleType(name)
    sys.modules[name].__path__ = [place]
sys.path[:] = sys.argv[7:]
from eea.logs.child import answer
from eea.logs.tables import read_streams
answer(read_streams, *sys.argv[3:7])
"""
#: One thread: the limit of memory counts what each thread reserves, and so does Arrow's own pool.
ENVIRONMENT = {
    "ARROW_DEFAULT_MEMORY_POOL": "system", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1",
}  # fmt: skip
#: The errors that are raised again by their names; any other is a library's own for damage.
ERRORS = (DamagedFileError, InvalidArgumentError, ImportError, MemoryError)


def read_in_child(path: str, format_name: str, size: int, remarks: list[str]) -> list[Stream]:
    """Return the streams of a log of ``size`` bytes, and add to the remarks on it.

    Raises
    ------
    InvalidArgumentError
        If it takes more time than :func:`most_seconds`, or the library ends the process.
    MemoryError
        If it takes more memory than :func:`most_memory`.
    """
    here = ""
    with contextlib.suppress(OSError):  # the folder was removed
        here = str(Path.cwd())  # a file there may have the name of a library
    packages = [next(iter(sys.modules[name].__path__)) for name in ("aquafish_gym", "eea")]
    places = [place for place in sys.path if place not in ("", here)]
    seconds = most_seconds(size)
    limits = [str(most_memory(size)), str(seconds)]
    words = [*packages, format_name, str(Path(path).resolve()), *limits, *places]
    expired = threading.Event()
    with subprocess.Popen(
        [sys.executable, "-c", PROGRAM, *words],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        env={**os.environ, **ENVIRONMENT},
        creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
    ) as child:  # fmt: skip

        def expire() -> None:
            expired.set()
            child.kill()

        deadline = threading.Timer(seconds, expire)
        deadline.daemon = True
        deadline.start()
        try:
            streams = _received(child.stdout, remarks)  # type: ignore[arg-type]
            if streams is not None:
                return streams
            said = child.stderr.read().decode(errors="replace")  # type: ignore[union-attr]
            code = child.wait()
        finally:
            deadline.cancel()
            child.kill()
    if expired.is_set():
        raise InvalidArgumentError(
            f"reading it must take at most {seconds:.0f} s; it takes longer: {ADVICE}"
        )
    if code == -getattr(signal, "SIGKILL", 0):
        raise MemoryError
    last = (said.strip().splitlines() or [f"code {code}"])[-1]
    raise InvalidArgumentError(
        f"the process that reads it ended ({last}): it is damaged, or takes too much memory"
    )


def _received(answers: BinaryIO, remarks: list[str]) -> list[Stream] | None:
    """Return the streams that the process sends; None if it ended before the last."""
    streams: list[Stream] = []
    for line in iter(answers.readline, b""):
        try:
            found = json.loads(line)
        except ValueError:  # it ended within the line
            return None
        if "error" in found:
            kinds = {kind.__name__: kind for kind in ERRORS}
            raise kinds.get(found["error"], ValueError)(found["text"])
        if "remarks" in found:
            remarks += found["remarks"]
            return streams
        columns = {}
        for name, texts in found["columns"]:
            cells = np.empty(found["rows"], np.float64 if texts is None else np.int32)
            if not _fill(answers, cells):
                return None
            columns[name] = cells if texts is None else np.array([*texts, None], object)[cells]
        streams.append(Stream(found["stream"], columns, found["clocks"], found["units"]))
    return None


def _fill(answers: BinaryIO, cells: NDArray[Any]) -> bool:
    """Read an array's bytes; return whether all of them came."""
    view = cells.view(np.uint8).data
    while len(view):
        count = answers.readinto(view)  # type: ignore[attr-defined]
        if not count:
            return False
        view = view[count:]
    return True


def answer(
    read: Callable[[str, str, list[str]], Iterator[Stream]],
    format_name: str,
    path: str,
    memory: str,
    seconds: str,
) -> NoReturn:
    """Read a log and send its streams; the process ends.

    Parameters
    ----------
    read
        It yields the streams of a log from its path and format, and adds remarks.
    format_name, path
        The log.
    memory, seconds
        The limits, bytes and s.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which ends this
    answers = os.fdopen(os.dup(1), "wb")
    nowhere = os.open(os.devnull, os.O_RDWR)
    for stream in (1, 2):  # libraries in C print past Python's streams
        os.dup2(nowhere, stream)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    most = int(memory)
    _end_after(float(seconds) + PARENT_SECONDS)
    said = io.StringIO()
    remarks: list[str] = []
    lift_limit = _limit_memory(most)
    try:
        with redirect_stdout(said), redirect_stderr(said):
            _send_all(answers, read(path, format_name, remarks), remarks)
        if _memory_was_short(most):
            raise MemoryError
        if said.getvalue():
            remarks.append(f"its library says: {said.getvalue().splitlines()[0]}")
        last: dict[str, Any] = {"remarks": _shortened(remarks)}
    except BaseException as error:
        error.__traceback__ = None  # it holds what took the memory
        lift_limit()
        kind = next((kind for kind in ERRORS if isinstance(error, kind)), type(error))
        # Without memory, a library in C may return without an error of its own.
        short = isinstance(error, SystemError) or _memory_was_short(most)
        if kind not in ERRORS and short:
            kind = MemoryError
        last = {"error": kind.__name__, "text": str(error) or type(error).__name__}
    answers.write(json.dumps(last).encode() + b"\n")
    answers.flush()
    os._exit(0)


def _shortened(remarks: list[str]) -> list[str]:
    shown = [remark[:LONGEST_REMARK] for remark in remarks[:MOST_REMARKS]]
    more = len(remarks) - len(shown)
    return [*shown, f"and {more} more remarks"] if more else shown


def _send_all(answers: BinaryIO, streams: Iterator[Stream], remarks: list[str]) -> None:
    texts = 0
    for stream in streams:
        columns: list[tuple[str, list[Any] | None]] = []
        contents: list[NDArray[Any]] = []
        for name, cells in stream.columns.items():
            words = None
            if cells.dtype == object:
                words, cells = _codes(cells)
                if texts + len(words) > MOST_TEXTS:
                    remarks.append(f"{stream.full_name(name)} has too many texts: it is left out")
                    continue
                texts += len(words)
            columns.append((name, words))
            contents.append(np.ascontiguousarray(cells))
        head = {
            "stream": stream.name, "rows": len(stream), "columns": columns,
            "clocks": dict(stream.clocks), "units": dict(stream.units),
        }  # fmt: skip
        answers.write(json.dumps(head).encode() + b"\n")
        for content in contents:
            answers.write(content.view(np.uint8).data)


def _codes(cells: NDArray[Any]) -> tuple[list[Any], NDArray[np.int32]]:
    """Return the different cells, and the number of each cell among them; of None it is -1."""
    every = cells.tolist()
    try:
        words = {cell: _word(cell) for cell in dict.fromkeys(every)}
    except TypeError:  # a list is no key
        every = [None if cell is None else str(cell) for cell in every]
        words = {cell: _word(cell) for cell in dict.fromkeys(every)}
    numbers: dict[Any, int] = {}
    codes = {
        cell: -1 if cell is None else numbers.setdefault(word, len(numbers))
        for cell, word in words.items()
    }
    return list(numbers), np.fromiter(map(codes.__getitem__, every), np.int32, len(every))


def _word(cell: Any) -> Any:
    """Return a cell as a number or a short text."""
    if not isinstance(cell, str):
        with contextlib.suppress(TypeError, ValueError, OverflowError):
            number = float(cell)
            return number if number == number else np.nan  # one object, which a dict finds
    return str(cell)[:LONGEST_TEXT]


def _end_with_parent() -> None:
    """End the process when the parent does, which holds the other end of standard input."""
    with contextlib.suppress(OSError):
        os.read(0, 1)
    os._exit(1)


def _end_after(seconds: float) -> None:
    """End the process after a time, also in a loop of a library that lets no other thread run."""
    timer = threading.Timer(seconds, os._exit, (1,))
    timer.daemon = True
    timer.start()
    with contextlib.suppress(ImportError, OSError, ValueError):
        import resource

        _, most = resource.getrlimit(resource.RLIMIT_CPU)
        resource.setrlimit(resource.RLIMIT_CPU, (int(seconds) + 1, most))


def _memory_was_short(most: int) -> bool:
    """Return whether a limit of memory was nearly reached.

    A library may drop the error, or raise another, where it finds no memory. The peak that the
    system's resource usage states may be that of the parent.
    """
    with contextlib.suppress(OSError, ValueError, IndexError):
        status = Path("/proc/self/status").read_text(encoding="utf-8", errors="replace")
        _, _, kibibytes = status.partition("VmHWM:")
        return 1024 * int(kibibytes.split()[0]) > NEARLY_ALL * most
    return False  # no Linux, on which the limit does not hold either


def _limit_memory(most: int) -> Callable[[], None]:
    """Limit the memory of this process; return a function that lifts the limit.

    Windows and macOS have no such limit: there, the number of cells and the time are limited.
    """
    try:
        import resource

        before = resource.getrlimit(resource.RLIMIT_DATA)
        held = [limit for limit in before if limit != resource.RLIM_INFINITY]
        resource.setrlimit(resource.RLIMIT_DATA, (min([most, *held]), before[1]))
    except (ImportError, OSError, ValueError):
        return lambda: None
    return lambda: resource.setrlimit(resource.RLIMIT_DATA, before)
