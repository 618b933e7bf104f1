"""Figures of a run, of a posterior and of a watched swim."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from scipy.ndimage import gaussian_filter1d

from aquafish_gym.rendering.pictures import new_figure
from eea.core.angles import Floats
from eea.core.checks import ConfigurationError
from eea.core.result import Result
from eea.fish.known import Watched
from eea.infer.answer import Answer

# Of Okabe and Ito's palette, which colour-blind readers can tell apart.
BLUE = "#0072B2"
VERMILION = "#D55E00"
SKY = "#56B4E9"
PLOT_DRAWS = 4000
BINS = 400  # of a range, for a density
SMOOTHING_BINS = 1.5  # sd
DENSITY_HEIGHT = 0.62  # share of a row's height at the highest density
LEAST_NAMED_PROBABILITY = 0.01  # less probable hypotheses are not named


def fitness_figure(result: Result) -> Figure:
    """Return a figure of OBJ_FIT, where the truth is known, and MOD_FIT against round."""
    figure = new_figure(6.4, 4.2, dpi=150)
    axes = figure.add_subplot()
    number = [record.round for record in result.rounds]
    model = [record.model_fitness for record in result.rounds]
    levels = (
        ("random bodies", result.chance, "--"),
        ("mid-range body", result.mid_range, ":"),
        ("quantisation limit", result.nearest if result.belief is None else None, "-"),
    )
    for name, level, line in levels:
        if level is not None:
            axes.axhline(level, color="0.4", ls=line, lw=1, label=name)
    # A wider line remains visible under an equal OBJ_FIT.
    name = "MOD_FIT, fit to the target's behaviour"
    axes.plot(number, model, "o-", color=VERMILION, lw=5, ms=9, label=name)
    objective = [r.objective_fitness for r in result.rounds if r.objective_fitness is not None]
    if objective:
        name = "OBJ_FIT, likeness to the true body"
        axes.plot(number, objective, "o-", color=BLUE, lw=2, ms=4, label=name)
    # MOD_FIT can fall far below 0, which would squash the rest.
    axes.set_ylim(max(0.0, min(0.4, axes.get_ylim()[0])), 1.02)
    axes.set_xlim(0.5, len(number) + 0.5)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    axes.set_xlabel("round (experiments on the target)")
    axes.set_ylabel("fitness")
    axes.grid(color="0.92")
    axes.legend(loc="lower right", fontsize="small")
    config = result.config
    if config is None:
        raise ConfigurationError("result must be of a run, since logs have no rounds to draw")
    axes.set_title(f"{config.condition}, {config.steps} steps a trial, seed {result.seed}")
    return figure


def watched_figure(watched: Watched) -> Figure:
    """Return a figure of each window's misfit as a multiple of its mean for the same body."""
    figure = new_figure(7.0, 3.0, dpi=150)
    axes = figure.add_subplot()
    excess = np.array([look.excess for look in watched.looks])
    same = np.array([look.same for look in watched.looks])
    axes.axhline(1.0, color="0.6", lw=0.8)
    axes.plot(watched.time, excess, color="0.8", lw=1, zorder=1)
    for which, colour, name in (
        (same, BLUE, "explained by the inferred body"),
        (~same, VERMILION, f"not explained: p < {watched.alarm:g}"),
    ):
        axes.scatter(watched.time[which], excess[which], s=14, color=colour, label=name, zorder=2)
    if watched.noticed is not None:
        axes.axvline(watched.noticed, color=VERMILION, lw=0.8, ls="--")
    axes.set_yscale("log")
    axes.set_ylim(min(0.1, excess.min() / 2), max(10.0, excess.max() * 2))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.set_xlabel("time (s)")
    axes.set_ylabel("misfit / misfit of noise")
    axes.legend(loc="upper left", fontsize="small")
    return figure


