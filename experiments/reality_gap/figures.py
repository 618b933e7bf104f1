"""The suite's pictures: OBJ_FIT by world, against trials and against CPU time; shares; coverage."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator, PercentFormatter

from aquafish_gym.rendering.pictures import new_figure, save_figure
from eea.core.angles import Floats
from eea.study.arms import ARMS
from eea.study.drawing import GREY, MARKERS, SMALL_FONT, grid, legend_below
from eea.study.statistics import curve_interval
from experiments.reality_gap.job import METHODS, ORACLE
from experiments.reality_gap.report import LEVELS, sure_to_swim
from experiments.reality_gap.worlds import WORLDS

COLOURS: dict[str, str] = {name: ARMS[name].colour for name in METHODS}
MARKS: dict[str, str] = dict(zip(METHODS, MARKERS, strict=False))
LEAST = 1e-4  # smaller errors of OBJ_FIT are drawn at the edge
FITNESSES = (0.5, 0.7, 0.8, 0.9, 0.95, 0.98, 0.99, 0.995, 0.998, 0.999, 0.9999)
CURVED = ("plain", "noise-0.01")  # worlds whose rounds are drawn
# The paper's best: the end of Out-of-Band Inference in its Fig. 9, and what a replicate was given.
PAPERS_FITNESS = 0.90
PAPERS_TRIALS = 25
PAPERS_SECONDS = 48 * 3600.0
SECONDS = {0.1: "0.1 s", 1.0: "1 s", 10.0: "10 s", 300.0: "5 min", 3600.0: "1 h", 172800.0: "48 h"}

Rows = Sequence[Mapping[str, Any]]


def draw_all(
    folder: Path, table: pd.DataFrame, report: Mapping[str, Any], formats: Sequence[str]
) -> list[str]:
    """Write all pictures, each in each format, and return their files' names."""
    rows = report["summary"]
    figures = {}
    if any(world in report["worlds"] for world in CURVED) and "trials" in table:
        figures["progress"] = progress_figure(table, "trials")
        figures["times"] = progress_figure(table, "seconds")
    if any("obj_fit" in row for row in rows):
        figures["obj_fit"] = worlds_figure(rows, "obj_fit")
    if any("share" in row for row in rows):
        figures["share"] = worlds_figure(rows, "share")
    if any("covered" in row for row in rows):
        figures["coverage"] = coverage_figure(rows)
    names = []
    for name, figure in figures.items():
        for kind in formats:
            names.append(f"{name}.{kind}")
            save_figure(figure, folder / names[-1])
    return names


def progress_figure(table: pd.DataFrame, across: Literal["trials", "seconds"]) -> Figure:
    """Draw OBJ_FIT against trials or CPU time on a log scale, with the paper's marked."""
    worlds = [world for world in CURVED if (table["world"] == world).any()]
    figure = new_figure(5.0, 0.8 + 2.9 * len(worlds))
    panels = figure.subplots(len(worlds), 1, sharex="col", squeeze=False)[:, 0]
    papers = PAPERS_TRIALS if across == "trials" else PAPERS_SECONDS
    for axes, world in zip(panels, worlds, strict=True):
        for method in METHODS:
            cell = table[(table["world"] == world) & (table["method"] == method)]
            if cell.empty:
                continue
            fitness = _by_round(cell, "obj_fit")
            low, high = curve_interval(fitness)
            x = np.arange(1.0, fitness.shape[1] + 1)
            if across == "seconds":
                seconds = _by_round(cell, "cpu_seconds")
                x = np.exp(np.log(np.maximum(seconds, 1e-3)).mean(axis=0))
            colour = COLOURS[method]
            axes.fill_between(x, _shown(low), _shown(high), color=colour, alpha=0.15, lw=0)
            mean = _shown(fitness.mean(axis=0))
            axes.plot(x, mean, color=colour, marker=MARKS[method], ms=4, lw=1.2)
        axes.set_xscale("log")
        axes.axvline(papers, color=GREY, ls="--", lw=1.0)
        axes.plot(papers, _shown(PAPERS_FITNESS), "*", ms=11, color=COLOURS["out-of-band"])
        axes.annotate(
            "the paper's\nbest", (papers, float(_shown(PAPERS_FITNESS))), (-8, 0),
            textcoords="offset points", ha="right", va="center", fontsize=SMALL_FONT,
        )  # fmt: skip
        axes.set_title(f"{world}: {WORLDS[world].difference}", fontsize=SMALL_FONT + 1)
        _fitness_axis(axes, "y")
        axes.set_ylabel("OBJ_FIT")
        axes.xaxis.set_minor_locator(NullLocator())
    if across == "trials":
        axes.set_xticks([1, 2, 3, 5, 10, 25], ["1", "2", "3", "5", "10", "25"])
        axes.set_xlim(0.9, 32)
        axes.set_xlabel("trials on the robot")
    else:
        axes.set_xticks(list(SECONDS), list(SECONDS.values()))
        axes.set_xlim(None, 4 * PAPERS_SECONDS)
        axes.set_xlabel("CPU time on one thread, a mark a trial")
    axes.xaxis.set_minor_locator(NullLocator())
    _name_methods(figure, axes, _of(table["method"].unique(), METHODS))
    return figure


