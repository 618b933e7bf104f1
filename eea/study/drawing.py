"""Parts of a study's figures: colours, axes, the levels beside OBJ_FIT, and legends."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from scipy.optimize import isotonic_regression

MARKERS = ("o", "s", "^", "D", "v", "P")
GREY = "0.35"
SMALL_FONT = 8  # points
GUESS_LINES = {"random bodies": "--", "mid-range body": ":", "quantisation limit": "-"}
_NAME = 0.08  # share of the axes' height for a name of two small lines


def duration_colour(steps: int, durations: Sequence[int]) -> Any:
    """Return a colour for a duration, from light for the shortest to dark for the longest."""
    share = durations.index(steps) / (len(durations) - 1) if len(durations) > 1 else 1.0
    return colormaps["viridis"](0.78 * (1.0 - share))


def draw_levels(axes: Axes, guesses: Mapping[str, float]) -> None:
    """Draw the levels of guessing and the quantisation limit, with names at the edge."""
    for (name, level), width in zip(guesses.items(), (1.2, 1.2, 0.8), strict=True):
        axes.axhline(level, color=GREY, ls=GUESS_LINES[name], lw=width, zorder=1.5)
    axes.set_ylim(top=1.01)
    # The scale is final now. Overlapping names are moved apart as little as needed: minus a gap for
    # each name below, places must not decrease, which is an isotonic regression.
    bottom, top = axes.get_ylim()
    names = sorted(guesses, key=lambda name: guesses[name])
    shift = _NAME * np.arange(len(names))
    places = np.array([(guesses[name] - bottom) / (top - bottom) for name in names])
    rising = isotonic_regression(places - shift).x
    inside = np.clip(rising, _NAME / 2, 1.0 - _NAME / 2 - shift[-1]) + shift
    for name, place in zip(names, inside, strict=True):
        axes.annotate(
            name.replace(" ", "\n"), (1.0, place), (4, 0), xycoords="axes fraction",
            textcoords="offset points", va="center", fontsize=SMALL_FONT - 1, color=GREY,
            linespacing=0.9, annotation_clip=False,
        )  # fmt: skip


def legend_below(figure: Figure, axes: Axes, columns: int) -> None:
    """Put the legend of some axes below the whole figure."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="outside lower center", ncols=min(columns, len(labels)),
        fontsize=SMALL_FONT, frameon=False, handlelength=2.2, columnspacing=1.2,
    )  # fmt: skip


def grid(axes: Axes, axis: Literal["both", "x", "y"] = "both") -> None:
    """Draw a light grid behind everything."""
    axes.set_axisbelow(True)
    axes.grid(axis=axis, color="0.92")


def round_axis(axes: Axes, rounds: int) -> None:
    """Give axes the rounds as whole numbers."""
    axes.set_xlim(0.5, rounds + 0.5)
    axes.xaxis.set_major_locator(MaxNLocator(nbins=6, integer=True))
