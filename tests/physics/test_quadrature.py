"""The drag law's few points against the whole surface, and the reference against itself."""

from __future__ import annotations

import numpy as np
import pytest

from aquafish_gym.physics.hydrodynamics import DENSITY, NORMAL_DRAG, SKIN_FRICTION
from aquafish_gym.physics.robot import hull_numbers
from aquafish_gym.plans import BodyPlan
from instruments.verification.harness import drag
from instruments.verification.momentum import Momentum
from instruments.verification.quadrature import (
    body_by_law,
    body_reference,
    fin_as_box,
    fin_by_rule,
    fin_reference,
    fine_strips,
    gauss_rule,
    midpoint_rule,
    motions_met,
    random_motion,
    relative_errors,
)
from instruments.verification.surface import Surface
from instruments.verification.trials import random_trials
from tests.plans import COMPILED_PLANS, EACH_PLAN

SIZES = {
    "any fin": lambda rng: rng.uniform(0, [1, 2, 0.5], (200, 3)).T,
    "nominal flipper": lambda _: np.tile([[0.4], [1.6], [0.1]], (1, 200)),
    "nominal tail": lambda _: np.tile([[0.6], [1.4], [0.4]], (1, 200)),
}


@pytest.mark.parametrize("fin", SIZES)
def test_the_laws_points_are_within_one_percent_in_wild_motion(fin: str) -> None:
    rng = np.random.default_rng(0)
    size, motion = SIZES[fin](rng), random_motion(rng, 200)
    force, torque = relative_errors(drag("numba", size, motion), fin_reference(size, motion, 24))
    assert 0 < force < 0.01
    assert 0 < torque < 0.01


@pytest.mark.parametrize("plan", COMPILED_PLANS)
def test_the_laws_points_are_within_two_percent_as_met_while_swimming(plan: BodyPlan) -> None:
    met = motions_met(random_trials(60, plan=plan))
    pairs = [(drag("numba", *fin), fin_reference(*fin, 24)) for fin in met.fins]
    pairs.append((body_by_law(met.bodies, plan), body_reference(met.bodies, 24, plan)))
    for found, truth in pairs:
        assert max(relative_errors(found, truth)) < 0.02


def test_the_reference_has_converged() -> None:
    rng = np.random.default_rng(1)
    size, motion = SIZES["any fin"](rng), random_motion(rng, 200)
    assert max(relative_errors(fin_reference(size, motion, 16), fin_reference(size, motion))) < 1e-5
    assert max(relative_errors(body_reference(motion, 16), body_reference(motion))) < 1e-4


def test_more_points_come_nearer() -> None:
    rng = np.random.default_rng(2)
    size, motion = SIZES["any fin"](rng), random_motion(rng, 200)
    truth = fin_reference(size, motion, 24)
    for rule in (midpoint_rule, gauss_rule):
        errors = [
            max(relative_errors(fin_by_rule(size, motion, rule(n), rule(n)), truth))
            for n in (1, 2, 4)
        ]
        assert errors[0] > 2 * errors[1] > 2 * errors[2]


def test_a_plate_in_straight_flow_feels_the_law_itself() -> None:
    """Along its normal C_N, along its sides friction on both faces."""
    size, speed = np.array([[0.5], [1.2], [0.0]]), 1.7
    area = 0.5 * 1.2
    for axis, coefficient in ((2, NORMAL_DRAG), (0, 2 * SKIN_FRICTION), (1, 2 * SKIN_FRICTION)):
        motion = np.zeros((6, 1))
        motion[axis] = speed
        force = fin_reference(size, motion, 4)[axis, 0]
        np.testing.assert_allclose(force, -0.5 * DENSITY * coefficient * area * speed**2)


def test_a_box_in_straight_flow_is_its_plates() -> None:
    """Without rotation one face of two leads, and it matters not where along the normal."""
    size = SIZES["any fin"](np.random.default_rng(3))
    motion = np.zeros((6, 200))
    motion[:3] = np.random.default_rng(4).normal(size=(3, 200))
    found, plates = fin_as_box(size, motion, 4), fin_reference(size, motion, 4)
    np.testing.assert_allclose(found[:3], plates[:3], rtol=1e-12)


@pytest.mark.parametrize("plan", EACH_PLAN)
def test_the_stations_are_those_of_gauss(plan: BodyPlan) -> None:
    """Five are exact for polynomials up to degree 9, and there is one such rule."""
    y, areas = fine_strips(plan.hull)
    (middle, at_middle), *fore = hull_numbers(plan.hull).stations
    assert middle == 0.0
    for degree in (0, 2, 4, 6, 8):  # the odd ones vanish
        found = at_middle * middle**degree + sum(2 * width * at**degree for at, width in fore)
        assert found == pytest.approx(areas @ y**degree, rel=1e-7)


@pytest.mark.parametrize("number", range(4))
@pytest.mark.parametrize("plan", COMPILED_PLANS)
def test_the_wrench_is_that_of_the_whole_surface(plan: BodyPlan, number: int) -> None:
    """Stated anew in body axes, point by point: frames, levers and signs are the same."""
    model = Momentum.of(random_trials(4, 5, plan), number)
    surface = Surface(model.robot, plan=plan)
    rng = np.random.default_rng(number)
    few, whole = [], []
    for time in np.linspace(0, 3, 40):
        q = rng.normal(size=4)
        motion = time, q / np.linalg.norm(q), rng.normal(size=3), rng.normal(size=3)
        model.surface = None
        few.append(np.concatenate(model.water(*motion)))
        model.surface = surface.wrench
        whole.append(np.concatenate(model.water(*motion)))
    assert max(relative_errors(np.array(few).T, np.array(whole).T)) < 0.02
