"""What the cases of a setting come to: the report's numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import reduce
from typing import Any

import numpy as np
from scipy.stats import binomtest

from aquafish_gym.plans import AQUAFISH
from instruments.inference.calibration import coverage, rank_uniformity
from instruments.inference.cases import DRAWS, MASSES, WORSE
from instruments.inference.settings import EVERY, FOREIGN_SETTINGS, Target

Document = Mapping[str, Any]
Part = dict[str, Any]

NAMES = tuple(d.name for d in AQUAFISH.dimensions)
TIMES = ("seconds", "p95")  # mean and 95% quantile, CPU s
TOUCH = 1e-6  # of a range: an interval that ends so near a truth at a bound holds it


def split_times(report: Document) -> tuple[Part, Part]:
    """Return a report without CPU times, and one of these alone; ``join_times`` is the reverse."""
    rest: Part = {}
    times: Part = {}
    for name, value in report.items():
        if name in TIMES:
            times[name] = value
        elif isinstance(value, dict):
            rest[name], inner = split_times(value)
            if inner:
                times[name] = inner
        else:
            rest[name] = value
    return rest, times


def join_times(report: Document, times: Document) -> Part:
    """Return a report with its CPU times."""
    inner = {
        name: join_times(report[name], part)
        for name, part in times.items()
        if isinstance(part, dict)
    }
    return {**report, **times, **inner}


def summarise(setting: str, documents: Sequence[Document]) -> Part:
    """Return a setting's part of the report."""
    known = [d for d in documents if d["excess"] is not None]
    part: Part = {
        "robots": len(documents),
        "rounds": {
            str(e + 1): _of_round([d["rounds"][e] for d in documents])
            for e in range(EVERY[setting].trials)
        },
        "coverage": covered(documents, NAMES),
        "width": _width(documents),
        "alarms": share([not d["good"] for d in documents]),
        "missed": share([d["excess"] > WORSE for d in known]) if known else None,
    }
    if setting in FOREIGN_SETTINGS:  # 1 where no fit is called good
        good = [d for d in documents if d["good"]]
        part["trusted"] = covered(good, NAMES)["90%"]["share"] if good else 1.0
    part |= part["rounds"][str(EVERY[setting].trials)]
    if known and EVERY[setting].noise:
        others = [d["others"] for d in known]
        part["others"] = covered(others, others[0]["names"], others[0]["circular"])
    if EVERY[setting].world == "prior":
        part["ranks"] = _ranked(known)
    if EVERY[setting].bodies == "edge":
        part["named"] = _named(documents)
    part["asked"] = [
        {**asdict(t), "found": lookup(part, t.what), "met": met(part, t)}
        for t in EVERY[setting].asked
    ]
    return part


def lookup(part: Part, what: str) -> float:
    """Return the entry of a part that a target names."""
    value = reduce(lambda node, key: node[key], what.split("."), part)
    return float(value["share"]) if isinstance(value, dict) else float(value)


def met(part: Part, target: Target) -> bool:
    """Return whether a part reaches a target."""
    found = lookup(part, target.what)
    return (target.low is None or found >= target.low) and (
        target.high is None or found <= target.high
    )


def share(held: Sequence[bool]) -> Part:
    """Return the share of those that hold, with its exact 95% interval."""
    interval = binomtest(sum(held), len(held)).proportion_ci(0.95)
    return {"share": sum(held) / len(held), "interval": [interval.low, interval.high]}


def _width(documents: Sequence[Document]) -> float:
    """Return the median width of the widest intervals, as a share of the range."""
    ends = np.array([[d["low"][-1], d["high"][-1]] for d in documents])
    return float(np.median(np.ptp(ends, axis=1) / [d.maximum for d in AQUAFISH.dimensions]))


def _of_round(rounds: Sequence[Document]) -> Part:
    fitness = np.array([r["fitness"] for r in rounds])
    seconds = np.array([r["seconds"] for r in rounds])
    return {
        "median": float(np.median(fitness)),
        "mean": float(fitness.mean()),
        "worst": float(fitness.min()),
        "exact": float((fitness >= 0.99).mean()),
        "close": float((fitness >= 0.98).mean()),
        "seconds": float(seconds.mean()),
        "p95": float(np.quantile(seconds, 0.95)),
    }


def covered(
    documents: Sequence[Document], names: Sequence[str], circular: Sequence[bool] | bool = False
) -> Part:
    """Return how often intervals hold the truth, by mass: of all unknowns, and of each."""
    truth = np.array([d["truth"] for d in documents])
    found = {}
    for k, mass in enumerate(MASSES):
        low, high = (np.array([d[end][k] for d in documents]) for end in ("low", "high"))
        held = coverage(truth, low - TOUCH, high + TOUCH, circular)
        found[f"{mass:.0%}"] = {
            "share": held.overall,
            "interval": held.overall_interval,
            "each": dict(zip(names, held.share.tolist(), strict=True)),
        }
    return found


def _ranked(documents: Sequence[Document]) -> Part:
    """Return the ranks of truths among draws, and the chance of ranks as uneven."""
    ranks = np.array([[*d["ranks"], *d["others"]["ranks"]] for d in documents])
    names = [*NAMES, *documents[0]["others"]["names"]]
    chances = rank_uniformity(ranks, DRAWS)
    return {
        "names": names,
        "ranks": ranks.T.tolist(),
        "chances": dict(zip(names, chances.tolist(), strict=True)),
        "least": float(min(1.0, chances.min() * len(chances))),  # Bonferroni
    }


def _named(documents: Sequence[Document]) -> Part:
    """Return how often a fin without length is said to be absent or missing."""
    lengths = [NAMES.index(name) for name in NAMES if name.endswith("length")]
    without = [d for d in documents if min(d["truth"][i] for i in lengths) == 0.0]
    words = ("absent", "missing")
    return share([any(w in f for f in d["findings"] for w in words) for d in without])
