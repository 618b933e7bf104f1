"""Pictures of one run: OBJ_FIT and MOD_FIT against round, beside guesses and the limit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from eea.core.checks import ConfigurationError
from eea.core.experiment import Floats
from eea.core.result import Result

# Blue and vermilion of Okabe and Ito's palette, told apart by all eyes.
_OBJECTIVE, _MODEL = "#0072B2", "#D55E00"


def draw_fitness(axes: Axes, results: Sequence[Result]) -> None:
    """Draw replicates of one condition into axes: thin lines each, thick ones their means.

    Bands reach a standard deviation to each side of the means.

    Parameters
    ----------
    axes
        Of a matplotlib figure.
    results
        At least one. OBJ_FIT and the levels of chance, of the mid-range body and the
        quantisation limit are drawn if all their truths are known.

    Raises
    ------
    ConfigurationError
        If there is no round to draw.
    """
    rounds = min((len(result.rounds) for result in results), default=0)
    if not rounds:
        raise ConfigurationError("results must hold at least one round each to be drawn")
    number = np.arange(1, rounds + 1)
    curves = [("MOD_FIT, fit to the target's behaviour", _MODEL, _series(results, "model_fitness"))]
    chances = [result.chance for result in results if result.chance is not None]
    middles = [result.mid_range for result in results if result.mid_range is not None]
    limits = [result.nearest for result in results if result.nearest is not None]
    if len(chances) == len(results):
        objective = _series(results, "objective_fitness")
        curves.append(("OBJ_FIT, likeness to the true body", _OBJECTIVE, objective))
        axes.axhline(float(np.mean(chances)), color="0.4", ls="--", lw=1, label="random bodies")
        axes.axhline(float(np.mean(middles)), color="0.4", ls=":", lw=1, label="mid-range body")
        axes.axhline(
            float(np.mean(limits)), color="0.4", ls="-", lw=0.8, label="quantisation limit"
        )
    for label, color, values in curves:
        mean = values.mean(axis=0)
        if len(values) > 1:
            axes.plot(number, values.T, color=color, lw=0.6, alpha=0.4)
            deviation = values.std(axis=0, ddof=1)
            low, high = mean - deviation, mean + deviation
            band = f"{label.partition(',')[0]}, mean ± SD"
            axes.fill_between(number, low, high, color=color, alpha=0.15, lw=0, label=band)
        axes.plot(number, mean, color=color, lw=2, marker="o", ms=4, label=label)
    # Without a clamp MOD_FIT can fall far below 0, where it would squash the rest.
    axes.set_ylim(max(0.0, min(0.4, axes.get_ylim()[0])), 1.02)
    least = min(float(values.min()) for _, _, values in curves)
    if least < 0.0:
        note = f"cut at 0: MOD_FIT falls to {least:.3g}"
        axes.text(0.01, 0.01, note, transform=axes.transAxes, color=_MODEL, fontsize="small")
    axes.set_xlim(0.5, rounds + 0.5)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel("round (experiments on the target)")
    axes.set_ylabel("fitness")
    axes.grid(color="0.92")
    axes.legend(loc="lower right", fontsize="small")


def fitness_figure(result: Result) -> Figure:
    """Return a figure of one run."""
    # Apart from pyplot and its global state.
    figure = Figure(figsize=(6.4, 4.2), layout="constrained", dpi=150)
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    draw_fitness(axes, [result])
    config = result.config
    axes.set_title(f"{config.condition}, {config.steps} steps a trial, seed {result.seed}")
    return figure


def _series(results: Sequence[Result], name: str) -> Floats:
    """Return one field of all records, (replicates, rounds), cut to the shortest run."""
    rounds = min(len(result.rounds) for result in results)
    records = [[getattr(record, name) for record in result.rounds[:rounds]] for result in results]
    return np.array(records, dtype=np.float64)
