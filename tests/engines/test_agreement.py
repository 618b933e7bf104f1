"""PyBullet and the compiled engine are one robot, and float32 stays near float64."""

from __future__ import annotations

import itertools
import subprocess
import sys

import numpy as np
import pytest

import aquafish_gym
from aquafish_gym.engines.api import check_engine, resolve_engine
from aquafish_gym.plans import AQUAFISH
from instruments.verification.agreement import (
    WHAT,
    quantiles,
    single_precision,
)
from instruments.verification.trials import random_trials

Trial = tuple[np.ndarray, np.ndarray, np.ndarray]


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
    bodies[0], bodies[1] = 0.0, AQUAFISH.maxima
    for i in range(len(AQUAFISH.dimensions)):
        bodies[2 + i, i] = 0.0
        bodies[11 + i, i] = AQUAFISH.maxima[i]
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
@pytest.mark.parametrize("reactive", [False, True])
def test_lanes_equal_pybullet(reactive: bool) -> None:
    """In fifty cases, and in all that differs from robot to robot, with any substeps."""
    cases = fifty_cases()
    assert largest_gap(cases, steps=512, reactive=reactive) < 1e-9
    for substeps in (1, 4):
        some: Trial = tuple(part[:24] for part in cases)  # type: ignore[assignment]
        options = {**NUISANCES, "substeps": substeps, "reactive": reactive}
        assert largest_gap(some, 96, **options) < 1e-9


@pytest.mark.pybullet
def test_lanes_equal_pybullet_for_twenty_seconds() -> None:
    bodies, commands, angles = fifty_cases()
    trials = bodies[20:26], commands[20:26], angles[20:26]
    assert largest_gap(trials, steps=2000) < 1e-9


def test_float32_stays_near_float64_at_the_median() -> None:
    """Rounding of 1e-7 a step may add up over the trial, no more."""
    bounds = {1.28: 1e-5, 2.56: 2e-5, 5.12: 5e-5, 20.0: 5e-4}
    rows = quantiles(list(single_precision(robots=250)))
    medians = {(row["what"], row["seconds"]): row["median"] for row in rows}
    for what, seconds in itertools.product(WHAT, bounds):
        assert 0 < medians[what, seconds] < bounds[seconds], (what, seconds)  # type: ignore[operator]


@pytest.mark.pybullet
def test_the_engine_auto_is_pybullet_where_it_is() -> None:
    assert resolve_engine("engine", "auto") == check_engine("auto") == "pybullet"


def test_the_engine_auto_is_the_compiled_one_without_pybullet() -> None:
    code = (
        "import sys; sys.modules['pybullet'] = None\n"
        "import gymnasium as gym, aquafish_gym\n"
        "from aquafish_gym.engines.api import check_engine, resolve_engine\n"
        "env = gym.make('AquaFish-v0')\n"
        "env.reset(seed=1), env.step(env.action_space.sample())\n"
        "print(check_engine('auto'), resolve_engine('target_engine', 'auto'))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "numba numba\n"
