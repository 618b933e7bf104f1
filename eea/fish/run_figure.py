"""The picture of a run: OBJ_FIT and MOD_FIT against round, beside guesses and the limit."""

from __future__ import annotations

from typing import Any

from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from aquafish_gym.rendering.pictures import new_figure
from eea.core.checks import ConfigurationError
from eea.core.result import Result

# Blue and vermilion of Okabe and Ito's palette, told apart by all eyes.
_OBJECTIVE, _MODEL = "#0072B2", "#D55E00"


def fitness_figure(result: Result) -> Figure:
    """Return a figure of one run, with its levels where the truth is known.

    Raises
    ------
    ConfigurationError
        If there is no round to draw.
    """
    if not result.rounds:
        raise ConfigurationError("result must hold at least one round to be drawn; it has none")
    figure = new_figure(6.4, 4.2, dpi=150)
    axes = figure.add_subplot()
    number = [record.round for record in result.rounds]
    model = [record.model_fitness for record in result.rounds]
    levels = (
        ("random bodies", result.chance, "--", 1.0),
        ("mid-range body", result.mid_range, ":", 1.0),
        ("quantisation limit", result.nearest, "-", 0.8),
    )
    for name, level, line, width in levels:
        if level is not None:
            axes.axhline(level, color="0.4", ls=line, lw=width, label=name)
    style: dict[str, Any] = {"lw": 2, "marker": "o", "ms": 4}
    axes.plot(number, model, color=_MODEL, label="MOD_FIT, fit to the target's behaviour", **style)
    objective = [r.objective_fitness for r in result.rounds if r.objective_fitness is not None]
    if objective:
        name = "OBJ_FIT, likeness to the true body"
        axes.plot(number, objective, color=_OBJECTIVE, label=name, **style)
    # Without a clamp MOD_FIT can fall far below 0, where it would squash the rest.
    axes.set_ylim(max(0.0, min(0.4, axes.get_ylim()[0])), 1.02)
    if min(model) < 0.0:
        note = f"cut at 0: MOD_FIT falls to {min(model):.3g}"
        axes.text(0.01, 0.01, note, transform=axes.transAxes, color=_MODEL, fontsize="small")
    axes.set_xlim(0.5, len(number) + 0.5)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel("round (experiments on the target)")
    axes.set_ylabel("fitness")
    axes.grid(color="0.92")
    axes.legend(loc="lower right", fontsize="small")
    config = result.config
    axes.set_title(f"{config.condition}, {config.steps} steps a trial, seed {result.seed}")
    return figure
