"""The picture of a posterior: how surely each size is known, and what differs besides the body."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.ndimage import gaussian_filter1d

from aquafish_gym.rendering.pictures import new_figure
from eea.core.angles import Floats
from eea.core.checks import ConfigurationError
from eea.core.result import Result

if TYPE_CHECKING:
    from eea.joint.joint_posterior import JointPosterior

# Of Okabe and Ito's palette, told apart by all eyes: the body's parts in turn, and the nuisances.
COLOURS, NUISANCE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7"), "#56B4E9"
DRAWS = 4000
BINS, SMOOTH = 400, 1.5  # of a range, for a density; sd of its smoothing, in bins
TALL = 0.62  # of a row's height, for the highest density
LEAST = 0.01  # what is less probable is not named


@dataclass(frozen=True)
class Row:
    """One quantity: what it is called, its range, what is believed, and what is the case."""

    name: str
    low: float
    high: float
    draws: tuple[Floats, ...]  # more than one where trials have their own
    ends: tuple[float, float, float]  # the median, and the 90% interval
    half: tuple[float, float]  # the 50% interval
    colour: str
    truth: float | None = None
    prior: tuple[float, float] | None = None  # the nominal value, and the normal prior's sd


def posterior_figure(result: Result) -> Figure:
    """Return a figure of what a run of joint inference believes.

    A row is the range of one quantity, with its posterior's density, the 50% and 90% intervals
    (thick and thin) and the truth where it is known: at the left the body's sizes, of all
    hypotheses, at the right the nuisances, of the most probable one, with their priors in grey.

    Raises
    ------
    ConfigurationError
        If there is no posterior: the condition is another, or no round was completed.
    """
    from eea.joint.joint_posterior import JointPosterior

    belief = result.belief
    if not isinstance(belief, JointPosterior):
        raise ConfigurationError(
            "result must have a posterior to be drawn, as the condition joint has after a round; "
            f"it has none, and is of the condition {result.config.condition}"
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
        figure.axes[1].set_title("besides the body; prior in grey", fontsize="medium")
    done, config = belief.branches[0].parameters.trials, result.config
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
    """Return what was inferred besides body and angles; of trials with their own, all of them."""
    best = belief.branches[0]
    names, joint = best.parameters.names, best.parameters.joint
    draws = best.natural(best.posterior.sample(DRAWS, np.random.default_rng(0)))
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
        middle = (row.ends[0] - row.low) / span
        axes.plot(middle, place, "|", color=row.colour, ms=9, mew=1.6)
    if row.truth is not None:
        at = (row.truth - row.low) / span
        axes.plot(at, place - 0.12, "v", color="black", ms=5, clip_on=False, zorder=5)
    style: dict[str, Any] = {"fontsize": "x-small", "color": "0.45", "va": "top"}
    axes.text(0, place + 0.1, f"{row.low:g}", ha="left", **style)
    axes.text(1, place + 0.1, f"{row.high:g}", ha="right", **style)
    if len(row.draws) == 1:
        middle, low, high = row.ends
        axes.text(
            1.02, place, f"{middle:z.3f} [{low:z.3f}, {high:z.3f}]", va="center", fontsize="small"
        )


def _conclusion(belief: JointPosterior) -> str:
    """Return which hypotheses are probable, if there is a choice, and whether the fit is good."""
    told = [b for b in belief.branches if b.probability > LEAST]
    said = [f"{b.hypothesis.name} ({b.probability:.0%})" for b in told if len(told) > 1]
    return "\n".join(["; ".join(said), belief.verdict][not said :])
