"""Pictures of gaits: paths on native and target body (Fig. 12), and a run's history."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.runs.storage import write_bytes
from gait.history import Generation

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Told apart in grey and by the colour-blind too. Paths leave the colours of the case study's
# treatments alone.
_PATHS = (("#000000", "-"), ("#cc79a7", "--"), ("#56b4e9", "-."), ("#b09500", ":"))
_FINAL, _MEAN = "#0072b2", "#d55e00"


class Path2D(Protocol):
    """What is drawn of a ``gait.Swim``."""

    @property
    def position(self) -> NDArray[np.float64]:
        """Positions (T, 3) in units of 5 cm."""

    @property
    def distance(self) -> float:
        """Progress along the world's +y."""


def present_axes(axes: Axes | None) -> Axes:
    """Return the axes given, or those of matplotlib's present figure, as its own functions do."""
    if axes is not None:
        return axes
    from matplotlib import pyplot

    return pyplot.gca()


def draw_trajectories(axes: Axes, swims: Mapping[str, Path2D]) -> None:
    """Draw paths from above, x to the right and y (forward) upwards, in units of 5 cm.

    Parameters
    ----------
    axes
        Where.
    swims
        Label to swim, for example ``{"native": ..., "target": ...}``.
    """
    for (label, one), (colour, line) in zip(swims.items(), _cycle(len(swims)), strict=True):
        x, y, text = one.position[:, 0], one.position[:, 1], f"{label}: {one.distance:.1f}"
        axes.plot(x, y, line, color=colour, label=text, linewidth=1.8)
        axes.plot(x[-1], y[-1], "o", color=colour, markersize=5)
    axes.plot(0.0, 0.0, "+", color="black", markersize=10)
    axes.axhline(0.0, color="0.85", linewidth=0.8, zorder=0)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x (units of 5 cm)")
    axes.set_ylabel("forward, y (units of 5 cm)")
    axes.legend(loc="best", frameon=False)


def draw_history(axes: Axes, history: Sequence[Generation]) -> None:
    """Draw a history's columns ``final`` and ``mean``, and the best ``final`` so far."""
    from matplotlib.ticker import MaxNLocator

    x = [row.generation for row in history]
    final = [row.final for row in history]
    axes.plot(x, np.maximum.accumulate(final), color=_FINAL, label="final, best so far")
    axes.plot(x, final, ".", color=_FINAL, alpha=0.6, label="final (the winner)")
    axes.plot(x, [row.mean for row in history], "--", color=_MEAN, label="mean (everyone)")
    axes.set_xlabel("generation")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_ylabel("distance (units of 5 cm)")
    axes.legend(loc="best", frameon=False)


def plot_trajectories(path: Path | str, swims: Mapping[str, Path2D], title: str = "") -> None:
    """Write :func:`draw_trajectories` to a PNG, PDF or SVG file."""
    figure = _figure(5.0, 5.0)
    axes = figure.add_subplot()
    draw_trajectories(axes, swims)
    axes.set_title(title)
    _save(figure, path)


def plot_history(path: Path | str, history: Sequence[Generation], title: str = "") -> None:
    """Write :func:`draw_history` to a PNG, PDF or SVG file."""
    figure = _figure(6.0, 4.0)
    axes = figure.add_subplot()
    draw_history(axes, history)
    axes.set_title(title)
    _save(figure, path)


def _save(figure: Figure, path: Path | str) -> None:
    """Write a picture whole or not at all; what kind it is, its name says, or else PNG."""
    target = Path(path)
    target = target if target.suffix else target.with_suffix(".png")
    picture = BytesIO()
    figure.savefig(picture, format=target.suffix[1:], dpi=150)
    write_bytes(target, picture.getvalue())


def _figure(width: float, height: float) -> Figure:
    # The object interface: no pyplot, no window system, no global state.
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _cycle(count: int) -> list[tuple[str, str]]:
    return [_PATHS[i % len(_PATHS)] for i in range(count)]
