"""The report's numbers as tables, for the terminal and for pages of the documentation."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from instruments.inference.recovery import recovery_table
from instruments.inference.settings import EVERY, FOREIGN_SETTINGS
from instruments.inference.strangers import KINDS
from instruments.inference.swims import TITLES
from instruments.verification.tables import Table

Report = Mapping[str, Any]

WORDS = {
    "median": "median OBJ_FIT",
    "exact": "OBJ_FIT at least 0.99",
    "close": "OBJ_FIT at least 0.98",
    "coverage.90%.share": "90% intervals that hold",
    "missed": "optimum missed",
    "alarms": "“none of the bodies…”",
    "trusted": "90% intervals of good fits that hold",
    "named": "a fin without length is said to be absent or missing",
}


def make_tables(report: Report) -> dict[str, Table]:
    """Return every table that a report has the numbers of, by the name that a page gives it."""
    parts = report["settings"]
    foreign = {name: part for name, part in parts.items() if name in FOREIGN_SETTINGS}
    parts = {name: part for name, part in parts.items() if name not in foreign}
    tables = {"calibration": settings_table(parts), "asked": asked_table(parts)} if parts else {}
    if foreign:
        tables["foreign"] = foreign_table(foreign)
    if "exact" in parts:
        tables["exact"] = exact_table(parts["exact"])
    swims = dict(report.get("swims", {}))
    if "rows" in (logs := report.get("logs", {})):
        tables["rows"] = rows_table(logs["rows"])
    recovery = swims.pop("recovery", None)
    if report.get("strangers"):
        tables["strangers"] = strangers_table(report["strangers"])
    if swims:
        tables["swims"] = swims_table(swims)
    if recovery:
        tables["recovery"] = recovery_table(recovery)
    return tables


def strangers_table(parts: Mapping[str, Any]) -> Table:
    """Return how often intervals of other people's robots hold where nothing warns."""
    rows = []
    for name, part in parts.items():
        held = part.get("share")
        rows.append(
            (KINDS.get(name, "all"), str(part["robots"]), str(part["good"]),
             str(part["warned"]), str(part["numbers"]), "" if held is None else f"{held:.1%}",
             "" if held is None else " to ".join(f"{end:.0%}" for end in part["interval"]),
             f"{part['simulations']:.0f}")
        )  # fmt: skip
    columns = (
        "robot", "draws", "as noise would", "warned of", "numbers", "90% intervals that hold",
        "95% interval of that", "simulations, median",
    )  # fmt: skip
    return Table("robots of other people", columns, rows)


def swims_table(parts: Mapping[str, Any]) -> Table:
    """Return what was found of swims."""
    rows = []
    for name, part in parts.items():
        swims = str(part["swims"])
        if name == "window":
            still = part["median_tail_still"]
            found = (
                f"OBJ_FIT {part['median']:.3f} in the median, {part['least']:.3f} at least; "
                f"{part['all_fins']} gaits move all fins, median "
                f"{part['median_all_fins'] or np.nan:.3f}"
                + (f"; with the tail still {still:.3f}" if still else "")
                + f"; 90% intervals hold {part['covered']:.0%} of the sizes"
            )
        elif name == "unchanged":
            found = (
                f"{part['alarms']} false alarms in {part['windows']} windows of a second; the "
                f"least chance is {part['least']:.1g}"
            )
        else:
            found = (
                f"{part['soon']} noticed within 3 s, the median after {part['median_delay']:.1f} "
                f"s; {part['early']} false alarms before; never noticed: "
                + (", ".join(part["unnoticed"]) or "none")
            )
        rows.append((TITLES[name], swims, found))
    return Table("swims", ("swims", "how many", "found"), rows, words=3)


