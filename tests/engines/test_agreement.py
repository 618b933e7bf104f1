"""PyBullet and the compiled engine are one robot, and float32 stays near float64."""

from __future__ import annotations

import numpy as np
import pytest

import aquafish_gym
from aquafish_gym.morphology import DIMENSIONS, MAXIMA
from instruments.verification.agreement import (
    QUANTILES,
    WHAT,
    quantiles,
    single_precision,
)
from instruments.verification.trials import random_trials

Trial = tuple[np.ndarray, np.ndarray, np.ndarray]

STILL = (0.0, 0.0, 0.0)

_rng = np.random.default_rng(9)
NUISANCES: dict[str, np.ndarray] = {
    "current": _rng.uniform(-0.5, 0.5, (24, 3)),
    "drag": _rng.uniform(0.0, 3.0, (24, 2)),
    "servo_gain": _rng.uniform(-2.0, 2.0, (24, 3)),
    "lag": _rng.uniform(0.0, 0.5, 24),
}


def fifty_cases() -> Trial:
    """Return random trials, among them fins of no size, of full size, and next to nothing."""
    trials = random_trials(50, seed=0)
    bodies = trials.morphologies
    bodies[0], bodies[1] = 0.0, MAXIMA
    for i in range(len(DIMENSIONS)):
        bodies[2 + i, i] = 0.0
        bodies[11 + i, i] = MAXIMA[i]
    bodies[20, :3] = 0.0
    bodies[21] = 1e-9
    trials.commands[22] = 0.0
    trials.commands[23] = 0.5, -0.5, 1.0
    return bodies, trials.commands, trials.fin_angles


def largest_gap(trials: Trial, steps: int, **settings: object) -> float:
    """Return the largest difference of the two engines in all that they log."""
    ours, bullets = (
        aquafish_gym.simulate(
            *trials, steps=steps, engine=engine, dtype="float64", record="pose", **settings
        )  # type: ignore[arg-type]
        for engine in ("numba", "pybullet")
    )
    assert not ours.diverged.any()
    gaps = [abs(getattr(ours, name) - getattr(bullets, name)).max() for name in WHAT]
    # A quaternion and its negative are one attitude.
    same = np.sign((ours.quaternion * bullets.quaternion).sum(axis=2, keepdims=True))
    gaps.append(abs(ours.quaternion - same * bullets.quaternion).max())
    gaps.append(abs(np.exp(1j * ours.fin_angles) - np.exp(1j * bullets.fin_angles)).max())
    return float(max(gaps))


@pytest.mark.pybullet
def test_lanes_equal_pybullet_in_fifty_cases() -> None:
    assert largest_gap(fifty_cases(), steps=512) < 1e-9


@pytest.mark.pybullet
@pytest.mark.parametrize(
    ("substeps", "current", "cases", "steps"),
    [
        (1, (0.3, -0.2, 0.1), slice(0, 50), 128),
        (4, STILL, slice(0, 24), 128),
        (8, (-1.0, 0.5, 0.25), slice(0, 24), 64),
    ],
    ids=["current", "4 substeps", "8 substeps in a current"],
)
def test_lanes_equal_pybullet_in_currents_and_substeps(
    substeps: int, current: tuple[float, float, float], cases: slice, steps: int
) -> None:
    bodies, commands, angles = fifty_cases()
    trials = bodies[cases], commands[cases], angles[cases]
    assert largest_gap(trials, steps, substeps=substeps, current=current) < 1e-9


@pytest.mark.pybullet
@pytest.mark.parametrize("reactive", [False, True])
@pytest.mark.parametrize("names", [*NUISANCES, "all"])
def test_lanes_equal_pybullet_in_what_differs_from_robot_to_robot(
    names: str, reactive: bool
) -> None:
    trials = tuple(part[:24] for part in fifty_cases())
    chosen = {n: value for n, value in NUISANCES.items() if names in (n, "all")}
    substeps = 2 if names == "all" else 1
    assert largest_gap(trials, 96, **chosen, reactive=reactive, substeps=substeps) < 1e-9  # type: ignore[arg-type]


@pytest.mark.pybullet
def test_lanes_equal_pybullet_for_twenty_seconds() -> None:
    bodies, commands, angles = fifty_cases()
    trials = bodies[20:26], commands[20:26], angles[20:26]
    assert largest_gap(trials, steps=2000) < 1e-9


# --- single precision -----------------------------------------------------------------------


@pytest.fixture(scope="module")
def growth() -> dict[tuple[str, float], dict[str, float]]:
    """Return the quantiles of float32's error over 250 robots, by what and duration."""
    parts = list(single_precision(robots=250))
    return {
        (str(r["what"]), float(r["seconds"])): {q: float(r[q]) for q in QUANTILES}  # type: ignore[arg-type]
        for r in quantiles(parts)
    }


# Rounding of 1e-7 a step may add up over the trial, no more.
BOUNDS = {1.28: 1e-5, 2.56: 2e-5, 5.12: 5e-5, 20.0: 5e-4}


@pytest.mark.parametrize("seconds", BOUNDS)
@pytest.mark.parametrize("what", WHAT)
def test_float32_stays_near_float64_at_the_median(growth: dict, what: str, seconds: float) -> None:
    assert 0 < growth[what, seconds]["median"] < BOUNDS[seconds]
