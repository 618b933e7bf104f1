"""What trials determine: numbers, sums of numbers, and what another trial would tell."""

from __future__ import annotations

import numpy as np
import pytest

from eea import FitConfig, Number, Robot, Trial
from eea.core.checks import ConfigurationError, TargetError
from eea.infer.design import UNTOLD_SHARE

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


def weighed(with_b=1.0, noise=0.01):
    values = {name: np.array([x]) for name, x in TRUE.items()}
    signal = weigh(values, np.array([[with_b]]))[0]
    rng = np.random.default_rng(0)
    return Trial(signal + rng.normal(0.0, noise, signal.shape), [with_b])


TRUE = {"a": 0.7, "b": 0.4, "c": 2.0, "idle": 0.5, "tare": 0.1}
NOISE = {"one": 0.01, "two": 0.01}


@pytest.fixture(scope="module")
def found():
    return SCALES.infer([weighed()], noise=NOISE, config=EFFORT)


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


def test_a_robot_that_is_measured_has_no_findings():
    scale = Robot(
        lambda v, _: np.tile(v["a"][:, None, None], (1, 9, 1)),
        {"a": Number(0.0, 2.0)},
        {"s": "kg"},
    )
    signal = 0.7 + np.random.default_rng(0).normal(0.0, 0.01, (9, 1))
    assert scale.infer([Trial(signal)], noise={"s": 0.01}, config=EFFORT).findings == []


@pytest.mark.parametrize(("share", "told"), [(0.95, 1), (1.05, 0)])
def test_a_number_is_told_if_its_spread_shrinks_to_the_stated_share(share, told):
    """Nine samples of noise n have an sd of n / 3, and a range of 2 one of 2 / sqrt(12)."""
    scale = Robot(
        lambda v, _: np.tile(v["a"][:, None, None], (1, 9, 1)),
        {"a": Number(0.0, 2.0)},
        {"s": "kg"},
    )
    information = (share * UNTOLD_SHARE) ** -2 - 1.0  # of the samples, over the range's
    noise = 3.0 * 2.0 / (12.0 * information) ** 0.5
    belief = scale.infer([Trial(np.ones((9, 1)))], noise={"s": noise}, config=EFFORT)
    known = belief.identified()
    assert (len(known.told), len(known.untold)) == (told, 1 - told)


def test_the_trial_that_tells_more_comes_first(found):
    same = weighed()
    other = weighed(with_b=0.0)
    prospects = found.prospects({"same": same, "without b": other})
    assert list(prospects) == ["without b", "same"]
    assert list(prospects["without b"].identified.untold) == ["idle"]
    assert set(prospects["same"].identified.untold) == set(found.identified().untold)
    assert prospects["without b"].bits > prospects["same"].bits + 3.0


def test_a_prospect_is_what_the_trial_then_tells(found):
    other = weighed(with_b=0.0)
    expected = found.prospects({"other": other})["other"].identified
    after = SCALES.infer([weighed(), other], noise=NOISE, config=EFFORT).identified()
    assert [one.name for one in after.told] == [one.name for one in expected.told]
    for then, now in zip(after.told, expected.told, strict=True):
        assert then.sd == pytest.approx(now.sd, rel=0.01)


def test_the_values_of_a_trial_that_is_imagined_do_not_matter(found):
    signal = np.zeros((60, 2))
    signal[:, 1] = np.nan
    some = found.prospects({"one": Trial(signal, [0.0])})["one"]
    shifted = found.prospects({"one": Trial(signal + 1.0, [0.0])})["one"]
    assert some.bits == pytest.approx(shifted.bits, rel=1e-6)
    c = next(one for one in some.identified.told if one.name == "c")
    assert c.sd == pytest.approx(
        next(one for one in found.identified().told if one.name == "c").sd, rel=1e-9
    )


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


def test_no_trials_are_refused(found):
    with pytest.raises(ConfigurationError, match="trials must be one or more, by name; got none"):
        found.prospects({})


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

    def brittle(values, _):
        signal = np.tile(values["a"][:, None, None], (1, 9, 1))
        return signal * np.nan if diverges else signal

    robot = Robot(brittle, {"a": Number(0.0, 2.0)}, {"s": "kg"})
    signal = 0.7 + np.random.default_rng(0).normal(0.0, 0.01, (9, 1))
    found = robot.infer([Trial(signal)], noise={"s": 0.01}, config=EFFORT)
    diverges.append(True)
    with pytest.raises(TargetError, match="does not stay finite near the best fit"):
        found.identified()
    assert found.findings == []


def test_a_robot_of_which_all_is_known_has_nothing_to_tell():
    robot = Robot(
        lambda v, _: np.tile(v["a"][:, None, None], (1, 9, 1)),
        {"a": Number(0.0, 2.0, healthy=0.7)},
        {"s": "kg"},
        hypotheses=(),
    )
    signal = 0.7 + np.random.default_rng(0).normal(0.0, 0.01, (9, 1))
    known = robot.infer([Trial(signal)], noise={"s": 0.01}, config=EFFORT).identified()
    assert known.told == ()
    assert known.findings == []
