"""The report's pictures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aquafish_gym.rendering.pictures import new_figure, save_figure
from instruments.verification import fish_data
from instruments.verification.strokes import (
    ROWING,
    SPEEDS,
    Stroke,
    flipper_stroke,
    rowing_stroke,
    tail_stroke,
)

Records = Sequence[dict[str, Any]]

# Of Okabe and Ito's palette, told apart by all eyes; each has a line style of its own, too.
_BLUE, _RED, _GREEN, _BLACK = "#0072B2", "#D55E00", "#009E73", "#000000"
_STYLES = ((_BLACK, "-"), (_BLUE, "--"), (_RED, "-."), (_GREEN, ":"))
_GRID = "0.92"
_DPI = 150


def draw_strokes(axes: Sequence[Axes], strokes: Sequence[tuple[str, Stroke]], name: str) -> None:
    """Draw the force along and across a fin above, and the thrust below, over a cycle."""
    above, below = axes
    for (label, stroke), (colour, line) in zip(strokes, _STYLES, strict=False):
        above.plot(stroke.cycle, stroke.normal, line, color=colour, lw=1.8, label=label)
        above.plot(stroke.cycle, stroke.tangential, line, color=colour, lw=0.9)
        mean = round(stroke.mean_thrust, 9) + 0.0
        below.plot(
            stroke.cycle, stroke.thrust, line, color=colour, lw=1.8, label=f"mean {mean:.2f}"
        )
    above.set_title(name, fontsize="medium", pad=36)
    above.set_ylabel("force on the fin (6.25 mN)")
    below.set_ylabel("thrust (6.25 mN)")
    for panel in axes:
        panel.axhline(0.0, color="0.7", lw=0.8, zorder=0)
        panel.set_xlim(0.0, 1.0)
        panel.margins(y=0.12)
        panel.grid(color=_GRID)
        # Above the curves, where none can be hidden.
        panel.legend(
            fontsize="small", frameon=False, ncols=2, loc="lower left", bbox_to_anchor=(0, 1),
            borderaxespad=0.2,
        )  # fmt: skip


def strokes_figure() -> Figure:
    """Return the forces on the nominal flipper and tail over a stroke."""
    figure = new_figure(9.0, 7.4, _DPI)
    axes = figure.subplots(2, 2, sharex="col")
    flippers = [(f"towed at {v:g} units/s", flipper_stroke(v)) for v in SPEEDS]
    flippers.append((f"held, speed varied by {ROWING:.0%}", rowing_stroke(0.0)))
    tails = [(f"towed at {v:g} units/s", tail_stroke(v)) for v in SPEEDS]
    draw_strokes(axes[:, 0], flippers, "flipper, 0.5 rev/s")
    draw_strokes(axes[:, 1], tails, "tail, 1 Hz, ±30°")
    axes[1, 0].set_xlabel("time (share of a turn; at 0 the flipper is straight back)")
    axes[1, 1].set_xlabel("time (share of a sweep)")
    figure.suptitle(
        "Nominal fins on a body towed ahead. Above: normal to the fin (thick) and along it (thin)",
        fontsize="medium",
    )
    return figure


def draw_convergence(axes: Axes, records: Records) -> None:
    """Draw median (line) and maximum (dots) error against the step, with a slope of one."""
    ends: dict[str, tuple[float, str]] = {}
    for what, colour, mark in (
        ("position", _BLACK, "o"),
        ("attitude", _BLUE, "s"),
        ("gyro", _RED, "^"),
    ):
        rows = [r for r in records if r["what"] == what]
        steps = [r["step"] for r in rows]
        medians = [r["median"] for r in rows]
        axes.loglog(steps, medians, "-", marker=mark, color=colour, ms=5, lw=1.8)
        axes.loglog(steps, [r["maximum"] for r in rows], ":", marker=mark, color=colour, ms=4,
                    lw=1.0, mfc="white")  # fmt: skip
        ends[f"{what} ({rows[0]['unit']})"] = (medians[0], colour)
    steps = sorted({r["step"] for r in records})
    least = 0.0
    for label, (value, colour) in sorted(ends.items(), key=lambda item: item[1]):
        least = max(value, 1.35 * least)  # apart enough to be read
        axes.annotate(
            label, (steps[-1], value), color=colour, xytext=(steps[-1] * 1.15, least),
            va="center", fontsize="small",
        )  # fmt: skip
    guide = 0.5 * min(r["median"] for r in records if r["step"] == steps[0])
    line = [guide * step / steps[0] for step in steps]
    axes.loglog(steps, line, "--", color="0.5", lw=1.2)
    axes.annotate(
        "slope 1", (steps[1], line[1]), color="0.4", xytext=(4, -12),
        textcoords="offset points", fontsize="small",
    )  # fmt: skip
    axes.set_xlim(steps[0] / 1.2, steps[-1] * 2.3)
    axes.set_xticks(steps, [f"{1000 * step:g}" for step in steps])
    axes.minorticks_off()
    axes.set_xlabel("time step (ms)")
    axes.set_ylabel("largest gap to RK4 along the path")
    axes.grid(color=_GRID)


def convergence_figure(report: dict[str, Any]) -> Figure:
    """Return the error against the step."""
    figure = new_figure(6.4, 4.6, _DPI)
    axes = figure.add_subplot()
    draw_convergence(axes, report["rows"])
    axes.set_title(
        f"{report['robots']} random robots over {report['seconds']:g} s\n"
        "filled: median, open: maximum",
        fontsize="medium",
    )
    return figure


def draw_quadrature(axes: Axes, records: Records, what: str) -> None:
    """Draw the rms error of force or torque of each rule against its number of points."""
    for family, colour, mark, side in (("midpoint", _BLACK, "o", 6), ("Gauss", _BLUE, "s", -13)):
        rows = [r for r in records if r["rule"].startswith(family)]
        points, errors = [r["points"] for r in rows], [100 * r[what] for r in rows]
        axes.loglog(points, errors, mark, color=colour, ms=6, label=family)
        for row, at, error in zip(rows, points, errors, strict=True):
            axes.annotate(
                row["rule"].split()[1], (at, error), color=colour, xytext=(0, side),
                textcoords="offset points", ha="center", fontsize="x-small",
            )  # fmt: skip
    own = next(r for r in records if r["rule"] == "the law's")
    axes.axhline(1.0, color=_RED, lw=0.8, ls="--")
    axes.loglog(own["points"], 100 * own[what], "D", color=_RED, ms=7)
    axes.annotate(
        f"the law's rule: {own[what]:.2%}", (own["points"], 100 * own[what]), color=_RED,
        xytext=(8, 5), textcoords="offset points", fontsize="small",
    )  # fmt: skip
    axes.set_xlim(0.8, 70)
    axes.set_xticks([1, 2, 4, 8, 16, 32], ["1", "2", "4", "8", "16", "32"])
    axes.set_ylim(0.15, 100)
    axes.set_yticks([0.3, 1, 3, 10, 30, 100], ["0.3", "1", "3", "10", "30", "100"])
    axes.legend(loc="upper right", frameon=False, fontsize="small")
    axes.minorticks_off()
    axes.set_xlabel("points on a fin")
    axes.set_ylabel(f"rms error of {what} (%)")
    axes.grid(color=_GRID)


def quadrature_figure(report: dict[str, Any]) -> Figure:
    """Return the errors of quadrature rules on the first kind of fin."""
    part = report["rows"][0]["part"]
    figure = new_figure(9.0, 4.2, _DPI)
    records = [r for r in report["rows"] if r["part"] == part]
    for axes, what in zip(figure.subplots(1, 2), ("force", "torque"), strict=True):
        draw_quadrature(axes, records, what)
    figure.suptitle(
        f"{part}, in motions met while swimming; rules are (along) x (across)", fontsize="medium"
    )
    return figure


def draw_single_precision(axes: Axes, records: Records) -> None:
    """Draw quantiles of float32's error against time."""
    seconds = [r["seconds"] for r in records]
    styles = {"median": "-", "90%": "--", "99%": "-.", "maximum": ":"}
    for quantile, line in styles.items():
        values = [r[quantile] for r in records]
        axes.loglog(seconds, values, line, color=_BLUE, marker="o", ms=3, lw=1.6)
        axes.annotate(
            quantile, (seconds[-1], values[-1]), color=_BLUE, xytext=(6, 0),
            textcoords="offset points", va="center", fontsize="small",
        )  # fmt: skip
    axes.set_xlim(seconds[0] / 1.2, seconds[-1] * 6)
    ticks = [s for s in seconds if s in (0.32, 1.28, 5.12, 20.0)]
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.minorticks_off()
    axes.set_xlabel("time (s)")
    axes.set_ylabel(f"{records[0]['what']} ({records[0]['unit']})")
    axes.grid(color=_GRID)


