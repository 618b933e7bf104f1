"""PyBullet and the compiled engine are one robot, and float32 stays near float64."""

from __future__ import annotations

import itertools
import subprocess
import sys

import numpy as np
import pytest

import aquafish_gym
from aquafish_gym.engines.api import check_engine, resolve_engine
from aquafish_gym.plans import AQUAFISH, BodyPlan
from instruments.verification.agreement import (
    WHAT,
    quantiles,
    single_precision,
)
from instruments.verification.trials import Trials, random_trials
from tests.plans import COMPILED_PLANS


def nuisances(plan: BodyPlan) -> dict[str, np.ndarray]:
    """Return what else may differ from robot to robot, of 24."""
    rng = np.random.default_rng(9)
    return {
        "current": rng.uniform(-0.5, 0.5, (24, 3)),
        "drag": rng.uniform(0.0, 3.0, (24, 2)),
        "servo_gain": rng.uniform(-2.0, 2.0, (24, len(plan.fins))),
        "lag": rng.uniform(0.0, 0.5, 24),
    }


def fifty_cases(plan: BodyPlan = AQUAFISH) -> Trials:
    """Return random trials, among them fins of no size, of full size, and next to nothing."""
    trials = random_trials(50, 0, plan)
    bodies = trials.morphologies
    sizes = len(plan.dimensions)
    bodies[0], bodies[1], bodies[2] = 0.0, plan.maxima, 1e-9
    bodies[3, :3] = 0.0
    trials.commands[4] = 0.0
    trials.commands[5] = np.where(
        np.arange(len(plan.fins)) % 2, plan.command_low, plan.command_high
    )
    for i in range(sizes):
        bodies[6 + i, i] = 0.0
        bodies[6 + sizes + i, i] = plan.maxima[i]
    return trials


def largest_gap(trials: Trials, steps: int, **settings: object) -> float:
    """Return the largest difference of the two engines in all that they log."""
    *numbers, plan = trials
    ours, bullets = (
        aquafish_gym.simulate(
            *numbers,
            steps=steps,
            engine=engine,
            dtype="float64",
            record="pose",
            plan=plan,
            **settings,
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
@pytest.mark.parametrize("plan", COMPILED_PLANS)
@pytest.mark.parametrize("reactive", [False, True])
def test_lanes_equal_pybullet(reactive: bool, plan: BodyPlan) -> None:
    """In fifty cases, and in all that differs from robot to robot, with any substeps."""
    cases = fifty_cases(plan)
    assert largest_gap(cases, steps=512, reactive=reactive) < 1e-9
    for substeps in (1, 4):
        options = {**nuisances(plan), "substeps": substeps, "reactive": reactive}
        assert largest_gap(cases.rows(slice(24)), 96, **options) < 1e-9


@pytest.mark.pybullet
def test_lanes_equal_pybullet_for_twenty_seconds() -> None:
    assert largest_gap(fifty_cases().rows(slice(2, 8)), steps=2000) < 1e-9


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
