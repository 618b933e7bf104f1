"""Jobs: long work in parts, each of which ends with a file of its own.

A *job* is a small frozen description with a name for people and a file, relative to the folder. Its
*work* is a pure function of a module that takes the job and returns a dictionary ready for JSON. So
a job can run in any process of any machine, and more than once, with the same bytes as its result.
A result is written when it arrives: an interruption costs only the running jobs, and the same
command resumes. Times are not results: what the work returns under ``seconds`` goes to a file
beside the result's, see :func:`read_seconds`.
"""

from __future__ import annotations

import queue
import sys
import traceback
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError, Executor, Future
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol, TypeVar

from aquafish_gym.runs.storage import (
    DamagedFileError,
    decode_document,
    encode_document,
    read_document,
    write_bytes,
    write_document,
)
from aquafish_gym.runs.workers import WorkerDiedError, interrupts, workers
from aquafish_gym.utils.validation import InvalidArgumentError

SCHEMA = "aquafish.result/1"
SECONDS = "aquafish.seconds/1"
TRIES = 3  # how often a job whose workers die is started
_TICK = 0.5  # s; the longest that Ctrl-C may have to wait
_LONGEST = 300  # characters of a failure's reason

Answer = tuple[bytes | None, Any, str]  # a result's file, its times, and why there is none
Report = Callable[[str, int], None]  # a line, and by how many jobs the bar advances


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
        Locked by ``manifest.lock``.
    count, scheduler
        Worker processes, or the address of a dask scheduler; see ``workers.workers``.
    warm_up
        Takes the missing jobs before any of them runs, as to compile for all workers.
    describe
        Returns the number that matters in a result, for the progress bar.

    Raises
    ------
    KeyboardInterrupt
        On Ctrl-C or SIGTERM, with the number of jobs left.
    OSError
        If no process can start, a cluster has gone, or a file cannot be written.
    """
    assert len({job.file for job in jobs}) == len(jobs), "each job needs a file of its own"
    done = finished(folder, jobs)
    missing = [job for job in jobs if job not in done]
    for job in missing:
        if (folder / job.file).exists():
            print(f"damaged: {folder / job.file}; {job.name} runs again", file=sys.stderr)
    if not missing:
        return []
    left, failures = len(missing), []
    try:
        with interrupts(), workers(count, scheduler) as executor, _progress(left) as report:
            warm_up(missing)
            for job, (content, seconds, reason) in _run_all(executor, work, missing, report):
                left -= 1
                if content is None:
                    failures.append(f"{job.name}: {' '.join(reason.split())[:_LONGEST]}")
                    report(f"failed: {failures[-1]}", 1)
                    continue
                result = _without_job(job, decode_document(content, job.name, SCHEMA), job.name)
                path = folder / job.file
                path.parent.mkdir(parents=True, exist_ok=True)
                if seconds is not None:
                    write_document(_beside(path), {"seconds": seconds}, SECONDS)
                write_bytes(path, content)
                report(f"{job.name}  {describe(result)}".rstrip(), 1)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(
            f"interrupted with {left} of {len(jobs)} jobs to do; the same command resumes"
        ) from None
    return failures


def finished(folder: Path, jobs: Iterable[Job]) -> set[Job]:
    """Return the jobs whose files are there and whole."""
    done = set()
    for job in jobs:
        try:
            if read_result(folder, job) is not None:
                done.add(job)
        except InvalidArgumentError:
            continue
    return done


def read_result(folder: Path, job: JobLike) -> dict[str, Any] | None:
    """Return a job's result, or ``None`` without a file; DamagedFileError if it is not one."""
    path = folder / job.file
    if not path.exists():
        return None
    return _without_job(job, read_document(path, SCHEMA, "result"), f"result: {path}")


def read_seconds(folder: Path, job: JobLike) -> Any:
    """Return the times that a job's work measured, or ``None`` without any."""
    path = _beside(folder / job.file)
    return read_document(path, SECONDS, "times")["seconds"] if path.exists() else None


def _beside(path: Path) -> Path:
    return path.with_suffix(".times.json")


def _run_all(
    executor: Executor, work: Callable[[Job], dict[str, Any]], jobs: Sequence[Job], report: Report
) -> Iterator[tuple[Job, Answer]]:
    """Yield each job when it ends, with what :func:`run_job` returned."""
    ended: queue.SimpleQueue[Future[Any]] = queue.SimpleQueue()
    pending: dict[Future[Any], Job] = {}
    tries: Counter[Job] = Counter()

    def submit(job: Job) -> None:
        tries[job] += 1
        future = executor.submit(run_job, work, job)
        pending[future] = job
        future.add_done_callback(ended.put)

    try:
        for job in jobs:
            submit(job)
        while pending:
            try:
                future = ended.get(timeout=_TICK)
            except queue.Empty:
                continue
            job = pending.pop(future)
            try:
                answer = future.result()
            except WorkerDiedError as error:
                if tries[job] < TRIES:
                    report(f"{job.name}: {error}; it starts again", 0)
                    submit(job)
                    continue
                answer = None, None, f"{error}, {TRIES} times"
            except CancelledError:
                raise OSError("the workers have gone") from None
            except OSError as error:
                raise OSError(f"no process can start: {error.strerror or error}") from error
            except Exception as error:  # such as dask's KilledWorker, which has advice to add
                answer = None, None, f"{type(error).__name__}: {error}".partition(". ")[0]
            yield job, answer
    finally:
        for future in pending:
            future.cancel()


def run_job(work: Callable[[Any], dict[str, Any]], job: JobLike) -> Answer:
    """Run a job; return its file's bytes and its times, or ``None`` twice and the reason."""
    try:
        result = dict(work(job))
        seconds = result.pop("seconds", None)
        return encode_document({"job": job.file, **result}, SCHEMA), seconds, ""
    except (Exception, SystemExit) as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{Path(place.filename).name}, line {place.lineno}"
        return None, None, f"{type(error).__name__}: {error} ({where})"


@contextmanager
def _progress(total: int) -> Iterator[Report]:
    """Show a bar on a terminal, or a line for each finished job elsewhere."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    console = Console(stderr=True)
    columns = (BarColumn(24), MofNCompleteColumn(), TimeRemainingColumn())
    text = TextColumn("{task.description}", markup=False)
    done = 0
    with Progress(*columns, text, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task("", total=total)

        def report(text: str, ended: int) -> None:
            nonlocal done
            done += ended
            bar.update(task, completed=done, description=text)
            if bar.disable:
                count = f"{done}/{total}  " if ended else ""
                print(f"{count}{text}", file=sys.stderr, flush=True)

        yield report


def _without_job(job: JobLike, document: dict[str, Any], name: str) -> dict[str, Any]:
    """Return a result without its job's file, which must be this one's."""
    if document.pop("job", None) != job.file:
        raise DamagedFileError(f"{name} holds the result of another job than {job.name}")
    return document
