"""The benchmark's table and its JSON records."""

from __future__ import annotations

import io
import os
import platform
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from instruments.benchmarks.measure import Timing
from instruments.benchmarks.rows import Group

_PACKAGES = ("numba", "numpy", "gymnasium", "pybullet", "mujoco", "stable_baselines3")


def machine_facts() -> dict[str, Any]:
    """Return what the figures depend on: the processor's vectors, its cores, the versions."""
    from aquafish_gym.engines.compiled.lanes import lane_width
    from aquafish_gym.physics.simd import register_bytes

    return {
        "architecture": platform.machine(),
        "cores": len(os.sched_getaffinity(0)),
        "vector_bits": 8 * register_bytes(),
        "lanes": {"float32": lane_width(np.float32), "float64": lane_width(np.float64)},
        "python": platform.python_version(),
        "versions": {name: _version(name) for name in _PACKAGES},
    }


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def make_records(
    name: str, group: Group, timings: list[Timing], first: int = 1
) -> list[dict[str, Any]]:
    """Return a record of each row, for JSON and for the table, numbered from ``first``.

    ``rate`` and ``median_rate`` are in ``unit`` a second. ``ratio`` is how many times as fast the
    row is as the one whose number is ``ratio_to``; both are None for a row compared with none. For
    a row that is a ``share``, it is which share of that one's time it takes.
    """
    number = {t.row: first + i for i, t in enumerate(timings)}
    timing = {t.row: t for t in timings}
    records: list[dict[str, Any]] = []
    for t in timings:
        row = t.row
        reference = None if row.against is None else timing[row.against]
        records.append(
            {
                "number": number[row],
                "group": name,
                "what": row.what,
                "engine": row.engine,
                "dtype": row.dtype,
                "batch": row.batch,
                "threads": row.threads,
                "unit": group.unit,
                "figure": "median" if row.typical else "best",
                "turns": len(t.seconds),
                "rate": t.rate,
                "median_rate": t.median_rate,
                "ratio": None if reference is None else _ratio(row.share, t.rate, reference.rate),
                "median_ratio": None
                if reference is None
                else _ratio(row.share, t.median_rate, reference.median_rate),
                "ratio_to": None if reference is None else number[reference.row],
                "as_time": row.as_time,
                "share": row.share,
            }
        )
    return records


def _ratio(share: bool, rate: float, other: float) -> float:
    return other / rate if share else rate / other


def make_table(title: str, groups: dict[str, Group], records: list[dict[str, Any]]) -> Table:
    """Return one table of all groups; a ratio is written with the number of its reference."""
    table = Table(title=title, box=SIMPLE_HEAD, pad_edge=False, padding=0)
    table.add_column("#", justify="right")
    table.add_column("what", overflow="fold", min_width=23)
    for column in ("engine", "dtype"):
        table.add_column(column, no_wrap=True)
    for column in ("batch", "threads", "rate", "ratio"):
        table.add_column(column, justify="right", no_wrap=True)
    for name, group in groups.items():
        table.add_section()
        table.add_row("", f"[bold]{group.title}[/bold]")
        for r in records:
            if r["group"] == name:
                table.add_row(
                    str(r["number"]),
                    *(str(r[key]) for key in ("what", "engine", "dtype", "batch", "threads")),
                    format_time(1 / r["rate"]) if r["as_time"] else f"{format_count(r['rate'])}/s",
                    _say_ratio(r),
                )
    return table


def as_text(table: Table) -> str:
    """Return a table as lines for a page."""
    console = Console(width=80, file=io.StringIO(), color_system=None)
    console.print(table)
    lines = console.file.getvalue().splitlines()  # type: ignore[attr-defined]
    return "\n".join(line.rstrip() for line in lines)


def _say_ratio(record: dict[str, Any]) -> str:
    ratio, other = record["ratio"], record["ratio_to"]
    if ratio is None:
        return "-"
    return f"{ratio:.1%} of #{other}" if record["share"] else f"{format_count(ratio)} x #{other}"


def format_count(value: float) -> str:
    """Return a number with three digits or four, and k for thousands or M for millions."""
    if value >= 1e6:
        return f"{_three_digits(value / 1e6)} M"
    if value >= 1e4:
        return f"{_three_digits(value / 1e3)} k"
    return _three_digits(value)


def format_time(seconds: float) -> str:
    """Return a time in s, ms or us, with three digits."""
    for scale, unit in ((1.0, "s"), (1e-3, "ms")):
        if seconds >= scale:
            return f"{_three_digits(seconds / scale)} {unit}"
    return f"{_three_digits(seconds / 1e-6)} us"


def _three_digits(value: float) -> str:
    digits = 0 if value >= 100 else 1 if value >= 10 else 2
    return f"{value:,.{digits}f}"
