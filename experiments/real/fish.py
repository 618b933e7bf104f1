"""A real fish: how well its sizes, found from some commands, predict its swims at other commands.

The robot is the law of this project with the numbers of this fish unknown. From a start on, the
swim is predicted from what was observed in the 1.5 s before: the pose, its mean rates, and how the
heading swings with the tail's beat. The swing tells the beat's rate and phase; the tail itself is
hidden, and so by how much it leads the swing is one of the numbers sought.

Six folds of commands are held out. What a fold is judged on is used for nothing else: numbers,
beat and spread of the errors come from the commands of the other five.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from aquafish_gym.physics.arithmetic import TAU
from aquafish_gym.runs.progress import track
from eea import Number, Robot, Trial
from eea.core.config import FitConfig
from experiments.real.beat import AHEAD, Case, Swing, cases_of, learn_swing, observe
from experiments.real.fish_rivals import RIVALS, rival_paths
from experiments.real.michigan import STRIDE, Command, Floats, Run, folds, read, straight_speeds
from experiments.real.planar_fish import FRAME, swim

COMPARED = 15  # frames between those that the fit compares
HORIZONS = {"2": 60, "5": 150}  # s -> frames
CONFIDENCE = 0.9
DRAWS = 16  # of the posterior, for a prediction
LAW = "our law"

RANGES = {  # of Swimmer's fields, in their units
    "tail_length": (0.03, 0.15),
    "tail_height": (0.02, 0.3),
    "tail_drag": (0.3, 6.0),
    "hinge": (0.03, 0.25),
    "hull_length": (0.05, 0.4),
    "hull_along": (0.0, 8.0),
    "hull_across": (0.0, 40.0),
    "sway_mass": (1.0, 6.0),
    "yaw_inertia": (0.0003, 0.01),
    "servo_gain": (0.3, 1.2),
    "trim": (-0.15, 0.15),
    "marker": (-0.08, 0.08),
}
LEAD = "lead"  # of the tail's phase over that of the heading's swing, rad
FIT = FitConfig(alternatives="never", bodies=48, poses=1, descents=6, polished=1, restarts=0)


def inputs_of(case: Case, swing: Swing) -> Floats:
    """Return what the simulator takes of a case: command, state and number of frames, (11,)."""
    return np.array([*case.run.tail, *observe(case.before, swing), len(case.after)])


def simulate(values: Mapping[str, Floats], inputs: Floats) -> Floats:
    """Return the predicted poses (B, T, 3) from the starts on; see :func:`inputs_of`."""
    start = inputs[:, 2:9].copy()
    start[:, 4] -= values["marker"] * inputs[:, 7]  # from the tracked point to the hull's centre
    start[:, 6] += values[LEAD]
    fish = {name: values[name] for name in RANGES}
    frames = inputs[:, 10].astype(np.intp)
    return swim(fish, inputs[:, :2], start, TAU * inputs[:, 9], frames, AHEAD + 1)


def fish_robot() -> Robot:
    """Return the fish: poses every half second from a start on."""
    return Robot(
        simulate=lambda values, inputs: simulate(values, inputs)[:, COMPARED::COMPARED],
        numbers={name: Number(*ends) for name, ends in {**RANGES, LEAD: (0.0, TAU)}.items()},
        channels={"x": "m", "y": "m", "heading": "rad"},
        hypotheses=(),
        stride=1,
    )


def infer(
    cases: Sequence[Case], swing: Swing, seed: int = 0, config: FitConfig = FIT
) -> dict[str, Floats]:
    """Return draws (n,) of the fish's numbers, by name, given some cases."""
    robot = fish_robot()
    trials = [Trial(case.after[COMPARED::COMPARED], inputs_of(case, swing)) for case in cases]
    found = robot.infer(trials, seed, config=config)
    drawn = found.sample(DRAWS, np.random.default_rng(seed))
    return dict(zip(robot.sought, drawn.T, strict=True))


class Prediction(NamedTuple):
    """Predicted poses of cases at 5 Hz, from 0.2 s after the start on."""

    pose: Floats  #: (B, T, 3), the mean of draws.
    variance: Floats  #: (B, T, 3), between draws; of places along and across the first heading.


def predict(draws: Mapping[str, Floats], cases: Sequence[Case], swing: Swing) -> Prediction:
    """Return what draws of the numbers predict of cases."""
    inputs = np.array([inputs_of(case, swing)[:-1] for case in cases])
    inputs = np.column_stack([inputs, np.full(len(inputs), AHEAD + 1)])
    count = len(next(iter(draws.values())))
    values = {name: np.repeat(drawn, len(cases)) for name, drawn in draws.items()}
    poses = simulate(values, np.tile(inputs, (count, 1)))[:, STRIDE::STRIDE]
    poses = poses.reshape(count, len(cases), -1, 3)
    mean = poses.mean(axis=0)
    return Prediction(mean, along_and_across(poses - mean, inputs[:, 4]).var(axis=0))


def along_and_across(moved: Floats, heading: Floats) -> Floats:
    """Turn differences of poses (..., B, T, 3) into the axes of headings (B,)."""
    cosine = np.cos(heading)[:, None]
    sine = np.sin(heading)[:, None]
    x, y, turned = np.moveaxis(moved, -1, 0)
    return np.stack([cosine * x + sine * y, cosine * y - sine * x, turned], axis=-1)


