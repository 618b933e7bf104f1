"""The figures of the case study: bodies (Fig. 11), paths (Fig. 12), fitness, distances; a film."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from PIL import Image, ImageDraw, ImageFont

from aquafish.recovery.report import Outcomes, distances
from aquafish.recovery.treatment import MODELLED, TREATMENTS, Treatment, path_from_dict
from aquafish_gym import Morphology
from aquafish_gym.rendering import Camera, render_motion, render_pose, write_gif
from aquafish_gym.rendering.pictures import new_figure, save_figure
from eea.core.fitness import chance_level, mid_range_level
from eea.fish import fish_problem
from gait.plots import DPI, draw_trajectories
from gait.rollout import Swim

# Joint inference has its colour of the studies' figures; the oracles share a hue.
COLOURS = {
    "undamaged": "#555555",
    "randomised": "#e69f00",
    "direct": "#b09500",
    "none": "#d55e00",
    "out-of-band": "#0072b2",
    "joint": "#882255",
    "joint-fins": "#cc79a7",
    "swims-on": "#332288",
    "oracle-neat": "#66c2a5",
    "oracle": "#009e73",
    "oracle-fins": "#00523c",
}
RECOVERED = "joint-fins"  # its gait is in the last scene of the film
LABELS = {name: spec.label for name, spec in TREATMENTS.items()}
PATHS = ("undamaged", "randomised", "out-of-band", "joint", "joint-fins", "oracle-fins")
AT_REST = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
BODY_CAMERA = Camera(distance=7.5, azimuth=-30.0, elevation=45.0, target=(0.0, -0.5, 0.0))
CM_PER_UNIT = 5
FILM_FPS = 10
FILM_SPEED = 2  # times real time
FILM_PIXELS = (224, 224)


def draw_all(
    folder: Path, job: Treatment, outcomes: Outcomes, formats: Sequence[str], film: bool
) -> list[str]:
    """Write all figures of a study in each format and return the names of their files."""
    figures = {
        "bodies": bodies_figure(job.target, outcomes),
        "paths": paths_figure(outcomes),
        "fitness": fitness_figure(job.target, outcomes),
        "distances": distances_figure(outcomes),
    }
    names = []
    for name, figure in figures.items():
        for kind in formats:
            names.append(f"{name}.{kind}")
            save_figure(figure, folder / names[-1])
    if film:
        names.append("film.gif")
        write_film(folder / names[-1], job.morphology, job.target, outcomes)
    return names


def bodies_figure(target: Morphology, outcomes: Outcomes) -> Figure:
    """Draw the target and each treatment's body of the first replicate, fins in red (Fig. 11)."""
    bodies = {"target": target} | {
        t: Morphology.coerce(outcomes[t][0]["morphology"])
        for t in ("undamaged", "none", "out-of-band", "joint")
    }
    figure = new_figure(2.63 * len(bodies), 3.3, DPI)
    for axes, (name, body) in zip(figure.subplots(1, len(bodies)), bodies.items(), strict=True):
        axes.imshow(render_pose(body, AT_REST, (0, 0, 0), 520, 520, BODY_CAMERA))
        axes.set_title("the damaged robot\n")
        if name != "target":
            fit = outcomes[name][0]["objective_fitness"]
            axes.set_title(f"{LABELS[name]}\nOBJ_FIT {fit:.2f}", color=COLOURS[name])
        axes.set_axis_off()
    return figure


def paths_figure(outcomes: Outcomes) -> Figure:
    """Draw the first replicate's gaits, each on its own model and on the target (Fig. 12)."""
    figure = new_figure(2.9 * len(PATHS), 3.6, DPI)
    panels = figure.subplots(1, len(PATHS), sharey=True)
    for axes, name in zip(panels, PATHS, strict=True):
        swims = {"own model": _first_swim(outcomes, name, "native")}
        draw_trajectories(swims | {"target": _first_swim(outcomes, name, "target")}, axes)
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.17), fontsize="small", ncols=2)
        axes.label_outer()
        axes.set_title(LABELS[name], color=COLOURS[name])
    return figure


def _first_swim(outcomes: Outcomes, treatment: str, body: str) -> Swim:
    return path_from_dict(outcomes[treatment][0]["swims"][body])