def posterior_figure(result: Result) -> Figure:
    """Return a figure of the posterior of a run of joint inference.

    A row is the range of one quantity, with its density, the 50% and 90% intervals (thick and thin)
    and the truth where known. The left side shows the body's sizes over all hypotheses. The right
    side shows the nuisances common to all trials under the most probable hypothesis, with their
    priors in grey. Where no body explains the trials only the values of the best fit are shown.
    """
    belief = result.belief
    if not isinstance(belief, Answer):
        raise ConfigurationError(
            "result must have a posterior to be drawn, as the condition joint has after a round; "
            f"got the condition {result.method} without a posterior"
        )
    best = belief.branches[0]
    nuisances = {
        name: number
        for name, number in belief.robot.table.items()
        if not (number.sought or number.varies or number.circular) and best.parameters.has(name)
    }
    most = max(len(result.layout), len(nuisances))
    columns = 2 if nuisances else 1
    figure = new_figure(5.4 * columns, 1.3 + 0.42 * most, dpi=150)
    sizes, *others = figure.subplots(1, columns, squeeze=False)[0]

    draws = belief.sample(PLOT_DRAWS, np.random.default_rng(0))
    low, high = result.interval(0.9)
    lower, upper = result.interval(0.5)
    ends = np.column_stack([low, lower, result.model, upper, high])
    for i, (start, stop) in enumerate(zip(result.layout.low, result.layout.high, strict=True)):
        _draw_row(sizes, i, start, stop, draws[:, i] if belief.good else None, ends[i], BLUE)
        if result.truth is not None:
            at = (result.truth[i] - start) / (stop - start)
            sizes.plot(at, i - 0.12, "v", color="black", ms=5, clip_on=False, zorder=5)
    _finish(sizes, list(result.layout.names), most, "sizes")

    for axes in others:
        theta = best.parameters.natural(best.doubted.sample(PLOT_DRAWS, np.random.default_rng(0)))
        wide = belief.table(0.9)
        half = belief.table(0.5)
        for i, (name, n) in enumerate(nuisances.items()):
            middle, first, last = wide[name]
            five = np.array([first, half[name][1], middle, half[name][2], last])
            column = theta[:, best.parameters.first_entry(name)] if belief.good else None
            _draw_row(axes, i, n.low, n.high, column, five, SKY)
            at = np.linspace(0.0, 1.0, BINS)
            prior = np.exp(-0.5 * ((n.low + (n.high - n.low) * at - (n.mean or 0.0)) / n.sd) ** 2)
            axes.fill_between(at, i, i - DENSITY_HEIGHT * prior, color="0.9", lw=0, zorder=0)
        _finish(axes, list(nuisances), most, "nuisances; prior in grey")

    trials = len(best.parameters.slots)
    begin = f"{trials} trial{'' if trials == 1 else 's'}"
    if result.config is not None:
        begin += f" of {result.config.steps} steps"
    marked = "" if result.truth is None else ", truth (▼)"
    shown = "density, 50% and 90% interval" if belief.good else "no body fits; the best fit"
    figure.suptitle(f"{begin}, seed {result.seed}: {shown}{marked}")
    probable = [b for b in belief.branches if b.probability > LEAST_NAMED_PROBABILITY]
    named = "; ".join(f"{b.hypothesis.name} ({b.probability:.0%})" for b in probable)
    lines = [named, belief.verdict] if len(probable) > 1 and belief.good else [belief.verdict]
    figure.supxlabel("\n".join(lines), fontsize="small")
    return figure


def _draw_row(
    axes: Axes, place: int, low: float, high: float, draws: Floats | None, ends: Floats, colour: str
) -> None:
    """Draw the density of ``draws`` (N,) over a range, on a base at the height ``place``.

    ``ends`` (5,) are the ends of the 90% and the 50% interval around the median. Without draws only
    the median is drawn. The axis points downwards.
    """
    axes.plot([0, 1], [place, place], color="0.75", lw=0.8, zorder=1)
    first, lower, middle, upper, last = (ends - low) / (high - low)
    said = f"{ends[2]:z.3f}"
    if draws is not None:
        edges = np.linspace(0.0, 1.0, BINS + 1)
        counts, _ = np.histogram((draws - low) / (high - low), edges)
        density = gaussian_filter1d(counts.astype(np.float64), SMOOTHING_BINS, mode="reflect")
        height = place - DENSITY_HEIGHT * density / density.max()
        centres = 0.5 * (edges[1:] + edges[:-1])
        axes.fill_between(centres, place, height, color=colour, alpha=0.45, lw=0)
        axes.plot([first, last], [place, place], color=colour, lw=1.6)
        axes.plot([lower, upper], [place, place], color=colour, lw=4.5, solid_capstyle="butt")
        said += f" [{ends[0]:z.3f}, {ends[4]:z.3f}]"
    axes.plot(middle, place, "|", color=colour, ms=9, mew=1.6)
    axes.text(1.02, place, said, va="center", fontsize="small")
    for at, value in ((0, low), (1, high)):
        side = "right" if at else "left"
        axes.text(
            at, place + 0.1, f"{value:g}", ha=side, va="top", color="0.45", fontsize="x-small"
        )


def _finish(axes: Axes, names: list[str], rows: int, title: str) -> None:
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(rows - 0.5, -0.8)
    axes.set_xlim(0, 1)
    axes.set_xticks([])
    axes.tick_params(axis="y", length=0)
    axes.spines[:].set_visible(False)
    axes.set_title(title, fontsize="medium")
