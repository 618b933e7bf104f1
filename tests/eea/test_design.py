"""Optimal design where the answer is known in closed form."""

from __future__ import annotations

from dataclasses import replace
from statistics import NormalDist

import numpy as np
import pytest

from eea.core.bits import action_layout
from eea.core.checks import TargetError
from eea.core.design import (
    ANGLE_INFORMATION,
    CANDIDATES,
    MOST_CORNERS,
    Forecast,
    best_command,
    candidates,
    checked_utilities,
    corners,
    fast_command,
    gains,
    gait_gains,
    robustness,
)
from fake_fish import ACTIONS

ONE = np.ones((1, 1))


def linear(weights, information, count: int = 4) -> Forecast:
    """A robot that says each of its sizes times ``weights(command)``, noise 1; nothing hidden."""
    body = len(information)
    return Forecast(
        np.full((count, body), 0.5),
        body,
        np.asarray(information, dtype=float),
        np.zeros((count, 0)),
        np.zeros(0),
        lambda samples, _, commands: (samples * weights(commands[:, 0]))[:, None],
        sigma=1.0,
    )


def gait_of(*signs):
    """How two gaits swim: as far as a size is above or below a half."""
    return lambda bodies: np.array([sign * (bodies[:, 0] - 0.5) + 1.0 for sign in signs])


# A trial of command u says the first size with information A u and the second with B (1 - u).
A, B, PRIOR = 400.0, 100.0, 12.0


def shared_effort(u):
    return np.stack([np.sqrt(A * u), np.sqrt(B * (1.0 - u))], axis=1)


def test_a_and_d_optimal_commands_are_those_of_the_closed_form():
    forecast = linear(shared_effort, PRIOR * np.eye(2))
    commands = np.linspace(0.0, 1.0, 2001)[:, None]
    rng = np.random.default_rng(0)
    # d/du of log((PRIOR + A u) (PRIOR + B (1 - u))) = 0, and of 1 / (PRIOR + A u) + ...
    volume = (A * PRIOR + A * B - B * PRIOR) / (2.0 * A * B)
    root = np.sqrt(B / A)
    variance = (PRIOR + B - root * PRIOR) / (B + root * A)
    found = {
        strategy: best_command(forecast, commands, strategy, None, rng)
        for strategy in ("a-optimal", "d-optimal", "information")
    }
    assert found["d-optimal"][0] == pytest.approx(volume, abs=1e-3)
    assert found["a-optimal"][0] == pytest.approx(variance, abs=1e-3)
    assert variance < volume - 0.1
    # Without nuisances, and where all bodies are told as much, volume and information are one.
    assert found["information"][0] == found["d-optimal"][0]
    after = np.array([PRIOR + A * volume, PRIOR + B * (1.0 - volume)])
    assert found["d-optimal"][1] == pytest.approx(0.5 * np.log(after / PRIOR).sum(), rel=1e-6)
    after = np.array([PRIOR + A * variance, PRIOR + B * (1.0 - variance)])
    assert found["a-optimal"][1] == pytest.approx(1 / PRIOR - (1 / after).mean(), rel=1e-6)


def test_nuisances_count_as_information_only():
    # Command 0 says the size with information 30, command 1 the nuisance with 1000.
    forecast = replace(
        linear(lambda u: np.stack([30.0**0.5 * (1 - u), 1000.0**0.5 * u], axis=1), np.eye(2)),
        body=1,
    )
    commands, rng = np.array([[0.0], [1.0]]), np.random.default_rng(0)
    chosen = {
        strategy: best_command(forecast, commands, strategy, None, rng)[0][0]
        for strategy in ("a-optimal", "d-optimal", "information")
    }
    assert chosen == {"a-optimal": 0.0, "d-optimal": 0.0, "information": 1.0}


def test_a_nuisance_that_is_tied_to_the_body_is_worth_telling():
    # Of the sum of both nothing is in doubt but the share of each: the nuisance tells the body.
    tied = np.array([[1000.0, 990.0], [990.0, 1000.0]])
    forecast = replace(linear(lambda u: np.stack([0 * u, 10.0 * u], axis=1), tied), body=1)
    worth = gains(forecast, forecast.informations(np.array([[0.0], [1.0]])), "a-optimal")
    after = np.linalg.inv(tied + np.diag([0.0, 100.0]))[0, 0]
    assert worth == pytest.approx([0.0, np.linalg.inv(tied)[0, 0] - after], abs=1e-9)
    assert worth[1] > 0.01


