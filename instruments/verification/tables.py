"""The report's numbers as tables: for the terminal, and for a page of the documentation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from rich.table import Table as RichTable

from aquafish_gym.runs.markdown import markdown_table

Report = dict[str, Any]


@dataclass(frozen=True)
class Table:
    """Text in rows; the first ``words`` columns are set to the left, the others are numbers."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    words: int = 1

    def rich(self) -> RichTable:
        """Return it for a terminal."""
        table = RichTable(title=self.title, title_justify="left")
        for i, column in enumerate(self.columns):
            table.add_column(column, justify="left" if i < self.words else "right")
        for row in self.rows:
            table.add_row(*row)
        return table

    def markdown(self) -> str:
        """Return it without its title."""
        return markdown_table([self.columns, *self.rows], self.words)


def agreement_table(report: Report) -> Table:
    """Return PyBullet against the compiled engine, and its precisions."""
    return Table(
        f"differences of the engines over {report['seconds']:g} s",
        ("engines", "robots", "what", "median", "maximum"),
        [
            (r["engines"], str(r["robots"]), f"{r['what']} ({r['unit']})",
             f"{r['median']:.1e}", f"{r['maximum']:.1e}")
            for r in report["rows"]
        ],
        words=3,
    )  # fmt: skip


TABLE_DURATIONS = (1.28, 2.56, 5.12, 20.0)


def single_precision_table(report: Report) -> Table:
    """Return float32's largest difference from float64 by duration."""
    return Table(
        f"float32 against float64, {report['robots']} robots",
        ("what", "seconds", "median", "90%", "99%", "maximum"),
        [
            (f"{r['what']} ({r['unit']})", f"{r['seconds']:g}",
             *(f"{r[q]:.1e}" for q in ("median", "90%", "99%", "maximum")))
            for r in report["rows"]
            if r["seconds"] in TABLE_DURATIONS
        ],
    )  # fmt: skip


def convergence_table(report: Report) -> Table:
    """Return the scheme's error at each step."""
    return Table(
        f"the scheme against RK4, {report['robots']} robots over {report['seconds']:g} s",
        ("what", "step (s)", "median", "maximum", "order", "diverged"),
        [
            (f"{r['what']} ({r['unit']})", f"{r['step']:g}", f"{r['median']:.1e}",
             f"{r['maximum']:.1e}", "" if r["order"] is None else f"{r['order']:.2f}",
             str(r["diverged"]))
            for r in report["rows"]
        ],
    )  # fmt: skip


def quadrature_table(report: Report) -> Table:
    """Return the rms errors on fins, of the law's rule and of others: force, torque."""
    cells: dict[str, dict[str, str]] = {}
    points: dict[str, str] = {}
    for r in report["rows"]:
        if r["part"] != "body":
            row = cells.setdefault(r["rule"], {})
            row[r["part"]] = f"{100 * r['force']:.2f}, {100 * r['torque']:.2f}"
            points[r["rule"]] = "" if r["points"] is None else str(r["points"])
    parts = next(iter(cells.values()))
    return Table(
        "rms error of force, torque on a fin, each in % of its rms",
        ("rule", "points", *parts),
        [(rule, points[rule], *row.values()) for rule, row in cells.items()],
    )


def body_table(report: Report) -> Table:
    """Return the rms errors on capsule and fin mounts."""
    return Table(
        "rms error on capsule and fin mounts, likewise",
        ("rule", "force", "torque"),
        [
            (r["rule"], f"{r['force']:.2%}", f"{r['torque']:.2%}")
            for r in report["rows"]
            if r["part"] == "body"
        ],
    )


def paths_table(report: Report) -> Table:
    """Return how far the law's few points lead robots off their paths."""
    return Table(
        f"paths by the law's points against the whole surface's, {report['robots']} robots "
        f"over {report['seconds']:g} s",
        ("what", "median", "maximum"),
        [
            (f"{r['what']} ({r['unit']})", f"{r['median']:.1e}", f"{r['maximum']:.1e}")
            for r in report["paths"]
        ],
    )


_STATEMENTS = {
    "mujoco": "MuJoCo, RK4",
    "momentum": "momentum form, RK4",
    "extrapolated": "scheme, extrapolated",
}
_QUANTITIES = {
    "position": "position (units)",
    "attitude": "attitude (rad)",
    "momentum": "momentum",
    "angular": "angular m.",
}


def mechanics_table(report: Report) -> Table:
    """Return the gaps to MuJoCo, median and maximum in one cell."""
    cells: dict[str, dict[str, str]] = {}
    for r in report["rows"]:
        row = cells.setdefault(r["statement"], {})
        row[r["what"]] = f"{r['median']:.0e}, {r['maximum']:.0e}"
    return Table(
        f"without water, {report['robots']} robots over {report['seconds']:g} s: gap to MuJoCo's "
        "motion, and to the momenta at the start; median, maximum",
        ("statement", *_QUANTITIES.values()),
        [
            (_STATEMENTS.get(name) or f"scheme, {name} s",
             *("" if name == "mujoco" and what in ("position", "attitude") else row[what]
               for what in _QUANTITIES))
            for name, row in cells.items()
        ],
    )  # fmt: skip


def strokes_table(report: Report) -> Table:
    """Return the mean thrust of fins on a towed body."""
    return Table(
        "mean thrust of a nominal fin at full speed on a body towed ahead",
        ("fin", "towed (units/s)", "mean thrust"),
        [
            # Rounding leaves 1e-16 where there is none.
            (r["fin"], f"{r['speed']:g}", f"{round(r['mean_thrust'], 9) + 0.0:.3f}")
            for r in report["rows"]
        ],
    )


TABLES: dict[str, tuple[str, Callable[[Report], Table]]] = {
    "agreement": ("agreement", agreement_table),
    "single_precision": ("single_precision", single_precision_table),
    "convergence": ("convergence", convergence_table),
    "quadrature": ("quadrature", quadrature_table),
    "body": ("quadrature", body_table),
    "paths": ("quadrature", paths_table),
    "mechanics": ("mechanics", mechanics_table),
    "strokes": ("strokes", strokes_table),
}


def make_tables(report: Report) -> dict[str, Table]:
    """Return every table that a whole report has the numbers of."""
    return {name: make(report[part]) for name, (part, make) in TABLES.items() if report.get(part)}
