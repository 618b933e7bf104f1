"""The figures of the real fish as a table, and a picture of what is predicted."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from aquafish_gym.rendering.pictures import new_figure, save_figure
from aquafish_gym.runs.markdown import markdown_table
from eea.study.drawing import GREY, SMALL_FONT, grid
from experiments.real.fish import LAW
from instruments.verification.fish_data import SPEED_SECONDS

LABELS = {"position_cm": "error of the place, cm", "heading_rad": "error of the heading, rad"}
LINES = ("-", "--", "-.", ":")
SHOWN = ((20, -50), (20, 0), (20, 20), (20, 50))  # commands whose swims are drawn, degrees


def fish_errors(table: Mapping[str, Any]) -> str:
    """Return the errors of ``fish_table`` in Markdown, a row a predictor."""
    seconds = list(table["cases"])
    at = [int(np.argmin(np.abs(np.array(table["seconds"]) - float(s)))) for s in seconds]
    rows = [["predicted by", *(f"after {s} s" for s in seconds)]]
    for name, of in table["by_second"].items():
        cells = [f"{of['position_cm'][i]:.1f} cm, {of['heading_rad'][i]:.2f} rad" for i in at]
        rows.append([name, *cells])
    return markdown_table(rows, words=1)


def fish_text(table: Mapping[str, Any]) -> str:
    """Return the figures of ``fish_table`` in Markdown."""
    cases = ", ".join(f"{count} after {s} s" for s, count in table["cases"].items())
    by = "; ".join(
        f"after {s} s along {along:.0%}, across {across:.0%}, heading {heading:.0%}"
        for s, (along, across, heading) in table["held_90_by"].items()
    )
    straight = [["amplitude", *(f"m/s at {at} s" for at in SPEED_SECONDS)]]
    straight += [[str(a), *(f"{v:.4f}" for v in speeds)] for a, speeds in table["straight_speeds"]]
    return (
        f"Root mean squares of held-out commands; cases: {cases}.\n\n"
        f"{fish_errors(table)}\n\n"
        f"Our 90% intervals hold {table['held_90']:.1%}: {by}.\n\n"
        f"Mean speeds of the runs without bias, in the second about each time:\n\n"
        f"{markdown_table(straight, words=1)}\n\n"
    )


def draw_fish(table: Mapping[str, Any], path: Path) -> None:
    """Draw the errors over time, and the seen and predicted paths of some swims."""
    figure = new_figure(9.0, 3.4)
    panels = figure.subplots(1, 3, width_ratios=(1, 1, 1.5))
    for axes, what in zip(panels, LABELS, strict=False):
        _draw_errors(axes, table, what)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(
        handles, labels, fontsize=SMALL_FONT, frameon=False, ncols=4, loc="outside upper left"
    )
    _draw_swims(panels[2], table)
    save_figure(figure, path)


def _draw_errors(axes: Axes, table: Mapping[str, Any], what: str) -> None:
    most = 0.0
    for i, (name, of) in enumerate(table["by_second"].items()):
        values = np.array(of[what])
        colour = "C0" if name == LAW else GREY
        axes.plot(table["seconds"], values, LINES[i], color=colour, lw=1.4, label=name)
        if name != "same speed and turn":
            most = max(most, values.max())
    axes.set(
        xlabel="time after the start, s", ylabel=LABELS[what], xlim=(0, 5), ylim=(0, 1.3 * most)
    )
    grid(axes)


def _draw_swims(axes: Axes, table: Mapping[str, Any]) -> None:
    swims = [one for one in table["swims"] if tuple(one["command"]) in SHOWN]
    for i, one in enumerate(swims):
        for what, line, colour in (("seen", "-", GREY), ("predicted", "--", "C0")):
            x, y = 100.0 * np.array(one[what]).T
            axes.plot(x, y, line, color=colour, lw=1.4, label="" if i else what)
        axes.annotate(
            f"{one['command'][1]}°", (x[-1], y[-1]), (4, -3), textcoords="offset points",
            fontsize=SMALL_FONT,
        )  # fmt: skip
    axes.set(xlabel="x, cm", ylabel="y, cm")
    axes.set_title("swims at an amplitude of 20°, by bias", fontsize=SMALL_FONT)
    axes.set_aspect("equal", adjustable="datalim")
    axes.legend(fontsize=SMALL_FONT, frameon=False, loc="upper left")
    grid(axes)
