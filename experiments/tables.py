"""What the experiments share: jobs in a folder, tables of their results, shortened searches."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from aquafish_gym.runs.jobs import Job, exit_if_failed, read_result, run_jobs
from aquafish_gym.runs.manifest import lock, write_manifest
from aquafish_gym.runs.markdown import markdown_table
from aquafish_gym.utils.storage import ensure_writable_directory, write_bytes
from gait.search.config import EvolveConfig


@contextmanager
def experiment(
    jobs: Sequence[Job],
    work: Callable[[Job], dict[str, Any]],
    out: Path,
    kind: str,
    settings: dict[str, Any],
    outputs: Sequence[str] = (),
    workers: int | None = None,
    scheduler: str | None = None,
    warm_up: Callable[[Sequence[Job]], object] = lambda _jobs: None,
) -> Iterator[tuple[Path, list[dict[str, Any]]]]:
    """Run the missing jobs in a folder; yield it, still locked, and all results in their order.

    For ``kind``, ``settings`` and ``outputs`` see ``write_manifest``, for the others ``run_jobs``.

    Raises
    ------
    SystemExit
        With the code 1, if a job failed; the results of the others are kept.
    """
    folder = ensure_writable_directory(out)
    with lock(folder):
        write_manifest(folder, kind, settings, outputs, work)
        failures = run_jobs(jobs, work, folder, count=workers, scheduler=scheduler, warm_up=warm_up)
        exit_if_failed(failures)
        yield folder, [read_result(folder, job) or {} for job in jobs]


def write_tables(folder: Path, tables: Mapping[str, Sequence[Sequence[str]]]) -> None:
    """Write each table to NAME.md; the first column is text, the others are numbers.

    ``times`` is the table of all that was measured in seconds, so that no other file differs
    between two runs of the same jobs.
    """
    for name, rows in tables.items():
        write_bytes(folder / f"{name}.md", f"{markdown_table(rows, words=1)}\n".encode())


def interval_text(values: Sequence[float], digits: int = 1) -> str:
    """Return a cell: a figure with its interval.

    Examples
    --------
    >>> interval_text((1.0, 0.5, 1.25), 2)
    '1.00 [0.50, 1.25]'
    """
    middle, low, high = (f"{value:z.{digits}f}" for value in values)
    return f"{middle} [{low}, {high}]"


def shortened(config: EvolveConfig, divisor: int) -> EvolveConfig:
    """Return a search with 1/``divisor`` of the generations, on one thread."""
    choices = config.choices
    fewer: dict[str, Any] = {"generations": max(1, choices.generations // divisor)}
    if choices.cma_generations:
        fewer["cma_generations"] = max(1, choices.cma_generations // divisor)
    if choices.random_candidates:
        fewer["random_candidates"] = max(choices.restarts, choices.random_candidates // divisor)
    return replace(config, threads=1, **fewer)
