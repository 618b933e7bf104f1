"""Jobs: parts of long work that each write one file.

A *job* is a small frozen description with a name for people and a file, relative to the folder. Its
*work* is a pure function of a module that takes the job and returns a dictionary ready for JSON. So
a job can run in any process of any machine, and more than once, with the same bytes as its result.
A result is written when it arrives: an interruption costs only the running jobs, and the same
command resumes. Times are not results: the entry ``seconds`` goes to a file of its own.
"""

from __future__ import annotations

import sys
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Protocol, TypeVar

from aquafish_gym.runs.progress import every
from aquafish_gym.runs.workers import POLL_SECONDS, Workers, workers
from aquafish_gym.utils.storage import (
    decode_document,
    encode_document,
    read_document,
    write_bytes,
    write_document,
)
from aquafish_gym.utils.validation import InvalidArgumentError, printable

RESULT_SCHEMA = "aquafish.result/1"
TIMES_SCHEMA = "aquafish.times/1"
TRIES = 3  # starts of an unfinished job if worker processes die
SILENT_SECONDS = 25.0  # s, longest time without a line
COMPILING = "what is not compiled yet compiles first, for up to a minute"  # in every worker
_LONGEST = 300  # characters in the reason of a failure


class Report(Protocol):
    """Takes a line, and the number of jobs by which the bar advances."""

    def __call__(self, text: str, ended: int) -> None: ...


class JobLike(Protocol):
    """A job's name for people, and its file, with slashes."""

    @property
    def name(self) -> str: ...

    @property
    def file(self) -> str: ...


Job = TypeVar("Job", bound=JobLike)


def run_jobs(
    jobs: Sequence[Job],
    work: Callable[[Job], dict[str, Any]],
    folder: Path,
    *,
    count: int | None = None,
    scheduler: str | None = None,
    warm_up: Callable[[Sequence[Job]], object] = lambda _jobs: None,
    describe: Callable[[dict[str, Any]], str] = lambda _result: "",
) -> list[str]:
    """Run the jobs whose files are missing, in order; return a sentence for each that failed.

    Progress goes to stderr. No result depends on the workers.

    Parameters
    ----------
    folder
        Folder of the results, locked by ``manifest.lock``.
    count, scheduler
        Worker processes, or the address of a dask scheduler; see ``workers.workers``.
    warm_up
        Called with the missing jobs before any of them runs, for example to compile kernels.
    describe
        Returns the main number of a result, for the progress bar.

    Raises
    ------
    KeyboardInterrupt
        On Ctrl-C or SIGTERM; the message has the number of remaining jobs.
    OSError
        If processes cannot start or die repeatedly, a cluster is lost, or a file cannot be
        written.
    """
    done = finished(folder, jobs)
    left = [job for job in jobs if job not in done]
    failures: list[str] = []
    for job in left:
        if (folder / job.file).exists():
            again = f"damaged: {folder / job.file}; {job.name} runs again"
            print(printable(again), file=sys.stderr)

    def run_left(report: Report) -> None:
        with workers(count, scheduler, work) as executor:
            warm_up(list(left))
            futures = {executor.submit(run_job, work, job): job for job in left}
            for future in _as_completed(futures, executor, partial(report, ended=0)):
                job = futures[future]
                content, reason = _answer(future)
                if content is None:
                    failures.append(f"{job.name}: {' '.join(reason.split())[:_LONGEST]}")
                    report(f"failed: {failures[-1]}", 1)
                else:
                    path = folder / job.file
                    result = decode_document(content, job.name, RESULT_SCHEMA)
                    if "seconds" in result:
                        times = {"seconds": result.pop("seconds")}
                        write_document(_times(path), times, TIMES_SCHEMA)
                        content = encode_document(result, RESULT_SCHEMA)
                    write_bytes(path, content)
                    report(f"{job.name}  {describe(result)}".rstrip(), 1)
                left.remove(job)

    tries = 0
    try:
        with _progress(left, len(jobs)) as report:
            while left:
                try:
                    run_left(report)
                except BrokenProcessPool:
                    tries += 1
                    if tries == TRIES:
                        raise OSError(
                            f"worker processes died {TRIES} times, as for lack of memory; the same "
                            "command resumes"
                        ) from None
                    report("a worker process died; the unfinished jobs start again", 0)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(
            f"interrupted with {len(left)} of {len(jobs)} jobs to do; the same command resumes"
        ) from None
    return failures


