"""All studies, run one after another into one report."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.engines.api import TIMESTEP
from aquafish_gym.plans import AQUAFISH, BodyPlan
from aquafish_gym.runs.progress import show_progress, track
from aquafish_gym.utils.validation import EngineUnavailableError
from instruments.verification import (
    agreement,
    convergence,
    foreign_water,
    mechanics,
    quadrature,
    reactive_terms,
    real_fish,
    strokes,
    tables,
)
from instruments.verification.mujoco_model import load_mujoco
from instruments.verification.tables import Report
from instruments.verification.trials import Trials, random_trials

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


class Studies:
    """The studies, a method each, which returns that part of the report.

    Parameters
    ----------
    effort
        How much to do.
    seed
        All that is random follows from it.
    plan
        Of the robots of the studies ``OF_ANY_PLAN``.
    """

    def __init__(self, effort: Effort, seed: int, plan: BodyPlan = AQUAFISH) -> None:
        self.effort = effort
        self.seed = seed
        self.plan = plan

    def agreement(self) -> Report:
        """Compare the engines with each other."""
        e = self.effort
        rows = _once(
            lambda: agreement.engines(
                e.robots, e.lane_robots, e.agreement_steps, self.seed, self.plan
            ),
            "engines",
        )
        return {"seconds": e.agreement_steps * TIMESTEP, "rows": rows}

    def single_precision(self) -> Report:
        """Compare float32 with float64 over ever longer times."""
        e = self.effort
        parts = track(
            agreement.single_precision(e.lane_robots, e.durations, self.seed, self.plan),
            "float32",
            -(-e.lane_robots // agreement.AT_ONCE),
        )
        return {"robots": e.lane_robots, "rows": agreement.quantiles(list(parts), e.durations)}

    @functools.cached_property
    def _trials(self) -> Trials:
        return random_trials(self.effort.robots, self.seed, self.plan)

    @functools.cached_property
    def _truths(self) -> NDArray[np.float64]:
        samples = round(self.effort.path_seconds / convergence.INTERVAL)
        paths = convergence.references(self._trials, samples)
        return np.array(list(track(paths, "RK4", len(self._trials))))

    def convergence(self) -> Report:
        """Compare the scheme with RK4."""
        robots, truths = self.effort.robots, self._truths
        return {
            "robots": robots,
            "seconds": self.effort.path_seconds,
            "path": convergence.path_length(truths),
            "reference": _once(
                lambda: convergence.reference_error(self._trials, truths, min(3, robots)),
                "RK4's own error",
            ),
            "rows": _once(lambda: convergence.study(self._trials, truths), "scheme"),
        }

    def quadrature(self) -> Report:
        """Compare the drag law's few points with the whole surface."""
        e = self.effort
        parts = track(
            convergence.surface_error(self._trials, self._truths, e.surface_robots),
            "whole surface",
            e.surface_robots,
        )
        gaps = list(parts)
        return {
            "robots": e.surface_robots,
            "seconds": e.path_seconds,
            "paths": [
                {"what": what, "unit": unit, "median": float(np.median([g[what] for g in gaps])),
                 "maximum": max(g[what] for g in gaps)}
                for what, unit in convergence.WHAT.items()
            ],
            "rows": _once(
                lambda: quadrature.study(
                    e.quadrature_trials, self.seed, e.quadrature_points, self.plan
                ),
                "quadrature",
            ),
        }  # fmt: skip

    def mechanics(self) -> Report | None:
        """Compare the mechanics with MuJoCo's; None where that is not installed."""
        if not _has_mujoco():
            return None
        robots, seconds = self.effort.robots, self.effort.dry_seconds
        found = track(mechanics.compare(robots, self.seed, seconds, self.plan), "MuJoCo", robots)
        return {"robots": robots, "seconds": seconds, "rows": mechanics.summary(list(found))}

    def foreign(self) -> Report | None:
        """Compare our water with MuJoCo's; None where that is not installed."""
        if not _has_mujoco():
            return None
        e, trials = self.effort, self._trials
        seconds = min(foreign_water.SECONDS, e.path_seconds)
        beating = foreign_water.BEATING if e.path_seconds > seconds else seconds
        waters = len(foreign_water.WITHOUT) + 2
        few = e.surface_robots
        gaps = list(track(foreign_water.convergence(trials, few, seconds), "MuJoCo's steps", few))
        rows = list(track(foreign_water.study(trials, seconds, beating), "MuJoCo's water", waters))
        return {
            "robots": e.robots, "seconds": seconds, "beating": beating, "rows": rows,
            "steps": foreign_water.step_rows(gaps),
        }  # fmt: skip

    def strokes(self) -> Report:
        """Compare fins' strokes with what they must bring."""
        return {"rows": _once(strokes.study, "strokes")}

    def reactive(self) -> Report:
        """Compare the reactive terms with potential flow."""
        quick = self.effort == QUICK
        return _once(lambda: reactive_terms.study(self.seed, quick), "reactive terms")

    def real_fish(self) -> Report:
        """Compare how speed depends on the beat with published swims."""
        quick = self.effort == QUICK
        return _once(lambda: real_fish.study(quick), "real fish")


#: Those that verify any body plan; the others are of the paper's fish.
OF_ANY_PLAN = ("agreement", "single_precision", "convergence", "quadrature", "mechanics")
STUDIES = (*OF_ANY_PLAN, "strokes", "reactive", "real_fish", "foreign")


def make_report(
    effort: Effort, seed: int, only: Iterable[str] = STUDIES, plan: BodyPlan = AQUAFISH
) -> Report:
    """Run some of the ``STUDIES``; see :class:`Studies`.

    Raises
    ------
    EngineUnavailableError
        If PyBullet is missing and is to be compared.
    """
    studies = Studies(effort, seed, plan)
    return {"seed": seed} | {name: getattr(studies, name)() for name in only}


def tables_of(report: Report) -> dict[str, tables.Table]:
    """Return every table of a report, by the name that a page gives it."""
    found = tables.make_tables(report)
    if "reactive" in report:
        found |= reactive_terms.make_tables(report["reactive"])
    if "real_fish" in report:
        found |= real_fish.make_tables(report["real_fish"])
    if report.get("foreign"):
        found |= foreign_water.make_tables(report["foreign"])
    return found


def _once(study: Callable[[], T], what: str) -> T:
    """Return a study's result, and show that it goes on."""
    with show_progress(what, 1):
        return study()


def _has_mujoco() -> bool:
    try:
        load_mujoco()
    except EngineUnavailableError:
        return False
    return True
