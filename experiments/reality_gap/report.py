"""Per-job results of the reality-gap suite, and means with intervals by world and method."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from aquafish_gym.runs.markdown import markdown_table
from eea.core.angles import Floats
from eea.study.statistics import FEWEST_VALUES, interval, ratio_interval
from experiments.reality_gap.job import MASSES, METHODS, ORACLE, Settings
from experiments.reality_gap.worlds import WORLDS

LEVELS = [f"{mass:.0%}" for mass in MASSES]
# What the summary has means of, columns of results.csv.
MEANS = ("obj_fit", "distance", "distance_sample", "trials", "fits", "right")
SHARES = {"share": "distance", "share_sample": "distance_sample"}
# Units that an oracle must surely swim for anything to be a share of it: half its body.
LEAST_DISTANCE = 2.0

Row = dict[str, Any]


def result_row(outcome: Mapping[str, Any]) -> Row:
    """Return the row of one job in results.csv."""
    row: Row = {name: outcome[name] for name in ("world", "method", "seed", "damage", "gap")}
    if "trials" in outcome:
        for name, column in (("obj_fit", "objective_fitness"), ("cpu_seconds", "seconds")):
            values = outcome[column]
            row |= {f"{name}_{r}": value for r, value in enumerate(values, 1)}
            row[name] = values[-1]
        row["mod_fit"] = outcome["model_fitness"][-1]
        row["trials"] = sum(outcome["trials"])
    belief = outcome.get("belief")
    if belief:
        for level in LEVELS:
            row[f"covered_{level}"] = float(np.mean(belief["covered"][level]))
        row["fits"] = float(belief["good"])
        row["hypothesis"] = max(belief["hypotheses"], key=belief["hypotheses"].get)
        row["right"] = float(row["hypothesis"] in belief["true"])
    row["distance"] = float(np.mean(outcome["gaits"]["body"]))
    if "sample" in outcome["gaits"]:
        row["distance_sample"] = float(np.mean(outcome["gaits"]["sample"]))
    return row


def results(outcomes: Iterable[Mapping[str, Any]]) -> pd.DataFrame:
    """Return the table of results.csv, a row for each job."""
    return pd.DataFrame([result_row(outcome) for outcome in outcomes])


def build_report(table: pd.DataFrame, settings: Mapping[str, Any], code: Any) -> dict[str, Any]:
    """Return all numbers of the report, ready for JSON, from the table of ``results``.

    ``summary`` has a row for each world and method. A mean is {"mean", "interval"}; the interval is
    None with fewer than five replicates. A share of the oracle's distance is the ratio of the two
    mean distances over the seeds that both have; no share is given where the oracle does not surely
    swim ``LEAST_DISTANCE``.
    """
    cells = {key: cell.set_index("seed") for key, cell in table.groupby(["world", "method"])}
    rows = []
    for world in WORLDS:
        oracle = cells.get((world, ORACLE))
        for method in (*METHODS, ORACLE):
            if (world, method) not in cells:
                continue
            cell = cells[world, method].dropna(axis="columns", how="all")
            row: Row = {"world": world, "method": method, "replicates": len(cell)}
            row |= {name: _mean(cell[name]) for name in MEANS if name in cell}
            if oracle is not None and method != ORACLE:
                shares = {name: _share(cell.get(col), oracle) for name, col in SHARES.items()}
                row |= {name: share for name, share in shares.items() if share}
            if "hypothesis" in cell:
                names = [f"covered_{level}" for level in LEVELS]
                row["covered"] = {n.removeprefix("covered_"): _mean(cell[n]) for n in names}
                row["hypotheses"] = cell["hypothesis"].value_counts().to_dict()
            rows.append(row)
    return {
        "settings": settings,
        "code": code,
        "seeds": sorted(int(seed) for seed in table["seed"].unique()),
        "worlds": {
            world: WORLDS[world].difference for world in WORLDS if (table["world"] == world).any()
        },
        "summary": rows,
    }


def sure_to_swim(distance: Mapping[str, Any]) -> bool:
    """Return whether an oracle's mean distance is surely large enough to divide by."""
    low: float = (distance["interval"] or [distance["mean"]])[0]
    return low >= LEAST_DISTANCE


def _mean(values: pd.Series[float] | Floats) -> Row:
    return {"mean": float(values.mean()), "interval": interval(values)}


