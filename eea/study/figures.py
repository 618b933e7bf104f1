"""The figures of a study: Figs. 5 to 10 of the paper, and comparisons of its arms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from aquafish_gym.plans.plan import SIZES
from aquafish_gym.rendering.pictures import new_figure, save_figure
from eea.core.angles import Floats
from eea.study.arms import Arm, angle_label, spoken
from eea.study.drawing import (
    GREY,
    GUESS_LINES,
    MARKERS,
    draw_levels,
    duration_colour,
    grid,
    legend_below,
    round_axis,
)
from eea.study.results import StudyResults, angle_columns, dimension_columns
from eea.study.statistics import curve_interval

_ROUND = "round (experiments on the target)"


def save_study_figures(
    results: StudyResults,
    summary: Mapping[str, Any],
    directory: Path,
    formats: Sequence[str] = ("png",),
) -> list[Path]:
    """Draw the figures of a study; return the files."""
    directory.mkdir(exist_ok=True)
    paths = []
    for name, figure in study_figures(results, summary).items():
        for form in formats:
            paths.append(directory / f"{name}.{form}")
            save_figure(figure, paths[-1])
    return paths


def study_figures(results: StudyResults, summary: Mapping[str, Any]) -> dict[str, Figure]:
    """Return every figure that the study's numbers allow, by name."""
    arms = results.arms
    figures = {
        _figure_name(results.plan[arm]): rounds_figure(results, summary, arm) for arm in arms
    }
    figures["final"] = final_figure(results, summary)
    if any(summary["dimension_error"].values()):
        figures["conditions"] = conditions_figure(results, summary)
        figures["dimensions"] = dimensions_figure(results, summary)
        if any(results.plan[arm].infers_angles for arm in arms):
            figures["angles"] = angles_figure(results)
    return figures


def _figure_name(arm: Arm) -> str:
    return f"rounds-{arm.name}" if arm.figure is None else f"fig{arm.figure}"


def rounds_figure(results: StudyResults, summary: Mapping[str, Any], arm: str) -> Figure:
    """Return one of Figs. 5 to 10: mean and SD of OBJ_FIT against round, one line a duration."""
    figure = new_figure(4.8, 4.6)
    axes, below = figure.subplots(2, 1, sharex=True, height_ratios=(3.2, 1))
    counts = []
    widest = 0.0
    every = results.durations()
    for steps in results.durations(arm):
        curves = results.curves(arm, "obj_fit", [steps])
        curves = curves.loc[:, : results.plan[arm].config.rounds]
        counts.append(len(curves))
        mean = curves.mean()
        deviation = curves.std()
        colour = duration_colour(steps, every)
        marker = MARKERS[every.index(steps) % len(MARKERS)]
        if len(curves) > 1:
            # OBJ_FIT cannot exceed 1, but a mean plus an SD can.
            low = mean - deviation
            high = np.minimum(mean + deviation, 1.0)
            axes.fill_between(mean.index, low, high, color=colour, alpha=0.12, lw=0)
            widest = max(widest, float(deviation.max()))
            below.plot(deviation, marker=marker, ms=2.5, lw=1.2, color=colour, clip_on=False)
        axes.plot(mean, marker=marker, ms=3.5, lw=1.6, color=colour, label=f"{steps} steps")
    number = " to ".join(str(count) for count in sorted({min(counts), max(counts)}))
    shown = f"{number} replicate" if max(counts) == 1 else f"mean ± SD of {number} replicates"
    axes.set_title(f"{results.labels[arm]}: {shown}", fontsize="medium")
    _finish_rounds(axes, results, summary)
    axes.set_xlabel("")
    below.set_xlabel(_ROUND)
    below.set_ylabel("SD")
    below.set_ylim(0.0, 1.15 * widest or 0.1)  # room for the highest marker
    grid(below)
    legend_below(figure, axes, 4)
    return figure


def conditions_figure(results: StudyResults, summary: Mapping[str, Any]) -> Figure:
    """Return OBJ_FIT against round, one line an arm: means over durations, 95% intervals."""
    figure = new_figure(4.8, 3.9)
    axes = figure.add_subplot()
    _draw_arms(axes, results, "obj_fit")
    title = "mean over durations, and its 95% interval;\nn replicates"
    axes.set_title(title, fontsize="medium")
    _finish_rounds(axes, results, summary)
    legend_below(figure, axes, 2)
    return figure


def dimensions_figure(results: StudyResults, summary: Mapping[str, Any]) -> Figure:
    """Return the error of each dimension against round, one line an arm, a row of panels a fin."""
    plan = results.body_plan
    figure = new_figure(7.0, 0.9 + 1.75 * len(plan.fins))
    panels = figure.subplots(len(plan.fins), len(SIZES), sharex=True, sharey=True, squeeze=False)
    sizes = plan.fins[0].order
    for name, column in dimension_columns(plan).items():
        fin, _, size = name.partition(".")
        axes = panels[plan.names.index(fin), sizes.index(size)]
        _draw_arms(axes, results, column)
        for (guess, errors), width in zip(
            summary["guess_errors"].items(), (1.0, 1.2, 0.8), strict=True
        ):
            axes.axhline(errors[name], color=GREY, ls=GUESS_LINES[guess], lw=width, label=guess)
        axes.set_title(spoken(name), fontsize="medium")
        grid(axes)
        round_axis(axes, results.rounds)
    panels[0, 0].set_ylim(bottom=0.0)
    for axes in panels[-1]:
        axes.set_xlabel("round")
    figure.supylabel("error of the best model, share of the dimension's range", fontsize="medium")
    legend_below(figure, panels[0, 0], 3)
    return figure


