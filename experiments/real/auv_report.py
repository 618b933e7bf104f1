"""The figures of the AUV as a table, and a picture of the three numbers of its swims."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from aquafish_gym.rendering.pictures import new_figure, save_figure
from aquafish_gym.runs.markdown import markdown_table
from eea.study.drawing import GREY, SMALL_FONT, grid
from experiments.real.auv import CALLED, KNOWN_SWIMS, NUMBERS
from experiments.real.haizhe import CONDITIONS

AXES = ("depth at the surface, m", "descent for its rate, log m", "rotor line, sd of noise")
COLOURS = ("C0", "C1", "C2", "C3", "C5")  # of the conditions


def auv_called(table: Mapping[str, Any]) -> str:
    """Return the share of each condition's swims that are called each way, in Markdown."""
    rows = [["condition", *CALLED]]
    for condition, shares in table["called"].items():
        rows.append([condition, *(f"{shares[name]:.1%}" for name in CALLED)])
    return markdown_table(rows, words=1)


def auv_text(table: Mapping[str, Any]) -> str:
    """Return the figures of ``auv_table`` as two tables in Markdown.

    The first is ``auv_called``; the second has a row for each odds of nothing to a fault.
    """
    named = ("weight", "depth_sensor", "thruster_bad", "thruster_slight", "false_alarms")
    by_odds = [["odds of nothing", *(name.replace("_", " ") for name in named)]]
    for odds, shares in table["at_odds"].items():
        by_odds.append([odds, *(f"{shares[name]:.1%}" for name in named)])
    strict = ", ".join(
        f"{name} {table['rotor_of_known'][key]:.1%}"
        for key, name in zip(named, by_odds[0][1:], strict=True)
    )
    counts = ", ".join(f"{count} {what}" for what, count in table["sessions"].items())
    return (
        f"{KNOWN_SWIMS} healthy swims are known; odds of {table['odds']:g} to each fault.\n\n"
        f"{auv_called(table)}\n\n{markdown_table(by_odds, words=1)}\n\n"
        f"If the rotors' rate is found in the known swims alone: {strict}.\nSessions: {counts}.\n"
    )


def draw_auv(table: Mapping[str, Any], path: Path) -> None:
    """Draw the numbers of each swim, a panel a number and a row a condition.

    Grey bands hold 95% of the healthy swims of a session that is not known. The rows are those of
    ``numbers`` of ``auv_table``: healthy swims of two sessions held out, all faulty ones.
    """
    figure = new_figure(9.0, 2.8)
    panels = figure.subplots(1, len(NUMBERS), sharey=True)
    rng = np.random.default_rng(0)
    places = np.arange(len(CONDITIONS))[::-1]
    for k, (axes, label) in enumerate(zip(panels, AXES, strict=True)):
        axes.axvspan(*table["healthy_95"][k], color="0.9", lw=0)
        for place, colour, rows in zip(places, COLOURS, table["numbers"].values(), strict=True):
            values = np.array(rows)[:, k]
            heights = place + rng.uniform(-0.3, 0.3, len(values))
            axes.plot(values, heights, ".", color=colour, ms=2.5, mew=0)
            axes.plot(np.median(values), place, "|", color=GREY, ms=12, mew=1.5)
        axes.set_xlabel(label, fontsize=SMALL_FONT)
        axes.tick_params(labelsize=SMALL_FONT)
        grid(axes, "x")
    panels[0].set_yticks(places, list(CONDITIONS.values()), fontsize=SMALL_FONT)
    save_figure(figure, path)
