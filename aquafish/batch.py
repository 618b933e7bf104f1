"""What the commands that do many jobs in a folder have in common."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import wait
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from rich.console import Console
from rich.progress import Progress

import aquafish_gym
import eea.core
import eea.fish
import eea.joint
import gait
from aquafish_gym.command_line import RESUMES
from aquafish_gym.runs.executors import workers
from aquafish_gym.runs.folder import claim, held
from aquafish_gym.runs.processes import WorkerDiedError
from aquafish_gym.runs.runner import Event, Job, JobLike, Say, finished, read_result, run_jobs
from aquafish_gym.runs.stamps import code_stamp
from aquafish_gym.runs.storage import ensure_writable_directory, write_bytes
from eea.core import ConfigurationError, EEAConfig
from eea.core.config import JointConfig
from eea.fish import EngineSimulator, fish_problem
from eea.fish.joint import fish_joint

PATIENCE = 3.0  # s, in which a worker with everything compiled is ready


class Stamped(JobLike, Protocol):
    """A job that knows which code must do it; "" for any."""

    @property
    def source(self) -> str: ...


def say(text: str) -> None:
    """Tell a person something beside the results."""
    print(text, file=sys.stderr, flush=True)


@cache
def source_stamp(*files: Path) -> str:
    """Return a hash of all code that self-models and gaits come from, and of more files."""
    packages = (aquafish_gym, eea.core, eea.joint, eea.fish, gait)
    folders = [Path(str(package.__file__)).parent for package in packages]
    kinds = ("*.py", "*.ini")
    theirs = [file for folder in folders for kind in kinds for file in folder.rglob(kind)]
    return code_stamp([*theirs, *files])


def check_source(job: Stamped, here: str) -> None:
    """Raise ConfigurationError if ``here``, this machine's code, is not what a job asks for."""
    if job.source and job.source != here:
        raise ConfigurationError(
            f"this worker has other code (source {here}, not {job.source}); install the same "
            "version on every machine"
        )


def in_small(config: EEAConfig) -> EEAConfig:
    """Return what takes little time and has all compiled that a run with these settings needs.

    But for joint inference's other hypotheses: to fit them to anything takes ten seconds, so that
    they are simulated here.
    """
    _simulate_hypotheses(config.steps)
    return replace(
        config,
        rounds=2,
        exploration=replace(config.exploration, generations=1),
        estimation=replace(config.estimation, generations=1),
        out_of_band=replace(config.out_of_band, inner_generations=1, revisit=0),
        joint=JointConfig(
            bodies=4, poses=4, descents=2, polished=1, restarts=0, alternatives="never"
        ),
    )


@cache
def _simulate_hypotheses(steps: int) -> None:
    """Simulate a fish under each hypothesis, its servos late or not, in both precisions."""
    joint = fish_joint(fish_problem(), EngineSimulator(steps, threads=1))
    still = np.zeros((len(joint.hypotheses), 3))
    bodies = np.zeros((len(still), 9))
    for lag in (0.0, 0.1):
        told = [
            [h.fixed.get(n.name, lag if n.name == "lag" else n.nominal) for n in joint.nuisances]
            for h in joint.hypotheses
        ]
        for fine in (False, True):
            joint.simulate(bodies, np.array(told), still, still, fine)


def do_missing(
    jobs: Sequence[Job],
    work: Callable[[Job, Say], dict[str, Any]],
    folder: Path,
    rehearse: Callable[[Sequence[Job]], None],
    progress: Callable[[Sequence[Job]], AbstractContextManager[Callable[[Event[Job]], None]]],
    *,
    processes: int | None,
    scheduler: str | None,
) -> list[str]:
    """Do the jobs that a held folder lacks; return a sentence for each that could not be done.

    Parameters
    ----------
    rehearse
        Has one worker compile what all of them then find compiled, before any job begins.
    progress
        Shows how the jobs that it is given come along.
    processes, scheduler
        See ``executors.workers``.

    Raises
    ------
    KeyboardInterrupt
        On Ctrl-C, with how many are left.
    OSError
        If no process can do anything, or a file cannot be written.
    """
    done = finished(folder, jobs)
    missing = [job for job in jobs if job not in done]
    for job in missing:
        if (folder / job.file).exists():
            say(f"damaged: {folder / job.file}; {job.name} is done anew")
    if not missing:
        return []
    try:
        with workers(processes, scheduler) as executor:
            rehearsal = executor.submit(rehearse, tuple(missing))
            if not wait([rehearsal], PATIENCE).done:
                say("preparing: the first run on a machine compiles, for a minute or two")
            try:
                rehearsal.result()
            except WorkerDiedError as error:
                raise OSError(f"nothing was begun: {error}") from None
            with progress(missing) as tell:
                return run_jobs(missing, work, folder, executor, tell)
    except KeyboardInterrupt:
        left = len(jobs) - len(finished(folder, jobs))
        raise KeyboardInterrupt(
            f"interrupted with {left} of {len(jobs)} jobs to do; {RESUMES}"
        ) from None


def do_table(
    jobs: Sequence[Job],
    work: Callable[[Job, Say], dict[str, Any]],
    out: Path,
    kind: str,
    settings: dict[str, Any],
    tabulate: Callable[[list[dict[str, Any]]], list[list[str]]],
    processes: int | None,
    pictures: tuple[str, ...] = (),
) -> list[list[str]]:
    """Do all jobs in a folder, with a bar; return the table of their results.

    It is also written to ``table.md`` there. Words stand to the left, and all columns but the first
    to the right. ``tabulate`` may draw ``pictures``, of these names, there. ``kind`` and
    ``settings`` are what the folder is claimed for, see ``claim``.

    Raises
    ------
    SystemExit
        With the code 1, if a job could not be done; the others are.
    """
    folder = ensure_writable_directory(out)
    with held(folder):
        claim(folder, kind, settings, {"source": source_stamp()}, ("table.md", *pictures))
        failures = do_missing(
            jobs, work, folder, _nothing, progress_bar, processes=processes, scheduler=None
        )
        if failures:
            say("\n".join(failures))
            raise SystemExit(1)
        rows = tabulate([read_result(folder, job) or {} for job in jobs])
        head, *body = (f"| {' | '.join(row)} |" for row in rows)
        text = "\n".join([head, "|---|" + "---:|" * (len(rows[0]) - 1), *body])
        write_bytes(folder / "table.md", f"{text}\n".encode())
    return rows


def _nothing(_jobs: Sequence[Any]) -> None:
    """Rehearse nothing: such a job compiles little besides what all have in common."""


@contextmanager
def progress_bar(jobs: Sequence[Any]) -> Iterator[Callable[[Event[Any]], None]]:
    """Show one bar of finished jobs on stderr."""
    with Progress(console=Console(stderr=True)) as bar:
        task = bar.add_task(f"{len(jobs)} jobs", total=len(jobs))
        yield lambda event: bar.update(
            task, advance=event.kind == "done", description=event.job.name
        )