def angles_figure(results: StudyResults) -> Figure:
    """Return the error of the inferred angles against round, a panel a fin, one line an arm."""
    columns = angle_columns(results.body_plan)
    figure = new_figure(max(7.0, 2.0 * len(columns)), 3.2)
    panels = figure.subplots(1, len(columns), sharey=True, squeeze=False)[0]
    for axes, (fin, column) in zip(panels, columns.items(), strict=True):
        _draw_arms(axes, results, column, angles=True)
        axes.axhline(90.0, color=GREY, ls="--", lw=1, label="a guess")
        axes.set_title(spoken(fin), fontsize="medium")
        axes.set_xlabel("round")
        grid(axes)
        round_axis(axes, results.rounds)
    panels[0].set_ylim(bottom=0.0)
    panels[0].yaxis.set_major_locator(MultipleLocator(30))
    panels[0].set_ylabel("error of the angle (degrees)")
    legend_below(figure, panels[0], 3)
    return figure


def final_figure(results: StudyResults, summary: Mapping[str, Any]) -> Figure:
    """Return the last round's OBJ_FIT of every replicate, by arm and duration.

    Boxes reach from quartile to quartile with a line at the median.
    """
    arms = results.arms
    every = results.durations()
    figure = new_figure(max(4.8, 0.8 + max(1.1, 0.29 * len(every)) * len(arms)), 3.8)
    axes = figure.add_subplot()
    width = 0.84 / len(every)
    for i, arm in enumerate(arms):
        for steps in results.durations(arm):
            last = results.replicates.loc[arm].loc[steps, "obj_fit"].to_numpy()
            place = i + (every.index(steps) - (len(every) - 1) / 2) * width
            _draw_distribution(axes, place, width, last, duration_colour(steps, every))
    for steps in every:
        colour = duration_colour(steps, every)
        axes.plot([], [], "o", ms=5, color=colour, label=f"{steps} steps")
    axes.set_xlim(-0.5, len(arms) - 0.5)
    axes.set_xticks(range(len(arms)), [results.labels[arm].replace(", ", ",\n") for arm in arms])
    for i in range(1, len(arms)):
        axes.axvline(i - 0.5, color="0.85", lw=0.8, zorder=0)
    grid(axes, "y")
    draw_levels(axes, summary["guesses"])
    axes.set_ylabel(f"OBJ_FIT after {results.rounds} rounds")
    legend_below(figure, axes, 4)
    return figure


def _draw_arms(axes: Axes, results: StudyResults, column: str, angles: bool = False) -> None:
    """Draw each arm's mean over durations and its 95% interval; angles in degrees, if inferred.

    Labels give the number n of replicates of each arm.
    """
    for arm in [results.plan[name] for name in results.arms]:
        curves = results.curves(arm.name, column).to_numpy()[:, : arm.config.rounds]
        if not len(curves) or (angles and not arm.infers_angles):
            continue
        label = arm.label
        if angles:
            curves = np.degrees(curves)
            label = angle_label(arm)
        number = np.arange(1, curves.shape[1] + 1)
        low, high = curve_interval(curves)
        axes.fill_between(number, low, high, color=arm.colour, alpha=0.15, lw=0)
        label = f"{label} (n = {len(curves)})"
        mean = curves.mean(axis=0)
        axes.plot(number, mean, color=arm.colour, ls=arm.dash, lw=1.6, label=label)


def _finish_rounds(axes: Axes, results: StudyResults, summary: Mapping[str, Any]) -> None:
    """Give axes of OBJ_FIT against round one scale for all arms of a study."""
    least = min(summary["guesses"].values())
    for arm in results.arms:
        for steps in results.durations(arm):
            curves = results.curves(arm, "obj_fit", [steps])
            least = min(least, float((curves.mean() - curves.std().fillna(0.0)).min()))
    axes.set_ylim(bottom=np.floor(10 * least) / 10)
    round_axis(axes, results.rounds)
    axes.set_xlabel(_ROUND)
    axes.set_ylabel("OBJ_FIT, likeness to the true body")
    grid(axes)
    draw_levels(axes, summary["guesses"])


def _draw_distribution(axes: Axes, place: float, width: float, values: Floats, colour: Any) -> None:
    """Draw points, shifted sideways where they would overlap, and a box behind them."""
    step = 0.012
    offsets = np.zeros(len(values))
    groups = np.floor(values / step)
    for group in np.unique(groups):
        (members,) = np.nonzero(groups == group)
        ranks = np.arange(len(members)) - (len(members) - 1) / 2
        offsets[members] = ranks * min(0.2 * width, 0.85 * width / len(members))
    low, middle, high = np.quantile(values, [0.25, 0.5, 0.75])
    left = place - 0.42 * width
    right = place + 0.42 * width
    axes.fill_between([left, right], low, high, color=colour, alpha=0.22, lw=0, zorder=1)
    axes.plot([left, right], [middle, middle], color=colour, lw=2.2, zorder=2)
    axes.scatter(place + offsets, values, s=7, color=colour, alpha=0.75, lw=0, zorder=3)