def rows_table(parts: Mapping[str, Any]) -> Table:
    """Return what was found of logs, by the rate of their rows."""
    return Table(
        "logs whose commands change between rows",
        ("rows a second", "logs", "as noise would", "median OBJ_FIT", "least", "90%", "CPU s"),
        [
            (rate, str(part["logs"]), str(part["good"]), f"{part['median']:.3f}",
             f"{part['least']:.3f}", "" if part["covered"] is None else f"{part['covered']:.1%}",
             f"{part['seconds']:.1f}")
            for rate, part in parts.items()
        ],
    )  # fmt: skip


def settings_table(parts: Mapping[str, Any]) -> Table:
    """Return what was found in each setting, after the last trial."""
    rows = []
    for name, part in parts.items():
        held = part["coverage"]
        covered = [f"{held[mass]['share']:.1%}" for mass in ("50%", "80%", "90%")]
        if not EVERY[name].noise:
            covered = ["", "", ""]
        missed = "" if part["missed"] is None else f"{part['missed']['share']:.1%}"
        rows.append(
            (EVERY[name].title, str(part["robots"]), f"{part['median']:.4f}",
             f"{part['close']:.0%}", f"{part['worst']:.3f}", *covered, missed,
             f"{part['alarms']['share']:.1%}", f"{part['seconds']:.1f} ({part['p95']:.1f})")
        )  # fmt: skip
    columns = (
        "setting", "robots", "median OBJ_FIT", "≥ 0.98", "least", "50%", "80%", "90%",
        "missed", "alarms", "CPU s (95%)",
    )  # fmt: skip
    return Table("joint inference, after three trials", columns, rows)


def foreign_table(parts: Mapping[str, Any]) -> Table:
    """Return what was found in the worlds that no nuisance describes."""
    return Table(
        "swims that the model does not describe, after three trials",
        ("world", "rad/s", "robots", "median OBJ_FIT", "said to be bad", "90%", "of good fits",
         "80% of good fits hold"),
        [
            (EVERY[name].title, f"{EVERY[name].noise:g}", str(part["robots"]),
             f"{part['median']:.3f}", f"{part['alarms']['share']:.0%}",
             f"{part['coverage']['90%']['share']:.0%}",
             f"{part['trusted']:.0%}" if part["alarms"]["share"] < 1.0 else "",
             "yes" if part["asked"][0]["met"] else "no")
            for name, part in parts.items()
        ],
    )  # fmt: skip


def exact_table(part: Mapping[str, Any]) -> Table:
    """Return what was found without noise, by trials."""
    return Table(
        "without noise",
        ("trials", "OBJ_FIT ≥ 0.99", "median", "least", "CPU s so far, mean", "95% quantile"),
        [
            (trials, f"{r['exact']:.0%}", f"{r['median']:.6f}", f"{r['worst']:.3f}",
             f"{r['seconds']:.2f}", f"{r['p95']:.2f}")
            for trials, r in part["rounds"].items()
        ],
    )  # fmt: skip


def asked_table(parts: Mapping[str, Any]) -> Table:
    """Return what was asked of each setting, and what was found."""
    return Table(
        "asked and found",
        ("setting", "what", "asked", "found", "met"),
        [
            (EVERY[name].title, _words(a["what"]), _bounds(a), _number(a["what"], a["found"]),
             "yes" if a["met"] else "no")
            for name, part in parts.items()
            for a in part["asked"]
        ],
        words=3,
    )  # fmt: skip


def _words(what: str) -> str:
    """Return a target's entry in words."""
    if what.startswith("rounds."):
        _, trials, entry = what.split(".")
        return f"{WORDS[entry]}, {trials} trial{'s' * (trials != '1')}"
    return WORDS[what]


def _bounds(asked: Mapping[str, Any]) -> str:
    low, high = (
        None if asked[end] is None else _number(asked["what"], asked[end])
        for end in ("low", "high")
    )
    if low and high:
        return f"{low} to {high}"
    return f"at least {low}" if low else f"at most {high}"


def _number(what: str, value: float) -> str:
    entry = what.rpartition(".")[2]
    return f"{value:.4g}" if entry in ("median", "least") else f"{value:.1%}"
