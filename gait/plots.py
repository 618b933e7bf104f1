"""Figures of gaits: paths on native and target body (Fig. 12), and the progress of a search."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gait.swims.swim import Swim

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DPI = 150
# Distinct in grey and for the colour-blind, and none of the case study's colours of treatments.
_PATHS = (("#000000", "-"), ("#cc79a7", "--"), ("#56b4e9", "-."), ("#b09500", ":"))
_FINAL, _MEAN = "#0072b2", "#d55e00"


def draw_trajectories(swims: Mapping[str, Swim], axes: Axes) -> None:
    """Draw labelled paths from above, x to the right and y (forward) upwards, units of 5 cm."""
    for (label, one), (colour, line) in zip(swims.items(), cycle(_PATHS), strict=False):
        x = one.position[:, 0]
        y = one.position[:, 1]
        text = f"{label}: {one.distance:.1f}"
        axes.plot(x, y, line, color=colour, label=text, linewidth=1.8)
        axes.plot(x[-1], y[-1], "o", color=colour, markersize=5)
    axes.plot(0.0, 0.0, "+", color="black", markersize=10)
    axes.axhline(0.0, color="0.85", linewidth=0.8, zorder=0)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x (units of 5 cm)")
    axes.set_ylabel("forward, y (units of 5 cm)")
    axes.legend(loc="best", frameon=False)


def plot_trajectories(path: Path, swims: Mapping[str, Swim]) -> None:
    """Write :func:`draw_trajectories` to a PNG, PDF or SVG file."""
    _write(path, (5.0, 5.0), lambda axes: draw_trajectories(swims, axes))


def plot_progress(
    path: Path,
    x: Sequence[int],
    final: Sequence[float],
    mean: Sequence[float],
    labels: tuple[str, str, str],
) -> None:
    """Write two curves over ``x``, and the best ``final`` so far, to a file.

    ``labels`` are of ``final``, ``mean`` and ``x``.
    """
    from matplotlib.ticker import MaxNLocator

    def draw(axes: Axes) -> None:
        axes.plot(x, np.maximum.accumulate(final), color=_FINAL, label=f"{labels[0]}, best so far")
        axes.plot(x, final, ".", color=_FINAL, alpha=0.6, label=labels[0])
        axes.plot(x, mean, "--", color=_MEAN, label=labels[1])
        axes.set_xlabel(labels[2])
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.set_ylabel("distance (units of 5 cm)")
        axes.legend(loc="best", frameon=False)

    _write(path, (6.0, 4.0), draw)


def _write(path: Path, size: tuple[float, float], draw: Callable[[Axes], None]) -> None:
    from aquafish_gym.rendering.pictures import new_figure, save_figure

    figure = new_figure(*size, DPI)
    draw(figure.add_subplot())
    save_figure(figure, path)