def errors(poses: Floats, cases: Sequence[Case]) -> Floats:
    """Return predicted less observed poses (B, T, 3) at 5 Hz, NaN where a run has ended.

    The first is 0.2 s after the start. Places are along and across the observed heading there.
    """
    seen = np.full(poses.shape, np.nan)
    for row, case in zip(seen, cases, strict=True):
        after = case.after[STRIDE::STRIDE]
        row[: len(after)] = after
    return along_and_across(poses - seen, np.array([case.after[0, 2] for case in cases]))


def half_widths(known: Prediction, known_cases: Sequence[Case], new: Prediction) -> Floats:
    """Return half the width of 90% intervals (B, T, 3) of a new prediction.

    The variance is that between draws and the mean square of the errors in known cases. It is
    scaled so that intervals of known cases hold (n + 1) / n times 90% of them.
    """
    left = errors(known.pose, known_cases)
    usual = np.nanmean(left**2, axis=0)
    score = np.abs(left) / np.sqrt(usual + known.variance)
    count = np.isfinite(score).sum(axis=0)
    share = np.minimum(CONFIDENCE * (1.0 + 1.0 / np.maximum(count, 1)), 1.0)
    factor = np.full(usual.shape, np.nan)
    for t, c in np.ndindex(*usual.shape):
        if count[t, c]:
            factor[t, c] = np.nanquantile(score[:, t, c], share[t, c])
    return np.asarray(factor * np.sqrt(usual + new.variance))


@dataclass(frozen=True, eq=False)
class HeldOut:
    """What is predicted of the cases of held-out commands, one after the other."""

    cases: list[Case]
    poses: dict[str, Floats]  #: (B, T, 3) at 5 Hz, by the predictor's name.
    widths: Floats  #: Half those of our 90% intervals, (B, T, 3), at 5 Hz.
    numbers: list[dict[str, float]]  #: The fish's, of each fold.


def hold_out(runs: Sequence[Run], seed: int = 0) -> HeldOut:
    """Predict the runs of each command from numbers learned from the other folds' commands."""
    cases: list[Case] = []
    poses: dict[str, list[Floats]] = {name: [] for name in (LAW, *RIVALS)}
    widths: list[Floats] = []
    numbers: list[dict[str, float]] = []
    split = folds(runs)
    for held in track(split, "folds", len(split)):
        known = [run for run in runs if run.command not in held]
        known_cases = cases_of(known)
        new = cases_of([run for run in runs if run.command in held])
        swing = learn_swing(known_cases)
        draws = infer(known_cases, swing, seed)
        before = predict(draws, known_cases, swing)
        ours = predict(draws, new, swing)
        at = [case.sample for case in new]
        rivals = rival_paths(known, [case.run for case in new], at, AHEAD // STRIDE)
        cases += new
        widths.append(half_widths(before, known_cases, ours))
        poses[LAW].append(ours.pose)
        for name, path in rivals.items():
            poses[name].append(path)
        numbers.append({name: float(drawn.mean()) for name, drawn in draws.items()})
    joined = {name: np.concatenate(parts) for name, parts in poses.items()}
    return HeldOut(cases, joined, np.concatenate(widths), numbers)


def fish_table(data: Path) -> dict[str, Any]:
    """Return how far predictions of held-out commands err: the root mean squares, and shares held.

    Raises
    ------
    InvalidArgumentError, DamagedFileError
        If ``data`` does not contain the runs.
    """
    held = hold_out(read(data))
    left = {name: errors(poses, held.cases) for name, poses in held.poses.items()}
    rows = {name: _root_mean_squares(apart) for name, apart in left.items()}
    inside = np.abs(left[LAW]) <= held.widths
    there = np.isfinite(left[LAW])
    at = {name: frames // STRIDE - 1 for name, frames in HORIZONS.items()}
    judged = list(at.values())
    return {
        **{what: {s: rows[LAW][what][i] for s, i in at.items()} for what in rows[LAW]},
        "held_90": float(inside[:, judged][there[:, judged]].mean()),
        "held_90_by": {
            s: [float(inside[there[:, i, c], i, c].mean()) for c in range(3)]
            for s, i in at.items()
        },
        "cases": {s: int(there[:, i, 0].sum()) for s, i in at.items()},
        "seconds": [STRIDE * FRAME * (i + 1) for i in range(AHEAD // STRIDE)],
        "by_second": rows,
        "numbers": {
            name: [one[name] for one in held.numbers] for name in (*RANGES, LEAD)
        },
        "swims": _swims(held),
        "straight_speeds": straight_speeds(data),
    }  # fmt: skip


def _root_mean_squares(apart: Floats) -> dict[str, list[float]]:
    """Return the root mean squares of errors (B, T, 3), of place and heading, by time."""
    place = np.sqrt(np.nanmean((apart[:, :, :2] ** 2).sum(axis=2), axis=0))
    heading = np.sqrt(np.nanmean(apart[:, :, 2] ** 2, axis=0))
    return {"position_cm": (100.0 * place).tolist(), "heading_rad": heading.tolist()}


def _swims(held: HeldOut) -> list[dict[str, Any]]:
    """Return seen and predicted paths, of the first start of a run of each command."""
    first: dict[Command, dict[str, Any]] = {}
    for i, case in enumerate(held.cases):
        seen = case.after[::STRIDE, :2]
        told = np.vstack([seen[:1], held.poses[LAW][i, : len(seen) - 1, :2]])
        swum = {"command": case.run.command, "seen": seen.tolist(), "predicted": told.tolist()}
        first.setdefault(case.run.command, swum)
    return [first[command] for command in sorted(first)]
