"""The oracles agree with each other, and the engines' scheme tends to them."""

from __future__ import annotations

import sys
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aquafish_gym.morphology import Morphology
from aquafish_gym.plans import BodyPlan
from aquafish_gym.utils.validation import EngineUnavailableError
from instruments.verification import mechanics
from instruments.verification.momentum import inertia_and_swing, robot_at
from instruments.verification.mujoco_model import load_mujoco, mujoco_model
from instruments.verification.mujoco_robot import DryRobot
from instruments.verification.rk4 import integrate, quaternion_rate, rotation_matrix
from instruments.verification.trials import random_trials
from tests.plans import COMPILED_PLANS, PLANS, plans

NOMINAL = Morphology.nominal()


@pytest.fixture(scope="module", params=COMPILED_PLANS)
def gaps(request: pytest.FixtureRequest) -> dict[str, np.ndarray]:
    """Return the gaps to MuJoCo, (robots, quantities), of each statement of the motion."""
    pytest.importorskip("mujoco")
    parts = list(mechanics.compare(robots=2, seed=1, plan=request.param))
    return {name: np.array([part[name] for part in parts]) for name in parts[0]}


def test_without_water_the_momentum_form_moves_as_mujocos_robot(gaps: dict) -> None:
    """Over 5 s, from a moving start: position, attitude, and both momenta."""
    assert gaps["momentum"].max() < 1e-7
    assert gaps["mujoco"].max() < 1e-7, "and MuJoCo's own momenta are kept"


def test_without_water_the_scheme_tends_to_mujocos_motion_with_order_one(gaps: dict) -> None:
    steps = [gaps[f"{h:g}"] for h in mechanics.STEPS]
    assert np.median(steps[0][:, 1]) > 1e-4, "at a step of 0.01 s the gap shows"
    for coarse, fine in pairwise(steps):
        orders = np.log2(coarse / fine)
        np.testing.assert_allclose(np.median(orders), 1.0, atol=0.1)


def test_without_water_the_scheme_tends_to_nothing_but_mujocos_motion(gaps: dict) -> None:
    """Extrapolated to no step, so that not even a small wrong term can hide in its error."""
    finest = gaps[f"{mechanics.STEPS[-1]:g}"]
    assert (gaps[mechanics.EXTRAPOLATED] < finest / 100).all()


@settings(deadline=None, max_examples=15)
@given(plan=st.sampled_from(PLANS) | plans())
def test_mujocos_inertia_matrix_is_the_momentum_forms(plan: BodyPlan) -> None:
    mujoco = pytest.importorskip("mujoco")
    bodies = random_trials(3, 2, plan).morphologies
    bodies[0], bodies[1] = 0.0, plan.maxima
    rng = np.random.default_rng(3)
    for body in bodies:
        model = mujoco_model(Morphology.from_array(body, plan))
        data = mujoco.MjData(model)
        angles = rng.uniform(-np.pi, np.pi, len(plan.fins))
        data.qpos[7:] = angles
        mujoco.mj_fwdPosition(model, data)
        rows = []
        for unit in np.eye(model.nv)[:6]:
            product = np.empty(model.nv)
            mujoco.mj_mulM(model, data, product, unit)
            rows.append(product[:6])
        inertia, _ = inertia_and_swing(plan, robot_at(plan, body), angles, 0 * angles)
        np.testing.assert_allclose(rows, inertia, atol=1e-11)


def test_without_mujoco_a_sentence_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    for use in (load_mujoco, mujoco_model, lambda: DryRobot(NOMINAL, np.zeros(3), np.zeros(3))):
        with pytest.raises(EngineUnavailableError, match=r'pip install "aquafish-gym\[mujoco\]"'):
            use()


def test_rk4_is_of_fourth_order() -> None:
    errors = [
        abs(
            integrate(lambda t, y: y * np.cos(t), np.ones(1), h, round(2 / h))[0]
            - np.exp(np.sin(2))
        )
        for h in (0.1, 0.05)
    ]
    np.testing.assert_allclose(np.log2(errors[0] / errors[1]), 4.0, atol=0.2)


def test_a_turning_quaternion_turns_its_axes_about_the_spin() -> None:
    """dR/dt = R [w], with w in the body's own axes."""
    rng = np.random.default_rng(4)
    q, w = rng.normal(size=4), rng.normal(size=3)
    q /= np.linalg.norm(q)
    skew = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
    dq, small = quaternion_rate(q, w), 1e-6
    rate = (rotation_matrix(q + small * dq) - rotation_matrix(q - small * dq)) / (2 * small)
    np.testing.assert_allclose(rate, rotation_matrix(q) @ skew, atol=1e-9)
    np.testing.assert_allclose(rotation_matrix(q) @ rotation_matrix(q).T, np.eye(3), atol=1e-14)
