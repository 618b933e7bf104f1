"""A stranger's robot: stated by names and numbers, inferred from recorded trials."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cart import CART, PUSH, QUICK, SD, SOUGHT, TIME, measured, record, roll, with_numbers
from eea import FitConfig, Hypothesis, Number, Robot, Trial, load_posterior, save_posterior
from eea.core.checks import ConfigurationError, TargetError
from eea.infer.answer import Answer
from eea.infer.branch import Branch
from eea.infer.design import least_change
from eea.infer.file import from_arrays, to_arrays
from eea.infer.goodness import Goodness
from eea.infer.mixture import Mode
from eea.infer.statement import Prior
from eea.infer.trials import Noise
from eea.infer.unknowns import Unknowns

HEAVIER = Hypothesis("it is heavier", moves={"gain": Number(mean=0.0, sd=0.3, low=0.0)}, odds=0.1)
SENSOR_OFF = Hypothesis("the sensor is off", moves={"bias": Number(0.0, sd=0.5)}, odds=0.1)
OTHER = measured(np.random.default_rng(5))
KNOWN_NOISE = dict(zip(CART.channels, SD, strict=True))
MASS = 0.9


def infer(robot, trials, **settings):
    return robot.infer(trials, config=QUICK, **settings)


def refused(message, make):
    with pytest.raises(ConfigurationError) as refusal:
        make()
    assert message in str(refusal.value)


LOG = measured(np.random.default_rng(0))
ANGLES = {"heading": Number.angle(), "phase": Number.angle(varies=False)}
MANY = {f"n{i}": Number(0.0, 1.0, healthy=0.5) for i in range(70)}


def supposing(*hypotheses):
    return replace(CART, hypotheses=hypotheses)


def moving(name, change):
    """Return a cart with two angles, of which a hypothesis moves a number."""
    cart = with_numbers(CART, **ANGLES)
    return replace(cart, hypotheses=[Hypothesis("x", moves={name: change})])


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
    ("make", "said"),
    [
        (lambda: Number(1.0, 0.0), "low must be less than high; got 1 and 0"),
        (lambda: Number(0.0, 1.0, 2.0), "the least and the greatest value"),
        (lambda: Number(0.0, mean=1.0), "the least and the greatest value"),
        (lambda: Number(0.0, 1.0, sd=0.3), "mean must be given with sd"),
        (lambda: Number(0.0, 1.0, healthy=3.0), "healthy must be a finite number in [0, 1]"),
        (lambda: Number(0.0, sd=0.1, healthy=0.0), "healthy must be of a number that"),
        (lambda: Number(0.0, 1.0, healthy=0.5, varies=True), "healthy must be of a number that"),
        (lambda: Number(0.0, 1.0, switch=True), "mean must be given with switch"),
        (lambda: Number(0.0, 1.0, group="water"), "group must be of a number with sd"),
        (lambda: Number(-3.0, 3.0, circular=True), "circular must be of an angle"),
        (lambda: with_numbers(CART, **{"gain@1": Number(0, 1)}), "must have no @; got 'gain@1'"),
        (lambda: with_numbers(CART, gain=Number(0.0)), "gain must have both ends or an sd"),
        (lambda: with_numbers(CART, gain=Number(low=0.0)), "high of gain must be finite"),
        (lambda: with_numbers(CART, gain=Number(0, 1, mean=0.5)), "is healthy=0.5; got Num"),
        (lambda: with_numbers(CART, a=Number(-1.0, 1.0, mean=2.0, sd=1.0)), "mean of a must be"),
        (lambda: Hypothesis("x", {"a": 1.0}, {"a": Number(0, sd=1)}), "not both; got a in both"),
        (lambda: supposing(Hypothesis("x")), "'x' must fix or move a number"),
        (lambda: supposing(HEAVIER, HEAVIER), "'it is heavier' is given twice"),
        (lambda: supposing(Hypothesis("x", {"gain": 7.0})), "in [0, 2]; got 7.0"),
        (lambda: moving("gian", Number(0, sd=1)), "one of gain, drag, bias, heading; got 'gian'"),
        (
            lambda: moving("gain", Number(mean=0, sd=1, low=5.0)),
            "within [0, 2] of gain, which is 1",
        ),
        (lambda: moving("gain", 0.3), "moves must be a mapping from names to Number"),
        (lambda: moving("gain", Number(0.0, sd=1.0, unit="m")), "Number(mean=0.0, sd=1.0)"),
        (lambda: moving("gain", Number(0.0, 1.0, healthy=0.5)), "so state Number(0, 1)"),
        (lambda: moving("gain", Number(0.0, sd=1.0, varies=True)), "Number(mean=0.0, sd=1.0)"),
        (lambda: moving("angle", Number.angle()), "unit='rad', circular=True"),
        (lambda: moving("gain", Number.angle(varies=False)), "such as Number(0.0, sd=0.1) of gain"),
        (lambda: moving("heading", Number(0.0)), "such as Number.angle(varies=False) of heading"),
        (lambda: moving("phase", Number.angle(varies=False)), "one of gain, drag, bias, heading"),
        (lambda: moving("bias", Number(0.0)), "low and high of bias must be given"),
        (lambda: Robot(roll, MANY, {"y": "m"}, at_once=2), "hypotheses must be at most 2000"),
    ],
)
def test_numbers_and_hypotheses_that_do_not_fit_together_are_refused(make, said):
    refused(said, make)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: CART.infer([]), "trials must be one or more; got none"),
        (lambda: CART.infer([Trial(np.zeros((5, 1)), PUSH[:5])]), "2 channels rate, force; got sh"),
        (lambda: CART.infer([Trial([[1.0, 1.0]], [1.0])]), "more samples than the 2 unknowns"),
        (lambda: CART.infer([Trial([[1.0, np.nan]] * 9, PUSH[:9])]), "force has none"),
        (lambda: CART.infer([LOG, Trial(LOG.signal)]), "trial 2 of 2 has none"),
        (lambda: CART.infer([LOG], noise={"rat": 1.0}), "one of rate, force; got 'rat'"),
        (lambda: CART.infer([LOG], noise={"rate": 1.0}), "every channel; force has none"),
        (lambda: CART.infer([LOG], noise={"rate": 1.0, "force": 1e-200}), "force must be a finite"),
        (lambda: CART.infer([LOG], noise=Noise(np.ones(1), np.zeros(1))), "(2,); got (1,)"),
        (lambda: CART.infer([LOG], config=FitConfig(noise=0.1)), "by channel; got 0.1"),
        (lambda: SOUGHT.infer([OTHER, LOG, LOG]), "given once; got the same in trials 2 and 3"),
        (lambda: SOUGHT.learn([LOG, OTHER, LOG]), "given once; got the same in trials 1 and 3"),
        # Numbers whose square overflows: any robot would explain them.
        (lambda: Trial([[1e300]]), "at most 1e+100, or NaN where missing; got 1e+300"),
        (lambda: Trial([[-np.inf], [0.0]]), "at most 1e+100, or NaN where missing; got inf"),
        (
            lambda: infer(replace(CART.without_healthy(), hypotheses=[HEAVIER]), [LOG]),
            "gain is none",
        ),
        (lambda: constant(Number(0.0, 2.0, mean=1.0, switch=True)), "one that is unknown if"),
        (lambda: constant(Number(1.0, sd=0.1), nuisances=()), "one that is unknown if"),
    ],
)
def test_trials_settings_and_robots_that_do_not_fit_together_are_refused(make, said):
    refused(said, make)


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
def test_a_simulator_of_the_wrong_shape_is_refused(wrong):
    robot = replace(CART, simulate=lambda values, push: wrong(roll(values, push)))
    for lengths in ((60,), (60, 30)):
        trials = [measured(np.random.default_rng(n), PUSH[:n]) for n in lengths]
        refused("simulate must return numbers of shape", lambda: infer(robot, trials))  # noqa: B023


def test_candidates_for_which_the_simulator_raises_or_masks_are_left_out():
    def give_up(values, push):
        if (values["gain"] > 1.5).any():
            raise ArithmeticError("the solver did not converge")
        return roll(values, push)

    def mask(values, push):
        signal = roll(values, push)
        failed = np.broadcast_to((values["gain"] > 1.5)[:, None, None], signal.shape)
        return np.ma.array(np.where(failed, 0.0, signal), mask=failed)

    middle = infer(SOUGHT, [LOG]).table()["gain"][0]
    found, masked = (infer(replace(SOUGHT, simulate=each), [LOG]) for each in (give_up, mask))
    for one in (found, masked):
        assert one.table()["gain"][0] == pytest.approx(middle, abs=1e-3)
    (said,) = [one for one in found.findings if "raised" in one]
    assert re.search(
        r"simulate raised for \d+ of \d+ candidates, which were left out; first ArithmeticError "
        r"\(the solver did not converge\) at gain 1\.[5-9]\d*, drag ",
        said,
    )


def test_a_simulator_that_always_raises_is_raised_with_a_candidate():
    calls = []

    def give_up(*given):
        calls.append(given)
        raise ArithmeticError("the solver did not converge")

    def interrupted(*given):
        calls.append(given)
        raise KeyboardInterrupt

    with pytest.raises(ArithmeticError, match="the solver did not converge") as raised:
        infer(replace(SOUGHT, simulate=give_up), [LOG])
    (note,) = raised.value.__notes__
    assert re.search(r"for each of \d+ trials; first at gain \S+, drag .* return NaN", note)
    calls.clear()
    with pytest.raises(KeyboardInterrupt):
        infer(replace(SOUGHT, simulate=interrupted), [LOG])
    assert len(calls) == 1  # it is not tried again


def test_trials_that_have_samples_in_common_are_named():
    """Parts of a recording may be trials of their own, as of one start each."""
    part = Trial(LOG.signal[20:50], PUSH[20:50])
    late = Trial(LOG.signal[25:], PUSH[25:])
    early = Trial(LOG.signal[:50], PUSH[:50])
    for trials, pair in (
        ([OTHER, part, LOG], "2 and 3"),
        ([late, OTHER, early], "1 and 3"),
        ([early, late], "1 and 2"),
        ([LOG, Trial(LOG.signal, 2.0 * PUSH)], "1 and 2"),
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
        reference = replace(robot.without_healthy(), hypotheses=()).learn(
            known_good[:2], config=replace(QUICK, bodies=2, poses=1, descents=1)
        )
        assert reference.test(known_good[0]).same
        follower = robot.without_healthy().follow({"rate": 0.05, "force": 5e4})
        assert not any(follower.update(one).alarm for one in known_good)
        assert np.geterr()["under"] == ("raise" if everywhere else "warn")


def test_what_is_raised_in_a_simulator_as_its_caller_asks_is_told():
    def divide(values, push):
        return roll(values, push) / (values["gain"] > 9.0)[:, None, None]

    with np.errstate(all="raise"), pytest.raises(FloatingPointError) as raised:
        infer(replace(SOUGHT, simulate=divide), [LOG])
    assert "simulate raised this" in raised.value.__notes__[0]
    never = replace(CART, simulate=lambda values, push: np.nan * roll(values, push))
    with pytest.raises(TargetError, match="simulate must return a signal that stays finite"):
        infer(never, [LOG])


def test_a_long_search_says_that_it_goes_on(monkeypatch):
    monkeypatch.setattr("eea.infer.simulating.SILENT_SECONDS", 0.0)
    said = []
    infer(CART, [measured(np.random.default_rng(0))], progress=said.append)
    assert "nothing is broken" in said
    assert any(re.fullmatch(r"gain has changed, \d+ simulations", s) for s in said)


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


@pytest.mark.parametrize("missing", ["none", "in turn", "two of three", "at random"])
def test_noise_of_each_channel_is_estimated_with_its_colour(missing):
    rng = np.random.default_rng(3)
    push = np.tile(PUSH, 10)
    signal = np.array(measured(rng, push, correlation=0.8).signal)
    signal[:, 1] = measured(rng, push).signal[:, 1]
    if missing == "in turn":  # two topics, at half of the rate each
        signal[::2, 0] = np.nan
        signal[1::2, 1] = np.nan
    elif missing == "two of three":
        signal[np.arange(len(signal)) % 3 > 0] = np.nan
    elif missing == "at random":
        signal[rng.random(signal.shape) < 0.6] = np.nan
    found = infer(SOUGHT, [Trial(signal, push)])
    np.testing.assert_allclose(found.noise.sd, SD, rtol=0.15)
    np.testing.assert_allclose(found.noise.correlation, [0.8, 0.0], atol=0.1)
    assert found.sigma == pytest.approx(1.0, abs=0.02)
    assert found.good, found.verdict


def test_the_unit_of_a_channel_makes_no_difference():
    scales = np.array([1e6, 1e-9])
    scaled = replace(SOUGHT, simulate=lambda values, push: scales * roll(values, push))
    other = infer(scaled, [Trial(scales * LOG.signal, LOG.inputs)]).table()
    for name, row in infer(SOUGHT, [LOG]).table().items():
        assert other[name] == pytest.approx(row, abs=1e-6)
    longer = replace(CART, simulate=lambda values, push: roll(values, np.tile(push, 2)))
    short = measured(np.random.default_rng(0), PUSH[:30])
    assert infer(longer, [short]).table() == infer(CART, [short]).table()  # the rest is ignored


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
    trials = [
        record(coast, {"drag": 0.6, "rate at first": first}, PUSH, 0.01, rng) for first in firsts
    ]
    table = infer(sledge, trials).table(0.99)
    for name, true in {
        "drag": 0.6, "rate at first@1": firsts[0], "rate at first@2": firsts[1]
    }.items():  # fmt: skip
        assert table[name][1] < true < table[name][2]


def test_intervals_hold_at_their_rate():
    rng = np.random.default_rng(6)
    held = []
    for seed in range(20):
        true = {"gain": rng.uniform(0.3, 1.7), "drag": rng.uniform(0.3, 1.7)}
        true["bias"] = 0.1 * rng.normal()
        table = infer(SOUGHT, [measured(rng, correlation=0.5, **true)], seed=seed).table(MASS)
        held += [low < true[name] < high for name, (_, low, high) in table.items()]
    assert 0.8 < np.mean(held) < 0.99  # 2.5 sd of 60 of 90%


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
    held = []
    for seed in range(40):
        true = rng.uniform(1.1, 1.6)
        found = infer(replace(CART, hypotheses=[HEAVIER]), [measured(rng, gain=true)], seed=seed)
        assert found.probability("it is heavier") > 0.5
        _, low, high = found.broken("gain", MASS)
        held.append(low < true < high)
    assert 0.78 <= np.mean(held) <= 0.99


@pytest.mark.parametrize(
    "hypothesis",
    [pytest.param(HEAVIER, marks=pytest.mark.slow), Hypothesis("x", moves={"gain": Number(0.0)})],
)
def test_a_change_that_would_not_show_is_named_half_of_the_time(hypothesis):
    rng = np.random.default_rng(9)
    robot = replace(CART, hypotheses=[hypothesis])
    sentence = infer(robot, [measured(rng)], noise=KNOWN_NOISE).findings[-1]
    least = float(sentence.removeprefix("a change of gain by less than ").split()[0])
    shares = []
    for change in (0.5 * least, least, 1.5 * least):
        logs = [measured(rng, gain=1.0 + change) for _ in range(12)]
        found = [infer(robot, [log], noise=KNOWN_NOISE).branches[0].hypothesis for log in logs]
        shares.append(np.mean([one.name == hypothesis.name for one in found]))
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


EXPLAINED = Goodness(1.0, 1.0, 1.0, 1.0, 1.0, good=True, verdict="as noise would")
SECONDS = 0.01 * np.arange(1, 81)


@st.composite
def robots_numbers(draw):
    """Return a valid number of any kind, in a robot."""
    low = draw(st.floats(-1e3, 1e3))
    high = low + draw(st.floats(1e-3, 1e3))
    inside = min(low + (high - low) * draw(st.floats(0.0, 1.0)), high)
    sd = draw(st.floats(1e-3, 1e3))
    one = {"unit": draw(st.sampled_from(["", "m", "rad/s"]))}
    many = {**one, "valleys": draw(st.integers(0, 20))}
    group = draw(st.sampled_from(["", "water"]))
    kinds = (
        lambda: Number(low, high, **many),
        lambda: Number(low, high, healthy=inside, **many),
        lambda: Number(inside, sd=sd, group=group, **many),
        lambda: Number(mean=inside, sd=sd, low=low, **many),
        lambda: Number(low, high, mean=inside, sd=sd, group=group, **many),
        lambda: Number(low, high, varies=True, **many),
        lambda: Number(inside, sd=sd, varies=True, **many),
        lambda: Number(low, high, mean=inside, switch=True, **one),
        lambda: Number.angle(**one),
        lambda: Number.angle(varies=False, **one),
    )
    return draw(st.sampled_from(kinds))()


def stated(numbers):
    """Return a robot of some numbers by their places."""
    named = {f"number {i}": number for i, number in enumerate(numbers)}
    return Robot(lambda *_: np.zeros((1, 9, 1)), named, {"signal": "V"})


some_robots = (
    st.lists(robots_numbers(), min_size=1, max_size=5)
    .filter(lambda numbers: not all(number.switch for number in numbers))
    .map(stated)
)


@given(some_robots, st.integers(1, 3))
@settings(max_examples=20, deadline=None)
def test_any_numbers_come_back_from_a_file(robot, trials):
    parameters = Unknowns.of(robot, trials, robot.groups)
    theta = np.where(parameters.circular, 0.5, parameters.prior_mean)
    information = parameters.proper_prior
    mode = Mode(theta, information, np.zeros(len(theta)), 0.0)
    posterior = parameters.posterior([mode])
    branch = Branch(robot.nominal, 1.0, parameters, posterior, posterior)
    found = from_arrays(to_arrays(Answer((branch,), EXPLAINED, 1.0, 0)))
    assert list(found.robot.table.items()) == list(robot.table.items())
    assert [*found.robot.alternatives] == [*robot.alternatives]
    assert found.branches[0].parameters.names == parameters.names
    assert found.table() == Answer((branch,), EXPLAINED, 1.0, 0).table()


@given(some_robots)
@settings(max_examples=60, deadline=None)
def test_ends_of_a_range_are_exact_in_natural_units(robot):
    parameters = Unknowns.of(replace(robot, hypotheses=()), 1, robot.groups)
    straight = np.flatnonzero(~parameters.circular)
    table = [robot.table[parameters.base(i)] for i in straight]
    for share, end in ((0.0, "low"), (1.0, "high")):
        theta = np.full(len(parameters), share)
        wanted = [getattr(number, end) for number in table]
        assert parameters.natural(theta)[straight].tolist() == wanted
        slots = np.full((1, len(robot.names)), share)
        simulated = parameters.values(slots)
        assert [simulated[parameters.base(i)][0] for i in straight] == wanted
    shares = [(n.high - n.low) / (n.high - n.low) for n in table]
    assert shares == [1.0] * len(table)


def test_no_number_is_simulated_beyond_its_range():
    """The sum -0.3 + (0.1 + 0.3) is beyond 0.1, where a simulator may have no value."""
    asked = []

    def decay(values, _):
        asked.append(values["rate"])
        return (values["rate"][:, None] * SECONDS)[:, :, None]

    robot = Robot(decay, {"rate": Number(-0.3, 0.1)}, {"level": "m"})
    noise = np.random.default_rng(0).normal(0.0, 0.01, SECONDS.shape)
    found = robot.infer([Trial((0.4 * SECONDS + noise)[:, None])], config=QUICK)
    assert found.table()["rate"][2] == 0.1
    rates = np.concatenate(asked)
    assert rates.max() == 0.1
    assert rates.min() >= -0.3


def test_numbers_are_ordered_by_what_is_asked_of_them():
    numbers = {
        "heading": Number.angle(),
        "speed": Number(0.0, sd=1.0, varies=True),
        "bias": Number(0.0, sd=0.1),
        "length": Number(0.2, 2.0),
        "servo": Number(0.0, 1.0, mean=1.0, switch=True),
        "mass": Number(1.0, 2.0, healthy=1.5),
        "phase": Number.angle(varies=False),
    }
    robot = replace(SOUGHT, numbers=numbers)
    assert robot.sought == ("length", "mass")
    assert robot.names == ("length", "mass", "bias", "servo", "speed", "heading", "phase")
    names = Unknowns.of(robot, 2, robot.groups).names
    assert names[:4] == ("length", "mass", "bias", "phase")
    assert names[4:] == ("speed@1", "heading@1", "speed@2", "heading@2")


def test_a_range_has_room_for_a_change_between_ends():
    """A uniform change has no sd, but it has ends."""
    number = moving("bias", Number(0.5, 0.8)).table["bias"]
    assert number.high == pytest.approx(0.8 + 5 * 0.1)
    assert number.low == -number.high


def test_a_number_that_a_hypothesis_moves_is_inferred_without_its_group():
    robot = replace(CART, hypotheses=[SENSOR_OFF])
    trial = measured(np.random.default_rng(0), bias=0.4)
    found = robot.infer([trial], config=replace(QUICK, nuisances=()))
    assert not Unknowns.of(robot, 1, ()).has("bias")
    assert found.probability("the sensor is off") > 0.99
    middle, low, high = found.broken("bias")
    assert low < 0.4 < high
    assert middle == pytest.approx(0.4, abs=0.05)


def sway(values, inputs):
    """Return a pendulum that swings from an angle, or one whose joint is stuck at it."""
    assert inputs is None
    angle = values["angle"][:, None]
    swing = values["servo"][:, None] * 9.0 * SECONDS
    return np.stack([np.cos(angle + swing), np.sin(angle + swing)], axis=-1)


SWAY = Robot(
    sway,
    {"servo": Number(0.0, 2.0, healthy=1.0), "angle": Number.angle()},
    {"x": "m", "y": "m"},
    hypotheses=[
        Hypothesis("stuck", fixed={"servo": 0.0}, moves={"angle": Number.angle(varies=False)})
    ],
)


def swayed(rng, **values):
    """Return a trial of the pendulum."""
    return record(sway, values, None, 0.1, rng)


def test_an_angle_moves_to_one_in_all_trials():
    rng = np.random.default_rng(0)
    stuck = SWAY.infer([swayed(rng, servo=0.0, angle=3.12) for _ in range(3)], config=QUICK)
    assert stuck.branches[0].hypothesis.name == "stuck"
    middle, low, high = stuck.broken("angle")
    off = math.remainder(middle - 3.12, math.tau)
    assert abs(off) < 0.03
    assert low < middle < high < low + 0.06  # as narrow as elsewhere, though it may cross pi
    apart = SWAY.infer([swayed(rng, servo=0.0, angle=a) for a in (0.5, 1.0, 2.0)], config=QUICK)
    assert not apart.good  # a stuck joint has one angle


@pytest.mark.parametrize(
    "gain", [Number(0.0, 2.0, healthy=1.0), Number(0.0, 2.0, mean=1.0, switch=True)]
)
def test_what_has_changed_is_known_afterwards(gain):
    """The robot after an answer has the new value as its prior, not the healthy one."""
    weak = Hypothesis("it is weak", moves={"gain": Number(0.0)})
    robot = replace(with_numbers(CART, gain=gain), hypotheses=[weak])
    found = robot.infer([measured(np.random.default_rng(1), gain=0.6)], config=QUICK)
    assert found.branches[0].hypothesis is weak
    known = found.branches[0].known(robot)
    assert set(known.healthy) == {"drag"}
    parameters = Unknowns.of(known, 1, known.groups)
    i = parameters.first_entry("gain")
    assert 2.0 * parameters.prior_mean[i] == pytest.approx(0.6, abs=0.05)
    assert parameters.prior_precision[i] > 100.0


HEALTHY = Number(0.0, 2.0, healthy=1.0)


@pytest.mark.parametrize(
    ("number", "change", "mean", "variance", "ends"),
    [
        (HEALTHY, Number(0.1, sd=0.3), 1.1, 0.09, (0.0, 2.0)),
        (HEALTHY, Number(mean=0.0, sd=0.3, high=0.0), 1.0, 0.09, (0.0, 1.0)),
        (HEALTHY, Number(0.0), 1.0, math.inf, (0.0, 2.0)),
        (Number(-2.0, 2.0, mean=0.1, sd=0.3), Number(0.0, sd=0.4), 0.1, 0.25, (-2.0, 2.0)),
    ],
)
def test_a_change_adds_to_what_was_known(number, change, mean, variance, ends):
    """Of a healthy number nothing else is known; of one with a prior the variances add."""
    changed = Hypothesis("it has changed", moves={"bias": change})
    robot = replace(with_numbers(CART, bias=number), hypotheses=[changed])
    parameters = Unknowns.of(robot, 1, robot.groups, changed)
    i = parameters.first_entry("bias")
    span = number.high - number.low
    shares = (parameters.low[i], parameters.high[i], parameters.prior_mean[i])
    assert [number.low + span * share for share in shares] == pytest.approx([*ends, mean])
    precision = parameters.prior_information[i, i]
    assert precision / span**2 == pytest.approx(1.0 / variance)


def constant(gain, **settings):
    """Return what 40 noisy readings of one number tell."""
    robot = Robot(
        lambda values, _: np.broadcast_to(
            values["gain"][:, None, None], (len(values["gain"]), 40, 1)
        ),
        {"gain": gain},
        {"rate": "rad/s"},
    )
    signal = 1.3 + np.random.default_rng(0).normal(0.0, 0.1, (40, 1))
    return robot.infer([Trial(signal)], config=replace(QUICK, **settings))


def test_a_robot_may_have_numbers_with_a_prior_alone():
    found = constant(Number(1.0, sd=0.5))
    middle, low, high = found.table()["gain"]
    assert low < 1.3 < high
    assert middle == pytest.approx(1.3, abs=0.05)
    assert found.model.shape == (0,)
    assert from_arrays(to_arrays(found)).to_dict() == found.to_dict()
    assert [one.name for one in found.identified().told] == ["gain"]
