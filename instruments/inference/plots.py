"""The report's numbers as pictures."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from aquafish_gym.rendering.pictures import new_figure, save_figure
from instruments.inference.cases import DRAWS, MASSES
from instruments.inference.settings import EVERY, FOREIGN_SETTINGS

BINS = 20
_DPI = 150
NAMED_MASSES = tuple(f"{mass:.0%}" for mass in MASSES)


def save_pictures(report: Mapping[str, Any], folder: Path) -> list[str]:
    """Write the pictures that a report has the numbers of; return their names."""
    parts = report["settings"]
    known = {name: part for name, part in parts.items() if name not in FOREIGN_SETTINGS}
    figures = {"coverage": coverage_figure(known)} if known else {}
    if "prior" in parts:
        figures["ranks"] = ranks_figure(parts["prior"]["ranks"])
    for name, figure in figures.items():
        save_figure(figure, folder / f"{name}.png")
    return sorted(figures)


def coverage_figure(parts: Mapping[str, Any]) -> Figure:
    """Return how often intervals held the truth, in each setting, against what they promise."""
    noisy = [name for name in parts if EVERY[name].noise]
    figure = new_figure(8.0, 1.4 + 0.42 * len(noisy), _DPI)
    axes = figure.subplots()
    for k, (mass, named) in enumerate(zip(MASSES, NAMED_MASSES, strict=True)):
        held = [parts[name]["coverage"][named] for name in noisy]
        shares = np.array([h["share"] for h in held])
        ends = np.array([h["interval"] or [h["share"]] * 2 for h in held])
        reach = np.abs(ends.T - shares) if noisy else np.zeros((2, 0))
        rows = np.arange(len(noisy))[::-1] + 0.18 * (k - 1)
        axes.errorbar(shares, rows, xerr=reach, fmt="o", color=f"C{k}", label=named)
        axes.axvline(mass, color=f"C{k}", linestyle=":", linewidth=1.0)
    axes.set_yticks(np.arange(len(noisy))[::-1], [EVERY[name].title for name in noisy])
    axes.set_xlabel("share of sizes that their intervals hold")
    axes.set_xlim(0.0, 1.0)
    axes.legend(title="intervals", loc="upper left", fontsize="small")
    return figure


def ranks_figure(found: Mapping[str, Any]) -> Figure:
    """Return histograms of the truths' ranks, with where 99% of even ones' bins are."""
    names, ranks = found["names"], np.array(found["ranks"])
    shown = [k for k, name in enumerate(names) if "@" not in name or name.endswith("@1")]
    columns = 5
    lines = -(-len(shown) // columns)
    figure = new_figure(10.0, 1.6 * lines, _DPI)
    grid = figure.subplots(lines, columns, sharex=True, sharey=True, squeeze=False).ravel()
    share = 1.0 / BINS
    count = ranks.shape[1]
    reach = 2.58 * np.sqrt(count * share * (1.0 - share))
    for axes, k in zip(grid, shown, strict=False):
        axes.hist(ranks[k], bins=BINS, range=(-0.5, DRAWS + 0.5), color="C0")
        axes.axhspan(count * share - reach, count * share + reach, color="C1", alpha=0.25)
        axes.set_title(names[k].replace("_pectoral", ""), fontsize="small")
    for axes in grid[len(shown) :]:
        axes.set_axis_off()
    grid[0].set_ylim(bottom=0)
    figure.supxlabel(f"rank of the truth among {DRAWS} draws of the posterior", fontsize="small")
    return figure
