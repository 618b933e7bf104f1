"""What the experiments share: tables of many jobs' results, and shortened searches."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from aquafish_gym.runs.jobs import Job, exit_if_failed, read_result, run_jobs
from aquafish_gym.runs.manifest import lock, write_manifest
from aquafish_gym.utils.storage import ensure_writable_directory, write_bytes
from gait.search.config import EvolveConfig


def do_table(
    jobs: Sequence[Job],
    work: Callable[[Job], dict[str, Any]],
    out: Path,
    kind: str,
    settings: dict[str, Any],
    tabulate: Callable[[list[dict[str, Any]]], list[list[str]]],
    workers: int | None,
    pictures: tuple[str, ...] = (),
    warm_up: Callable[[Sequence[Job]], object] = lambda _jobs: None,
    scheduler: str | None = None,
) -> list[list[str]]:
    """Run all jobs in a folder; return the table of their results, written to ``table.md``.

    ``tabulate`` takes the results in the order of the jobs. The
    first column is aligned to the left, the others to the right. ``tabulate`` may draw
    ``pictures``, of these names, in the folder. For ``kind`` and ``settings`` see
    ``write_manifest``, for ``workers``, ``scheduler`` and ``warm_up`` ``run_jobs``.

    Raises
    ------
    SystemExit
        With the code 1, if a job failed; the results of the others are kept.
    """
    folder = ensure_writable_directory(out)
    with lock(folder):
        write_manifest(folder, kind, settings, ("table.md", *pictures), work)
        failures = run_jobs(jobs, work, folder, count=workers, scheduler=scheduler, warm_up=warm_up)
        exit_if_failed(failures)
        rows = tabulate([read_result(folder, job) or {} for job in jobs])
        write_bytes(folder / "table.md", markdown(rows).encode())
    return rows


def markdown(rows: Sequence[Sequence[str]]) -> str:
    """Return a table in Markdown; the first row is its head, only the first column is text."""
    head, *body = (f"| {' | '.join(row)} |" for row in rows)
    return "\n".join([head, "|---|" + "---:|" * (len(rows[0]) - 1), *body, ""])


def shortened(config: EvolveConfig, divisor: int) -> EvolveConfig:
    """Return a search with 1/``divisor`` of the generations, on one thread."""
    plan = config.plan
    fewer: dict[str, Any] = {"generations": max(1, plan.generations // divisor)}
    if plan.cma_generations:
        fewer["cma_generations"] = max(1, plan.cma_generations // divisor)
    if plan.random_candidates:
        fewer["random_candidates"] = max(plan.restarts, plan.random_candidates // divisor)
    return replace(config, threads=1, **fewer)
