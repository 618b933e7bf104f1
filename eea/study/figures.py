"""The figures of a study: Figs. 5 to 10 of the paper, and comparisons of its arms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from aquafish_gym.morphology import FINS
from aquafish_gym.rendering.pictures import FORMATS, new_figure, save_figure
from aquafish_gym.utils.validation import one_of
from eea.study.arms import FIGURES, angle_label
from eea.study.drawing import (
    GREY,
    MARKERS,
    Floats,
    arm_style,
    draw_levels,
    duration_colour,
    fins_and_sizes,
    grid,
    legend_below,
    round_axis,
    signed_axis,
)
from eea.study.results import ANGLE_ERRORS, DIMENSION_ERRORS, LAYOUT, StudyResults
from eea.study.statistics import FEWEST, curve_interval
from eea.study.tables import duration_name, spoken

_ROUND = "round (experiments on the target)"
_MOST_LINES = 8  # in one figure
_NAMES = {"final", "paired", "conditions", "dimensions", "angles", *FIGURES.values()}


def save_study_figures(
    results: StudyResults,
    summary: Mapping[str, Any],
    directory: Path,
    formats: Sequence[str] = ("png",),
) -> list[Path]:
    """Draw the figures of a study; return the files.

    Figures of an earlier report that this one does not draw are removed from the directory.

    Raises
    ------
    UnknownNameError
        If a format is not in ``FORMATS``.
    """
    for form in formats:
        one_of("format", form, FORMATS)
    directory.mkdir(exist_ok=True)
    paths = []
    for name, figure in study_figures(results, summary).items():
        for form in formats:
            paths.append(directory / f"{name}.{form}")
            save_figure(figure, paths[-1])
    for old in directory.iterdir():
        ours = old.stem in _NAMES or old.stem.startswith("rounds-")
        if ours and old.suffix[1:] in FORMATS and old not in paths:
            old.unlink()
    return paths


def study_figures(results: StudyResults, summary: Mapping[str, Any]) -> dict[str, Figure]:
    """Return every figure that a study has the numbers for, by name."""
    arms = results.arms
    figures = {
        FIGURES.get(arm, f"rounds-{arm}"): rounds_figure(results, summary, arm) for arm in arms
    }
    figures["final"] = final_figure(results, summary)
    if any(comparison["rows"] for comparison in summary["paired"]):
        figures["paired"] = paired_figure(summary)
    if len(arms) <= _MOST_LINES and summary["dimensions"]["arms"]:
        figures["conditions"] = conditions_figure(results, summary)
        figures["dimensions"] = dimensions_figure(results, summary)
        if any(results.conditions[arm] != "ideal" for arm in arms):
            figures["angles"] = angles_figure(results)
    return figures


def rounds_figure(results: StudyResults, summary: Mapping[str, Any], arm: str) -> Figure:
    """Return one of Figs. 5 to 10: mean and SD of OBJ_FIT against round, one line a duration."""
    figure = new_figure(4.8, 4.6)
    axes, below = figure.subplots(2, 1, sharex=True, height_ratios=(3.2, 1))
    counts, widest, every = [], 0.0, results.durations()
    for steps in results.durations(arm):
        curves = results.curves(arm, "obj_fit", [steps])
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
    title = "mean over durations" if len(results.durations()) > 1 else "mean over replicates"
    if len({tuple(results.durations(arm)) for arm in results.arms}) > 1:
        title = "mean over each condition's durations"
    if any(len(results.last_rounds(arm)) >= FEWEST for arm in results.arms):
        title += ",\nand its 95% interval"
    axes.set_title(title, fontsize="medium")
    _finish_rounds(axes, results, summary)
    legend_below(figure, axes, 2)
    return figure


def dimensions_figure(results: StudyResults, summary: Mapping[str, Any]) -> Figure:
    """Return the error of each dimension against round, one line an arm, a row of panels a fin."""
    found = summary["dimensions"]
    fins, sizes = fins_and_sizes(LAYOUT.names)
    figure = new_figure(7.0, 0.9 + 1.75 * len(fins))
    panels = figure.subplots(len(fins), len(sizes), sharex=True, sharey=True, squeeze=False)
    for name, column in zip(LAYOUT.names, DIMENSION_ERRORS, strict=True):
        fin, _, size = name.partition(".")
        axes = panels[fins.index(fin), sizes.index(size)]
        _draw_arms(axes, results, column)
        chance, middle = found["chance_error"][name], found["mid_range_error"][name]
        limit = found["nearest_error"][name]
        axes.axhline(chance, color=GREY, ls="--", lw=1, label="random bodies")
        axes.axhline(middle, color=GREY, ls=":", lw=1.2, label="mid-range body")
        axes.axhline(limit, color=GREY, lw=0.8, label="quantisation limit")
        axes.set_title(spoken(name), fontsize="medium")
        grid(axes)
        round_axis(axes, results.rounds)
    panels[0, 0].set_ylim(bottom=0.0)
    for axes in panels[-1]:
        axes.set_xlabel("round")
    figure.supylabel("error of the best model, share of the dimension's range", fontsize="medium")
    legend_below(figure, panels[0, 0], 4)
    return figure


def angles_figure(results: StudyResults) -> Figure:
    """Return the error of the inferred angles against round, a panel a fin, one line an arm."""
    figure = new_figure(7.0, 3.2)
    panels = figure.subplots(1, len(FINS), sharey=True)
    for axes, fin, column in zip(panels, FINS, ANGLE_ERRORS, strict=True):
        _draw_arms(axes, results, column, angles=True)
        axes.axhline(90.0, color=GREY, ls="--", lw=1, label="a guess")
        axes.set_title(spoken(fin), fontsize="medium")
        axes.set_xlabel("round")
        grid(axes)
        round_axis(axes, results.rounds)
    panels[0].set_ylim(bottom=0.0)
    panels[0].yaxis.set_major_locator(MultipleLocator(30))
    panels[0].set_ylabel("error of the angle (degrees)")
    legend_below(figure, panels[0], 4)
    return figure


def final_figure(results: StudyResults, summary: Mapping[str, Any]) -> Figure:
    """Return the last round's OBJ_FIT of every replicate, by arm and duration.

    Boxes reach from quartile to quartile with a line at the median.
    """
    arms, every = results.arms, results.durations()
    names = [results.labels[arm].replace(", ", ",\n") for arm in arms]
    crowded = len(arms) > 8 or max(len(line) for name in names for line in name.split("\n")) > 14
    share = max(0.3 if crowded else 1.1, 0.29 * len(every))
    figure = new_figure(max(4.8, 0.8 + share * len(arms)), 5.2 if crowded else 3.8)
    axes = figure.add_subplot()
    width = 0.84 / len(every)
    for i, arm in enumerate(arms):
        for j, steps in enumerate(every):
            if steps in results.durations(arm):
                last = results.replicates.loc[arm].loc[steps, "obj_fit"].to_numpy()
                place = i + (j - (len(every) - 1) / 2) * width
                _draw_distribution(axes, place, width, last, duration_colour(steps, every))
    for steps in every:
        colour = duration_colour(steps, every)
        axes.plot([], [], "o", ms=5, color=colour, label=f"{steps} steps")
    axes.set_xlim(-0.5, len(arms) - 0.5)
    axes.set_xticks(range(len(arms)), names)
    if crowded:
        axes.tick_params(axis="x", rotation=90)
    for i in range(1, len(arms)):
        axes.axvline(i - 0.5, color="0.85", lw=0.8, zorder=0)
    grid(axes, "y")
    draw_levels(axes, summary)
    axes.set_ylabel(f"OBJ_FIT after {results.rounds} rounds")
    legend_below(figure, axes, 4)
    return figure


def paired_figure(summary: Mapping[str, Any]) -> Figure:
    """Return paired differences of OBJ_FIT with their 95% intervals, by comparison and duration.

    A point is hollow where the interval holds 0, and a cross where there is no interval.
    """
    labels, durations = summary["labels"], summary["durations"]
    shown = [comparison for comparison in summary["paired"] if comparison["rows"]]
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


def _draw_arms(axes: Axes, results: StudyResults, column: str, angles: bool = False) -> None:
    """Draw each arm's mean over durations and its 95% interval; angles in degrees, if inferred."""
    arms, number = results.arms, np.arange(1, results.rounds + 1)
    if angles:
        arms = [arm for arm in arms if results.conditions[arm] != "ideal"]
    for i, arm in enumerate(arms):
        curves, label = results.curves(arm, column).to_numpy(), results.labels[arm]
        if not len(curves):
            continue
        if angles:
            curves, label = np.degrees(curves), angle_label(label, results.conditions[arm])
        colour, line = arm_style(i, arm)
        axes.fill_between(number, *curve_interval(curves), color=colour, alpha=0.15, lw=0)
        axes.plot(number, curves.mean(axis=0), color=colour, ls=line, lw=1.6, label=label)


def _finish_rounds(axes: Axes, results: StudyResults, summary: Mapping[str, Any]) -> None:
    """Give axes of OBJ_FIT against round their scale, the same for all of a study's arms."""
    least = min(summary["chance"], summary["mid_range"])
    for arm in results.arms:
        for steps in results.durations(arm):
            curves = results.curves(arm, "obj_fit", [steps])
            least = min(least, float((curves.mean() - curves.std().fillna(0.0)).min()))
    axes.set_ylim(bottom=np.floor(10 * least) / 10)
    round_axis(axes, results.rounds)
    axes.set_xlabel(_ROUND)
    axes.set_ylabel("OBJ_FIT, likeness to the true body")
    grid(axes)
    draw_levels(axes, summary)


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
