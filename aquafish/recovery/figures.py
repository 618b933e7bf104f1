"""The figures of the case study: bodies (Fig. 11), paths (Fig. 12), fitness, distances; a film."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from aquafish.recovery.page import shown_swims
from aquafish.recovery.report import Outcomes, shown_replicate
from aquafish.recovery.treatment import MODEL_CONDITIONS, TREATMENTS, Treatment, path_from_dict
from aquafish_gym import Morphology
from aquafish_gym.rendering import Camera, film, render_pose
from aquafish_gym.rendering.pictures import encode_figure, new_figure, save_figure
from aquafish_gym.rendering.scene import CM_PER_UNIT
from aquafish_gym.runs.progress import show_share
from eea.core.fitness import chance_level, mid_range_level
from eea.fish import fish_problem
from eea.study.arms import ARMS
from eea.study.statistics import interval
from gait.plots import DPI, draw_trajectories
from gait.swims.swim import Swim

# A condition has its colour of the studies' figures; the oracles share a hue.
COLOURS = {
    "undamaged": "#555555",
    "randomised": "#e69f00",
    "direct": "#b09500",
    **{name: ARMS[name].colour for name in ("none", "out-of-band", "joint")},
    "joint-fins": "#cc79a7",
    "swims-on": "#332288",
    "oracle-neat": "#66c2a5",
    "oracle": "#009e73",
    "oracle-fins": "#00523c",
}
TREATMENT_LABELS = {name: spec.label for name, spec in TREATMENTS.items()}
WIDE = 8.0  # inches, of a figure on a page
NARROW = 4.6  # for a telephone, whose 390 pixels are 4.1 inches of a browser
PATHS = ("undamaged", "randomised", "out-of-band", "joint", "joint-fins", "oracle-fins")
REST_POSE = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
BODY_CAMERA = Camera(distance=7.5, azimuth=-30.0, elevation=45.0, target=(0.0, -0.5, 0.0))
FILM_FPS = 10.0
VIDEO_FPS = 20.0
FILM_SPEED = 2.0  # times real time
FILM_PIXELS = (800, 450)


def draw_all(
    folder: Path,
    job: Treatment,
    outcomes: Outcomes,
    formats: Sequence[str],
    filmed: bool,
    keep_film: bool = False,
) -> tuple[list[str], dict[str, bytes]]:
    """Write all figures of a study in each format.

    ``job`` is of the shown replicate; ``keep_film`` draws no film that exists already. Return the
    names of the files, and as SVG the figures of the report's page: ``sizes`` and ``distances``,
    and both for a narrow screen as ``sizes-narrow`` and ``distances-narrow``.
    """
    figures = {
        "bodies": bodies_figure(job, outcomes),
        "sizes": sizes_figure(job, outcomes),
        "paths": paths_figure(outcomes),
        "fitness": treatment_fitness_figure(job.target, outcomes),
        "distances": distances_figure(outcomes),
    }
    on_page = {name: figures[name] for name in ("sizes", "distances")} | {
        "sizes-narrow": sizes_figure(job, outcomes, NARROW),
        "distances-narrow": distances_figure(outcomes, NARROW),
    }
    names = []
    for name, figure in figures.items():
        for kind in formats:
            names.append(f"{name}.{kind}")
            save_figure(figure, folder / names[-1])
    if filmed:
        names += write_film(folder, job, outcomes, keep_film)
    return names, {name: encode_figure(figure, "svg") for name, figure in on_page.items()}


def bodies_figure(job: Treatment, outcomes: Outcomes) -> Figure:
    """Draw the target and each treatment's body (Fig. 11); the broken fins have another colour."""
    shown = shown_replicate(outcomes)
    plan = job.morphology.plan
    bodies = {"target": job.target} | {
        t: Morphology.coerce(outcomes[t][shown]["morphology"], plan)
        for t in ("undamaged", "none", "out-of-band", "joint")
    }
    broken = [fin for fin in plan.names if getattr(job.morphology, fin) != getattr(job.target, fin)]
    figure = new_figure(2.63 * len(bodies), 3.1, DPI)
    for axes, (name, body) in zip(figure.subplots(1, len(bodies)), bodies.items(), strict=True):
        marked = () if name == "undamaged" else broken
        straight = np.zeros(len(plan.fins))
        axes.imshow(render_pose(body, REST_POSE, straight, 520, 520, BODY_CAMERA, marked))
        axes.set_title(f"the damaged robot\n{_mark(job.target, broken)}")
        if name != "target":
            fit = outcomes[name][shown]["objective_fitness"]
            label = "the healthy body" if name == "undamaged" else TREATMENT_LABELS[name]
            axes.set_title(f"{label}\nOBJ_FIT {fit:.2f}", color=COLOURS[name])
        axes.set_axis_off()
        axes.set_anchor("S")
    return figure