def worlds_figure(rows: Rows, column: str) -> Figure:
    """Draw OBJ_FIT, or the share of the oracle's distance, by world and method, with intervals."""
    worlds = _of((row["world"] for row in rows), WORLDS)
    methods = _of((row["method"] for row in rows), METHODS)
    figure = new_figure(6.4, 1.2 + 0.38 * len(worlds))
    axes = figure.add_subplot()
    gap = 0.78 / len(methods)
    for row in (row for row in rows if column in row):
        mean = row[column]["mean"]
        ends = row[column]["interval"]
        method = methods.index(row["method"])
        colour = COLOURS[row["method"]]
        place = worlds.index(row["world"]) + (method - (len(methods) - 1) / 2) * gap
        if ends is not None:
            axes.plot([_shown(end, column) for end in ends], [place] * 2, color=colour, lw=1.2)
        mark = MARKS[row["method"]]
        axes.plot(_shown(mean, column), place, mark, ms=3.6, color=colour, clip_on=False)
    if column == "obj_fit":
        _fitness_axis(axes, "x")
        axes.set_xlabel("OBJ_FIT after the last trial")
    else:
        axes.xaxis.set_major_formatter(PercentFormatter(1.0))
        for share, width in ((0.0, 0.6), (1.0, 1.0)):
            axes.axvline(share, color=GREY, lw=width)
        axes.set_xlabel("share of the oracle's distance")
        grid(axes, "x")
        oracles = {row["world"]: row["distance"] for row in rows if row["method"] == ORACLE}
        for place, world in enumerate(worlds):
            if world in oracles and not sure_to_swim(oracles[world]):
                far = round(oracles[world]["mean"], 1) + 0.0  # which is never -0.0
                text = f"no share: the oracle's gait swims {far:.1f} units"
                axes.text(0.02, place, text, fontsize=SMALL_FONT, color=GREY, va="center")
    for i in range(1, len(worlds)):
        axes.axhline(i - 0.5, color="0.88", lw=0.8)
    _list_worlds(axes, worlds)
    _name_methods(figure, axes, methods)
    return figure


def coverage_figure(rows: Rows) -> Figure:
    """Draw how many dimensions joint's intervals of each mass hold, by world, with intervals."""
    shown = [row for row in rows if "covered" in row]
    figure = new_figure(6.0, 1.2 + 0.3 * len(shown))
    axes = figure.add_subplot()
    colours = ("#56B4E9", "#0072B2", "#000000")
    for i, (level, colour) in enumerate(zip(LEVELS, colours, strict=True)):
        axes.axvline(float(level[:-1]) / 100, color=colour, lw=1.0, ls="--", zorder=1)
        for row, world in enumerate(shown):
            place = row + 0.2 * (i - 1)
            share = world["covered"][level]
            if share["interval"] is not None:
                axes.plot(share["interval"], [place] * 2, color=colour, lw=1.4)
            axes.plot(share["mean"], place, MARKERS[i], ms=4.5, color=colour, clip_on=False)
        axes.plot([], [], MARKERS[i], color=colour, label=f"{level} intervals")
    _list_worlds(axes, [row["world"] for row in shown])
    axes.set_xlim(0.0, 1.0)
    axes.xaxis.set_major_formatter(PercentFormatter(1.0))
    axes.set_xlabel("dimensions covered")
    grid(axes, "x")
    legend_below(figure, axes, 3)
    return figure


def _by_round(cell: pd.DataFrame, name: str) -> Floats:
    """Return a quantity's (replicates, rounds)."""
    found: Floats = cell.filter(regex=rf"^{name}_\d+$").dropna(axis="columns").to_numpy(float)
    return found


def _of(there: Iterable[str], order: Iterable[str]) -> list[str]:
    """Return which names are there, in order."""
    names = set(there)
    return [one for one in order if one in names]


def _shown(value: Any, column: str = "obj_fit") -> Any:
    """Return where a value is drawn: OBJ_FIT by its error."""
    return value if column != "obj_fit" else -np.log10(np.maximum(1.0 - np.asarray(value), LEAST))


def _fitness_axis(axes: Axes, which: str) -> None:
    """Give axes a scale of OBJ_FIT on which each decade of error has the same room."""
    axis, limits = (axes.xaxis, axes.set_xlim) if which == "x" else (axes.yaxis, axes.set_ylim)
    ticks = {float(_shown(fitness)): f"{fitness:g}" for fitness in FITNESSES}
    last = max(ticks)
    ticks[last] = "1"
    axis.set_major_locator(FixedLocator(list(ticks)))
    axis.set_major_formatter(FuncFormatter(lambda place, _: ticks.get(place, "")))
    limits(float(_shown(0.4)), last)
    grid(axes, "x" if which == "x" else "both")


def _list_worlds(axes: Axes, worlds: Sequence[str]) -> None:
    axes.set_ylim(len(worlds) - 0.5, -0.5)
    axes.set_yticks(range(len(worlds)), worlds)
    axes.tick_params(axis="y", length=0)


def _name_methods(figure: Figure, axes: Axes, methods: Sequence[str]) -> None:
    for method in methods:
        axes.plot([], [], color=COLOURS[method], marker=MARKS[method], ms=4, label=method)
    legend_below(figure, axes, 6)
