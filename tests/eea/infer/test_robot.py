"""A stranger's robot: stated by names, inferred from recorded trials, with honest answers."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from cart import CART, PUSH, QUICK, SD, SOUGHT, TIME, measured, roll, with_numbers
from eea import (
    FitConfig,
    Hypothesis,
    Number,
    Robot,
    Trial,
    load_posterior,
    save_posterior,
)
from eea.core.checks import ConfigurationError, TargetError
from eea.infer.design import least_change
from eea.infer.statement import Prior
from eea.infer.trials import Noise
from eea.infer.unknowns import Unknowns

HEAVIER = Hypothesis("it is heavier", moves={"gain": Number(mean=0.0, sd=0.3, low=0.0)}, odds=0.1)
SENSOR_OFF = Hypothesis("the sensor is off", moves={"bias": Number(0.0, sd=0.5)}, odds=0.1)
MASS = 0.9


def infer(robot, trials, **settings):
    return robot.infer(trials, config=QUICK, **settings)


def refused(message, make):
    with pytest.raises(ConfigurationError) as refusal:
        make()
    assert message in str(refusal.value)


def test_a_robot_needs_a_simulator_numbers_and_channels_only():
    def grow(values, inputs):
        assert inputs is None
        return (values["rate"][:, None] * TIME)[:, :, None]

    plant = Robot(grow, {"rate": Number(0.0, 2.0)}, {"height": "cm"})
    rng = np.random.default_rng(0)
    found = infer(plant, [Trial((0.7 * TIME + rng.normal(size=60))[:, None])])
    _, low, high = found.table(MASS)["rate"]
    assert low < 0.7 < high
    assert high - low == pytest.approx(2 * 1.645 / np.sqrt((TIME**2).sum()), rel=0.4)
    assert found.good, found.verdict
    assert found.findings == []


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"numbers": {}}, "numbers must be one or more, by name; got none"),
        ({"numbers": {"gain": (0, 1)}}, "numbers must be a mapping from names to Number"),
        ({"numbers": {"gain@1": Number(0, 1)}}, "a name must have no @; got 'gain@1'"),
        (
            {"numbers": {"gain": Number(0.0)}},
            "gain must have both ends or an sd, as in Number(0.0, 2.0) or Number(0, sd=0.1); got",
        ),
        (
            {"numbers": {"gain": Number(low=0.0)}},
            "high of gain must be finite, or a mean and an sd",
        ),
        (
            {"numbers": {"gain": Number(0, 1, mean=0.5)}},
            "nothing is broken is healthy=0.5; got Num",
        ),
        (
            {"numbers": {"bias": Number(-1.0, 1.0, mean=2.0, sd=1.0)}},
            "mean of bias must be a finite number in [-1, 1]; got 2",
        ),
        ({"simulate": 3}, "simulate must be a function; got 3"),
        ({"channels": ["rate"]}, "channels must be a mapping from names to text; got ['rate']"),
        ({"hypotheses": HEAVIER}, "hypotheses must be a list or tuple of Hypothesis"),
        ({"hypotheses": [HEAVIER, HEAVIER]}, "'it is heavier' is given twice"),
        (
            {"hypotheses": [Hypothesis("x", moves={"gian": Number(0, sd=1)})]},
            "moves of 'x' must be one of gain, drag, bias; got 'gian'",
        ),
        (
            {"hypotheses": [Hypothesis("x", {"gain": 7.0})]},
            "fixed gain of 'x' must be a finite number in [0, 2]; got 7.0",
        ),
        (
            {"hypotheses": [Hypothesis("x", moves={"gain": Number(mean=0, sd=1, low=5.0)})]},
            "moves of 'x' must stay within [0, 2] of gain, which is 1 before",
        ),
    ],
)
def test_a_wrong_statement_is_refused(changes, message):
    refused(message, lambda: replace(CART, **changes))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Number(1.0, 0.0), "low must be less than high; got 1 and 0"),
        (lambda: Number(0.0, 1.0, 2.0), "ends must be the least and the greatest value, or the"),
        (lambda: Number(0.0, mean=1.0), "ends must be the least and the greatest value, or the"),
        (lambda: Number(0.0, 1.0, sd=0.3), "mean must be given with sd, as in Number(0.0, sd=0.1)"),
        (lambda: Number(0.0, 1.0, healthy=3.0), "healthy must be a finite number in [0, 1]"),
        (lambda: Number(0.0, sd=0.1, healthy=0.0), "healthy must be of a number that lies in a"),
        (lambda: Number(0.0, 1.0, healthy=0.5, varies=True), "healthy must be of a number that"),
        (lambda: Number(0.0, 1.0, switch=True), "mean must be given with switch"),
        (lambda: Number(0.0, 1.0, group="water"), "group must be of a number with sd that all"),
        (lambda: Number(-3.0, 3.0, circular=True), "circular must be of an angle that may be any"),
        (lambda: Number(0.0, sd=0.0), "sd must be"),
        (lambda: Number(0.0, 1.0, unit=3), "unit must be"),
        (lambda: Number("a", 1.0), "low must be"),
    ],
)
def test_a_wrong_number_is_refused(make, message):
    refused(message, make)


def test_a_number_is_fixed_or_moves():
    refused(
        "'x' must fix or move a number, not both; got gain in both",
        lambda: Hypothesis("x", {"gain": 1.0}, moves={"gain": Number(0, sd=1)}),
    )
    refused(
        "'x' must fix or move a number, as a hypothesis of what is broken; got neither",
        lambda: replace(CART, hypotheses=[Hypothesis("x")]),
    )


@pytest.mark.parametrize(
    ("trials", "settings", "message"),
    [
        ([], {}, "trials must be one or more; got none"),
        (np.zeros((5, 2)), {}, "trials must be a list or tuple of Trial"),
        ([Trial(np.zeros((5, 1)), PUSH[:5])], {}, "the 2 channels rate, force; got shape (5, 1)"),
        ([Trial([[1.0, 1.0]], [1.0])], {}, "trials must have more samples than the 2 unknowns"),
        (
            [Trial([[1.0, np.nan]] * 9, PUSH[:9])],
            {},
            "a channel of unknown noise must have a sample in some trial; force has none",
        ),
        (None, {"noise": 0.1}, "noise must be a mapping from names to numbers; got 0.1"),
        (None, {"noise": {"rat": 1.0}}, "noise must be one of rate, force; got 'rat'"),
        (None, {"noise": {"rate": 1.0}}, "noise must be that of every channel; force has none"),
        (
            None,
            {"noise": {"rate": 1.0, "force": 1e-200}},
            "force must be a finite number of at least",
        ),
        (
            None,
            {"noise": Noise(np.ones(1), np.zeros(1))},
            "sd of noise must have shape (2,); got (1,)",
        ),
        (None, {"config": 3}, "config must be of type FitConfig; got 3"),
        (None, {"config": FitConfig(noise=0.1)}, "noise is given by channel; got 0.1"),
        (None, {"seed": -1}, "seed must be a whole number"),
    ],
)
def test_wrong_trials_and_settings_are_refused(trials, settings, message):
    trials = [measured(np.random.default_rng(0))] if trials is None else trials
    refused(message, lambda: CART.infer(trials, **settings))


@pytest.mark.parametrize(
    "wrong",
    [
        lambda signal: signal[:, :, 0],
        lambda signal: signal[0],
        lambda signal: signal[:1],
        lambda signal: signal[:, :-1],
        lambda signal: signal.swapaxes(1, 2),
        lambda signal: 1j * signal,
    ],
)
@pytest.mark.parametrize("lengths", [(60,), (60, 30)])
def test_a_simulator_of_the_wrong_shape_is_refused(wrong, lengths):
    rng = np.random.default_rng(0)
    trials = [measured(rng, PUSH[:n]) for n in lengths]
    robot = replace(CART, simulate=lambda values, push: wrong(roll(values, push)))
    refused("simulate must return numbers of shape", lambda: infer(robot, trials))


def test_candidates_for_which_the_simulator_raises_are_left_out_and_named():
    def give_up(values, push):
        if (values["gain"] > 1.5).any():
            raise ArithmeticError("the solver did not converge")
        return roll(values, push)

    trials = [measured(np.random.default_rng(0))]
    found = infer(replace(SOUGHT, simulate=give_up), trials)
    assert found.table()["gain"][0] == pytest.approx(
        infer(SOUGHT, trials).table()["gain"][0], abs=1e-3
    )
    (said,) = [one for one in found.findings if "raised" in one]
    assert re.search(
        r"simulate raised for \d+ of \d+ candidates, which were left out; first ArithmeticError "
        r"\(the solver did not converge\) at gain 1\.[5-9]\d*, drag ",
        said,
    )


def test_a_simulator_that_always_raises_is_raised_with_a_candidate():
    def give_up(*_):
        raise ArithmeticError("the solver did not converge")

    with pytest.raises(ArithmeticError, match="the solver did not converge") as raised:
        infer(replace(SOUGHT, simulate=give_up), [measured(np.random.default_rng(0))])
    (note,) = raised.value.__notes__
    assert re.search(r"for each of \d+ trials; first at gain \S+, drag .* return NaN", note)


def test_ctrl_c_passes_through_a_simulator_that_is_retried():
    calls = []

    def interrupted(_, push):
        calls.append(len(push))
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        infer(replace(SOUGHT, simulate=interrupted), [measured(np.random.default_rng(0))])
    assert len(calls) == 1


def test_masked_numbers_of_a_simulator_are_those_of_trials_that_failed():
    def give_up(values, push):
        failed = (values["gain"] > 1.5)[:, None, None]
        signal = roll(values, push)
        return np.ma.array(
            np.where(failed, 0.0, signal), mask=np.broadcast_to(failed, signal.shape)
        )

    trials = [measured(np.random.default_rng(0))]
    found = infer(replace(SOUGHT, simulate=give_up), trials).table()
    assert found["gain"][0] == pytest.approx(infer(SOUGHT, trials).table()["gain"][0], abs=1e-3)


def test_a_recording_is_given_once():
    rng = np.random.default_rng(5)
    whole = measured(rng)
    said = "each given once; got the same in trials "
    refused(f"{said}2 and 3", lambda: SOUGHT.infer([measured(rng), whole, whole]))
    refused(f"{said}1 and 3", lambda: SOUGHT.learn([whole, measured(rng), whole]))


def test_trials_that_have_samples_in_common_are_named():
    """Parts of a recording may be trials of their own, as of one start each."""
    rng = np.random.default_rng(5)
    whole = measured(rng)
    part = Trial(whole.signal[20:50], PUSH[20:50])
    late = Trial(whole.signal[25:], PUSH[25:])
    early = Trial(whole.signal[:50], PUSH[:50])
    for trials, pair in (
        ([measured(rng), part, whole], "2 and 3"),
        ([late, measured(rng), early], "1 and 3"),
        ([early, late], "1 and 2"),
        ([whole, Trial(whole.signal, 2.0 * PUSH)], "1 and 2"),
    ):
        said = f"trials {pair} have samples in common, which count twice: the intervals are too"
        assert any(one.startswith(said) for one in infer(SOUGHT, trials).findings)
    assert not any("in common" in one for one in infer(SOUGHT, [early]).findings)


def test_a_log_without_a_signal_is_explained_without_a_warning():
    still = Trial(np.zeros((60, 2)), np.zeros(60))
    assert infer(SOUGHT, [still, still]).findings[0] == "not measured: gain; drag"


def test_short_trials_of_a_switch_may_be_equal_by_chance():
    def share(values, _):
        return np.tile(values["share"][:, None, None], (1, 8, 1))

    switch = Robot(share, {"share": Number(0.0, 1.0)}, {"on": ""})
    once = Trial([[1.0], [0.0], [1.0], [1.0], [0.0], [0.0], [1.0], [0.0]])
    middle, _, _ = infer(switch, [once, once]).table()["share"]
    assert middle == pytest.approx(0.5, abs=0.05)


def test_trials_with_and_without_inputs_are_refused():
    one = measured(np.random.default_rng(0))
    several = [one, Trial(one.signal)]
    refused("trials must all have inputs, or none of them; trial 2 of 2 has none",
            lambda: CART.infer(several))  # fmt: skip


@pytest.mark.parametrize("everywhere", [True, False])
def test_a_caller_that_raises_floating_point_errors_ends_no_inference(everywhere):
    def strict(values, push):
        np.seterr(all="raise")
        return roll(values, push)

    rng = np.random.default_rng(0)
    robot = replace(CART, simulate=roll if everywhere else strict)
    known_good = [measured(rng) for _ in range(3)]
    plain = infer(CART, known_good[:1]).table()
    with np.errstate(all="raise" if everywhere else "warn"):
        found = infer(robot, known_good[:1])
        assert found.table() == plain
        assert found.findings
        assert found.broken("gain")
        found.prospects({"again": known_good[0]})
        reference = replace(robot.without_healthy(), hypotheses=()).learn(known_good, config=QUICK)
        assert reference.test(known_good[0]).same
        follower = robot.without_healthy().follow({"rate": 0.05, "force": 5e4})
        assert not any(follower.update(one).alarm for one in known_good)
        assert np.geterr()["under"] == ("raise" if everywhere else "warn")


def test_what_is_raised_in_a_simulator_as_its_caller_asks_is_told():
    def divide(values, push):
        return roll(values, push) / (values["gain"] > 9.0)[:, None, None]

    with np.errstate(all="raise"), pytest.raises(FloatingPointError) as raised:
        infer(replace(SOUGHT, simulate=divide), [measured(np.random.default_rng(0))])
    assert "simulate raised this" in raised.value.__notes__[0]


def test_more_hypotheses_than_can_be_fitted_are_refused():
    names = [f"n{i}" for i in range(70)]
    many = {
        "simulate": roll, "numbers": dict.fromkeys(names, Number(0.0, 1.0, healthy=0.5)),
        "channels": {"y": "m"},
    }  # fmt: skip
    assert len(Robot(**many).alternatives) == 70
    refused("hypotheses must be at most 2000", lambda: Robot(**many, at_once=2))


def test_a_long_search_says_that_it_goes_on(monkeypatch):
    monkeypatch.setattr("eea.infer.simulating.SILENT_SECONDS", 0.0)
    said = []
    infer(CART, [measured(np.random.default_rng(0))], progress=said.append)
    assert "nothing is broken" in said
    assert any(re.fullmatch(r"gain has changed, \d+ simulations", s) for s in said)


def test_a_simulator_that_never_stays_finite_is_named():
    robot = replace(CART, simulate=lambda values, push: np.nan * roll(values, push))
    with pytest.raises(TargetError, match="simulate must return a signal that stays finite"):
        infer(robot, [measured(np.random.default_rng(0))])


def test_a_log_that_never_changes_is_searched_without_a_warning():
    found = infer(SOUGHT, [Trial(np.zeros((64, 2)), np.zeros(64))])
    assert any(words.startswith("not measured: gain") for words in found.findings)


@pytest.mark.parametrize("most", [1.1, 1.2])
def test_a_fit_beside_a_simulator_that_diverges_keeps_what_the_trials_tell(most):
    """A derivative that is taken where a robot diverges does not make its number unknown."""

    def grow(values, _):
        signal = (values["rate"][:, None] * TIME)[:, :, None]
        signal[values["rate"] > most] = np.nan
        return signal

    plant = Robot(grow, {"rate": Number(0.0, 2.0, healthy=0.5)}, {"height": "cm"})
    signal = most * TIME + np.random.default_rng(0).normal(size=60)
    found = plant.infer([Trial(signal[:, None])], noise={"height": 1.0})
    _, low, high = found.broken("rate")
    assert low < most
    assert high - low < 0.5


def test_numbers_whose_square_overflows_are_refused():
    """Otherwise any robot explains them."""
    refused(
        "signal must be at most 1e+100, or NaN where missing; got 1e+300", lambda: Trial([[1e300]])
    )
    refused(
        "signal must be at most 1e+100, or NaN where missing; got inf",
        lambda: Trial([[-np.inf], [0.0]]),
    )


def test_a_simulator_may_go_on_for_longer_than_a_trial():
    rng = np.random.default_rng(0)
    short = measured(rng, PUSH[:30])
    longer = replace(CART, simulate=lambda values, push: roll(values, np.tile(push, 2)))
    assert infer(longer, [short]).table() == infer(CART, [short]).table()


def test_a_change_needs_a_value_to_start_from():
    sought = replace(CART.without_healthy(), hypotheses=[HEAVIER])
    refused(
        "moves of 'it is heavier' must be of numbers that have a mean, say what is healthy, "
        "or were found by learn(); gain is none of these",
        lambda: infer(sought, [measured(np.random.default_rng(0))]),
    )


def test_noise_of_each_channel_is_estimated_with_its_colour():
    rng = np.random.default_rng(1)
    push = np.tile(PUSH, 10)
    trials = [measured(rng, push, correlation=0.8)]
    trials[0] = Trial(np.stack([trials[0].signal[:, 0], measured(rng, push).signal[:, 1]], 1), push)
    found = infer(SOUGHT, trials)
    assert found.noise is not None
    np.testing.assert_allclose(found.noise.sd, SD, rtol=0.15)
    np.testing.assert_allclose(found.noise.correlation, [0.8, 0.0], atol=0.08)
    assert found.sigma == pytest.approx(1.0, abs=0.02)
    assert found.good, found.verdict


@pytest.mark.parametrize("missing", ["in turn", "two of three", "at random"])
def test_noise_keeps_its_colour_where_samples_are_missing(missing):
    rng = np.random.default_rng(3)
    push = np.tile(PUSH, 10)
    trial = measured(rng, push, correlation=0.8)
    signal = np.array(trial.signal)
    if missing == "in turn":  # two topics, at half of the rate each
        signal[::2, 0] = np.nan
        signal[1::2, 1] = np.nan
    elif missing == "two of three":
        signal[np.arange(len(signal)) % 3 > 0] = np.nan
    else:
        signal[rng.random(signal.shape) < 0.6] = np.nan
    found = infer(SOUGHT, [Trial(signal, push)])
    assert found.noise is not None
    np.testing.assert_allclose(found.noise.sd, SD, rtol=0.15)
    np.testing.assert_allclose(found.noise.correlation, 0.8, atol=0.1)
    assert found.good, found.verdict


def test_the_unit_of_a_channel_makes_no_difference():
    trial = measured(np.random.default_rng(2))
    scales = np.array([1e6, 1e-9])
    scaled = replace(SOUGHT, simulate=lambda values, push: scales * roll(values, push))
    one = infer(SOUGHT, [trial]).table()
    other = infer(scaled, [Trial(scales * trial.signal, trial.inputs)]).table()
    for name, row in one.items():
        assert other[name] == pytest.approx(row, abs=1e-6)


def test_a_missing_sample_has_no_weight_and_no_bias():
    """As much as if it had not been sampled, whatever stands there."""
    rng = np.random.default_rng(3)
    whole, lacking = [measured(rng, gain=1.3) for _ in range(4)], []
    for trial in whole:
        signal = trial.signal.copy()
        signal[rng.random(signal.shape) < 0.5] = np.nan
        signal[-10:] = np.nan
        lacking.append(Trial(signal, trial.inputs))
    rows = [infer(SOUGHT, trials).table()["gain"] for trials in (whole, lacking)]
    for _, low, high in rows:
        assert low < 1.3 < high
    width = [high - low for _, low, high in rows]
    assert 1.2 < width[1] / width[0] < 2.0


def test_trials_of_unequal_length_count_as_long_as_they_are():
    rng = np.random.default_rng(4)
    trials = [measured(rng, PUSH[:n], gain=1.3, sd=(0.01, 1e4)) for n in (60, 12, 33)]
    found = infer(SOUGHT, trials)
    assert found.samples == 2 * (60 + 12 + 33)
    _, low, high = found.table(MASS)["gain"]
    assert low < 1.3 < high
    assert found.noise is not None
    np.testing.assert_allclose(found.noise.sd, (0.01, 1e4), rtol=0.25)


def test_a_trial_may_start_in_motion():
    def coast(values, push):
        rate = values["rate at first"][:, None] * np.exp(-values["drag"][:, None] * TIME / 30)
        return (rate + push.cumsum(axis=1) / 60)[:, :, None]

    numbers = {"drag": Number(0.0, 2.0), "rate at first": Number(-3.0, 3.0, varies=True)}
    sledge = Robot(coast, numbers, {"rate": "m/s"})
    rng, firsts = np.random.default_rng(5), (-2.0, 1.5)
    trials = []
    for first in firsts:
        values = {"drag": np.array([0.6]), "rate at first": np.array([first])}
        trials.append(Trial(coast(values, PUSH[None])[0] + 0.01 * rng.normal(size=(60, 1)), PUSH))
    table = infer(sledge, trials).table(0.99)
    for name, true in {
        "drag": 0.6, "rate at first@1": firsts[0], "rate at first@2": firsts[1]
    }.items():  # fmt: skip
        assert table[name][1] < true < table[name][2]


def test_intervals_hold_at_their_rate():
    rng = np.random.default_rng(6)
    held = []
    for seed in range(40):
        true = {"gain": rng.uniform(0.3, 1.7), "drag": rng.uniform(0.3, 1.7)}
        true["bias"] = 0.1 * rng.normal()
        table = infer(SOUGHT, [measured(rng, correlation=0.5, **true)], seed=seed).table(MASS)
        held += [low < true[name] < high for name, (_, low, high) in table.items()]
    assert 0.82 < np.mean(held) < 0.97  # 2.5 sd of 120 of 90%


def test_nothing_is_broken_is_a_finding_with_its_probability():
    found = infer(CART, [measured(np.random.default_rng(7))])
    nothing = found.probability("nothing is broken")
    assert nothing > 0.95
    assert nothing + sum(found.probability(f"{n} has changed") for n in CART.healthy) == (
        pytest.approx(1.0)
    )
    assert found.findings[0] == f"nothing is broken ({nothing:.0%})"
    assert found.findings[-1].startswith("a change of gain by less than 0.0")
    assert " m or of drag by less than 0.0" in found.findings[-1]
    assert found.findings[-1].endswith(" would not show")
    low, high = found.interval(MASS)
    assert low[0] == pytest.approx(1.0, abs=1e-4) == high[0]  # whole, with nearly all of the mass
    _, least, most = found.broken("gain", MASS)  # but if it has changed
    assert most - least > 0.02


@pytest.mark.slow
def test_intervals_given_a_change_hold_at_their_rate():
    rng = np.random.default_rng(8)
    held, named = [], []
    for seed in range(40):
        true = rng.uniform(1.1, 1.6)
        found = infer(replace(CART, hypotheses=[HEAVIER]), [measured(rng, gain=true)], seed=seed)
        named.append(found.probability("it is heavier") > 0.5)
        _, low, high = found.broken("gain", MASS)
        held.append(low < true < high)
    assert np.mean(named) == 1.0
    assert 0.78 <= np.mean(held) <= 0.99


@pytest.mark.parametrize(
    "hypothesis",
    [pytest.param(HEAVIER, marks=pytest.mark.slow), Hypothesis("x", moves={"gain": Number(0.0)})],
)
def test_a_change_that_would_not_show_is_named_half_of_the_time(hypothesis):
    rng = np.random.default_rng(9)
    robot = replace(CART, hypotheses=[hypothesis])
    noise = dict(zip(CART.channels, SD, strict=True))
    sentence = infer(robot, [measured(rng)], noise=noise).findings[-1]
    least = float(sentence.removeprefix("a change of gain by less than ").split()[0])
    shares = []
    for change in (0.5 * least, least, 1.5 * least):
        found = [infer(robot, [measured(rng, gain=1.0 + change)], noise=noise) for _ in range(20)]
        shares.append(np.mean([f.branches[0].hypothesis.name == hypothesis.name for f in found]))
    assert shares[0] < 0.3
    assert 0.25 <= shares[1] <= 0.75
    assert shares[2] > 0.7


def test_of_what_is_most_improbable_there_is_an_answer_all_the_same():
    """What if it is broken after all?"""
    robot = replace(CART, hypotheses=[replace(HEAVIER, odds=1e-9)])
    found = infer(robot, [measured(np.random.default_rng(7))])
    assert 0.0 < found.probability(HEAVIER.name) < 1e-8
    _, low, high = found.broken("gain", MASS)
    assert 1.0 < low < high < 1.1


def test_a_changes_own_prior_is_no_evidence_that_it_would_show():
    """With noise as large as the usual change: data of sd 1 / sqrt(20), the prior's is 0.3."""
    cause = Hypothesis("x", moves={"gain": Number(0.0, sd=0.3)}, odds=0.1)
    push = np.ones(20)
    robot = Robot(
        lambda values, push: (values["gain"][:, None] * push)[:, :, None],
        {"gain": Number(0.0, 2.0, healthy=1.0)},
        {"rate": "rad/s"},
        hypotheses=[cause],
    )
    sentence = infer(robot, [Trial(push[:, None], push)], noise={"rate": 1.0}).findings[-1]
    expected = least_change(20**-0.5, 0.0, 0.3, np.array([-1.0, 1.0]), 0.1 / robot.nominal.odds)
    assert float(re.search(r"less than (\S+) ", sentence)[1]) == pytest.approx(expected, rel=0.05)


