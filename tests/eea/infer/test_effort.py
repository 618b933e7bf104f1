"""How many simulations a search takes: few where descents agree, more where there are valleys."""

from __future__ import annotations

import numpy as np
import pytest

from eea import FitConfig, Hypothesis, Number, Robot, Trial

THRUST = np.random.default_rng(3).uniform(-1.0, 1.0, 20).repeat(10)
TRUE = {"gain": 1.3, "drag": 0.6}
SD = 0.02


def drive(values, thrust):
    """Return the speeds (B, T, 1) of vehicles that are driven by thrusts (B, T)."""
    speed = np.zeros(len(thrust))
    out = np.empty((*thrust.shape, 1))
    for step, push in enumerate(thrust.T):
        speed = speed + 0.05 * (values["gain"] * push - values["drag"] * speed)
        out[:, step, 0] = speed
    return out


def fitted(simulate, numbers, true, config=None, beside=0.0, **statement):
    """Return the answer to a noisy log, and how many trials were simulated for it."""
    count = 0

    def counted(values, inputs):
        nonlocal count
        count += len(inputs)
        return simulate(values, inputs)

    signal = simulate({name: np.array([value]) for name, value in true.items()}, THRUST[None])[0]
    signal = signal + np.random.default_rng(4).normal(0.0, SD, signal.shape) + beside
    robot = Robot(counted, numbers, {"speed": "m/s"}, **statement)
    found = robot.infer([Trial(signal, THRUST)], config=config)
    return found, count


VEHICLE = {"gain": Number(0.1, 3.0), "drag": Number(0.05, 2.0)}


def test_two_numbers_of_a_smooth_simulator_take_some_hundred_simulations():
    found, few = fitted(drive, VEHICLE, TRUE)
    assert few < 400
    assert found.good
    for name, (_, low, high) in found.table(0.99).items():
        assert low < TRUE[name] < high


def test_a_short_search_ends_where_a_long_one_does():
    found, few = fitted(drive, VEHICLE, TRUE)
    long, many = fitted(drive, VEHICLE, TRUE, FitConfig(bodies=400, descents=100))
    assert few < 0.5 * many
    for name, row in found.table().items():
        assert row == pytest.approx(long.table()[name], rel=1e-3)


def test_a_simulator_that_explains_nothing_is_searched_for_again_but_once():
    wave = 0.2 * np.sign(np.sin(0.3 * np.arange(len(THRUST))))[:, None]
    found, count = fitted(drive, VEHICLE, TRUE, beside=wave)
    assert not found.good
    assert 400 < count < 1600


def test_valleys_across_the_axes_are_all_found():
    def waves(values, thrust):
        time = 0.05 * np.arange(thrust.shape[1])
        across = np.cos(3.0 * (values["x"] - values["y"]))
        along = values["x"] + values["y"]
        return (along[:, None] * np.sin(time) + across[:, None] * np.cos(2.0 * time))[:, :, None]

    numbers = {"x": Number(0.0, 2.0), "y": Number(0.0, 3.0)}
    found, count = fitted(waves, numbers, {"x": 0.8, "y": 1.2})
    # x + y = 2 and cos(3 (x - y)) = cos(1.2): x - y = +-0.4 + 2 pi n / 3 within the ranges.
    apart = np.array([-0.4, 0.4, -0.4 + 2 * np.pi / 3, 0.4 - 2 * np.pi / 3])
    modes = found.branches[0].posterior.modes
    natural = found.branches[0].parameters.natural(np.array([mode.theta for mode in modes]))
    assert np.sort(natural[:, 0]) == pytest.approx(np.sort(1.0 + 0.5 * apart), abs=0.02)
    assert count < 4000


def test_a_fault_is_found_by_a_short_search():
    weak = Hypothesis("it is weak", moves={"gain": Number(0.0, sd=0.5, high=0.0)}, odds=0.1)
    numbers = {"gain": Number(0.1, 3.0, healthy=2.0), "drag": Number(0.05, 2.0)}
    found, count = fitted(drive, numbers, TRUE, hypotheses=[weak])
    assert found.good
    assert found.branches[0].hypothesis.name == "it is weak"
    _, low, high = found.broken("gain")
    assert low < TRUE["gain"] < high
    assert count < 3000


def swing(values, torque):
    """Return the rates (B, T, 1) of pendulums at rest at first, driven by torques (B, T)."""
    angle = values["angle"].copy()
    rate = np.zeros(len(torque))
    out = np.empty((*torque.shape, 1))
    for step, push in enumerate(torque.T):
        rate = rate + 0.02 * (push - 9.81 / values["length"] * np.sin(angle))
        angle = angle + 0.02 * rate
        out[:, step, 0] = rate
    return out


PENDULUM = {"length": Number(0.2, 2.0), "angle": Number.angle()}


def test_an_unknown_angle_is_found_by_a_short_search():
    true = {"length": 0.63, "angle": 2.0}
    found, count = fitted(swing, PENDULUM, true)
    assert count < 4000  # 16,000 if a scan of all poses came first
    assert found.good
    for name, key in (("length", "length"), ("angle", "angle@1")):
        _, low, high = found.table(0.99)[key]
        assert low < true[name] < high


def test_a_short_search_leaves_no_mirrored_angle_out():
    def squared(values, torque):
        return swing(values, 0.0 * torque) ** 2

    found, _ = fitted(squared, PENDULUM, {"length": 0.63, "angle": 2.0})
    angles = [mode.theta[1] for mode in found.branches[0].posterior.modes]
    assert np.sort(angles) == pytest.approx([-2.0, 2.0], abs=0.02)


def test_a_budget_may_end_anywhere():
    """In a search, or where its answer is weighed."""
    _, whole = fitted(drive, VEHICLE, TRUE)
    for budget in range(20, whole + 10, 3):
        found, count = fitted(drive, VEHICLE, TRUE, FitConfig(evaluations=budget))
        assert count <= budget + 40
        assert found.good == (not found.ended)