def test_information_averages_over_bodies_what_d_optimality_averages_before():
    # Command 0 says all of one body in two and nothing of the other; command 1 some of each.
    def simulate(samples, _, commands):
        uneven = np.where(samples > 0.5, 10.0 * (samples - 0.5), 0.0)
        return np.where(commands > 0.0, 3.0**0.5 * samples, uneven)[:, None]

    forecast = replace(linear(None, np.eye(1), 2), simulate=simulate, samples=[[0.3], [0.8]])
    forecast = replace(forecast, samples=np.array(forecast.samples))
    told = forecast.informations(np.array([[0.0], [1.0]]))
    assert told[:, :, 0, 0] == pytest.approx(np.array([[0.0, 100.0], [3.0, 3.0]]), rel=1e-6)
    volume = gains(forecast, told, "d-optimal")
    assert volume == pytest.approx([-0.5 * np.log(0.5 + 0.5 / 101), 0.5 * np.log(4.0)], rel=1e-6)
    information = gains(forecast, told, "information")
    assert information == pytest.approx([0.25 * np.log(101), 0.5 * np.log(4.0)], rel=1e-6)
    assert volume.argmax() == 1
    assert information.argmax() == 0


@pytest.mark.parametrize("revealed", [False, True])
def test_the_new_trials_own_angle_is_marginalised_unless_it_will_be_told(revealed):
    # The size and the angle are felt as a sum, of noise sigma: what is left is the angle's spread.
    forecast = replace(
        linear(None, np.eye(1), 1),
        own=np.array([[2.0]]),
        own_information=np.array([np.inf if revealed else ANGLE_INFORMATION]),
        simulate=lambda samples, own, _: (samples + own)[:, None],
        sigma=0.1,
    )
    expected = 100.0 if revealed else 1.0 / (0.1**2 + 1.0 / ANGLE_INFORMATION)
    assert forecast.informations(ONE)[0, 0, 0, 0] == pytest.approx(expected, rel=1e-6)


def test_derivatives_stay_in_the_range_and_in_their_batch():
    sizes, batches = [], []

    def simulate(samples, own, _):
        sizes.append(samples)
        batches.append(len(samples))
        return (samples**2 + 0.0 * own)[:, None]

    forecast = replace(
        linear(None, np.eye(1), 3),
        samples=np.array([[0.0], [0.5], [1.0]]),
        own=np.zeros((3, 1)),
        own_information=np.ones(1),
        simulate=simulate,
    )
    told = forecast.informations(np.zeros((1000, 1)))
    assert min(size.min() for size in sizes) == 0.0
    assert max(size.max() for size in sizes) == 1.0
    assert len(batches) > 1
    assert sum(batches) == 1000 * 3 * 3
    assert told[-1, :, 0, 0] == pytest.approx([0.0, 1.0, 4.0], abs=0.01)


def test_a_robot_that_diverges_tells_nothing():
    def simulate(samples, _, commands):
        with np.errstate(divide="ignore"):
            return (samples / commands)[:, None]

    told = replace(linear(None, np.eye(1)), simulate=simulate).informations(
        np.array([[0.0], ONE[0]])
    )
    assert (told[0] == 0.0).all()
    assert told[1] == pytest.approx(1.0)


def two_bodies() -> Forecast:
    """Which of two bodies it is shows in the first size; command 1 tells much of the second."""
    forecast = linear(lambda u: np.stack([60.0 * (1 - u), 1000.0 * u], axis=1), 12.0 * np.eye(2))
    return replace(forecast, samples=np.tile([[0.3, 0.5], [0.7, 0.5]], (2, 1)))


def test_the_gait_wants_to_know_which_body_it_is_and_nothing_else():
    forecast, commands, rng = two_bodies(), np.array([[1.0], [0.0]]), np.random.default_rng(0)
    utilities = np.array([[2.0, 1.0, 2.0, 1.0], [1.0, 1.9, 1.0, 1.9]])
    for strategy in ("a-optimal", "d-optimal", "information"):
        assert best_command(forecast, commands, strategy, None, rng)[0] == 1.0
    command, value = best_command(forecast, commands, "gait", utilities, rng)
    assert command == 0.0
    assert value == pytest.approx((2.0 + 1.9) / 2 - (2.0 + 1.0) / 2)  # as if told the body
    told = forecast.informations(commands)
    assert gait_gains(forecast, told, utilities, rng) == pytest.approx([0.0, 0.45])