def _share(distances: pd.Series[float] | None, oracle: pd.DataFrame) -> Row | None:
    if distances is None:
        return None
    pairs = pd.concat([distances, oracle["distance"]], axis=1, join="inner").dropna().to_numpy()
    if not len(pairs):
        return None
    own, far = pairs.T
    if not sure_to_swim(_mean(far)):
        return None
    return {"mean": float(own.mean() / far.mean()), "interval": ratio_interval(own, far)}


def times_rows(table: pd.DataFrame) -> list[list[str]]:
    """Return the CPU s of each method by world: all trials, one thread, everything compiled."""
    methods = [name for name in METHODS if (table["method"] == name).any()]
    rows = [["world", *(f"CPU s, {name}" for name in methods)]]
    means = table.groupby(["world", "method"])["cpu_seconds"].mean()
    for world in WORLDS:
        if (table["world"] == world).any():
            cells = [means.get((world, name)) for name in methods]
            rows.append([world, *("-" if one is None else f"{one:.2g}" for one in cells)])
    return rows


def to_markdown(report: Mapping[str, Any], settings: Settings, pictures: Sequence[str]) -> str:
    """Return the report for people, with these pictures' files shown."""
    seeds = len(report["seeds"])
    eea = settings.eea
    gait = settings.gait
    parts = [
        "# Reality gap",
        f"Targets whose world differs from the one that the methods simulate, with damages that no "
        f"method was developed on; {seeds} replicate{'s' if seeds != 1 else ''}"
        f"{', means with 95% bootstrap intervals' if seeds >= FEWEST_VALUES else ''}. Every method "
        f"performs {eea.rounds} trials of {eea.steps / 100:g} s of its own; what the target hides "
        "is the same for all of them.",
        "*Covered* is the share of dimensions that the 90% intervals hold, which only joint "
        "inference gives. *Swims* is how far the gait for the body that was found gets in the "
        f"target's world in {gait.seconds:g} s, in units of 5 cm, on average over "
        f"{settings.poses} random poses, and *share* of what the oracle's does, the gait for the "
        f"true body. Gaits are evolved in the plain world, for {gait.generations} generations of "
        f"{gait.population}; *sample* is the gait for {settings.bodies} bodies that joint "
        f"inference holds possible. Where the oracle does not surely swim {LEAST_DISTANCE:g} units "
        "ahead, nothing is a share of it.",
    ]
    for world, difference in report["worlds"].items():
        parts.append(f"## {world}: {difference}")
        rows = [row for row in report["summary"] if row["world"] == world]
        parts.append(markdown_table([_HEAD, *(_cells(row) for row in rows)]))
    judged = [row for row in report["summary"] if "hypotheses" in row]
    if judged:
        parts += [
            "## The calibration of joint inference",
            "Shares of dimensions that its intervals hold; *fits*, the share of replicates in "
            "which the goodness-of-fit test accepts the best fit; *right*, that in which the "
            "most probable hypothesis is true.",
            markdown_table(
                [
                    ["world", *(f"{level} intervals" for level in LEVELS), "fits", "right",
                     "most probable, times"],
                    *(_calibration_cells(row) for row in judged),
                ]
            ),
        ]  # fmt: skip
    if pictures:
        parts += ["## Figures", *(f"![{name.partition('.')[0]}]({name})" for name in pictures)]
    return "\n\n".join(parts) + "\n"


_HEAD = ["method", "n", "OBJ_FIT", "covered", "swims", "share", "sample swims", "share"]


def _cells(row: Mapping[str, Any]) -> list[str]:
    covered = row.get("covered", {})
    return [
        row["method"],
        str(row["replicates"]),
        _number(row.get("obj_fit"), ".3f"),
        _number(covered.get("90%"), ".2f"),
        _number(row["distance"], ".1f"),
        _number(row.get("share"), ".0%"),
        _number(row.get("distance_sample"), ".1f"),
        _number(row.get("share_sample"), ".0%"),
    ]


def _calibration_cells(row: Mapping[str, Any]) -> list[str]:
    return [
        row["world"],
        *(_number(row["covered"][level], ".2f") for level in LEVELS),
        f"{row['fits']['mean']:.0%}",
        f"{row['right']['mean']:.0%}",
        "; ".join(f"{name}, {count}" for name, count in row["hypotheses"].items()),
    ]


def _number(value: Mapping[str, Any] | None, form: str) -> str:
    if value is None:
        return ""
    low, high = value["interval"] or (0.0, 0.0)
    return f"{value['mean']:{form}}" + (f" [{low:{form}}, {high:{form}}]" if low < high else "")
