"""How speed depends on the tail's beat: known answers, oracles, and the study beside real fish."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from instruments.verification.momentum import Momentum
from instruments.verification.paper_robot import SWEEP
from instruments.verification.propulsion import straight_swims
from instruments.verification.real_fish import NAMED, exponent
from instruments.verification.tail_swims import (
    beat_tails,
    steady_swims,
    turns_per_beat,
)
from instruments.verification.trials import Trials
from instruments.verification.water_momentum import ReactiveMomentum

THIN = NAMED["thin tail alone"]
STILL = np.zeros((1, 3))


def test_the_exponent_of_a_power_law_is_exact() -> None:
    x = np.array([1.0, 2.0, 3.0, 5.0])
    assert_allclose(exponent(x, 7.0 * x**1.7), (1.7, 1.7, 1.7), atol=1e-12)


def test_the_interval_of_an_exponent_holds_the_truth_in_95_of_100_samples() -> None:
    rng = np.random.default_rng(0)
    x = np.array([15.0, 20.0, 20.0, 25.0, 30.0])
    fits = [exponent(x, x**1.1 * np.exp(rng.normal(0, 0.1, 5))) for _ in range(2000)]
    held = np.mean([fit.low < 1.1 < fit.high for fit in fits])
    assert held == pytest.approx(0.95, abs=0.015)


@pytest.mark.parametrize(("amplitude", "bias"), [(30, 0), (20, 0), (15, 10), (15, 15)])
def test_commands_give_the_tail_its_angle(amplitude: int, bias: int) -> None:
    a, b, f = math.radians(amplitude), math.radians(bias), 0.5
    log = beat_tails(THIN[None], f, False, 2, a, b, substeps=1)
    assert log.fin_angles is not None
    t = 0.01 * np.arange(1, log.fin_angles.shape[1] + 1)
    angle = SWEEP * np.sin(log.fin_angles[0, :, 2])
    assert_allclose(angle, b + a * np.sin(2 * math.pi * f * t), atol=1e-9)
    assert not log.fin_angles[..., :2].any()


class _Prescribed:
    """Mix in a tail whose angle is 5 + 20 sin(2 pi t) degrees."""

    def phases(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        turn = 2 * math.pi * t
        angle = math.radians(5 + 20 * math.sin(turn))
        rate = math.radians(20) * 2 * math.pi * math.cos(turn)
        phase = math.asin(angle / SWEEP)
        speed = rate / (SWEEP * math.cos(phase))
        return np.array([0.0, 0.0, phase]), np.array([0.0, 0.0, speed])


class _Drag(_Prescribed, Momentum):
    pass


class _Reactive(_Prescribed, ReactiveMomentum):
    pass


@pytest.mark.parametrize("reactive", [False, True], ids=["drag", "reactive"])
def test_swims_at_any_amplitude_and_bias_equal_the_momentum_form(reactive: bool) -> None:
    model = (_Reactive if reactive else _Drag).of(Trials(THIN[None], STILL, STILL), 0)
    truth = model.run(model.at_rest(), 0.01, 200)[:3]
    errors = []
    for substeps in (8, 16):
        log = beat_tails(
            THIN[None], 1.0, reactive, 2, math.radians(20), math.radians(5), substeps
        )  # fmt: skip
        assert log.position is not None
        errors.append(np.linalg.norm(log.position[0, -1] - truth))
    assert np.linalg.norm(truth) > 0.01
    assert errors[1] < 0.05 * np.linalg.norm(truth)
    assert errors[1] < 0.65 * errors[0]


@pytest.mark.parametrize("reactive", [False, True], ids=["drag", "reactive"])
def test_the_steady_speed_is_that_of_a_long_swim_from_rest(reactive: bool) -> None:
    bodies, beats = np.array([THIN, NAMED["its tail alone"]]), (60 if reactive else 250)
    amplitude = math.radians(20 if reactive else 30)
    log = beat_tails(bodies, 1.0, reactive, beats, amplitude, substeps=9)
    first, end = 100 * (beats - 4), 100 * beats
    speed, strouhal = straight_swims(bodies, log, 1.0, first, end)
    steady, number, unsettled = steady_swims(bodies, 1.0, reactive, amplitude, substeps=9)
    assert_allclose(steady, speed, rtol=1e-3)
    assert_allclose(number, strouhal, rtol=1e-3)
    assert unsettled.max() < 1e-6


def test_a_tail_that_leans_to_the_other_side_turns_the_fish_as_far_the_other_way() -> None:
    bias, amplitude = math.radians(10), math.radians(15)
    left, right = (turns_per_beat(THIN[None], True, b, amplitude) for b in (bias, -bias))
    assert left > 0.01
    # The half beat at which the swim begins is not mirrored.
    assert_allclose(left, -right, rtol=0.02)
