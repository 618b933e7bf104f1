"""The runner: jobs are pure functions of their descriptions, and it alone writes their files.

A *job* is a small frozen description that can be pickled and hashed; it has a name for people and
a file, relative to the folder. The *work* is a function of a module that takes a job, and a way to
say how far it is, and returns a dictionary ready for JSON; it touches no file. So it can be done in
any process on any machine, and as often as need be: what is in the folder is the same.

The work's dictionary becomes bytes, with its checksum, where it was done. Here they are checked
and written the moment they arrive. A kill costs the jobs that were being done and no other.
"""

from __future__ import annotations

import queue
import traceback
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any, Generic, Literal, Protocol, TypeVar

from aquafish_gym.runs.executors import interrupts
from aquafish_gym.runs.processes import ProcessExecutor, WorkerDiedError, say
from aquafish_gym.runs.storage import (
    CannotWriteError,
    DamagedFileError,
    decode_document,
    encode_document,
    read_document,
    write_bytes,
)
from aquafish_gym.utils.validation import InvalidArgumentError

SCHEMA = "aquafish.result/1"
TRIES = 3  # how often a job is begun, if the processes that do it die
_TICK = 0.5  # s; the longest that Ctrl-C may have to wait to be noticed
_LONGEST = 300  # characters of a reason

Say = Callable[[str, float], None]
Kind = Literal["began", "said", "done", "retried", "failed"]


class JobLike(Protocol):
    """What the runner knows of a job: a name for people, and a file, with slashes, of its own."""

    @property
    def name(self) -> str: ...

    @property
    def file(self) -> str: ...


Job = TypeVar("Job", bound=JobLike)


@dataclass(frozen=True)
class Event(Generic[Job]):
    """What happened to a job.

    It "began"; "said" something; is "done"; its process died and it is "retried"; or it "failed"
    for good, by an error or because its processes died too often. A foreign executor does not
    tell of beginnings, and what jobs say to it nobody hears. ``text`` was said or is the reason,
    ``share`` of the work in [0, 1] is done, ``document`` is what it returned, once written.
    """

    kind: Kind
    job: Job
    text: str = ""
    share: float = 0.0
    document: dict[str, Any] | None = None


def run_jobs(
    jobs: Sequence[Job],
    work: Callable[[Job, Say], dict[str, Any]],
    folder: Path,
    executor: Executor,
    on_event: Callable[[Event[Job]], None] | None = None,
) -> list[str]:
    """Do the jobs whose files are not there whole, in their order, and write their files.

    Return a sentence for each job that could not be done; the others' files are there.

    For jobs and work see this module's beginning. The folder is held by ``folder.held``; no result
    depends on the executor, see ``executors.workers``; ``on_event`` is told in this thread.

    Raises
    ------
    InvalidArgumentError
        If two jobs have one file, or a file is outside the folder.
    KeyboardInterrupt
        On Ctrl-C or SIGTERM. Calls that have not begun are cancelled; ``workers`` stops the others.
    CannotWriteError
        If a file cannot be written, as on a full disk; the same jobs go on from what there is.
    OSError
        If no process can be begun, or a cluster has gone.
    """
    _check_files(jobs)
    done = finished(folder, jobs)
    with interrupts():
        left = [job for job in jobs if job not in done]
        return _Run(work, folder, executor, on_event or (lambda _: None)).do(left)


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
    """Return a job's result, ``None`` without a file; DamagedFileError if it is another."""
    path = folder / job.file
    if not path.exists():
        return None
    return _of(job, read_document(path, SCHEMA, "result"), f"result: {path}")


def merge_results(folder: Path, other: Path, jobs: Collection[Job]) -> int:
    """Copy results that another folder of the same study has and this one lacks; return how many.

    Nothing has been copied if both have a job, and not the same bytes (InvalidArgumentError), or
    one of the other's results is damaged (DamagedFileError). One that is damaged here is replaced.
    """
    _check_files(list(jobs))
    ours = finished(folder, jobs)
    new: list[tuple[Path, bytes]] = []
    for job in jobs:
        if read_result(other, job) is None:
            continue
        content = (other / job.file).read_bytes()
        if job not in ours:
            new.append((folder / job.file, content))
        elif (folder / job.file).read_bytes() != content:
            raise InvalidArgumentError(
                f"{other} and {folder} hold different results of {job.name} ({job.file})"
            )
    for path, content in new:
        _write(path, content)
    return len(new)


