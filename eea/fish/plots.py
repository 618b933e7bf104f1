"""Figures of a run, of a posterior and of a watched swim."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from scipy.ndimage import gaussian_filter1d

from aquafish_gym.rendering.pictures import new_figure
from eea.core.angles import Floats
from eea.core.checks import ConfigurationError
from eea.core.result import Result
from eea.fish.watch import Watched
from eea.joint.joint_posterior import JointPosterior

# Of Okabe and Ito's palette, which colour-blind readers can tell apart.
BLUE, VERMILION = "#0072B2", "#D55E00"
COLOURS, NUISANCE = (BLUE, VERMILION, "#009E73", "#CC79A7"), "#56B4E9"  # parts of the body
DRAWS = 4000
BINS, SMOOTH = 400, 1.5  # of a range, for a density; sd of its smoothing, in bins
TALL = 0.62  # of a row's height, for the highest density
LEAST = 0.01  # probability of a hypothesis that is named


def fitness_figure(result: Result) -> Figure:
    """Return a figure of OBJ_FIT, where the truth is known, and MOD_FIT against round."""
    if not result.rounds:
        raise ConfigurationError("result must have at least one round to be drawn; it has none")
    figure = new_figure(6.4, 4.2, dpi=150)
    axes = figure.add_subplot()
    number = [record.round for record in result.rounds]
    model = [record.model_fitness for record in result.rounds]
    levels = (
        ("random bodies", result.chance, "--", 1.0),
        ("mid-range body", result.mid_range, ":", 1.0),
        ("quantisation limit", result.nearest if result.belief is None else None, "-", 0.8),
    )
    for name, level, line, width in levels:
        if level is not None:
            axes.axhline(level, color="0.4", ls=line, lw=width, label=name)
    style: dict[str, Any] = {"lw": 2, "marker": "o", "ms": 4}
    name = "MOD_FIT, fit to the target's behaviour"
    # Wider, to be seen under an equal OBJ_FIT.
    axes.plot(number, model, color=VERMILION, label=name, **(style | {"lw": 5, "ms": 9}))
    objective = [r.objective_fitness for r in result.rounds if r.objective_fitness is not None]
    if objective:
        name = "OBJ_FIT, likeness to the true body"
        axes.plot(number, objective, color=BLUE, label=name, **style)
    # Without a clamp MOD_FIT can fall far below 0, which would squash the rest.
    axes.set_ylim(max(0.0, min(0.4, axes.get_ylim()[0])), 1.02)
    if min(model) < 0.0:
        note = f"cut at 0: MOD_FIT falls to {min(model):.3g}"
        axes.text(0.01, 0.01, note, transform=axes.transAxes, color=VERMILION, fontsize="small")
    axes.set_xlim(0.5, len(number) + 0.5)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    axes.set_xlabel("round (experiments on the target)")
    axes.set_ylabel("fitness")
    axes.grid(color="0.92")
    axes.legend(loc="lower right", fontsize="small")
    config = result.config
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


@dataclass(frozen=True)
class Row:
    """One quantity of a posterior: its range, samples and intervals."""

    name: str
    low: float
    high: float
    draws: tuple[Floats, ...]  # several where each trial has its own value
    ends: tuple[float, float, float]  # the median, and the 90% interval
    half: tuple[float, float]  # the 50% interval
    colour: str
    truth: float | None = None
    prior: tuple[float, float] | None = None  # mean and sd of the normal prior


def posterior_figure(result: Result) -> Figure:
    """Return a figure of the posterior of a run of joint inference.

    A row is the range of one quantity, with its density, the 50% and 90% intervals (thick and thin)
    and the truth where known. At the left are the body's sizes over all hypotheses, at the right
    the nuisances of the most probable one, with their priors in grey.
    """
    belief = result.belief
    if not isinstance(belief, JointPosterior):
        raise ConfigurationError(
            "result must have a posterior to be drawn, as the condition joint has after a round; "
            f"got the condition {result.config.condition} without a posterior"
        )
    columns = [rows for rows in (_body(result, belief), _nuisances(belief)) if rows]
    most = max(map(len, columns))
    figure = new_figure(5.4 * len(columns), 1.3 + 0.42 * most, dpi=150)
    for axes, rows in zip(figure.subplots(1, len(columns), squeeze=False)[0], columns, strict=True):
        for place, row in enumerate(rows):
            _draw(axes, place, row)
        axes.set_yticks(range(len(rows)), [row.name for row in rows])
        axes.set_ylim(most - 0.5, -0.8)
        axes.set_xlim(0, 1)
        axes.set_xticks([])
        axes.tick_params(axis="y", length=0)
        axes.spines[:].set_visible(False)
    figure.axes[0].set_title("sizes", fontsize="medium")
    if len(columns) > 1:
        figure.axes[1].set_title("nuisances; prior in grey", fontsize="medium")
    done, config = len(belief.branches[0].parameters.slots), result.config
    figure.suptitle(
        f"{done} trial{'' if done == 1 else 's'} of {config.steps} steps, seed {result.seed}: "
        f"density, 50% and 90% interval{'' if result.truth is None else ', truth (▼)'}"
    )
    figure.supxlabel(_conclusion(belief), fontsize="small")
    return figure


def _body(result: Result, belief: JointPosterior) -> list[Row]:
    layout = result.layout
    draws = belief.sample(DRAWS, np.random.default_rng(0))
    ends, half = belief.interval(0.9), belief.interval(0.5)
    parts = list(dict.fromkeys(name.partition(".")[0] for name in layout.names))
    return [
        Row(
            name,
            float(layout.low[i]),
            float(layout.high[i]),
            (draws[:, i],),
            (float(result.model[i]), float(ends[0][i]), float(ends[1][i])),
            (float(half[0][i]), float(half[1][i])),
            COLOURS[parts.index(name.partition(".")[0]) % len(COLOURS)],
            None if result.truth is None else float(result.truth[i]),
        )
        for i, name in enumerate(layout.names)
    ]


def _nuisances(belief: JointPosterior) -> list[Row]:
    """Return the rows of the nuisances; those of each trial share a row."""
    best = belief.branches[0]
    names, joint = best.parameters.names, best.parameters.joint
    draws = best.parameters.natural(best.posterior.sample(DRAWS, np.random.default_rng(0)))
    wide, half = belief.table(0.9), belief.table(0.5)
    rows = []
    for nuisance in joint.nuisances:
        own = [i for i, name in enumerate(names) if name.partition("@")[0] == nuisance.name]
        if own:
            last = names[own[-1]]
            rows.append(
                Row(
                    nuisance.name if len(own) == 1 else f"{nuisance.name}, by trial",
                    nuisance.low,
                    nuisance.high,
                    tuple(draws[:, i] for i in own),
                    wide[last],
                    half[last][1:],
                    NUISANCE,
                    prior=(nuisance.nominal, nuisance.sd),
                )
            )
    return rows


def _draw(axes: Axes, place: int, row: Row) -> None:
    """Draw one row, whose base is at the height ``place``; the axis points downwards."""
    span = row.high - row.low
    edges = np.linspace(0.0, 1.0, BINS + 1)
    middles = 0.5 * (edges[1:] + edges[:-1])
    axes.plot([0, 1], [place, place], color="0.75", lw=0.8, zorder=1)
    if row.prior is not None:
        nominal, sd = row.prior
        shape = np.exp(-0.5 * ((row.low + span * middles - nominal) / sd) ** 2)
        axes.fill_between(middles, place, place - TALL * shape, color="0.9", lw=0, zorder=0)
    for drawn in row.draws:
        counts, _ = np.histogram((drawn - row.low) / span, edges)
        density = gaussian_filter1d(counts.astype(np.float64), SMOOTH, mode="reflect")
        height = place - TALL * density / density.max()
        alpha = 0.45 / len(row.draws) ** 0.5
        axes.fill_between(middles, place, height, color=row.colour, alpha=alpha, lw=0)
    if len(row.draws) == 1:
        for (low, high), width in ((row.ends[1:], 1.6), (row.half, 4.5)):
            ends = [(low - row.low) / span, (high - row.low) / span]
            axes.plot(ends, [place, place], color=row.colour, lw=width, solid_capstyle="butt")
        middle, low, high = row.ends
        axes.plot((middle - row.low) / span, place, "|", color=row.colour, ms=9, mew=1.6)
        axes.text(
            1.02, place, f"{middle:z.3f} [{low:z.3f}, {high:z.3f}]", va="center", fontsize="small"
        )
    if row.truth is not None:
        at = (row.truth - row.low) / span
        axes.plot(at, place - 0.12, "v", color="black", ms=5, clip_on=False, zorder=5)
    style: dict[str, Any] = {"fontsize": "x-small", "color": "0.45", "va": "top"}
    axes.text(0, place + 0.1, f"{row.low:g}", ha="left", **style)
    axes.text(1, place + 0.1, f"{row.high:g}", ha="right", **style)


def _conclusion(belief: JointPosterior) -> str:
    """Return the probable hypotheses, if there are several, and whether the fit is good."""
    probable = [b for b in belief.branches if b.probability > LEAST]
    named = "; ".join(f"{b.hypothesis.name} ({b.probability:.0%})" for b in probable)
    return "\n".join([named, belief.verdict] if len(probable) > 1 else [belief.verdict])
