"""The figures of the two drones as a table, and a picture of true against found cuts."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from aquafish_gym.rendering.pictures import new_figure, save_figure
from aquafish_gym.runs.markdown import markdown_table
from eea.study.drawing import GREY, MARKERS, SMALL_FONT, grid
from experiments.real.crazypad import MOTORS

COLOURS = ("C0", "C1", "C2", "C3")  # of the motors


def drones_cuts(table: Mapping[str, Any]) -> str:
    """Return the errors of ``drones_table`` in Markdown.

    "If cut" is of a propeller that has been cut, given that it is known to be cut. "No change" is
    the error of an answer that says that nothing was lost.
    """
    rows = [["error, mm", *table["rmse_mm"], "named", "90% hold, if cut", "false alarms"]]
    for known, of in (("this build", table), ("other builds", table["other_builds"])):
        alarms = f"{of['false_alarms']} of {of['healthy_flights']}"
        shares = [f"{of['named']:.0%}", f"{of['held_90_if_cut']:.0%}", alarms]
        rows.append([f"known: {known}", *_lengths(of["rmse_mm"]), *shares])
        rows.append(["the same, if cut", *_lengths(of["rmse_if_cut_mm"]), "", "", ""])
        rows.append(['answering "no change"', *_lengths(of["rmse_of_zero_mm"]), "", "", ""])
    return markdown_table(rows, words=1)


def drones_text(table: Mapping[str, Any]) -> str:
    """Return the figures of ``drones_table`` in Markdown."""
    same = table["would_not_show_mm"]
    other = table["other_builds"]["would_not_show_mm"]
    hidden = (
        f"In one flight, a cut below {same:.1f} mm would not show since flights of the same build, "
        f"and one below {other:.1f} mm since other builds.\n"
    )
    return f"{drones_cuts(table)}\n\n{hidden}"


def _lengths(by_session: Mapping[str, float]) -> list[str]:
    return [f"{length:.2f}" for length in by_session.values()]


def draw_drones(table: Mapping[str, Any], path: Path) -> None:
    """Draw each cut as it was and as it was found, a panel a session.

    ``table`` is that of ``drones_table``. A point is the median of a propeller if it is cut,
    since the session's first condition, a line its 90% interval. Open points are propellers that
    the flights leave more probably uncut.
    """
    rows = table["found"]
    sessions = list(dict.fromkeys(row["session"] for row in rows))
    figure = new_figure(3.0 * len(sessions), 3.4)
    panels = figure.subplots(1, len(sessions), squeeze=False)[0]
    for axes, name in zip(panels, sessions, strict=True):
        most = 0.0
        for row in rows:
            if row["session"] != name:
                continue
            for k in np.flatnonzero(np.array(row["lost"]) > 0.0):
                middle, low, high = row["if_cut"][k]
                most = max(most, row["lost"][k], high)
                sure = row["median"][k] > 0.0
                axes.errorbar(
                    row["lost"][k] + 0.06 * (k - 1.5),
                    middle,
                    [[middle - low], [high - middle]],
                    color=COLOURS[k],
                    marker=MARKERS[k],
                    markersize=4,
                    markerfacecolor=COLOURS[k] if sure else "white",
                    linewidth=1,
                )
        drawn = {k for row in rows if row["session"] == name for k in np.flatnonzero(row["lost"])}
        for k in sorted(drawn):
            axes.plot([], [], MARKERS[k], color=COLOURS[k], markersize=4, label=MOTORS[k])
        axes.plot([0.0, most], [0.0, most], color=GREY, linewidth=0.8, linestyle="--")
        axes.legend(fontsize=SMALL_FONT, loc="upper left")
        axes.set_title(name, fontsize=SMALL_FONT + 1)
        axes.set_xlabel("cut since the first condition, mm", fontsize=SMALL_FONT)
        grid(axes)
    panels[0].set_ylabel("found, if it is cut, mm", fontsize=SMALL_FONT)
    save_figure(figure, path)
