"""How the scheme's error falls with its step: against the momentum form's RK4.

The engines' step is explicit and of first order, so half the step should halve the error.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.physics.layout import layout
from instruments.verification.harness import POSITION, QUATERNION, SPIN, march
from instruments.verification.momentum import Momentum
from instruments.verification.surface import Surface
from instruments.verification.trials import Trials

Array = NDArray[np.float64]

STEPS = (0.02, 0.01, 0.005, 0.0025, 0.00125)
INTERVAL = 0.16  # s between the samples that are compared
REFERENCE_STEP = 0.01
WHAT = {"position": "units", "attitude": "rad", "gyro": "rad/s"}


def reference_path(
    trials: Trials, robot: int, samples: int, h: float = REFERENCE_STEP, whole_surface: bool = False
) -> Array:
    """Return position, quaternion and spin (samples, 10) of one robot by RK4.

    The water is the law's, by its few points, or integrated over the whole surface.
    """
    model = Momentum.of(trials, robot)
    if whole_surface:
        model.surface = Surface(model.robot, plan=trials.plan).wrench
    y, path = model.at_rest(), []
    for i in range(samples):
        y = model.run(y, h, round(INTERVAL / h), i * INTERVAL)
        _, spin = model.velocities((i + 1) * INTERVAL, y)
        path.append(np.concatenate([y[:7], spin]))
    return np.array(path)


def scheme_paths(trials: Trials, samples: int, h: float, backend: str = "float64") -> Array:
    """Return position, quaternion and spin (B, samples, 10) in the engines' scheme."""
    states, paths = layout(trials.plan).start(trials.fin_angles), []
    for _ in range(samples):
        states = march(
            backend, trials.morphologies, states, trials.commands, h, round(INTERVAL / h),
            plan=trials.plan,
        )  # fmt: skip
        paths.append(np.concatenate([states[POSITION], states[QUATERNION], states[SPIN]]))
    return np.array(paths).transpose(2, 0, 1)


def attitude_gap(one: Array, other: Array) -> Array:
    """Return the angle (rad) between attitudes given by unit quaternions (..., 4)."""
    same = np.where((one * other).sum(axis=-1, keepdims=True) < 0, -1.0, 1.0)
    chord = np.linalg.norm(one - same * other, axis=-1)
    angle: Array = 4 * np.arcsin(np.minimum(chord / 2, 1.0))
    return angle


def path_gaps(paths: Array, truths: Array) -> dict[str, Array]:
    """Return the largest gap over the samples, (B,), of each of ``WHAT``."""
    gaps = {
        "position": np.linalg.norm(paths[..., :3] - truths[..., :3], axis=-1),
        "attitude": attitude_gap(paths[..., 3:7], truths[..., 3:7]),
        "gyro": np.linalg.norm(paths[..., 7:] - truths[..., 7:], axis=-1),
    }
    return {name: gap.max(axis=1) for name, gap in gaps.items()}


def references(trials: Trials, samples: int) -> Iterator[Array]:
    """Yield each robot's reference path; this is what takes the time."""
    for robot in range(len(trials.commands)):
        yield reference_path(trials, robot, samples)


def study(
    trials: Trials, truths: Array, steps: tuple[float, ...] = STEPS
) -> list[dict[str, object]]:
    """Return the scheme's error at each step, and the orders that are seen.

    Parameters
    ----------
    trials
        B of them.
    truths
        (B, samples, 10) from :func:`references`.
    steps
        Each half of the one before.

    Returns
    -------
    list of dict
        For each of ``WHAT`` and each step: median and maximum over the robots that stay finite,
        how many do not, and log2 of the median over that at half the step (None at the last).
    """
    samples = truths.shape[1]
    gaps = [path_gaps(scheme_paths(trials, samples, h), truths) for h in steps]
    records: list[dict[str, object]] = []
    for what, unit in WHAT.items():
        finite = [gap[what][np.isfinite(gap[what])] for gap in gaps]
        medians = [float(np.median(gap)) for gap in finite]
        for i, h in enumerate(steps):
            order = float(np.log2(medians[i] / medians[i + 1])) if i + 1 < len(steps) else None
            records.append(
                {
                    "what": what,
                    "unit": unit,
                    "step": h,
                    "median": medians[i],
                    "maximum": float(finite[i].max()),
                    "order": order,
                    "diverged": len(trials.commands) - len(finite[i]),
                }
            )
    return records


def reference_error(trials: Trials, truths: Array, robots: int = 3) -> dict[str, float]:
    """Return how far the first robots' references move when their step is halved."""
    samples = truths.shape[1]
    finer = np.array(
        [reference_path(trials, r, samples, REFERENCE_STEP / 2) for r in range(robots)]
    )
    return {what: float(gap.max()) for what, gap in path_gaps(truths[:robots], finer).items()}


def surface_error(trials: Trials, truths: Array, robots: int) -> Iterator[dict[str, float]]:
    """Yield how far the law's few points lead each of the first robots off its path.

    Both paths are RK4's, so that nothing but the quadrature differs.
    """
    for robot in range(robots):
        whole = reference_path(trials, robot, truths.shape[1], whole_surface=True)
        gaps = path_gaps(truths[robot : robot + 1], whole[None])
        yield {what: float(gap[0]) for what, gap in gaps.items()}


def path_length(truths: Array) -> float:
    """Return the median length of the paths, units, as their samples show it."""
    from_start = np.concatenate([np.zeros_like(truths[:, :1, :3]), truths[..., :3]], axis=1)
    lengths = np.linalg.norm(np.diff(from_start, axis=1), axis=-1).sum(axis=1)
    return float(np.median(lengths))