def test_what_a_noisy_trial_is_worth_to_the_gait_is_the_textbooks():
    # One size, normal; gaits swim as far as it is above and below its mean: E|posterior mean|.
    sd, told, count = 0.1, 60.0, 400
    normal = NormalDist(0.5, sd)
    samples = np.array([[normal.inv_cdf((i + 0.5) / count)] for i in range(count)])
    robot = linear(lambda u: told**0.5 * u[:, None], [[sd**-2]])
    forecast = replace(robot, samples=np.random.default_rng(0).permutation(samples))
    utilities = gait_of(1.0, -1.0)(forecast.samples)
    told_of = forecast.informations(np.array([[0.0], [1.0]]))
    worth = gait_gains(forecast, told_of, utilities, np.random.default_rng(1))
    preposterior = sd * np.sqrt(told / (told + sd**-2))
    expected = [0.0, preposterior * np.sqrt(2.0 / np.pi)]
    assert worth == pytest.approx(expected, rel=0.1, abs=1e-9)


def test_where_the_gait_is_certain_information_decides():
    forecast, commands, rng = two_bodies(), np.array([[0.0], [1.0]]), np.random.default_rng(0)
    certain = np.array([[2.0, 2.0, 2.0, 2.0], [1.0, 1.9, 1.0, 1.9]])
    command, value = best_command(forecast, commands, "gait", certain, rng)
    assert (command, value) == (1.0, 0.0)


def test_robustness_is_what_the_chosen_gait_keeps_of_the_best():
    bodies = np.linspace(0.0, 1.0, 101)
    steady, fitting = np.full(101, 5.0), np.where(bodies < 0.4, 10.0, 0.0)
    assert robustness(np.stack([steady, fitting])) == pytest.approx(0.5)
    assert robustness(np.stack([steady, 0.9 * steady])) == 1.0
    sinking = np.where(bodies > 0.5, -1.0, 5.0)  # what no gait moves costs nothing
    assert robustness(np.stack([sinking, sinking - 1.0])) == 1.0


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (np.ones((1, 4)), r"K >= 2 gaits .* shape \(K, 4\); it returned \(1, 4\)"),
        (np.ones((2, 3)), r"it returned \(2, 3\)"),
        (np.full((2, 4), np.nan), "finite"),
    ],
)
def test_a_utility_that_answers_wrongly_is_named(answer, message):
    with pytest.raises(TargetError, match=message):
        checked_utilities(lambda _: answer, np.ones((4, 9)))


def test_fast_commands_are_all_used_before_one_is_repeated():
    rng = np.random.default_rng(0)
    performed = np.empty((0, 3))
    for _ in range(2):
        for _ in range(8):
            command = fast_command(ACTIONS, performed, rng)
            performed = np.concatenate([performed, command[None]])
        assert set(np.unique(performed[-8:], axis=0)[:, 2]) == {0.75, 1.0}
        assert len(np.unique(performed[-8:], axis=0)) == 8
    assert (np.abs(performed[:, :2]) == 0.5).all()


def test_a_servo_that_saturates_still_has_its_corner_counted():
    rng = np.random.default_rng(0)
    asked = np.empty((0, 3))
    for _ in range(8):
        asked = np.concatenate([asked, fast_command(ACTIONS, 0.9 * asked, rng)[None]])
    assert len(np.unique(asked, axis=0)) == 8


def test_candidates_are_fast_and_random_ones_within_the_range():
    found = candidates(ACTIONS, np.random.default_rng(0))
    assert len(np.unique(found, axis=0)) == len(found) == CANDIDATES
    assert np.array_equal(found[:8], corners(ACTIONS, np.random.default_rng(0)))
    assert (found >= ACTIONS.low).all()
    assert (found <= ACTIONS.high).all()
    many = action_layout([(f"motor {i}", -1.0, 1.0) for i in range(40)])
    assert corners(many, np.random.default_rng(0)).shape == (MOST_CORNERS, 40)