def single_precision_figure(report: dict[str, Any]) -> Figure:
    """Return the growth of float32's error."""
    figure = new_figure(10.0, 3.9, _DPI)
    whats = list(dict.fromkeys(r["what"] for r in report["rows"]))
    for axes, what in zip(figure.subplots(1, len(whats)), whats, strict=True):
        draw_single_precision(axes, [r for r in report["rows"] if r["what"] == what])
    figure.suptitle(
        f"largest gap so far between float32 and float64, {report['robots']} random robots",
        fontsize="medium",
    )
    return figure


def draw_real_fish(axes: Axes, rows: Records, published: Sequence[tuple[float, float]]) -> None:
    """Draw published speeds, the nominal robot's under both laws, and all tails' range.

    Speeds are shares of the mean one at the greatest amplitude or frequency.
    """
    x, y = zip(*published, strict=True)
    top = max(x)
    greatest = float(np.mean([v for at, v in published if at == top]))
    for row in rows:
        colour, line = (_RED, "-.") if row["reactive"] else (_BLUE, "--")
        # Over a frequency range of the same ratio, at the published frequencies.
        at = [top * v / max(row["x"]) for v in row["x"]]
        if "speeds" in row:
            share = [v / row["speeds"][-1] for v in row["speeds"]]
            axes.loglog(at, share, line, color=colour, lw=1.8)
        else:
            axes.fill_between(at, row["least"], row["most"], color=colour, alpha=0.15, lw=0)
    axes.loglog(x, [v / greatest for v in y], "o", color=_BLACK, ms=5)
    axes.minorticks_off()
    axes.set_ylabel("speed (share of the greatest)")
    axes.grid(color=_GRID)


