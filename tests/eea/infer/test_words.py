"""What is said of an answer: findings, hypotheses, and what the trials determine."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from cart import record
from eea import FitConfig, Trial
from eea.core.checks import TargetError
from eea.core.experiment import RecordedLog
from eea.fish.hypotheses import AS_COMMANDED
from eea.infer import fit as inference
from eea.infer.descent import Fitted
from eea.infer.design import UNTOLD_SHARE
from eea.infer.mixture import Mixture
from eea.infer.robot import Robot
from eea.infer.search import search
from eea.infer.session import JointInference
from eea.infer.statement import NOTHING_BROKEN, Hypothesis, Number, Part
from eea.infer.unknowns import FIXED_PRECISION
from eea.infer.words import Fit, faults, findings
from linear_worlds import mode
from swing import CONFIG, PROBLEM, SIGMA, SWING, infer, simulate

NAMES = ("fin.length", "fin.width", "fin.thickness", "tail.length", "tail.width", "gain", "phase")
CIRCULAR = np.array([False] * 6 + [True])
RANGES = (2.0, 1.0, 0.1, 2.0, 1.0, 1.2)
NUMBERS = {name: Number(0.0, high) for name, high in zip(NAMES, RANGES, strict=False)}
NUMBERS["phase"] = Number.angle()
SIZES = {name: name.partition(".")[2] for name in NAMES[:5]}
FIN = Part({name: SIZES[name] for name in NAMES[:3]}, NAMES[:2], "faster flippers would tell")
TAIL = Part({name: SIZES[name] for name in NAMES[3:5]}, NAMES[3:5], "a faster tail would tell")
BOTH = {"fin": FIN, "tail": TAIL}
KNOWN = np.full(7, 1e4)
MIDDLE = np.full(7, 0.5)


def known(*modes):
    return Mixture(NAMES, np.zeros(7), np.ones(7), CIRCULAR, modes)


def robot_of(parts):
    return Robot(lambda *_: None, NUMBERS, {"gyro": "rad/s"}, parts=parts, nominal=AS_COMMANDED)


def said_of(posterior, parts=BOTH):
    """Return the findings on a robot of these parts."""
    return findings(posterior, robot_of(parts))


def test_a_known_an_absent_and_an_untold_body():
    assert said_of(known(mode(MIDDLE, np.diag(KNOWN), 0.0))) == []
    theta, precision = MIDDLE.copy(), KNOWN.copy()
    theta[0], precision[1:3] = 0.0, 0.0
    (said,) = said_of(known(mode(theta, np.diag(precision), 0.0)))
    assert said.startswith("the fin is absent: its area is at most 0.0")
    precision[:5] = 0.0
    said = said_of(known(mode(MIDDLE, np.diag(precision), 0.0)))
    assert said == ["the data do not constrain the body: no size is determined"]


@pytest.mark.parametrize(("pull", "theta", "beyond"), [(6, 1, 1), (3, 1, 0), (-6, 0, 0)])
def test_a_size_that_would_rather_be_beyond_its_range_is_named(pull, theta, beyond):
    """A best fit so many sd, 0.01, above the range; below it there is nothing."""
    at, slope = MIDDLE.copy(), np.zeros(7)
    at[0], slope[0] = theta, -100.0 * pull
    said = said_of(
        known(mode(at, np.diag(KNOWN), 0.0, slope)), {"tail": TAIL, "fin": replace(FIN, area=())}
    )
    expected = "the fin's length is at the end of its range, 2, and may be beyond it"
    assert said == [expected] * beyond


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_two_sizes_that_trade_off_are_named_with_what_would_tell(sign):
    information = np.diag(KNOWN)
    information[3:5, 3:5] = 1e4 * np.array([[1.0, 0.99 * sign], [0.99 * sign, 1.0]])
    found = known(mode(MIDDLE, information, 0.0))
    assert said_of(found) == ["the tail's length and width trade off; a faster tail would tell"]
    assert said_of(found, {"fin": FIN}) == []


def test_a_size_that_is_not_told_is_named_with_its_range_in_its_unit():
    precision = KNOWN.copy()
    precision[2] = 0.0
    (said,) = said_of(known(mode(MIDDLE, np.diag(precision), 0.0)))
    told = re.fullmatch(
        "the data do not tell the fin's thickness: anything from (.*) to (.*); "
        "faster flippers would tell",
        said,
    )
    assert [float(end) for end in told.groups()] == pytest.approx([0.005, 0.095], abs=0.002)


def test_several_bodies_are_told_with_their_weights_where_they_differ():
    other = MIDDLE.copy()
    other[3] = 0.8
    odds = np.log(0.7 / 0.3)
    found = known(mode(MIDDLE, np.diag(KNOWN), 0.0), mode(other, np.diag(KNOWN), odds))
    expected = "2 bodies explain it: 70% the tail's length 1, or 30% the tail's length 1.6"
    assert said_of(found)[0] == expected


@pytest.mark.parametrize(("low", "high", "bodies"), [(0.0, 1.0, 1), (0.4, 0.6, 2)])
def test_bodies_that_differ_by_less_than_a_hundredth_of_the_range_are_one(low, high, bodies):
    other = MIDDLE.copy()
    other[3] += 0.005  # 50 sd
    modes = tuple(mode(at, np.diag(1e8 * np.ones(7)), 0.0) for at in (MIDDLE, other))
    found = Mixture(NAMES, np.full(7, low), np.full(7, high), CIRCULAR, modes)
    assert len(found.modes) == 2
    assert [said[:22] for said in said_of(found)] == ["2 bodies explain it: 5"] * (bodies - 1)


def test_modes_of_other_angles_and_nuisances_are_one_body():
    other = MIDDLE.copy()
    other[5], other[6] = 0.1, 2.5
    modes = (mode(MIDDLE, np.diag(KNOWN), 0.0), mode(other, np.diag(KNOWN), 0.0))
    assert len(known(*modes).modes) == 2
    assert said_of(known(*modes)) == []
    other[3] += 0.015  # a sd and a half: the shapes of the two lengths overlap
    assert said_of(known(modes[0], mode(other, np.diag(KNOWN), 0.0))) == []
    gain = {"servos": Part({"gain": "gain"})}
    assert said_of(known(*modes), gain)[0].startswith("2 bodies explain it: ")


def test_numbers_have_the_units_that_the_robot_states():
    at = MIDDLE.copy()
    slope = np.zeros(7)
    at[0] = 1.0
    slope[0] = -600.0
    metres = {name: replace(NUMBERS[name], unit="m") for name in ("fin.length", "fin.width")}
    robot = replace(robot_of({"fin": FIN}), numbers={**NUMBERS, **metres})
    (said,) = findings(known(mode(at, np.diag(KNOWN), 0.0, slope)), robot)
    assert said == "the fin's length is at the end of its range, 2 m, and may be beyond it"
    at[0] = 0.0
    (said,) = findings(known(mode(at, np.diag(KNOWN), 0.0)), robot)
    assert said.startswith("the fin is absent")
    assert said.endswith(" m^2")


def test_nothing_is_said_of_the_servo_of_an_absent_part():
    """The tail is not absent and its servo seized: what is not there cannot be stuck."""
    theta, precision = MIDDLE.copy(), KNOWN.copy()
    theta[3], precision[4] = 0.0, 0.0
    absent = known(mode(theta, np.diag(precision), 0.0))
    joint = robot_of(BOTH)
    seized = Hypothesis("the servo of the tail is seized", part="tail")
    gone = {"tail.length": 0.0, "tail.width": 0.0}
    missing = Hypothesis("the tail is missing", gone, part="tail")
    other = Hypothesis("the servo of the fin is dead", part="fin")
    fits = [Fit(AS_COMMANDED, 0.8, 0.0), Fit(seized, 0.05, 3.0), Fit(missing, 0.1, 2.0)]
    first, second = findings(absent, joint, [*fits, Fit(other, 0.05, 9.0)])
    assert first == "the servo of the fin is dead (5%)"
    assert second.startswith("the tail is absent: its area")
    said = findings(absent, joint, [Fit(missing, 0.9, 0.0), Fit(seized, 0.1, 9.0)])
    assert said == ["the tail is missing (90%)"]
    present = known(mode(MIDDLE, np.diag(KNOWN), 0.0))
    said = findings(present, joint, [Fit(seized, 0.9, 0.0), Fit(AS_COMMANDED, 0.1, 9.0)])
    assert said == ["the servo of the tail is seized (90%)"]


def test_causes_that_fit_alike_are_one_statement_and_others_are_named_apart():
    robot = robot_of({"fin": replace(FIN, hint="a faster fin would tell")})
    seized, missing, fouled = (
        Hypothesis(name, part="fin")
        for name in ("the servo is seized", "the fin is missing", "weed hangs on the fin")
    )
    said = "; the data fit nearly alike if "
    hint = "; a faster fin would tell"
    two = [Fit(seized, 0.6, 0.0), Fit(missing, 0.3, 0.1), Fit(robot.nominal, 0.1, 0.5)]
    assert faults(two, robot) == [
        f"the servo is seized (60%){said}the fin is missing (30%) or nothing is wrong with it{hint}"
    ]
    three = [Fit(seized, 0.5, 0.0), Fit(missing, 0.3, 0.1), Fit(fouled, 0.2, 0.2)]
    assert faults(three, robot) == [
        f"the servo is seized (50%){said}the fin is missing (30%) or "
        f"weed hangs on the fin (20%){hint}"
    ]
    alone = [Fit(seized, 0.98, 0.0), Fit(missing, 0.02, 9.0), Fit(robot.nominal, 0.0, 40.0)]
    assert faults(alone, robot) == ["the servo is seized (98%)", "the fin is missing (2%)"]


SLIPPERY = "the arm has no friction"
SLIPPERY_ARM = replace(
    SWING,
    hypotheses=(*SWING.alternatives, Hypothesis(SLIPPERY, {"arm.friction": 0.0}, part="arm")),
    parts={"arm": replace(SWING.parts["arm"], area=("arm.length", "arm.friction"))},
)


def slippery_session():
    """Return a session with a robot of which a part does nothing."""
    rng = np.random.default_rng(2)

    class Slippery:
        def perform(self, command):
            true = {"arm.length": 1.3, "arm.friction": 0.0, "bias": 0.0, "motor": 1.0, "angle": 0.5}
            values = {name: np.array([value]) for name, value in true.items()}
            felt = simulate(values, command[None])[0]
            return RecordedLog(gyro=felt + SIGMA * rng.normal(size=felt.shape))

    return JointInference(Slippery(), SLIPPERY_ARM, PROBLEM, CONFIG)


def weighed(method):
    return {branch.hypothesis.name for branch in method.result.belief.branches}


def optima_of(method):
    return dict(method.result.belief.warm_start.optima)


def test_what_was_probable_is_weighed_on(monkeypatch):
    """A sliver explains a missing part a little better than none: that is no reason to forget."""
    method = slippery_session()
    rounds = iter(method)
    next(rounds)
    assert SLIPPERY in weighed(method)
    monkeypatch.setattr(inference, "ABSENT_SIZE_SHARE", -1.0)  # now nothing seems to be absent
    next(rounds)
    assert SLIPPERY in weighed(method)
    assert method.result.belief.branches[0].hypothesis.name == SLIPPERY


def test_a_part_may_be_absent_though_the_best_has_some_of_it(monkeypatch):
    monkeypatch.setattr(inference, "ABSENT_SIZE_SHARE", 1e-9)
    method = slippery_session()
    next(iter(method))
    assert optima_of(method)[NOTHING_BROKEN.name].fits.theta[0, 1] > 1e-9
    assert SLIPPERY in weighed(method)


def test_optimum_of_another_hypothesis_starts_the_search_without_fault(monkeypatch):
    """Or a better search would pass for evidence."""

    def worse(regression, *args, **settings):
        found = search(regression, *args, **settings)
        if regression.parameters.prior_precision[1] == FIXED_PRECISION:  # the arm has no friction
            return found
        missed = found.fits.theta[:1].copy()
        missed[:, 0] = 0.1
        return replace(found, fits=Fitted(missed, np.array([1e3]), np.array([1e6])))

    monkeypatch.setattr(inference, "search", worse)
    method = slippery_session()
    next(iter(method))
    for name in (SLIPPERY, NOTHING_BROKEN.name):
        assert optima_of(method)[name].fits.theta[0, 0] == pytest.approx(0.65, abs=0.01)


def test_hypotheses_that_fail_have_no_probability_in_the_findings():
    belief = infer(motor=0.0, alternatives="always").belief
    assert belief.good
    assert belief.findings[0].startswith("the motor is dead (")
    wrong = replace(belief.goodness, good=False, verdict="no body explains the log")
    assert replace(belief, goodness=wrong).findings[:2] == [
        "no body explains the log",
        "the best of the hypotheses that fail: the motor is dead",
    ]


TIME = np.arange(60)
EFFORT = FitConfig(bodies=8, poses=2, descents=4, polished=1, restarts=0)


def weigh(values, inputs):
    """Return two scales (B, T, 2): of the sum of two masses, and of the third with a tare.

    The input says with which weight the second mass is on the first scale.
    """
    first = values["a"] + 2.0 * values["b"] * inputs[:, 0]
    second = values["c"] * (1.0 + 0.1 * np.sin(TIME)[:, None]) + values["tare"]
    first = np.broadcast_to(first, second.shape)
    return np.stack([first.T, second.T], axis=-1)


SCALES = Robot(
    simulate=weigh,
    numbers={
        "a": Number(0.0, 2.0, unit="kg"),
        "b": Number(0.0, 1.0, unit="kg"),
        "c": Number(0.0, 5.0, unit="kg"),
        "idle": Number(0.0, 1.0),
        "tare": Number(-1.0, 1.0, mean=0.0, sd=0.3, varies=True),
    },
    channels={"one": "kg", "two": "kg"},
)


def trial_of(with_b=1.0, noise=0.01):
    return record(weigh, TRUE, np.array([with_b]), noise)


TRUE = {"a": 0.7, "b": 0.4, "c": 2.0, "idle": 0.5, "tare": 0.1}
NOISE = {"one": 0.01, "two": 0.01}


@pytest.fixture(scope="module")
def found():
    return SCALES.infer([trial_of()], noise=NOISE, config=EFFORT)


def test_a_sum_is_told_and_its_terms_are_not(found):
    known = found.identified()
    (total,) = (one for one in known.told if len(one.coefficients) == 2)
    (other,) = set(total.coefficients) - {next(iter(total.coefficients))}
    first = next(iter(total.coefficients))
    ratio = {"a": 1.0, "b": 2.0}
    assert total.coefficients[other] == pytest.approx(ratio[other] / ratio[first], rel=1e-6)
    expected = sum(factor * TRUE[name] for name, factor in total.coefficients.items())
    assert total.value == pytest.approx(expected, abs=4.0 * total.sd)
    assert total.sd == pytest.approx(0.01 / 60**0.5 / ratio[first], rel=0.2)
    assert known.untold == {other: (first,), "idle": ()}


def test_numbers_that_no_other_hides_are_told_alone(found):
    (alone,) = (one for one in found.identified().told if len(one.coefficients) == 1)
    assert alone.name == "c"
    assert alone.value == pytest.approx(2.0, abs=4.0 * alone.sd)
    # The trial's own tare is integrated out.
    assert alone.sd > 0.01 / 60**0.5


def test_the_findings_are_the_gaps_in_words(found):
    first, second = found.identified().gaps
    assert first.startswith("measured only together: ")
    assert second.startswith("not measured: ")
    assert "idle" in second
    assert found.findings == [first, second]


def scale_of_one(**number):
    """Return a scale that reads one mass nine times, and a trial of 0.7 kg."""
    robot = Robot(
        lambda values, _: np.tile(values["a"][:, None, None], (1, 9, 1)),
        {"a": Number(0.0, 2.0, **number)},
        {"s": "kg"},
        hypotheses=(),
    )
    return robot, Trial(0.7 + np.random.default_rng(0).normal(0.0, 0.01, (9, 1)))


def test_a_robot_that_is_measured_or_known_has_no_findings():
    for number in ({}, {"healthy": 0.7}):
        scale, trial = scale_of_one(**number)
        found = scale.infer([trial], noise={"s": 0.01}, config=EFFORT)
        assert found.findings == []
        assert len(found.identified().told) == (not number)


@pytest.mark.parametrize(("share", "told"), [(0.95, 1), (1.05, 0)])
def test_a_number_is_told_if_its_spread_shrinks_to_the_stated_share(share, told):
    """Nine samples of noise n have an sd of n / 3, and a range of 2 one of 2 / sqrt(12)."""
    information = (share * UNTOLD_SHARE) ** -2 - 1.0  # of the samples, over the range's
    noise = 3.0 * 2.0 / (12.0 * information) ** 0.5
    belief = scale_of_one()[0].infer([Trial(np.ones((9, 1)))], noise={"s": noise}, config=EFFORT)
    known = belief.identified()
    assert (len(known.told), len(known.untold)) == (told, 1 - told)


def test_the_trial_that_tells_more_comes_first(found):
    same = trial_of()
    other = trial_of(with_b=0.0)
    prospects = found.prospects({"same": same, "without b": other})
    assert list(prospects) == ["without b", "same"]
    assert list(prospects["without b"].identified.untold) == ["idle"]
    assert set(prospects["same"].identified.untold) == set(found.identified().untold)
    assert prospects["without b"].bits > prospects["same"].bits + 3.0


def test_a_prospect_is_what_the_trial_then_tells(found):
    other = trial_of(with_b=0.0)
    expected = found.prospects({"other": other})["other"].identified
    after = SCALES.infer([trial_of(), other], noise=NOISE, config=EFFORT).identified()
    assert [one.name for one in after.told] == [one.name for one in expected.told]
    for then, now in zip(after.told, expected.told, strict=True):
        assert then.sd == pytest.approx(now.sd, rel=0.01)


def test_the_values_of_a_trial_that_is_imagined_do_not_matter(found):
    signal = np.zeros((60, 2))
    signal[:, 1] = np.nan
    some, shifted = (
        found.prospects({"one": Trial(one, [0.0])})["one"] for one in (signal, signal + 1.0)
    )
    assert some.bits == pytest.approx(shifted.bits, rel=1e-6)
    then, now = (
        next(one.sd for one in known.told if one.name == "c")
        for known in (some.identified, found.identified())
    )
    assert then == pytest.approx(now, rel=1e-9)


def test_a_nuisance_that_its_prior_tells_as_well_is_open():
    robot = Robot(
        lambda v, _: np.tile((v["a"] + v["tare"])[:, None, None], (1, 9, 1)),
        {"a": Number(0.0, 2.0), "tare": Number(0.0, sd=0.001)},
        {"s": "kg"},
    )
    signal = 0.7 + np.random.default_rng(0).normal(0.0, 0.01, (9, 1))
    known = robot.infer([Trial(signal)], noise={"s": 0.01}, config=EFFORT).identified()
    assert [one.name for one in known.told] == ["a"]
    assert known.untold == {"tare": ()}


def test_a_trial_that_magnifies_small_differences_tells_no_more_than_a_sum():
    def shake(values, stretch):
        phase = values["a"] + 2.0 * values["b"]
        return np.sin(stretch[:, :1] * phase[:, None] * np.linspace(0.5, 1.0, 200))[:, :, None]

    robot = Robot(shake, {"a": Number(0.0, 1.0), "b": Number(0.0, 1.0)}, {"signal": "V"})
    signal = shake({"a": np.array([0.3]), "b": np.array([0.4])}, np.array([[1.0]]))[0]
    signal += np.random.default_rng(0).normal(0.0, 0.001, signal.shape)
    found = robot.infer([Trial(signal, [1.0])], noise={"signal": 0.001}, config=EFFORT)
    wild = found.prospects({"wild": Trial(signal, [2e4])})["wild"]
    assert len(wild.identified.untold) == 1
    assert len(wild.identified.told) == 1


def test_where_nearby_robots_diverge_there_are_no_findings():
    diverges = []
    scale, trial = scale_of_one()
    brittle = replace(
        scale, simulate=lambda *given: scale.simulate(*given) * (np.nan if diverges else 1.0)
    )
    found = brittle.infer([trial], noise={"s": 0.01}, config=EFFORT)
    diverges.append(True)
    with pytest.raises(TargetError, match="does not stay finite near the best fit"):
        found.identified()
    assert found.findings == []
