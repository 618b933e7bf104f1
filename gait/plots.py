"""Pictures of gaits: paths on native and target body (Fig. 12), and how a search went."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from gait.baselines import Leg
    from gait.records import Generation
    from gait.rollout import Swim

DPI = 150
# Told apart in grey and by the colour-blind too. Paths leave the colours of the case study's
# treatments alone.
_PATHS = (("#000000", "-"), ("#cc79a7", "--"), ("#56b4e9", "-."), ("#b09500", ":"))
_FINAL, _MEAN = "#0072b2", "#d55e00"


def draw_trajectories(swims: Mapping[str, Swim], axes: Axes | None = None) -> Axes:
    """Draw paths from above, x to the right and y (forward) upwards, in units of 5 cm.

    Parameters
    ----------
    swims
        Label to swim, for example ``{"native": ..., "target": ...}``.
    axes
        Where; None is matplotlib's present figure.
    """
    axes = axes or _present_axes()
    for (label, one), (colour, line) in zip(swims.items(), cycle(_PATHS), strict=False):
        x, y, text = one.position[:, 0], one.position[:, 1], f"{label}: {one.distance:.1f}"
        axes.plot(x, y, line, color=colour, label=text, linewidth=1.8)
        axes.plot(x[-1], y[-1], "o", color=colour, markersize=5)
    axes.plot(0.0, 0.0, "+", color="black", markersize=10)
    axes.axhline(0.0, color="0.85", linewidth=0.8, zorder=0)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x (units of 5 cm)")
    axes.set_ylabel("forward, y (units of 5 cm)")
    axes.legend(loc="best", frameon=False)
    return axes


def draw_history(history: Sequence[Generation], axes: Axes | None = None) -> Axes:
    """Draw a history's columns ``final`` and ``mean``, and the best ``final`` so far."""
    from matplotlib.ticker import MaxNLocator

    x, final = [row.generation for row in history], [row.final for row in history]
    axes = _draw_progress(axes or _present_axes(), x, final, "final", "the winner")
    axes.plot(x, [row.mean for row in history], "--", color=_MEAN, label="mean (everyone)")
    axes.set_xlabel("generation")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.legend(loc="best", frameon=False)
    return axes


def draw_curve(curve: Sequence[Leg], axes: Axes | None = None) -> Axes:
    """Draw a learning curve's columns ``score`` and ``training``, and the best score so far."""
    x, score = [leg.steps for leg in curve], [leg.score for leg in curve]
    axes = _draw_progress(axes or _present_axes(), x, score, "score", "held-out poses")
    axes.plot(x, [leg.training for leg in curve], "--", color=_MEAN, label="while learning")
    axes.set_xlabel("actions, of all robots together")
    axes.legend(loc="best", frameon=False)
    return axes


def _draw_progress(axes: Axes, x: Sequence[int], y: Sequence[float], name: str, what: str) -> Axes:
    axes.plot(x, np.maximum.accumulate(y), color=_FINAL, label=f"{name}, best so far")
    axes.plot(x, y, ".", color=_FINAL, alpha=0.6, label=f"{name} ({what})")
    axes.set_ylabel("distance (units of 5 cm)")
    return axes


def plot_trajectories(path: Path, swims: Mapping[str, Swim]) -> None:
    """Write :func:`draw_trajectories` to a PNG, PDF or SVG file."""
    _write(path, (5.0, 5.0), lambda axes: draw_trajectories(swims, axes))


def plot_history(path: Path, history: Sequence[Generation]) -> None:
    """Write :func:`draw_history` to a PNG, PDF or SVG file."""
    _write(path, (6.0, 4.0), lambda axes: draw_history(history, axes))


def plot_curve(path: Path, curve: Sequence[Leg]) -> None:
    """Write :func:`draw_curve` to a PNG, PDF or SVG file."""
    _write(path, (6.0, 4.0), lambda axes: draw_curve(curve, axes))


def _write(path: Path, size: tuple[float, float], draw: Callable[[Axes], object]) -> None:
    from aquafish_gym.rendering.pictures import new_figure, save_figure

    figure = new_figure(*size, DPI)
    draw(figure.add_subplot())
    save_figure(figure, path)


def _present_axes() -> Axes:
    from matplotlib import pyplot

    return pyplot.gca()