@dataclass
class _Run(Generic[Job]):
    """One call of ``run_jobs``. Other threads reach it through its queue alone."""

    work: Callable[[Job, Say], dict[str, Any]]
    folder: Path
    executor: Executor
    tell: Callable[[Event[Job]], None]
    news: queue.SimpleQueue[Any] = field(default_factory=queue.SimpleQueue)
    pending: dict[Future[Any], Job] = field(default_factory=dict)
    begun: Counter[Job] = field(default_factory=Counter)
    failures: list[str] = field(default_factory=list)

    def do(self, jobs: Sequence[Job]) -> list[str]:
        heard = self.executor if isinstance(self.executor, ProcessExecutor) else None
        try:
            if heard:
                heard.hear(lambda *said: self.news.put(said))
            for job in jobs:
                self._submit(job)
            while self.pending:
                try:
                    news = self.news.get(timeout=_TICK)
                except queue.Empty:
                    continue
                if isinstance(news, Future):
                    self._conclude(news)
                elif news[0] in self.pending:
                    job = self.pending[news[0]]
                    kind: Kind = "said" if news[1] else "began"
                    self.tell(Event(kind, job, *news[1:]))
        finally:
            for future in list(self.pending):
                future.cancel()
            if heard:
                heard.hear(None)
        return self.failures

    def _submit(self, job: Job) -> None:
        self.begun[job] += 1
        try:
            future = self.executor.submit(do_job, self.work, job)
        except BrokenExecutor as error:
            raise OSError(f"no process is left to do the jobs: {error}") from error
        self.pending[future] = job
        future.add_done_callback(self.news.put)

    def _conclude(self, future: Future[Any]) -> None:
        job = self.pending.pop(future)
        try:
            kind, answer = future.result()
        except WorkerDiedError as error:
            if self.begun[job] < TRIES:
                self.tell(Event("retried", job, str(error)))
                self._submit(job)
            else:
                self._fail(job, f"{error}, {TRIES} times")
        except CancelledError:
            raise OSError("the processes that did the jobs are gone") from None
        except OSError as error:
            raise OSError(f"no process can be begun: {error.strerror or error}") from error
        except Exception as error:  # such as dask's KilledWorker, which has advice to add
            self._fail(job, f"{type(error).__name__}: {error}".partition(". ")[0])
        else:
            if kind == "failed":
                self._fail(job, answer)
                return
            document = _of(job, decode_document(answer, job.name, SCHEMA), job.name)
            _write(self.folder / job.file, answer)
            self.tell(Event("done", job, share=1.0, document=document))

    def _fail(self, job: Job, reason: str) -> None:
        reason = " ".join(reason.split())[:_LONGEST]
        self.failures.append(f"{job.name}: {reason}")
        self.tell(Event("failed", job, reason))


def do_job(work: Callable[[Job, Say], dict[str, Any]], job: Job) -> tuple[str, Any]:
    """Do a job, wherever this is; return "done" and its file's bytes, or "failed" and why."""
    try:
        document = work(job, say)
        if not isinstance(document, dict) or "job" in document:
            raise TypeError("the work must return a dictionary, without a key 'job'")
        return "done", encode_document({"job": job.file, **document}, SCHEMA)
    except (Exception, SystemExit) as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{Path(place.filename).name}, line {place.lineno}"
        return "failed", f"{type(error).__name__}: {error} ({where})"


def _of(job: JobLike, document: dict[str, Any], name: str) -> dict[str, Any]:
    """Return a result without the word about its job, which must be this one."""
    if document.pop("job", None) != job.file:
        raise DamagedFileError(f"{name} holds the result of another job than {job.name}")
    return document


def _write(path: Path, content: bytes) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise CannotWriteError(f"cannot make {path.parent}: {error.strerror}") from error
    write_bytes(path, content)


def _check_files(jobs: Sequence[JobLike]) -> None:
    seen: dict[str, JobLike] = {}
    for job in jobs:
        path = PurePosixPath(job.file)
        if path.is_absolute() or ".." in path.parts or not path.name:
            raise InvalidArgumentError(f"a job's file must be in the folder; got {job.file!r}")
        if job.file in seen:
            both = f"{seen[job.file].name} and {job.name} both have {job.file}"
            raise InvalidArgumentError(f"jobs must have a file each; {both}")
        seen[job.file] = job