def _mark(body: Morphology, broken: Sequence[str]) -> str:
    """Return how broken fins of a body are marked: one that is missing leaves its break alone."""
    left = [fin for fin in broken if any(getattr(body, fin))]
    return "broken fin in yellow" if left or not broken else "break of the lost fin in black"


def sizes_figure(job: Treatment, outcomes: Outcomes, width: float = WIDE) -> Figure:
    """Draw the sizes of the damaged robot and of each self-model, with posterior intervals."""
    shown = shown_replicate(outcomes)
    plan = job.morphology.plan
    whole, true = job.morphology.to_array(), job.target.to_array()
    joint = outcomes["joint"][shown]
    middle = Morphology.coerce(joint["morphology"], plan).to_array() / whole
    inferred = outcomes["out-of-band"][shown]["morphology"]
    paper = Morphology.coerce(inferred, plan).to_array() / whole
    rows = -np.arange(len(whole))
    figure = new_figure(width, 1.1 + 0.3 * len(rows), DPI)
    axes = figure.add_subplot()
    for row in rows[true != whole]:
        axes.axhspan(row - 0.5, row + 0.5, color="#facc15", alpha=0.3, lw=0)
    axes.axvline(100, color="0.8", lw=0.8, zorder=0)
    columns = [middle]
    if interval := joint["interval"]:
        ends = [
            Morphology.coerce(interval[end], plan).to_array() / whole for end in ("low", "high")
        ]
        low, high = np.minimum(ends[0], middle), np.maximum(ends[1], middle)
        mass = f"{interval['mass']:.0%} interval of {TREATMENT_LABELS['joint']}"
        axes.hlines(rows, 100 * low, 100 * high, COLOURS["joint"], lw=8, alpha=0.4, label=mass)
        columns += [low, high]
    axes.plot(100 * middle, rows, ".", color=COLOURS["joint"], label=TREATMENT_LABELS["joint"])
    blue = COLOURS["out-of-band"]
    axes.plot(
        100 * paper, rows, "s", ms=5, mfc="none", color=blue, label=TREATMENT_LABELS["out-of-band"]
    )
    axes.plot(100 * true / whole, rows, "|", ms=14, mew=1.8, color="black", label="truth")
    axes.set_yticks(rows, [f"{plan.words[d.fin]} {d.size}" for d in plan.dimensions])
    for row, values in zip(rows, 100 * np.column_stack(columns), strict=True):
        text = ("{:.0f}% [{:.0f}, {:.0f}]" if len(values) > 1 else "{:.0f}%").format(*values)
        axes.annotate(text, (1.01, row), xycoords=("axes fraction", "data"), va="center")
    figure.supxlabel("size, % of the healthy robot's; yellow: broken", size="medium")
    _legend_above(figure)
    return figure


def paths_figure(outcomes: Outcomes) -> Figure:
    """Draw the shown replicate's gaits, each on its own model and on the target (Fig. 12)."""
    figure = new_figure(2.9 * len(PATHS), 3.6, DPI)
    panels = figure.subplots(1, len(PATHS), sharey=True)
    for axes, name in zip(panels, PATHS, strict=True):
        swims = {"own model": shown_swim(outcomes, name, "native")}
        draw_trajectories(swims | {"target": shown_swim(outcomes, name, "target")}, axes)
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.17), fontsize="small", ncols=2)
        axes.label_outer()
        axes.set_title(TREATMENT_LABELS[name], color=COLOURS[name])
    return figure


def shown_swim(outcomes: Outcomes, treatment: str, body: str) -> Swim:
    return path_from_dict(outcomes[treatment][shown_replicate(outcomes)]["swims"][body])


