"""Warm-up settings of self-models, and tables of many jobs' results."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from aquafish_gym.runs.jobs import Job, read_result, read_seconds, run_jobs
from aquafish_gym.runs.manifest import lock, write_manifest
from aquafish_gym.runs.storage import ensure_writable_directory, write_bytes
from eea.core.config import Config, JointConfig
from eea.fish import EngineSimulator, fish_problem
from eea.fish.joint import fish_joint


def in_small(config: Config) -> Config:
    """Return settings of a short run that compiles everything that a run with ``config`` needs.

    The alternative hypotheses of joint inference, whose fit takes ten seconds, are simulated here.
    """
    if isinstance(config, JointConfig):
        _simulate_hypotheses(config.steps)
        return JointConfig(
            steps=config.steps, rounds=2, bodies=4, poses=4, descents=2, polished=1, restarts=0,
            alternatives="never",
        )  # fmt: skip
    return replace(
        config,
        rounds=2,
        exploration=replace(config.exploration, generations=1),
        estimation=replace(config.estimation, generations=1),
        out_of_band=replace(config.out_of_band, inner_generations=1, revisit=0),
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


def do_table(
    jobs: Sequence[Job],
    work: Callable[[Job], dict[str, Any]],
    out: Path,
    kind: str,
    settings: dict[str, Any],
    tabulate: Callable[[list[dict[str, Any]]], list[list[str]]],
    workers: int | None,
    pictures: tuple[str, ...] = (),
) -> list[list[str]]:
    """Run all jobs in a folder; return the table of their results, written to ``table.md``.

    ``tabulate`` takes the results, each with the job's ``seconds``, in the order of the jobs. The
    first column is aligned to the left, the others to the right. ``tabulate`` may draw
    ``pictures``, of these names, in the folder. For ``kind`` and ``settings`` see
    ``write_manifest``.

    Raises
    ------
    SystemExit
        With the code 1, if a job failed; the results of the others are kept.
    """
    folder = ensure_writable_directory(out)
    with lock(folder):
        write_manifest(folder, kind, settings, ("table.md", *pictures))
        failures = run_jobs(jobs, work, folder, count=workers)
        if failures:
            print("\n".join(failures), file=sys.stderr)
            raise SystemExit(1)
        rows = tabulate(
            [
                {**(read_result(folder, job) or {}), "seconds": read_seconds(folder, job)}
                for job in jobs
            ]
        )
        head, *body = (f"| {' | '.join(row)} |" for row in rows)
        text = "\n".join([head, "|---|" + "---:|" * (len(rows[0]) - 1), *body])
        write_bytes(folder / "table.md", f"{text}\n".encode())
    return rows
