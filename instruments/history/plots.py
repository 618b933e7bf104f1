"""The history as one picture: a panel for each family of figures."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Picture

from aquafish_gym.rendering.pictures import new_figure
from eea.study.drawing import grid
from instruments.history.changes import find_bands, find_changes
from instruments.history.figures import Figure, family_of
from instruments.history.rows import Row

COLUMNS = 2
DAY = 86_400.0  # s
MOST_LINES = 10  # of different colours
# A ratio's panel has a logarithmic axis: ratios differ a hundredfold.
RATIO = "ratio of speed"


def history_picture(rows: Sequence[Row]) -> Picture:
    """Return a picture of all figures over time, with their bands and their changes."""
    families: dict[str, list[str]] = {}
    for name in dict.fromkeys(name for row in rows for name in row.figures):
        families.setdefault(family_of(name)[0], []).append(name)
    lines = -(-len(families) // COLUMNS)
    picture = new_figure(6.6 * COLUMNS, 2.7 * lines, dpi=100)
    grid_of_axes = picture.subplots(lines, COLUMNS, squeeze=False).ravel()
    changes = find_changes(rows)
    bands = find_bands(rows, changes)
    moments = np.array([datetime.fromisoformat(row.date).timestamp() / DAY for row in rows])
    days = np.arange(np.ceil(moments[0]), moments[-1] + 1.0, 1 + (moments[-1] - moments[0]) // 7)
    dates = [f"{datetime.fromtimestamp(day * DAY, tz=UTC):%d %b}" for day in days]
    for axes, family in zip(grid_of_axes, sorted(families), strict=False):
        if family == RATIO:
            axes.set_yscale("log")
        for k, name in enumerate(sorted(families[family])):
            points = [(i, row.figures[name]) for i, row in enumerate(rows) if name in row.figures]
            colour = f"C{k % MOST_LINES}"
            _draw_line(axes, moments, points, colour, family_of(name)[1])
            for band in bands[name]:
                span = moments[[band.first, band.last]] if band.last > band.first else None
                if span is not None and np.isfinite(band.high):
                    axes.fill_between(span, band.low, band.high, color=colour, alpha=0.12, lw=0)
            for change in changes:
                if change.figure == name:
                    _mark(axes, moments[change.row], rows[change.row], change.since, colour)
        axes.set_title(family, fontsize="medium")
        axes.set_xticks(days, dates)
        axes.set_xlim(moments[0] - 0.1, moments[-1] + 0.1)
        axes.legend(fontsize="x-small", frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.02))
        grid(axes)
    for axes in grid_of_axes[len(families) :]:
        axes.set_axis_off()
    return picture


def _draw_line(
    axes: Axes,
    moments: np.ndarray,
    points: Sequence[tuple[int, Figure]],
    colour: str,
    label: str,
) -> None:
    """Draw a figure's values with their intervals."""
    when = moments[[i for i, _ in points]]
    values = np.array([figure.value for _, figure in points])
    ends = np.array([[figure.low, figure.high] for _, figure in points], dtype=np.float64)
    reach = np.nan_to_num(np.abs(ends.T - values))
    axes.errorbar(
        when, values, yerr=reach, fmt="o-", ms=3, lw=1, elinewidth=0.8, color=colour, label=label
    )


def _mark(axes: Axes, moment: float, row: Row, value: float, colour: str) -> None:
    """Ring a value that left its band, and name its commit."""
    axes.plot([moment], [value], "o", ms=10, mfc="none", mec=colour, mew=1.6)
    axes.annotate(
        row.commit[:7], (moment, value), (0, 8), textcoords="offset points",
        ha="center", fontsize="x-small", color=colour,
    )  # fmt: skip