def fitness_figure(target: Morphology, outcomes: Outcomes) -> Figure:
    """Draw OBJ_FIT and MOD_FIT against trials for each self-model."""
    figure = new_figure(9.0, 3.8, DPI)
    panels = figure.subplots(1, 2)
    titles = {
        "objective_fitness": "OBJ_FIT: likeness to the true body",
        "model_fitness": "MOD_FIT: fit to the measured signal",
    }
    for axes, (field, title) in zip(panels, titles.items(), strict=True):
        for name in dict.fromkeys(MODELLED.values()):  # joint and joint-fins share a self-model
            curves = np.array([[r[field] for r in o["rounds"]] for o in outcomes[name]])
            number = np.arange(1, curves.shape[1] + 1)
            if len(curves) > 1:
                axes.plot(number, curves.T, color=COLOURS[name], lw=0.5, alpha=0.4)
            mean = curves.mean(axis=0)
            axes.plot(number, mean, "o-", ms=3, color=COLOURS[name], label=LABELS[name])
        axes.set_title(title)
        axes.set_xlabel("trials on the robot")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.grid(color="0.92")
    for level, line, label in (
        (chance_level, "--", "random body"),
        (mid_range_level, ":", "mid-range body"),
    ):
        height = level(target.to_array(), fish_problem().models)
        panels[0].axhline(height, color="0.4", ls=line, lw=1, label=label)
    panels[0].set_ylim(0.4, 1.01)
    panels[1].set_ylim(max(-0.5, panels[1].get_ylim()[0]), 1.02)
    panels[0].legend(loc="lower right", fontsize="small")
    return figure


def distances_figure(outcomes: Outcomes) -> Figure:
    """Draw every replicate's distance on the target, a line within each replicate."""
    figure = new_figure(9.0, 8.4, DPI)
    names = {
        "target_distance": "from the zero pose",
        "target_distance_random_poses": "mean over random fin poses",
    }
    count, places = len(outcomes["oracle"]), np.arange(len(TREATMENTS))
    for axes, (field, title) in zip(figure.subplots(2, 1, sharex=True), names.items(), strict=True):
        table = np.array([[distances(o)[field] for o in outcomes[t]] for t in TREATMENTS])
        if count > 1:
            axes.plot(places, table, color="0.8", lw=0.8, zorder=1)
        for place, name, values in zip(places, TREATMENTS, table, strict=True):
            colour = COLOURS[name]
            axes.scatter(np.full(count, place), values, s=18, color=colour, zorder=2)
            axes.plot([place - 0.25, place + 0.25], [values.mean()] * 2, color=colour, lw=2.5)
        axes.axhline(0, color="0.6", lw=0.8)
        axes.set_xticks(places, [LABELS[t].replace(" ", "\n") for t in TREATMENTS])
        axes.grid(axis="y", color="0.92")
        axes.set_title(title)
        axes.set_ylabel("distance (units of 5 cm)")
    figure.suptitle(f"on the damaged robot, {count} replicate{'s' if count > 1 else ''}")
    return figure


def write_film(path: Path, healthy: Morphology, target: Morphology, outcomes: Outcomes) -> None:
    """Write a GIF: healthy, damaged with the old gait, damaged with the recovered gait."""
    scenes = [
        ("healthy", healthy, _first_swim(outcomes, "undamaged", "native")),
        ("damaged, old gait", target, _first_swim(outcomes, "undamaged", "target")),
        ("damaged, recovered", target, _first_swim(outcomes, RECOVERED, "target")),
    ]
    columns = []
    for title, body, swim in scenes:
        stride = max(1, round(FILM_SPEED / FILM_FPS / (swim.time[1] - swim.time[0])))
        motion = (swim.position, swim.quaternion, swim.fin_angles)
        place, turn, fins = (samples[::stride] for samples in motion)
        frames = render_motion(body, place, turn, fins, *FILM_PIXELS, Camera(distance=13.0))
        columns.append(
            [
                caption(frame, f"{title}: {y * CM_PER_UNIT:+.0f} cm")
                for frame, y in zip(frames, place[:, 1], strict=True)
            ]
        )
    write_gif([np.concatenate(row, axis=1) for row in zip(*columns, strict=True)], path, FILM_FPS)


def caption(frame: np.ndarray, text: str) -> np.ndarray:
    """Write a line of text into a frame."""
    image, font = Image.fromarray(frame), ImageFont.load_default(size=16)
    ImageDraw.Draw(image).text((8, 6), text, fill=(20, 20, 20), font=font)
    return np.asarray(image)
