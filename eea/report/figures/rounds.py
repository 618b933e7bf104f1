"""Pictures of a study against its rounds: Figs. 5 to 10, the conditions, sizes and angles."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from aquafish_gym.morphology import FINS
from aquafish_gym.rendering.pictures import new_figure
from eea.report.arms import angle_label
from eea.report.figures.drawing import (
    GREY,
    MARKERS,
    arm_style,
    draw_levels,
    duration_colour,
    fins_and_sizes,
    grid,
    legend_below,
    round_axis,
)
from eea.report.findings import ANGLE_ERRORS, DIMENSION_ERRORS, LAYOUT, Findings
from eea.report.statistics import FEWEST, curve_interval
from eea.report.tables import spoken

_ROUND = "round (experiments on the target)"


def rounds_figure(findings: Findings, summary: Mapping[str, Any], arm: str) -> Figure:
    """Return one of Figs. 5 to 10: mean and SD of OBJ_FIT against round, one line a duration."""
    figure = new_figure(4.8, 4.6)
    axes, below = figure.subplots(2, 1, sharex=True, height_ratios=(3.2, 1))
    counts, widest, every = [], 0.0, findings.durations()
    for steps in findings.durations(arm):
        curves = findings.curves(arm, "obj_fit", [steps])
        counts.append(len(curves))
        mean, deviation = curves.mean(), curves.std()
        colour, marker = duration_colour(steps, every), MARKERS[every.index(steps) % len(MARKERS)]
        if len(curves) > 1:
            # No OBJ_FIT passes 1, which a mean and an SD can.
            low, high = mean - deviation, np.minimum(mean + deviation, 1.0)
            axes.fill_between(mean.index, low, high, color=colour, alpha=0.12, lw=0)
            widest = max(widest, float(deviation.max()))
            below.plot(deviation, marker=marker, ms=2.5, lw=1.2, color=colour, clip_on=False)
        axes.plot(mean, marker=marker, ms=3.5, lw=1.6, color=colour, label=f"{steps} steps")
    number = " to ".join(str(count) for count in sorted({min(counts), max(counts)}))
    shown = f"{number} replicate" if max(counts) == 1 else f"mean ± SD of {number} replicates"
    axes.set_title(f"{findings.labels[arm]}: {shown}", fontsize="medium")
    _finish_rounds(axes, findings, summary)
    axes.set_xlabel("")
    below.set_xlabel(_ROUND)
    below.set_ylabel("SD")
    below.set_ylim(0.0, 1.15 * widest or 0.1)  # room for the highest marker
    grid(below)
    legend_below(figure, axes, 4)
    return figure


def conditions_figure(findings: Findings, summary: Mapping[str, Any]) -> Figure:
    """Return OBJ_FIT against round, one line an arm: means over durations, 95% intervals."""
    figure = new_figure(4.8, 3.9)
    axes = figure.add_subplot()
    _draw_arms(axes, findings, "obj_fit")
    title = "mean over durations" if len(findings.durations()) > 1 else "mean over replicates"
    if len({tuple(findings.durations(arm)) for arm in findings.arms}) > 1:
        title = "mean over each condition's durations"
    if any(len(findings.last_rounds(arm)) >= FEWEST for arm in findings.arms):
        title += ",\nand its 95% interval"
    axes.set_title(title, fontsize="medium")
    _finish_rounds(axes, findings, summary)
    legend_below(figure, axes, 2)
    return figure


def dimensions_figure(findings: Findings, summary: Mapping[str, Any]) -> Figure:
    """Return the error of each dimension against round, one line an arm, a row of panels a fin."""
    found = summary["dimensions"]
    fins, sizes = fins_and_sizes(LAYOUT.names)
    figure = new_figure(7.0, 0.9 + 1.75 * len(fins))
    panels = figure.subplots(len(fins), len(sizes), sharex=True, sharey=True, squeeze=False)
    for name, column in zip(LAYOUT.names, DIMENSION_ERRORS, strict=True):
        fin, _, size = name.partition(".")
        axes = panels[fins.index(fin), sizes.index(size)]
        _draw_arms(axes, findings, column)
        chance, middle = found["chance_error"][name], found["mid_range_error"][name]
        limit = found["nearest_error"][name]
        axes.axhline(chance, color=GREY, ls="--", lw=1, label="random bodies")
        axes.axhline(middle, color=GREY, ls=":", lw=1.2, label="mid-range body")
        axes.axhline(limit, color=GREY, lw=0.8, label="quantisation limit")
        axes.set_title(spoken(name), fontsize="medium")
        grid(axes)
        round_axis(axes, findings.rounds)
    panels[0, 0].set_ylim(bottom=0.0)
    for axes in panels[-1]:
        axes.set_xlabel("round")
    figure.supylabel("error of the best model, share of the dimension's range", fontsize="medium")
    legend_below(figure, panels[0, 0], 4)
    return figure


def angles_figure(findings: Findings) -> Figure:
    """Return the error of the inferred angles against round, a panel a fin, one line an arm."""
    # Where the angles are told there is nothing to show; where zero is assumed, the name says so.
    figure = new_figure(7.0, 3.2)
    panels = figure.subplots(1, len(FINS), sharey=True)
    for axes, fin, column in zip(panels, FINS, ANGLE_ERRORS, strict=True):
        _draw_arms(axes, findings, column, angles=True)
        axes.axhline(90.0, color=GREY, ls="--", lw=1, label="a guess")
        axes.set_title(spoken(fin), fontsize="medium")
        axes.set_xlabel("round")
        grid(axes)
        round_axis(axes, findings.rounds)
    panels[0].set_ylim(bottom=0.0)
    panels[0].yaxis.set_major_locator(MultipleLocator(30))
    panels[0].set_ylabel("error of the angle (degrees)")
    legend_below(figure, panels[0], 4)
    return figure


def _draw_arms(axes: Axes, findings: Findings, column: str, angles: bool = False) -> None:
    """Draw each arm's mean over durations and its 95% interval; angles in degrees, if not told."""
    arms, number = findings.arms, np.arange(1, findings.rounds + 1)
    if angles:
        arms = [arm for arm in arms if findings.conditions[arm] != "ideal"]
    for i, arm in enumerate(arms):
        curves, label = findings.curves(arm, column).to_numpy(), findings.labels[arm]
        if not len(curves):
            continue
        if angles:
            curves, label = np.degrees(curves), angle_label(label, findings.conditions[arm])
        colour, line = arm_style(i, arm)
        axes.fill_between(number, *curve_interval(curves), color=colour, alpha=0.15, lw=0)
        axes.plot(number, curves.mean(axis=0), color=colour, ls=line, lw=1.6, label=label)


def _finish_rounds(axes: Axes, findings: Findings, summary: Mapping[str, Any]) -> None:
    """Give axes of OBJ_FIT against round their scale, the same for all of a study's arms."""
    least = min(summary["chance"], summary["mid_range"])
    for arm in findings.arms:
        for steps in findings.durations(arm):
            curves = findings.curves(arm, "obj_fit", [steps])
            least = min(least, float((curves.mean() - curves.std().fillna(0.0)).min()))
    axes.set_ylim(bottom=np.floor(10 * least) / 10)
    round_axis(axes, findings.rounds)
    axes.set_xlabel(_ROUND)
    axes.set_ylabel("OBJ_FIT, likeness to the true body")
    grid(axes)
    draw_levels(axes, summary)
