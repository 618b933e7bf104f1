"""Pictures of a study: each of the paper's figures, and what the paper does not show.

They are a function of the study's numbers: the same ones give the same bytes. matplotlib is
loaded when a picture is drawn, and no global state of it is touched.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.morphology import FINS
from aquafish_gym.runs.storage import write_bytes
from eea.report.statistics import FEWEST, curve_interval
from eea.report.summary import (
    ARMS,
    BASELINE,
    angle_label,
    duration_name,
    known_arms,
    setting_label,
    signed,
    spoken,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from eea.report.analysis import Findings

Floats = NDArray[np.float64]

# Okabe and Ito's palette, told apart by all eyes.
_COLOURS = {
    "ideal": "#009E73",
    "none": "#D55E00",
    "in-band": "#CC79A7",
    "in-band-200": "#E69F00",
    "out-of-band": "#0072B2",
    "out-of-band-100": "#56B4E9",
}
_OTHERS = ("#000000", "#8C6D31", "#7F7F7F", "#637939", "#843C39", "#5254A3")
_SIZES = ("#D55E00", "#0072B2", "#009E73", "#000000")
_LINES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (3, 1)))
_MARKERS = ("o", "s", "^", "D", "v", "P")
_GREY, _SMALL = "0.35", 8
_MOST_LINES = 8  # that can be told apart in one picture
_NAME = 0.08  # of the height of axes, for a name of two small lines
_ROUND = "round (experiments on the target)"


def save_study_figures(
    findings: Findings, summary: Mapping[str, Any], directory: Path
) -> list[Path]:
    """Draw every picture that a study has the numbers for; return the files.

    Parameters
    ----------
    findings
        The study's finished replicates.
    summary
        As ``eea.report.analysis.summarize_study``.
    directory
        Where the files go; it exists.
    """
    arms = known_arms(summary)
    effects = summary["effects"]
    baselines = list(dict.fromkeys(effect["second"] for effect in effects))
    plain = [arm for arm in arms if arm not in baselines]
    labels = summary["labels"]
    figures: dict[str, Figure] = {}
    for arm in plain:
        figures[ARMS.get(arm, f"rounds-{arm}")] = rounds_figure(findings, summary, arm)
    if plain:
        figures["final"] = final_figure(findings, summary, plain)
    if any(comparison["rows"] for comparison in summary["paired"]):
        figures["paired"] = forest_figure(summary["paired"], labels, findings.durations)
    for baseline in baselines:
        against = [effect for effect in effects if effect["second"] == baseline]
        suffix = baseline.removeprefix(BASELINE)
        group = [baseline, *(effect["first"] for effect in against)]
        figures[f"final{suffix}"] = final_figure(findings, summary, group)
        if any(effect["rows"] for effect in against):
            figures[f"effects{suffix}"] = forest_figure(against, labels, findings.durations)
    shown = replace(findings, replicates={arm: findings.replicates[arm] for arm in arms})
    if len(arms) <= _MOST_LINES and any(arm in summary["dimensions"]["arms"] for arm in arms):
        figures["conditions"] = conditions_figure(shown, summary)
        figures["dimensions"] = dimensions_figure(shown, summary)
        figures["spread"] = spread_figure(summary)
        if any(findings.conditions[arm] != "ideal" for arm in arms):
            figures["angles"] = angles_figure(shown)
    paths = []
    for name, figure in figures.items():
        content = io.BytesIO()
        # Without matplotlib's version the file says nothing but the picture.
        figure.savefig(content, format="png", metadata={"Software": None})
        paths.append(directory / f"{name}.png")
        write_bytes(paths[-1], content.getvalue())
    return paths


def is_a_picture(name: str) -> bool:
    """Return whether a report may have a picture of this name."""
    whole = ("final", "paired", "conditions", "dimensions", "spread", "angles", "effects")
    return name in (*whole, *ARMS.values()) or name.startswith(("rounds-", "final-", "effects-"))


def rounds_figure(findings: Findings, summary: Mapping[str, Any], arm: str) -> Figure:
    """Return one of Figs. 5 to 10: mean and SD of OBJ_FIT against round, one line a duration."""
    figure = _new_figure(4.8, 4.6)
    axes, below = figure.subplots(2, 1, sharex=True, height_ratios=(3.2, 1))
    durations = findings.replicates[arm]
    number = np.arange(1, findings.rounds + 1)
    widest = 0.0
    for steps in durations:
        i = findings.durations.index(steps)
        curves = _stack(findings.curves(arm, steps, "objective_fitness"))
        mean, deviation = curves.mean(axis=0), _deviation(curves)
        colour, marker = _duration_colour(steps, findings.durations), _MARKERS[i % len(_MARKERS)]
        if len(curves) > 1:
            # No OBJ_FIT passes 1, which a mean and an SD can.
            low, high = mean - deviation, np.minimum(mean + deviation, 1.0)
            axes.fill_between(number, low, high, color=colour, alpha=0.12, lw=0)
            widest = max(widest, float(deviation.max()))
            below.plot(
                number, deviation, marker=marker, ms=2.5, lw=1.2, color=colour, clip_on=False
            )
        axes.plot(number, mean, marker=marker, ms=3.5, lw=1.6, color=colour, label=f"{steps} steps")
    axes.set_title(_title(findings.labels[arm], durations), fontsize="medium")
    _finish_rounds(axes, findings, summary)
    axes.set_xlabel("")
    below.set_xlabel(_ROUND)
    below.set_ylabel("SD")
    below.set_ylim(0.0, 1.15 * widest or 0.1)  # room for the highest marker
    _grid(below)
    _legend_below(figure, axes, 4)
    return figure


def conditions_figure(findings: Findings, summary: Mapping[str, Any]) -> Figure:
    """Return OBJ_FIT against round, one line an arm: means over durations, 95% intervals."""
    figure = _new_figure(4.8, 3.9)
    axes = figure.add_subplot()
    _draw_arms(axes, findings, "objective_fitness")
    curves = [findings.mean_curves(arm, "objective_fitness") for arm in findings.replicates]
    sets = {tuple(durations) for durations in findings.replicates.values()}
    title = "mean over durations" if len(findings.durations) > 1 else "mean over replicates"
    if len(sets) > 1:
        title = "mean over each condition's durations"
    if any(len(seeds) >= FEWEST for seeds in curves):
        title += ",\nand its 95% interval"
    axes.set_title(title, fontsize="medium")
    _finish_rounds(axes, findings, summary)
    _legend_below(figure, axes, 2)
    return figure


def final_figure(findings: Findings, summary: Mapping[str, Any], arms: Sequence[str]) -> Figure:
    """Return the last round's OBJ_FIT of every replicate of some arms, by duration.

    Boxes reach from quartile to quartile with a line at the median.
    """
    every = sorted({steps for arm in arms for steps in findings.replicates[arm]})
    names = [setting_label(arm, arms[0], findings.labels).replace(", ", ",\n") for arm in arms]
    crowded = len(arms) > 8 or max(len(line) for name in names for line in name.split("\n")) > 14
    share = max(0.3 if crowded else 1.1, 0.29 * len(every))
    figure = _new_figure(max(4.8, 0.8 + share * len(arms)), 5.2 if crowded else 3.8)
    axes = figure.add_subplot()
    width = 0.84 / len(every)
    for i, arm in enumerate(arms):
        for j, steps in enumerate(every):
            if steps in findings.replicates[arm]:
                last = _stack(findings.curves(arm, steps, "objective_fitness"))[:, -1]
                place = i + (j - (len(every) - 1) / 2) * width
                colour = _duration_colour(steps, findings.durations)
                _draw_distribution(axes, place, width, last, colour)
    for steps in every:
        colour = _duration_colour(steps, findings.durations)
        axes.plot([], [], "o", ms=5, color=colour, label=f"{steps} steps")
    axes.set_xlim(-0.5, len(arms) - 0.5)
    axes.set_xticks(range(len(arms)), names)
    if crowded:
        axes.tick_params(axis="x", rotation=90)
    for i in range(1, len(arms)):
        axes.axvline(i - 0.5, color="0.85", lw=0.8, zorder=0)
    _grid(axes, "y")
    _levels(axes, summary)
    axes.set_ylabel(f"OBJ_FIT after {findings.rounds} rounds")
    _legend_below(figure, axes, 4)
    return figure


def forest_figure(
    comparisons: Sequence[Mapping[str, Any]], labels: Mapping[str, str], durations: Sequence[int]
) -> Figure:
    """Return paired differences of OBJ_FIT with their 95% intervals, by comparison and duration.

    Differences from one and the same arm are ordered by size. A point is hollow where the interval
    holds 0, and a cross where there is none.
    """
    shown = [comparison for comparison in comparisons if comparison["rows"]]
    against = sorted({comparison["second"] for comparison in shown})
    if len(against) == 1:
        shown.sort(key=lambda comparison: -comparison["rows"][-1]["last_round"]["mean"])
    keys = sorted({tuple(row["durations"]) for c in shown for row in c["rows"]}, key=_by_size)
    colours = {
        key: _duration_colour(key[0], durations) if len(key) == 1 else "black" for key in keys
    }
    gap = 0.3 if len(against) == 1 else 1.5  # for names of one line, and of two
    gap = 0.8 if len(keys) > 1 else gap
    lines = sum(len(comparison["rows"]) + gap for comparison in shown)
    figure = _new_figure(5.4, 1.3 + 0.18 * lines)
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
        first, second = (labels[comparison[which]] for which in ("first", "second"))
        name = f"{first}\nless {second}"
        if len(against) == 1:
            name = setting_label(comparison["first"], comparison["second"], labels)
        ticks.append((place + (len(rows) - 1) / 2, name))
        place += len(rows) + gap
        axes.axhline(place - (1 + gap) / 2, color="0.9", lw=0.8)
    axes.axvline(0.0, color=_GREY, lw=1)
    axes.set_ylim(place - (1 + gap) / 2, -(1 + gap) / 2)
    axes.set_yticks([tick for tick, _ in ticks], [name for _, name in ticks])
    axes.tick_params(axis="y", length=0)
    _grid(axes, "x")
    origin = f"\nfrom {labels[against[0]]}" if len(against) == 1 else ""
    intervals = [row["last_round"]["interval"] for c in shown for row in c["rows"]]
    notes = []
    if any(interval is not None for interval in intervals):
        notes.append("95% interval (hollow where it holds 0)")
    if None in intervals:
        notes.append(f"crosses: under {FEWEST} replicates, no interval")
    axes.set_xlabel(
        ",\n".join([f"paired difference of OBJ_FIT{origin}", *notes]), fontsize="medium"
    )
    _signed_ticks(axes)
    for key in keys:
        mark = "o" if len(key) == 1 else "D"
        axes.plot([], [], mark, ms=5, color=colours[key], label=duration_name(key))
    _legend_below(figure, axes, 3)
    return figure


def dimensions_figure(findings: Findings, summary: Mapping[str, Any]) -> Figure:
    """Return the error of each dimension against round, one line an arm, a row of panels a fin."""
    found = summary["dimensions"]
    fins, sizes = _fins_and_sizes(findings.layout.names)
    figure = _new_figure(7.0, 0.9 + 1.75 * len(fins))
    panels = figure.subplots(len(fins), len(sizes), sharex=True, sharey=True, squeeze=False)
    for i, name in enumerate(findings.layout.names):
        fin, _, size = name.partition(".")
        axes = panels[fins.index(fin), sizes.index(size)]
        _draw_arms(axes, findings, "dimension_error", i)
        chance, middle = found["chance_error"][name], found["mid_range_error"][name]
        axes.axhline(chance, color=_GREY, ls="--", lw=1, label="random bodies")
        axes.axhline(middle, color=_GREY, ls=":", lw=1.2, label="mid-range body")
        axes.axhline(found["nearest_error"][name], color=_GREY, lw=0.8, label="nearest genome")
        axes.set_title(spoken(name), fontsize="medium")
        _grid(axes)
        axes.set_xlim(0.5, findings.rounds + 0.5)
        _whole_ticks(axes)
    panels[0, 0].set_ylim(bottom=0.0)
    for axes in panels[-1]:
        axes.set_xlabel("round")
    figure.supylabel("error of the best model, share of the dimension's range", fontsize="medium")
    _legend_below(figure, panels[0, 0], 4)
    return figure


def spread_figure(summary: Mapping[str, Any]) -> Figure:
    """Return final error against the models' spread, a point a dimension, a panel an arm.

    Errors are shares of what a random body would have, so that 1 is chance.
    """
    found = summary["dimensions"]
    names = list(found["chance_error"])
    fins, sizes = _fins_and_sizes(names)
    arms = {arm: found["arms"][arm] for arm in known_arms(summary) if arm in found["arms"]}
    columns = 2 if len(arms) == 4 else min(3, len(arms))
    rows = -(-len(arms) // columns)
    figure = _new_figure(max(4.8, 0.8 + 2.1 * columns), 1.3 + 2.0 * rows)
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
            marker = _MARKERS[fins.index(fin) % len(_MARKERS)]
            axes.plot(
                x, y, marker, ms=6, color=colour, mec="white", mew=0.6, clip_on=False, zorder=3
            )
        axes.axhline(1.0, color=_GREY, ls="--", lw=1)
        _grid(axes)
        axes.set_title(summary["labels"][arm], fontsize="medium")
    for i, axes in enumerate(panels):
        if i >= len(arms):
            axes.set_axis_off()
        elif i + columns >= len(arms):
            axes.set_xlabel("spread, share of range")
            axes.tick_params(labelbottom=True)
    # Roots spread out what is near zero, and zero itself has a place.
    panels[0].set_xscale("function", functions=(_root, np.square))
    panels[0].set_yscale("function", functions=(_root, np.square))
    panels[0].set_xticks([0.0, 0.01, 0.05, 0.1, 0.2, 0.3], ["0", ".01", ".05", ".1", ".2", ".3"])
    panels[0].set_yticks([0.0, 0.05, 0.2, 0.5, 1.0, 1.5], ["0", ".05", ".2", ".5", "1", "1.5"])
    panels[0].set_ylim(0.0, max(1.2, panels[0].get_ylim()[1]))
    panels[0].set_xlim(0.0, max(0.1, 1.05 * panels[0].get_xlim()[1]))
    _draw_keys(panels[0], fins, sizes)
    figure.supylabel("error of the best model,\n1 = random bodies (root scales)", fontsize="medium")
    _legend_below(figure, panels[0], 4)
    return figure


def angles_figure(findings: Findings) -> Figure:
    """Return the error of the inferred angles against round, a panel a fin, one line an arm."""
    # Where the angles are told there is nothing to show; where zero is assumed, the name says so.
    told = [arm for arm in findings.replicates if findings.conditions[arm] == "ideal"]
    inferred = replace(
        findings,
        replicates={arm: runs for arm, runs in findings.replicates.items() if arm not in told},
        labels={
            arm: angle_label(label, findings.conditions[arm])
            for arm, label in findings.labels.items()
        },
    )
    figure = _new_figure(7.0, 3.2)
    panels = figure.subplots(1, len(FINS), sharey=True)
    for i, (axes, fin) in enumerate(zip(panels, FINS, strict=True)):
        _draw_arms(axes, inferred, "angle_error", i, scale=180 / np.pi)
        axes.axhline(90.0, color=_GREY, ls="--", lw=1, label="a guess")
        axes.set_title(spoken(fin), fontsize="medium")
        axes.set_xlim(0.5, findings.rounds + 0.5)
        axes.set_xlabel("round")
        _grid(axes)
        _whole_ticks(axes)
    panels[0].set_ylim(bottom=0.0)
    panels[0].yaxis.set_major_locator(_multiples(30))
    panels[0].set_ylabel("error of the angle (degrees)")
    _legend_below(figure, panels[0], 4)
    return figure


def _draw_arms(
    axes: Axes,
    findings: Findings,
    field: str,
    part: int | None = None,
    scale: float = 1.0,
) -> None:
    """Draw the mean over durations of each arm, with 95% intervals of the mean as bands."""
    number = np.arange(1, findings.rounds + 1)
    for i, arm in enumerate(findings.replicates):
        curves = findings.mean_curves(arm, field)
        if not curves:
            continue
        table = _stack(curves) * scale
        table = table if part is None else table[:, :, part]
        colour, line = _arm_style(i, arm)
        low, high = curve_interval(table)
        axes.fill_between(number, low, high, color=colour, alpha=0.15, lw=0)
        label = findings.labels[arm]
        axes.plot(number, table.mean(axis=0), color=colour, ls=line, lw=1.6, label=label)


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


def _draw_keys(axes: Axes, fins: Sequence[str], sizes: Sequence[str]) -> None:
    """Put markers of fins and colours of sizes into the legend."""
    for fin, marker in zip(fins, _MARKERS, strict=False):
        axes.plot([], [], marker, ms=6, color="0.5", label=spoken(fin))
    for size, colour in zip(sizes, _SIZES, strict=False):
        axes.plot([], [], "-", lw=4, color=colour, label=size)
    axes.plot([], [], "--", lw=1, color=_GREY, label="random bodies")


def _finish_rounds(axes: Axes, findings: Findings, summary: Mapping[str, Any]) -> None:
    """Give axes of OBJ_FIT against round their scale, the same for all of a study's arms."""
    least = min(summary["chance"], summary["mid_range"])
    for arm, durations in findings.replicates.items():
        for steps in durations:
            curves = _stack(findings.curves(arm, steps, "objective_fitness"))
            least = min(least, float((curves.mean(axis=0) - _deviation(curves)).min()))
    axes.set_ylim(bottom=np.floor(10 * least) / 10)
    axes.set_xlim(0.5, findings.rounds + 0.5)
    _whole_ticks(axes)
    axes.set_xlabel(_ROUND)
    axes.set_ylabel("OBJ_FIT, likeness to the true body")
    _grid(axes)
    _levels(axes, summary)


