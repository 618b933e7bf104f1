"""The picture of a swim watched: what each second leaves unexplained."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from aquafish_gym.rendering.pictures import new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from eea.fish.watch import Watched

_SAME, _OTHER = "#0072B2", "#D55E00"  # of Okabe and Ito's palette


def watched_figure(watched: Watched) -> Figure:
    """Return a figure of what each window leaves, as a multiple of noise alone."""
    figure = new_figure(7.0, 3.0, dpi=150)
    axes = figure.add_subplot()
    excess = np.array([look.excess for look in watched.looks])
    same = np.array([look.same for look in watched.looks])
    axes.axhline(1.0, color="0.6", lw=0.8)
    axes.plot(watched.time, excess, color="0.8", lw=1, zorder=1)
    for which, colour, name in (
        (same, _SAME, "as the body believed in would swim"),
        (~same, _OTHER, f"not: chance under {watched.alarm:g}"),
    ):
        axes.scatter(watched.time[which], excess[which], s=14, color=colour, label=name, zorder=2)
    if watched.noticed is not None:
        axes.axvline(watched.noticed, color=_OTHER, lw=0.8, ls="--")
    axes.set_yscale("log")
    axes.set_xlabel("time (s)")
    axes.set_ylabel("unexplained, of noise alone")
    axes.legend(loc="upper left", fontsize="small")
    return figure
