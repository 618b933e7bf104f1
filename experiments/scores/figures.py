"""Pictures of the scores, and of the controllers' training."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from aquafish_gym.rendering.pictures import new_figure
from eea.study.drawing import GREY, SMALL_FONT, grid, legend_below
from experiments.scores.episodes import COLUMNS

COLOURS = dict(zip(COLUMNS, ("#0072B2", "#009E73", "#E69F00", "#D55E00"), strict=True))
MARKS = dict(zip(COLUMNS, "osD^", strict=True))
# Mean and 95% interval of a controller's returns in an environment under each tier.
Scored = Mapping[tuple[str, str], Sequence[tuple[float, float, float]]]
# What each of some replicates scored on the way, by task and controller: (x, score) of any x.
Curves = Mapping[tuple[str, str], Sequence[Sequence[tuple[int, float]]]]


def scores_figure(scored: Scored) -> Figure:
    """Draw the interquartile mean of the returns, with its interval.

    A panel an environment, a row a controller, a mark a tier.
    """
    environments = list(dict.fromkeys(name for name, _ in scored))
    entries = list(dict.fromkeys(entry for _, entry in scored))
    across = min(2, len(environments))
    down = -(-len(environments) // 2)
    figure = new_figure(1.6 + 3.4 * across, down * (0.9 + 0.34 * len(entries)))
    panels = figure.subplots(down, across, sharey=True, squeeze=False)
    for axes, name in zip(panels.flat, environments, strict=False):
        for row, entry in enumerate(entries):
            for i, (middle, low, high) in enumerate(scored.get((name, entry), ())):
                column = COLUMNS[i]
                y = row + 0.18 * (i - 1.5)
                axes.plot([low, high], [y, y], color=COLOURS[column], lw=1.4)
                axes.plot(
                    middle, y, MARKS[column], color=COLOURS[column], ms=4,
                    label=column if row == 0 else None,
                )  # fmt: skip
        axes.axvline(0.0, color=GREY, lw=0.8)
        axes.set_yticks(range(len(entries)), entries, fontsize=SMALL_FONT + 1)
        axes.set_ylim(len(entries) - 0.5, -0.5)
        axes.set_title(name, fontsize=SMALL_FONT + 2)
        axes.set_xlabel("return", fontsize=SMALL_FONT + 1)
        grid(axes, "x")
    for axes in panels.flat[len(environments) :]:
        axes.set_visible(False)
    legend_below(figure, panels.flat[0], len(COLUMNS))
    return figure


def curves_figure(curves: Curves) -> Figure:
    """Draw the best that each replicate scored by then: a panel a task, a colour a controller."""
    tasks = list(dict.fromkeys(task for task, _ in curves))
    entries = list(dict.fromkeys(entry for _, entry in curves))
    colours = dict(zip(entries, mpl.colormaps["tab20"](np.arange(len(entries)) % 20), strict=True))
    figure = new_figure(1.2 + 3.0 * len(tasks), 3.6)
    for axes, task in zip(figure.subplots(1, len(tasks), squeeze=False).flat, tasks, strict=True):
        for entry in entries:
            for i, curve in enumerate(curves.get((task, entry), ())):
                x, y = np.transpose(curve)
                best = np.maximum.accumulate(y)  # a search begins several times
                axes.plot(x / x[-1], best, color=colours[entry], lw=0.9, label="" if i else entry)
        axes.set_title(task, fontsize=SMALL_FONT + 2)
        axes.set_xlabel("share of its budget", fontsize=SMALL_FONT + 1)
        axes.set_ylabel("best score so far", fontsize=SMALL_FONT + 1)
        grid(axes)
    legend_below(figure, figure.axes[0], 5)
    return figure