def test_what_was_known_of_a_number_of_each_trial_is_known_in_all():
    """A later trial's own number has a prior, too; a common number has one."""
    prior = Prior(("gain", "bias"), np.array([0.4, 0.6]), np.diag([0.01, 0.04]))
    bias = Number(mean=0.0, sd=0.1, varies=True)
    robot = replace(with_numbers(SOUGHT, bias=bias), prior=prior)
    parameters = Unknowns.of(robot, 2, robot.groups)
    entries = [parameters.names.index(name) for name in ("gain", "bias@1", "bias@2")]
    assert parameters.prior_mean[entries] == pytest.approx([0.4, 0.6, 0.6])
    assert parameters.prior_precision[entries] == pytest.approx([100.0, 25.0, 25.0])


def test_a_change_of_what_has_no_effect_would_never_show():
    robot = with_numbers(CART, paint=Number(0.0, 1.0, healthy=0.5))
    found = infer(robot, [measured(np.random.default_rng(10))])
    assert found.findings[-1].endswith(" or of paint would not show")
    _, low, high = found.broken("paint")
    assert high - low > 0.8


def test_a_change_has_a_direction():
    rng = np.random.default_rng(11)
    robot = replace(CART, hypotheses=[HEAVIER])
    noise = dict(zip(CART.channels, SD, strict=True))
    more, less = (infer(robot, [measured(rng, gain=gain)], noise=noise) for gain in (1.3, 0.7))
    assert more.probability("it is heavier") > 0.99
    assert less.probability("it is heavier") < 0.01
    assert not less.good  # nothing that was stated explains it


