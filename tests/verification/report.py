"""All studies, run one after another into one report."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from rich.progress import Progress

from aquafish_gym.engines.base import TIMESTEP
from aquafish_gym.utils.validation import EngineUnavailableError
from tests.verification import (
    agreement,
    convergence,
    mechanics,
    quadrature,
    reactive,
    strokes,
    tables,
)
from tests.verification.mujoco_robot import load_mujoco
from tests.verification.trials import random_trials

T = TypeVar("T")


@dataclass(frozen=True)
class Effort:
    """How much each study is made of."""

    robots: int = 20
    lane_robots: int = 2000
    agreement_steps: int = 512
    durations: tuple[float, ...] = agreement.DURATIONS
    path_seconds: float = 5.12
    surface_robots: int = 8
    quadrature_trials: int = 300
    quadrature_points: int = quadrature.FINE
    dry_seconds: float = mechanics.SECONDS


QUICK = Effort(
    robots=2,
    lane_robots=16,
    agreement_steps=32,
    durations=(0.32, 1.28),
    path_seconds=0.64,
    surface_robots=2,
    quadrature_trials=8,
    quadrature_points=12,
    dry_seconds=0.5,
)


def make_report(effort: Effort, seed: int, progress: Progress) -> dict[str, Any]:
    """Run every study; ``mechanics`` is None where MuJoCo is missing.

    Parameters
    ----------
    effort
        How much to do.
    seed
        All that is random follows from it.
    progress
        Where to show how far it is.

    Raises
    ------
    EngineUnavailableError
        If PyBullet is missing.
    """

    def each(items: Iterable[T], total: int, what: str) -> list[T]:
        return list(progress.track(items, total=total, description=what))

    report: dict[str, Any] = {"seed": seed}
    (rows,) = each(
        (agreement.engines(effort.robots, effort.lane_robots, effort.agreement_steps, seed)
         for _ in range(1)), 1, "engines",
    )  # fmt: skip
    report["agreement"] = {"seconds": effort.agreement_steps * TIMESTEP, "rows": rows}

    parts = each(
        agreement.single_precision(effort.lane_robots, effort.durations, seed),
        -(-effort.lane_robots // agreement.AT_ONCE), "float32",
    )  # fmt: skip
    report["single_precision"] = {
        "robots": effort.lane_robots,
        "rows": agreement.quantiles(parts, effort.durations),
    }

    trials = random_trials(effort.robots, seed)
    samples = round(effort.path_seconds / convergence.INTERVAL)
    truths = np.array(each(convergence.references(trials, samples), len(trials), "RK4"))
    report["convergence"] = {
        "robots": effort.robots,
        "seconds": effort.path_seconds,
        "path": convergence.path_length(truths),
        "reference": convergence.reference_error(trials, truths, min(3, effort.robots)),
        "rows": convergence.study(trials, truths),
    }

    gaps = each(
        convergence.surface_error(trials, truths, effort.surface_robots),
        effort.surface_robots, "whole surface",
    )  # fmt: skip
    (rows,) = each(
        (quadrature.study(effort.quadrature_trials, seed, effort.quadrature_points)
         for _ in range(1)), 1, "quadrature",
    )  # fmt: skip
    report["quadrature"] = {
        "robots": effort.surface_robots,
        "seconds": effort.path_seconds,
        "paths": [
            {"what": what, "unit": unit, "median": float(np.median([g[what] for g in gaps])),
             "maximum": max(g[what] for g in gaps)}
            for what, unit in convergence.WHAT.items()
        ],
        "rows": rows,
    }  # fmt: skip

    report["mechanics"] = None
    if _has_mujoco():
        found = each(
            mechanics.compare(effort.robots, seed, effort.dry_seconds), effort.robots, "MuJoCo"
        )
        report["mechanics"] = {
            "robots": effort.robots,
            "seconds": effort.dry_seconds,
            "rows": mechanics.summary(found),
        }
    report["strokes"] = {"rows": strokes.study()}
    quick = effort == QUICK
    (report["reactive"],) = each(
        (reactive.study(seed, quick) for _ in range(1)), 1, "reactive terms"
    )
    return report


def tables_of(report: dict[str, Any]) -> dict[str, tables.Table]:
    """Return every table of a report, by the name that a page gives it."""
    return tables.make_tables(report) | reactive.make_tables(report["reactive"])


def _has_mujoco() -> bool:
    try:
        load_mujoco()
    except EngineUnavailableError:
        return False
    return True