def exit_if_failed(failures: Sequence[str]) -> None:
    """Print the failures of :func:`run_jobs`; raise SystemExit(1) if there are any."""
    for failure in failures:
        print(printable(f"failed: {failure}"), file=sys.stderr)
    if failures:
        raise SystemExit(1)


def finished(folder: Path, jobs: Iterable[Job]) -> set[Job]:
    """Return the jobs with complete files."""
    done = set()
    for job in jobs:
        try:
            if read_result(folder, job) is not None:
                done.add(job)
        except InvalidArgumentError:
            continue
    return done


def read_result(folder: Path, job: JobLike) -> dict[str, Any] | None:
    """Return a job's result, or ``None`` without a file; other content raises DamagedFileError."""
    path = folder / job.file
    if not path.exists():
        return None
    times = read_document(_times(path), TIMES_SCHEMA, "times") if _times(path).exists() else {}
    return read_document(path, RESULT_SCHEMA, "result") | times


def _times(path: Path) -> Path:
    """Return the file of times for the file of a result."""
    return path.with_suffix(".times.json")


def run_job(work: Callable[[Any], dict[str, Any]], job: JobLike) -> tuple[bytes | None, str]:
    """Run a job; return the bytes of its file, or ``None`` and the reason."""
    try:
        return encode_document(work(job), RESULT_SCHEMA), ""
    except (Exception, SystemExit) as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{Path(place.filename).name}, line {place.lineno}"
        return None, f"{type(error).__name__}: {error} ({where})"


def _as_completed(
    futures: Iterable[Future[Any]], executor: Workers, say: Callable[[str], None]
) -> Iterator[Future[Any]]:
    """Yield futures as they end, and watch the workers meanwhile."""
    pending = set(futures)
    while pending:
        done, pending = wait(pending, POLL_SECONDS, FIRST_COMPLETED)
        yield from done
        executor.check(say)


def _answer(future: Future[tuple[bytes | None, str]]) -> tuple[bytes | None, str]:
    """Return the result of :func:`run_job`, or the reason for its failure."""
    try:
        return future.result()
    except BrokenProcessPool:
        raise
    except CancelledError:
        raise OSError("the workers have gone") from None
    except Exception as error:  # such as dask's KilledWorker, with advice of its own
        return None, f"{type(error).__name__}: {error}".partition(". ")[0]


@contextmanager
def _progress(left: Sequence[JobLike], jobs: int) -> Iterator[Report]:
    """Show a bar on a terminal, or a line for each finished job and each half minute elsewhere.

    ``left`` shrinks as jobs end: its first is the one that has run the longest.
    """
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    console = Console(stderr=True)
    columns = (BarColumn(24), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    text = TextColumn("{task.description}", markup=False)
    total = len(left)
    done = 0
    began = time.monotonic()
    said = time.monotonic()
    with Progress(*columns, text, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task("", total=total)

        def report(text: str, ended: int) -> None:
            nonlocal done, said
            done += ended
            bar.update(task, completed=done, description=text)
            if bar.disable:
                count = f"{done}/{total}  " if ended else ""
                said = time.monotonic()
                print(f"{count}{text}", file=sys.stderr, flush=True)

        def beat() -> None:
            now = time.monotonic()
            if bar.disable and left and now - said >= SILENT_SECONDS:
                report(f"{done}/{total}  {now - began:.0f} s; {left[0].name} still runs", 0)

        if total:
            report(f"{jobs} jobs, {jobs - total} done already, {total} to do; {COMPILING}", 0)
        with every(min(5.0, SILENT_SECONDS), beat):  # is a line due?
            yield report