def real_fish_figure(report: dict[str, Any]) -> Figure:
    """Return speed against amplitude and frequency, and turning against bias.

    Speeds at an amplitude are those after ten beats from rest, as the longest that were measured.
    """
    figure = new_figure(10.0, 3.9, _DPI)
    left, middle, right = figure.subplots(1, 3)

    def shown(rows: Records) -> Records:
        """Return the rows of the nominal robot and of all tails."""
        return [r for r in rows if r["swimmer"] == "nominal robot" or "least" in r]

    draw_real_fish(left, shown(report["from rest"][-1]), fish_data.speeds_at(-1))
    left.set_xticks([15, 20, 25, 30], ["15", "20", "25", "30"])
    left.set_yticks([0.1, 0.2, 0.3, 0.5, 1.0], ["0.1", "0.2", "0.3", "0.5", "1"])
    left.set_xlabel(f"amplitude (degrees), after {fish_data.SPEED_BEATS[-1]} beats")
    draw_real_fish(middle, shown(report["frequency"]), fish_data.FREQUENCY_RUNS)
    middle.set_xticks([0.5, 1, 1.5, 2.25], ["0.5", "1", "1.5", "2.25"])
    middle.set_yticks([0.1, 0.2, 0.3, 0.5, 1.0], ["0.1", "0.2", "0.3", "0.5", "1"])
    middle.set_xlabel("frequency (Hz)")
    for reactive, colour, line in ((False, _BLUE, "--"), (True, _RED, "-.")):
        rows = [r for r in report["turning"] if r["reactive"] is reactive]
        bias = [r["bias"] for r in rows]
        right.loglog(bias, [r["nominal"] for r in rows], line, color=colour, lw=1.8,
                     label="drag and reactive terms" if reactive else "drag")  # fmt: skip
        right.fill_between(bias, [r["low"] for r in rows], [r["high"] for r in rows],
                           color=colour, alpha=0.15, lw=0)  # fmt: skip
    turns = [(bias, fish_data.turn_per_beat(turn)) for bias, turn in fish_data.BIAS_RUNS]
    right.loglog(*zip(*turns, strict=True), "o", color=_BLACK, ms=5, label="measured")
    right.set_xticks([5, 10, 15, 20, 30, 50], ["5", "10", "15", "20", "30", "50"])
    right.minorticks_off()
    right.set_xlabel("bias of the tail (degrees)")
    right.set_ylabel("turn in a beat (rad)")
    right.grid(color=_GRID)
    figure.legend(loc="outside upper center", ncols=3, frameon=False, fontsize="small")
    return figure


def save_pictures(report: dict[str, Any], directory: Path) -> list[Path]:
    """Write a picture as a PNG of each study in a report that has one; return their paths."""
    draw: dict[str, Callable[[dict[str, Any]], Figure]] = {
        "strokes": lambda _: strokes_figure(),
        "convergence": convergence_figure,
        "quadrature": quadrature_figure,
        "single_precision": single_precision_figure,
        "real_fish": real_fish_figure,
    }
    figures = {name: make(report[name]) for name, make in draw.items() if name in report}
    paths = []
    for name, figure in figures.items():
        paths.append(directory / f"{name}.png")
        save_figure(figure, paths[-1])
    return paths