def _levels(axes: Axes, summary: Mapping[str, Any]) -> None:
    """Draw the two levels of guessing, and the most that a genome allows, named at the edge."""
    levels = [
        ("random\nbodies", summary["chance"], "--", 1.2),
        ("mid-range\nbody", summary["mid_range"], ":", 1.2),
        ("nearest\ngenome", summary["nearest"], "-", 0.8),
    ]
    levels.sort(key=lambda level: level[1])
    for _, value, line, width in levels:
        axes.axhline(value, color=_GREY, ls=line, lw=width, zorder=1.5)
    axes.set_ylim(top=1.01)
    # Only now does the scale stand, and so which names would cover one another.
    bottom, top = axes.get_ylim()
    places = _spaced(np.array([(level[1] - bottom) / (top - bottom) for level in levels]), _NAME)
    for (name, *_), place in zip(levels, places, strict=True):
        axes.annotate(
            name, (1.0, place), (4, 0), xycoords="axes fraction", textcoords="offset points",
            va="center", fontsize=_SMALL - 1, color=_GREY, linespacing=0.9, annotation_clip=False,
        )  # fmt: skip


def _spaced(places: Floats, gap: float) -> Floats:
    """Return ascending places in [0, 1], moved the least that keeps them apart and inside."""
    # Less a gap for each place below, they must only not fall: the nearest such row of numbers
    # is known in closed form.
    shift = gap * np.arange(len(places))
    row, every = places - shift, range(len(places))
    rising = [
        max(min(row[i : k + 1].mean() for k in every[j:]) for i in every[: j + 1]) for j in every
    ]
    spaced: Floats = np.clip(rising, gap / 2, 1.0 - gap / 2 - shift[-1]) + shift
    return spaced


