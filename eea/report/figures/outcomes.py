"""Pictures of what a study ends with: its last round, differences between arms, and spread."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aquafish_gym.rendering.pictures import new_figure
from eea.report.figures.drawing import (
    GREY,
    MARKERS,
    Floats,
    draw_levels,
    duration_colour,
    fins_and_sizes,
    grid,
    legend_below,
    signed_axis,
)
from eea.report.findings import Findings
from eea.report.statistics import FEWEST
from eea.report.tables import duration_name, spoken

_SIZES = ("#D55E00", "#0072B2", "#009E73", "#000000")
# Roots spread out what is near zero, and zero itself has a place.
_ROOTS = (lambda value: np.sqrt(np.maximum(value, 0.0)), np.square)


def final_figure(findings: Findings, summary: Mapping[str, Any], arms: Sequence[str]) -> Figure:
    """Return the last round's OBJ_FIT of every replicate of some arms, by duration.

    Boxes reach from quartile to quartile with a line at the median.
    """
    every, durations = findings.durations(*arms), findings.durations()
    names = [findings.labels[arm].replace(", ", ",\n") for arm in arms]
    crowded = len(arms) > 8 or max(len(line) for name in names for line in name.split("\n")) > 14
    share = max(0.3 if crowded else 1.1, 0.29 * len(every))
    figure = new_figure(max(4.8, 0.8 + share * len(arms)), 5.2 if crowded else 3.8)
    axes = figure.add_subplot()
    width = 0.84 / len(every)
    for i, arm in enumerate(arms):
        for j, steps in enumerate(every):
            if steps in findings.durations(arm):
                last = findings.replicates.loc[arm].loc[steps, "obj_fit"].to_numpy()
                place = i + (j - (len(every) - 1) / 2) * width
                _draw_distribution(axes, place, width, last, duration_colour(steps, durations))
    for steps in every:
        colour = duration_colour(steps, durations)
        axes.plot([], [], "o", ms=5, color=colour, label=f"{steps} steps")
    axes.set_xlim(-0.5, len(arms) - 0.5)
    axes.set_xticks(range(len(arms)), names)
    if crowded:
        axes.tick_params(axis="x", rotation=90)
    for i in range(1, len(arms)):
        axes.axvline(i - 0.5, color="0.85", lw=0.8, zorder=0)
    grid(axes, "y")
    draw_levels(axes, summary)
    axes.set_ylabel(f"OBJ_FIT after {findings.rounds} rounds")
    legend_below(figure, axes, 4)
    return figure


def forest_figure(
    comparisons: Sequence[Mapping[str, Any]], labels: Mapping[str, str], durations: Sequence[int]
) -> Figure:
    """Return paired differences of OBJ_FIT with their 95% intervals, by comparison and duration.

    A point is hollow where the interval holds 0, and a cross where there is none.
    """
    shown = [comparison for comparison in comparisons if comparison["rows"]]
    keys = sorted(
        {tuple(row["durations"]) for c in shown for row in c["rows"]}, key=lambda k: (len(k), *k)
    )
    colours = {
        key: duration_colour(key[0], durations) if len(key) == 1 else "black" for key in keys
    }
    # For names of one line, and of two, beside one row.
    gap = 0.8 if len(keys) > 1 else 1.5
    lines = sum(len(comparison["rows"]) + gap for comparison in shown)
    figure = new_figure(5.4, 1.3 + 0.18 * lines)
    axes = figure.add_subplot()
    place, ticks = 0.0, []
    for comparison in shown:
        rows = comparison["rows"]
        for i, row in enumerate(rows):
            key, last = tuple(row["durations"]), row["last_round"]
            colour, single = colours[key], len(key) == 1
            mark = "o" if single else "D"
            if last["interval"] is None:
                axes.plot(last["mean"], place + i, "x", ms=5, mew=1.6, color=colour)
                continue
            low, high = last["interval"]
            fill = "white" if low <= 0.0 <= high else colour
            axes.plot([low, high], [place + i] * 2, color=colour, lw=1.6 if single else 2.4)
            axes.plot(last["mean"], place + i, mark, ms=5, color=colour, mfc=fill)
        name = f"{labels[comparison['first']]}\nless {labels[comparison['second']]}"
        ticks.append((place + (len(rows) - 1) / 2, name))
        place += len(rows) + gap
        axes.axhline(place - (1 + gap) / 2, color="0.9", lw=0.8)
    axes.axvline(0.0, color=GREY, lw=1)
    axes.set_ylim(place - (1 + gap) / 2, -(1 + gap) / 2)
    axes.set_yticks([tick for tick, _ in ticks], [name for _, name in ticks])
    axes.tick_params(axis="y", length=0)
    grid(axes, "x")
    intervals = [row["last_round"]["interval"] for c in shown for row in c["rows"]]
    notes = []
    if any(interval is not None for interval in intervals):
        notes.append("95% interval (hollow where it holds 0)")
    if None in intervals:
        notes.append(f"crosses: under {FEWEST} replicates, no interval")
    axes.set_xlabel(",\n".join(["paired difference of OBJ_FIT", *notes]), fontsize="medium")
    signed_axis(axes)
    for key in keys:
        mark = "o" if len(key) == 1 else "D"
        axes.plot([], [], mark, ms=5, color=colours[key], label=duration_name(key))
    legend_below(figure, axes, 3)
    return figure


def spread_figure(summary: Mapping[str, Any]) -> Figure:
    """Return final error against the models' spread, a point a dimension, a panel an arm.

    Errors are shares of what a random body would have, so that 1 is chance.
    """
    found = summary["dimensions"]
    names = list(found["chance_error"])
    fins, sizes = fins_and_sizes(names)
    arms = {arm: found["arms"][arm] for arm in summary["arms"] if arm in found["arms"]}
    columns = 2 if len(arms) == 4 else min(3, len(arms))
    rows = -(-len(arms) // columns)
    figure = new_figure(max(4.8, 0.8 + 2.1 * columns), 1.3 + 2.0 * rows)
    panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    for axes, (arm, numbers) in zip(panels, arms.items(), strict=False):
        for name in names:
            fin, _, size = name.partition(".")
            row, chance = numbers["dimensions"][name], found["chance_error"][name]
            x, y = row["spread"]["mean"], row["error"]["mean"] / chance
            colour = _SIZES[sizes.index(size) % len(_SIZES)]
            if row["error"]["interval"] is not None:
                low, high = row["error"]["interval"]
                ends = [low / chance, high / chance]
                axes.plot([x, x], ends, color=colour, lw=1, clip_on=False)
            marker = MARKERS[fins.index(fin) % len(MARKERS)]
            axes.plot(
                x, y, marker, ms=6, color=colour, mec="white", mew=0.6, clip_on=False, zorder=3
            )
        axes.axhline(1.0, color=GREY, ls="--", lw=1)
        grid(axes)
        axes.set_title(summary["labels"][arm], fontsize="medium")
    for i, axes in enumerate(panels):
        if i >= len(arms):
            axes.set_axis_off()
        elif i + columns >= len(arms):
            axes.set_xlabel("spread, share of range")
            axes.tick_params(labelbottom=True)
    panels[0].set_xscale("function", functions=_ROOTS)
    panels[0].set_yscale("function", functions=_ROOTS)
    panels[0].set_xticks([0.0, 0.01, 0.05, 0.1, 0.2, 0.3], ["0", ".01", ".05", ".1", ".2", ".3"])
    panels[0].set_yticks([0.0, 0.05, 0.2, 0.5, 1.0, 1.5], ["0", ".05", ".2", ".5", "1", "1.5"])
    panels[0].set_ylim(0.0, max(1.2, panels[0].get_ylim()[1]))
    panels[0].set_xlim(0.0, max(0.1, 1.05 * panels[0].get_xlim()[1]))
    for fin, marker in zip(fins, MARKERS, strict=False):
        panels[0].plot([], [], marker, ms=6, color="0.5", label=spoken(fin))
    for size, colour in zip(sizes, _SIZES, strict=False):
        panels[0].plot([], [], "-", lw=4, color=colour, label=size)
    panels[0].plot([], [], "--", lw=1, color=GREY, label="random bodies")
    figure.supylabel("error of the best model,\n1 = random bodies (root scales)", fontsize="medium")
    legend_below(figure, panels[0], 4)
    return figure


def _draw_distribution(axes: Axes, place: float, width: float, values: Floats, colour: Any) -> None:
    """Draw points beside each other where they would hide one another, and a box behind."""
    step = 0.012
    offsets = np.zeros(len(values))
    groups = np.floor(values / step)
    for group in np.unique(groups):
        (members,) = np.nonzero(groups == group)
        ranks = np.arange(len(members)) - (len(members) - 1) / 2
        offsets[members] = ranks * min(0.2 * width, 0.85 * width / len(members))
    low, middle, high = np.quantile(values, [0.25, 0.5, 0.75])
    left, right = place - 0.42 * width, place + 0.42 * width
    axes.fill_between([left, right], low, high, color=colour, alpha=0.22, lw=0, zorder=1)
    axes.plot([left, right], [middle, middle], color=colour, lw=2.2, zorder=2)
    axes.scatter(place + offsets, values, s=7, color=colour, alpha=0.75, lw=0, zorder=3)