@pytest.mark.parametrize("varies", [False, True])
def test_a_hypothesis_may_move_a_number_beyond_its_usual_spread(varies):
    rng = np.random.default_rng(12)
    robot = replace(
        with_numbers(CART, bias=Number(0.0, sd=0.02, varies=varies)),
        hypotheses=[HEAVIER, SENSOR_OFF],
    )
    trials = [measured(rng, bias=bias) for bias in (0.48, 0.5)]
    found = infer(robot, trials)
    assert found.probability("the sensor is off") > 0.99
    _, low, high = found.broken("bias")
    assert low < (0.48 if varies else 0.49) < high
    assert infer(robot, [measured(rng)]).probability("nothing is broken") > 0.9


def test_causes_that_fit_alike_are_one_sentence_with_the_trial_that_would_tell():
    alike = Hypothesis(
        "a weight hangs below",
        moves={"gain": Number(mean=0.0, sd=0.3, low=0.0)},
        odds=0.1,
        hint="turn",
    )
    robot = replace(CART, hypotheses=[HEAVIER, alike])
    (said,) = infer(robot, [measured(np.random.default_rng(13), gain=1.2)]).findings
    assert said.startswith("it is heavier (50%): gain 1.2")
    assert "; the data fit nearly alike if a weight hangs below (50%): gain 1.2" in said
    assert said.endswith("; turn to find out")


def test_a_posterior_with_noise_survives_a_file(tmp_path):
    found = infer(CART, [measured(np.random.default_rng(14), correlation=0.6)])
    save_posterior(tmp_path / "cart.npz", found)
    again = load_posterior(tmp_path / "cart.npz")
    assert again.noise is not None
    for name in ("sd", "correlation"):
        assert np.array_equal(getattr(again.noise, name), getattr(found.noise, name))
    assert again.to_dict() == found.to_dict()
    assert again.broken("gain") == found.broken("gain")
    assert again.findings == found.findings
    assert again.robot.table == CART.table