def _legend_below(figure: Figure, axes: Axes, columns: int) -> None:
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="outside lower center", ncols=min(columns, len(labels)),
        fontsize=_SMALL, frameon=False, handlelength=2.2, columnspacing=1.2,
    )  # fmt: skip


def _grid(axes: Axes, axis: Literal["both", "x", "y"] = "both") -> None:
    axes.set_axisbelow(True)
    axes.grid(axis=axis, color="0.92")


def _whole_ticks(axes: Axes) -> None:
    from matplotlib.ticker import MaxNLocator

    axes.xaxis.set_major_locator(MaxNLocator(nbins=6, integer=True))


def _multiples(base: float) -> Any:
    from matplotlib.ticker import MultipleLocator

    return MultipleLocator(base)


def _signed_ticks(axes: Axes) -> None:
    from matplotlib.ticker import FuncFormatter, MaxNLocator

    axes.xaxis.set_major_locator(MaxNLocator(nbins=6, steps=[1, 2, 5, 10]))
    axes.xaxis.set_major_formatter(
        FuncFormatter(lambda value, _: signed(value)[:-1] if abs(value) > 1e-9 else "0")
    )


def _arm_style(index: int, arm: str) -> tuple[str, Any]:
    """Return a colour and a dash, for the paper's conditions the same in every study."""
    if arm in _COLOURS:
        return _COLOURS[arm], _LINES[list(_COLOURS).index(arm)]
    return _OTHERS[index % len(_OTHERS)], _LINES[index % len(_LINES)]