def treatment_fitness_figure(target: Morphology, outcomes: Outcomes) -> Figure:
    """Draw OBJ_FIT and MOD_FIT against trials for each self-model."""
    figure = new_figure(9.0, 3.8, DPI)
    panels = figure.subplots(1, 2)
    titles = {
        "objective_fitness": "OBJ_FIT: likeness to the true body",
        "model_fitness": "MOD_FIT: fit to the measured signal",
    }
    for axes, (field, title) in zip(panels, titles.items(), strict=True):
        for name in dict.fromkeys(
            MODEL_CONDITIONS.values()
        ):  # joint and joint-fins share a self-model
            curves = np.array([[r[field] for r in o["rounds"]] for o in outcomes[name]])
            number = np.arange(1, curves.shape[1] + 1)
            if len(curves) > 1:
                axes.plot(number, curves.T, color=COLOURS[name], lw=0.5, alpha=0.4)
            mean = curves.mean(axis=0)
            axes.plot(number, mean, "o-", ms=3, color=COLOURS[name], label=TREATMENT_LABELS[name])
        axes.set_title(title)
        axes.set_xlabel("trials on the robot")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.grid(color="0.92")
    for level, line, label in (
        (chance_level, "--", "random body"),
        (mid_range_level, ":", "mid-range body"),
    ):
        height = level(target.to_array(), fish_problem(target.plan).models)
        panels[0].axhline(height, color="0.4", ls=line, lw=1, label=label)
    panels[0].set_ylim(0.4, 1.01)
    panels[1].set_ylim(max(-0.5, panels[1].get_ylim()[0]), 1.02)
    panels[0].legend(loc="lower right", fontsize="small")
    return figure


def distances_figure(outcomes: Outcomes, width: float = WIDE) -> Figure:
    """Draw each treatment's distances on the target: their mean, its interval, and all of them.

    Of one replicate they are its swims from random poses, of several the replicates' means.
    """
    count = len(outcomes["oracle"])
    figure = new_figure(width, 5.2, DPI)
    axes = figure.add_subplot()
    places = -np.arange(len(outcomes))
    for place, name in zip(places, outcomes, strict=True):
        colour = COLOURS[name]
        swims = CM_PER_UNIT * np.array([o["target_random_distances"] for o in outcomes[name]])
        zero = CM_PER_UNIT * np.mean([o["target_distance"] for o in outcomes[name]])
        values = swims.mean(axis=1) if count > 1 else swims[0]
        axes.plot(values, np.full(len(values), place), ".", color=colour, ms=7, alpha=0.45, mew=0)
        if ends := interval(values):
            axes.plot(ends, (place, place), color=colour, lw=2)
        axes.plot(values.mean(), place, "o", color=colour, ms=8)
        axes.plot(zero, place, "D", mfc="none", mec=colour, ms=6)
        text = f"{values.mean():z.0f} cm"
        axes.annotate(text, (1.01, place), xycoords=("axes fraction", "data"), va="center")
    swum = "mean of a replicate" if count > 1 else "swim from a random pose"
    axes.plot([], [], "o", ms=8, label="mean over random poses", color="0.3", ls="")
    axes.plot([], [], color="0.3", lw=2, label="95% interval of the mean")
    axes.plot([], [], ".", ms=7, alpha=0.45, label=swum, color="0.3", ls="")
    axes.plot([], [], "D", mfc="none", ms=6, label="from the zero pose", color="0.3", ls="")
    _legend_above(figure)
    axes.axvline(0, color="0.6", lw=0.8)
    axes.grid(axis="x", color="0.92")
    axes.set_yticks(places, [TREATMENT_LABELS[name] for name in outcomes])
    several = "replicates" if count > 1 else "replicate"
    figure.supxlabel(f"distance forward on the damaged robot, cm; {count} {several}", size="medium")
    return figure


def _legend_above(figure: Figure) -> None:
    """Put the legend above the axes, in as many columns as a figure of this width holds."""
    columns = 4 if figure.get_figwidth() >= WIDE else 2
    figure.legend(fontsize="small", ncols=columns, frameon=False, loc="outside upper center")


def write_film(folder: Path, job: Treatment, outcomes: Outcomes, keep: bool = False) -> list[str]:
    """Write the film of the shown replicate and return the names of its files.

    They are film.webp and, where imageio-ffmpeg is installed, film.mp4. ``keep`` draws none that
    exists already.
    """
    forms = {"film.webp": (*FILM_PIXELS, FILM_FPS)}
    if find_spec("imageio_ffmpeg") is not None:
        forms["film.mp4"] = (1920, 1080, VIDEO_FPS)
    swims = shown_swims(job, outcomes)
    title = job.damage.said().capitalize()
    for name, form in forms.items():
        if keep and (folder / name).exists():
            continue
        with show_share(name, "frames") as show:
            film(swims, folder / name, *form, FILM_SPEED, title, show)
    return list(forms)
