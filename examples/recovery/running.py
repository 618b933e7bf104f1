"""Running the jobs: in processes of their own, one command a folder, stopped at any time."""

from __future__ import annotations

import json
import multiprocessing
import os
import queue
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

import aquafish_gym
import eea
import gait
from aquafish_gym.runs.stamps import code_stamp
from aquafish_gym.runs.storage import write_json
from aquafish_gym.utils.validation import InvalidArgumentError
from recovery.treatments import Job, run_job

CONFIG_FILE = "config.json"

Show = Callable[[str, str, float], None]


def source_stamp() -> str:
    """Return a hash of all code that the results come from."""
    packages = [Path(str(package.__file__)).parent for package in (aquafish_gym, eea, gait)]
    folders = (*packages, Path(__file__).parent)
    return code_stamp(
        file for folder in folders for end in ("py", "ini") for file in folder.rglob(f"*.{end}")
    )


def claim(out: Path, settings: dict[str, Any]) -> None:
    """Note a study's settings in its folder, or refuse a folder that holds another study.

    Raises
    ------
    InvalidArgumentError
        The message names a setting that differs.
    """
    if not (out / CONFIG_FILE).exists():
        write_json(out / CONFIG_FILE, settings)
        return
    held = _flat(held_settings(out))
    ours = _flat(json.loads(json.dumps(settings)))
    for name in sorted(held.keys() | ours.keys()):
        if held.get(name) != ours.get(name):
            raise InvalidArgumentError(
                f"out: {out} holds a study with {name} {held.get(name)!r}, not "
                f"{ours.get(name)!r}; choose another folder"
            )


def held_settings(out: Path) -> dict[str, Any]:
    """Return the settings of the study that a folder holds.

    Raises
    ------
    InvalidArgumentError
        If they cannot be read.
    """
    path = out / CONFIG_FILE
    try:
        held: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        missing = {"versions", "source"} - held.keys()
    except (OSError, ValueError, AttributeError):
        missing = {"everything"}
    if missing:
        raise InvalidArgumentError(
            f"out: {path} is damaged, so what the folder holds is not known; choose another folder"
        )
    return held


def _flat(settings: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return nested settings as one mapping with dotted names."""
    found: dict[str, Any] = {}
    for name, value in settings.items():
        nested = isinstance(value, dict)
        found |= _flat(value, f"{prefix}{name}.") if nested else {f"{prefix}{name}": value}
    return found


def run_jobs(jobs: list[Job], workers: int | None) -> None:
    """Run jobs in processes of their own and show how each goes.

    Raises
    ------
    KeyboardInterrupt
        On Ctrl-C or SIGTERM, after the processes have been stopped; what is on disk stays.
    """
    if not jobs:
        return
    count = min(len(jobs), workers or len(os.sched_getaffinity(0)))
    context = multiprocessing.get_context("spawn")
    messages: multiprocessing.Queue[tuple[str, str, float]] = context.Queue()
    before = signal.signal(signal.SIGTERM, _interrupt)
    pool = ProcessPoolExecutor(count, context, _begin_worker, (messages, os.getpid()))
    try:
        futures = {pool.submit(_work, job): job for job in jobs}
        with progress(jobs) as show:
            for message in _messages(messages, futures):
                show(*message)
    except BaseException:
        for process in multiprocessing.active_children():
            process.terminate()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
        signal.signal(signal.SIGTERM, before)


def _interrupt(_signal: int, _frame: object) -> None:
    raise KeyboardInterrupt


# A worker's way to say how it goes; set as it begins.
_said: multiprocessing.Queue[tuple[str, str, float]]


def _begin_worker(messages: multiprocessing.Queue[tuple[str, str, float]], parent: int) -> None:
    global _said
    _said = messages
    # Ctrl-C reaches the whole process group; the parent answers it. Should the parent be
    # killed, nobody else would stop its workers from writing on.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_leave_with, args=(parent,), daemon=True).start()


def _leave_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(1)


def _work(job: Job) -> dict[str, Any]:
    return run_job(job, lambda text, share: _said.put((job.name, text, share)))


def _messages(
    messages: multiprocessing.Queue[tuple[str, str, float]],
    futures: dict[Future[dict[str, Any]], Job],
) -> Iterator[tuple[str, str, float]]:
    """Yield what the workers say until all are done; raise what one of them raised."""
    waiting = set(futures)
    while waiting:
        try:
            message = messages.get(timeout=0.2)
        except queue.Empty:
            message = None
        if message is not None:
            yield message
        for future in [f for f in waiting if f.done()]:
            waiting.remove(future)
            yield futures[future].name, _conclusion(future.result()), 1.0


def _conclusion(outcome: dict[str, Any]) -> str:
    return (
        f"OBJ_FIT {outcome['objective_fitness']:.3f}, swims {outcome['native_distance']:.1f} units "
        f"on its model, {outcome['target_distance']:.1f} on the damaged robot"
    )


@contextmanager
def progress(jobs: list[Job]) -> Iterator[Show]:
    """Show a bar a job on a terminal, or a line a finished job elsewhere."""
    console = Console(stderr=True)
    width = max(len(job.name) for job in jobs)
    columns = (TextColumn("{task.description}"), BarColumn(24), TextColumn("{task.fields[text]}"))
    live = console.is_terminal
    with Progress(*columns, TimeElapsedColumn(), console=console, disable=not live) as bars:
        tasks = {
            job.name: bars.add_task(job.name.ljust(width), total=1.0, start=False, text="waiting")
            for job in jobs
        }
        unfinished = dict.fromkeys(tasks, False)

        def show(name: str, text: str, share: float) -> None:
            if name not in unfinished:
                return  # a last word that was overtaken by the outcome
            if not unfinished[name]:
                unfinished[name] = True
                bars.start_task(tasks[name])
            bars.update(tasks[name], completed=share, text=text)
            if share == 1.0:
                del unfinished[name]
                if not live:
                    print(f"{name}: {text}", file=sys.stderr, flush=True)

        yield show