def _duration_colour(steps: int, durations: Sequence[int]) -> Any:
    """Return a colour from light for the study's short to dark for its long trials."""
    from matplotlib import colormaps

    share = durations.index(steps) / (len(durations) - 1) if len(durations) > 1 else 1.0
    return colormaps["viridis"](0.78 * (1.0 - share))


def _root(value: Floats) -> Floats:
    root: Floats = np.sqrt(np.maximum(value, 0.0))
    return root


def _by_size(durations: tuple[int, ...]) -> tuple[int, ...]:
    return (len(durations), *durations)


def _title(label: str, durations: Mapping[int, Mapping[int, Any]]) -> str:
    lone = all(len(seeds) == 1 for seeds in durations.values())
    return (
        f"{label}: {_counts(durations)}" if lone else f"{label}: mean ± SD of {_counts(durations)}"
    )


def _counts(durations: Mapping[int, Mapping[int, Any]]) -> str:
    counts = sorted({len(seeds) for seeds in durations.values()})
    text = f"{counts[0]}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
    return f"{text} replicate{'' if counts == [1] else 's'}"


def _fins_and_sizes(names: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return the fins and the sizes that dimensions are of, each in the order of the first."""
    pairs = [name.partition(".") for name in names]
    return list(dict.fromkeys(p[0] for p in pairs)), list(dict.fromkeys(p[2] for p in pairs))


def _stack(curves: Mapping[int, Floats]) -> Floats:
    """Return the curves of all seeds as one array."""
    return np.array(list(curves.values()))


def _deviation(curves: Floats) -> Floats:
    zero: Floats = np.zeros(curves.shape[1:])
    return curves.std(axis=0, ddof=1) if len(curves) > 1 else zero


def _new_figure(width: float, height: float) -> Figure:
    # The object interface: no pyplot, no window system, no global state.
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained", dpi=200)
    FigureCanvasAgg(figure)
    return figure
