"""Strangers' simulators: of one candidate, failing, slow, rough; and their budget."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from cart import CART, PUSH, QUICK, SD, SOUGHT, TRUTH, measured, record, roll
from eea import FitConfig, Hypothesis, Number, Robot, Trial, one_by_one
from eea.core.checks import ConfigurationError, TargetError
from eea.infer.roughness import Near

TURN = 2.0 * np.pi
HELM = np.random.default_rng(0).uniform(-1.0, 1.0, 20).repeat(10)
COURSE = {
    "gain": Number(0.1, 3.0),
    "drag": Number(0.05, 2.0),
    "heading": Number(-3.2, 3.2, mean=0.0, sd=2.0, varies=True),
}


def one_cart(values, push):
    signal = roll({name: np.array([value]) for name, value in values.items()}, push[None])
    return signal[0]


def wrapped(angle):
    return (angle + TURN / 2) % TURN - TURN / 2


def steer(values, thrust, wraps, scale=1.0):
    """Return rates and headings (B, T, 2) in rad/s and rad, or in other units."""
    rate = np.zeros(len(thrust))
    heading = values["heading"].copy()
    out = np.empty((*thrust.shape, 2))
    for step in range(thrust.shape[1]):
        rate = rate + 0.1 * (values["gain"] * thrust[:, step] - values["drag"] * rate)
        heading = heading + 0.1 * rate
        out[:, step] = np.stack([rate, wrapped(heading) if wraps else heading], axis=-1)
    return out * [1.0, scale]


def ship(log_wraps, simulator_wraps, unit, scale=1.0):
    """Return what is inferred of a ship whose heading crosses half a turn."""
    true = {"gain": 1.3, "drag": 0.6, "heading": 2.5}
    signal = record(lambda *given: steer(*given, False), true, HELM, [0.02, 0.05]).signal
    if log_wraps:
        signal[:, 1] = wrapped(signal[:, 1])
    robot = Robot(
        lambda values, thrust: steer(values, thrust, simulator_wraps, scale),
        COURSE,
        {"gyro": "rad/s", "compass": unit},
    )
    found = robot.infer([Trial(signal * [1.0, scale], HELM)])
    return found, true


@pytest.mark.parametrize(
    ("unit", "scale"),
    [
        ("deg, wraps", 360.0 / TURN),
        *(
            pytest.param(unit, scale, marks=pytest.mark.slow)
            for unit, scale in (("rad, wraps", 1.0), ("rev, wraps", 1 / TURN))
        ),
    ],
)
def test_a_compass_that_wraps_is_compared_the_short_way(unit, scale):
    plain, true = ship(False, False, unit.partition(",")[0], scale)
    assert plain.findings == []  # a heading that goes on beyond a turn is no jump
    for log_wraps, simulator_wraps in ((1, 1), (1, 0), (0, 1), (0, 0)):
        found, _ = ship(log_wraps, simulator_wraps, unit, scale)
        assert found.good, found.verdict
        assert found.findings == []
        for name, row in found.table().items():
            assert row[1] < true[name.partition("@")[0]] < row[2]
            assert row == pytest.approx(plain.table()[name], rel=1e-3)


@pytest.mark.parametrize(
    ("log_wraps", "simulator_wraps"), [(1, 1), (1, 0), pytest.param(0, 1, marks=pytest.mark.slow)]
)
def test_a_compass_that_wraps_unsaid_is_named_with_the_way_out(log_wraps, simulator_wraps):
    found, _ = ship(log_wraps, simulator_wraps, "rad")
    (said,) = [one for one in found.findings if one.startswith("compass ")]
    assert "state its unit as 'rad, wraps'" in said


def attitude(values, times):
    half = 0.5 * (values["rate"][:, None] * times + 0.3)
    zero = np.zeros_like(half)
    return np.stack([np.cos(half), np.sin(half), zero, zero], axis=-1)


@pytest.mark.parametrize("unit", ["quaternion", "1"])
def test_a_quaternion_has_two_signs(unit):
    log = record(attitude, {"rate": 0.7}, 0.1 * np.arange(1.0, 61.0), 0.01)
    log.signal[20:35] *= -1.0
    names = ("q w", "q x", "q y", "q z")
    robot = Robot(attitude, {"rate": Number(0.0, 2.0)}, dict.fromkeys(names, unit))
    found = robot.infer([log])
    if unit == "quaternion":
        assert found.good, found.verdict
        _, low, high = found.table()["rate"]
        assert low < 0.7 < high < low + 0.02
    else:
        assert any("change their sign at once 2 times in the log" in f for f in found.findings)


def test_a_channel_of_an_unknown_kind_is_refused():
    for channels, said in (
        ({"a": "m, wraps"}, "the unit of a must be a plain one, or one of 'rad, wraps', 'deg, "),
        ({"a": "rad wraps"}, "the unit of a must be a plain one"),
        (dict.fromkeys("abc", "quaternion"), "must be four, one after the other; got 3"),
        ({"a": "quaternion", "b": "m"}, "must be four, one after the other; got 1"),
    ):
        with pytest.raises(ConfigurationError) as refused:
            Robot(attitude, {"rate": Number(0.0, 2.0)}, channels)
        assert said in str(refused.value)


LOG = measured(np.random.default_rng(0))


def test_a_simulator_of_one_trial_gives_the_same_answer():
    trials = [LOG, measured(np.random.default_rng(1), PUSH[:40])]
    one = replace(CART, simulate=one_by_one(one_cart)).infer(trials, config=QUICK)
    assert one.table() == CART.infer(trials, config=QUICK).table()

    def give_up(values, push):
        if values["gain"] > 1.5:
            raise ArithmeticError("no solution")
        return one_cart(values, push)

    found = replace(SOUGHT, simulate=one_by_one(give_up)).infer([LOG], config=QUICK)
    assert found.good
    (said,) = [one for one in found.findings if "raised" in one]
    assert re.search(r"first ArithmeticError \(no solution\) at gain 1\.\d+, drag", said)


def test_a_signal_of_one_trial_has_a_shape_that_does_not_change():
    with pytest.raises(ConfigurationError, match=r"the signal \(T, channels\) of one trial"):
        one_by_one(lambda _, push: push)({"gain": np.ones(2)}, np.ones((2, 5)))
    lengths = iter((3, 4))
    with pytest.raises(ConfigurationError, match=r"of shape \(3, 1\) and \(4, 1\)"):
        one_by_one(lambda *_: np.ones((next(lengths), 1)))({"gain": np.ones(2)}, None)


@pytest.mark.parametrize(
    "simulate",
    [
        lambda values, push: np.stack([values["gain"] * push[0]] * 2, axis=-1),
        lambda values, push: one_cart({n: v[0] for n, v in values.items()}, push[0]),
        lambda values, push: one_cart({n: float(v) for n, v in values.items()}, push),
    ],
)
def test_a_simulator_of_one_candidate_is_told_how_to_be_wrapped(simulate):
    with pytest.raises(ConfigurationError, match=r"one_by_one\(simulate\)"):
        replace(SOUGHT, simulate=simulate).infer([LOG], config=QUICK)


@pytest.mark.parametrize("evaluations", [30, 100, 250])
def test_a_budget_ends_the_search_with_the_best_so_far(evaluations):
    calls = []

    def simulate(values, push):
        calls.append(len(push))
        return roll(values, push)

    robot = replace(SOUGHT, simulate=simulate)
    config = FitConfig(alternatives="always", evaluations=evaluations)
    found = robot.infer([LOG], config=config)
    assert not found.good
    assert found.verdict.startswith(f"unfinished, by the budget of {evaluations} simulations")
    assert found.findings[0] == found.verdict
    assert sum(calls) < evaluations + 150  # what the answer asks of the best so far
    assert found.table()["gain"][0] == pytest.approx(TRUTH["gain"], abs=0.3)
    assert found.table() == robot.infer([LOG], config=config).table()
    assert found.prospects({"again": LOG})  # an answer may be asked beyond its budget
    if evaluations > 30:
        assert found.identified().told


def test_a_budget_that_suffices_changes_nothing_and_one_too_small_says_so():
    found = SOUGHT.infer([LOG], config=replace(QUICK, evaluations=10**6))
    assert found.table() == SOUGHT.infer([LOG], config=QUICK).table()
    assert found.good
    with pytest.raises(TargetError, match="the budget of 1 simulations ended the search before"):
        SOUGHT.infer([LOG], config=FitConfig(evaluations=1))


def test_ctrl_c_gives_the_best_so_far():
    calls = []

    def interrupted(values, push):
        calls.append(len(push))
        if sum(calls) > 150 and not any(n < 0 for n in calls):
            calls.append(-1)
            raise KeyboardInterrupt
        return roll(values, push)

    found = replace(SOUGHT, simulate=interrupted).infer([LOG])
    assert found.verdict.startswith("unfinished, by Ctrl-C: so far the best fit leaves")
    assert not found.good


def test_the_log_density_is_that_of_the_posterior():
    rng = np.random.default_rng(3)
    trials = [measured(rng), measured(rng, PUSH[:40])]
    density = SOUGHT.log_density(trials, dict(zip(CART.channels, SD, strict=True)))
    assert density.names == ("gain", "drag", "bias")
    assert (density.low[0], density.high[0]) == (0.0, 2.0)
    vectors = rng.normal([1.0, 1.0, 0.0], [0.05, 0.05, 0.02], (50, 3))
    expected = -0.5 * (vectors[:, 2] / 0.1) ** 2
    for trial in trials:
        values = dict(zip(density.names, vectors.T, strict=True))
        apart = (roll(values, np.tile(trial.inputs, (50, 1))) - trial.signal) / SD
        expected -= 0.5 * (apart**2).sum(axis=(1, 2))
    got = density(vectors)
    np.testing.assert_allclose(got - got[0], expected - expected[0], rtol=1e-9, atol=1e-6)
    assert density(vectors[3]) == got[3]
    for gain in (-1.0, 2.5):
        assert density([gain, 1.0, 0.0]) == -np.inf
    with pytest.raises(ConfigurationError, match="vectors must have shape"):
        density(vectors[0, :2])


def test_an_angle_of_the_log_density_has_any_value():
    """A turn more is the same angle."""
    times = 0.1 * np.arange(40.0)
    wheel = Robot(
        lambda values, times: np.sin(times + values["phase"][:, None])[:, :, None],
        {"phase": Number.angle()},
        {"signal": "V"},
    )
    density = wheel.log_density([Trial(np.sin(times + 1.0)[:, None], times)], {"signal": 0.1})
    assert density.names == ("phase@1",)
    np.testing.assert_allclose(density([[1.0], [1.0 + TURN], [1.0 - TURN]]), 0.0, atol=1e-9)


THRUST = np.random.default_rng(3).uniform(-1.0, 1.0, 20).repeat(10)
TRUE = {"gain": 1.3, "drag": 0.6}


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

    log = record(simulate, true, THRUST, 0.02, 4)
    robot = Robot(counted, numbers, {"speed": "m/s"}, **statement)
    found = robot.infer([Trial(log.signal + beside, THRUST)], config=config)
    return found, count


VEHICLE = {"gain": Number(0.1, 3.0), "drag": Number(0.05, 2.0)}


def test_a_short_search_of_some_hundred_simulations_ends_where_a_long_one_does():
    found, few = fitted(drive, VEHICLE, TRUE)
    long, many = fitted(drive, VEHICLE, TRUE, FitConfig(bodies=400, descents=100))
    assert few < 400
    assert few < 0.5 * many
    assert found.good
    for name, row in found.table().items():
        assert row == pytest.approx(long.table()[name], rel=1e-3)
    for name, (_, low, high) in found.table(0.99).items():
        assert low < TRUE[name] < high


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


def test_an_unknown_angle_and_its_mirror_are_found_by_a_short_search():
    true = {"length": 0.63, "angle": 2.0}
    found, count = fitted(swing, PENDULUM, true)
    assert count < 4000  # 16,000 if a scan of all poses came first
    assert found.good
    for name, key in (("length", "length"), ("angle", "angle@1")):
        _, low, high = found.table(0.99)[key]
        assert low < true[name] < high

    def squared(values, torque):
        return swing(values, 0.0 * torque) ** 2

    found, _ = fitted(squared, PENDULUM, true)
    angles = [mode.theta[1] for mode in found.branches[0].posterior.modes]
    assert np.sort(angles) == pytest.approx([-2.0, 2.0], abs=0.02)


def test_a_budget_may_end_anywhere():
    """In a search, or where its answer is weighed."""
    _, whole = fitted(drive, VEHICLE, TRUE)
    for budget in range(20, whole + 10, 17):
        found, count = fitted(drive, VEHICLE, TRUE, FitConfig(evaluations=budget))
        assert count <= budget + 40
        assert found.good == (not found.ended)


RISE_NOISE = 0.05


def fall(values, time):
    """Return a smooth signal of two numbers."""
    rise = 1.0 - np.exp(-values["rate"][:, None] * time)
    return (values["size"][:, None] * rise)[:, :, None]


RISE_TIME = np.linspace(0.1, 5.0, 60)
RISE = {"size": 1.2, "rate": 0.8}
RANGES = {"size": (0.1, 3.0), "rate": (0.1, 3.0)}


def found_with(simulate, ranges=RANGES, true=RISE, inputs=RISE_TIME, smooth=None):
    """Return what is inferred by a simulator from a log of it, or of a smooth one."""
    numbers = {name: Number(*ends) for name, ends in ranges.items()}
    log = record(smooth or simulate, true, inputs, RISE_NOISE)
    return Robot(simulate, numbers, {"y": "V"}).infer([log])


def widths(found):
    return np.array([high - low for _, low, high in found.table().values()])


def wiggling(values, time):
    """Return the signal with a jitter of a thousandth of the noise."""
    jitter = np.sin(1e9 * values["size"][:, None] + 1e8 * values["rate"][:, None] + 1e5 * time)
    return fall(values, time) + 1e-3 * RISE_NOISE * jitter[:, :, None]


def single(values, time):
    """Return the signal in single precision."""
    rise = 1.0 - np.exp(-values["rate"][:, None].astype(np.float32) * time.astype(np.float32))
    return (values["size"][:, None].astype(np.float32) * rise)[:, :, None]


@pytest.mark.parametrize("rough", [wiggling, single])
def test_a_rough_simulator_gives_the_intervals_of_a_smooth_one(rough):
    found, smooth = found_with(rough, smooth=fall), found_with(fall)
    assert smooth.warm_start.roughness.smooth
    assert not any("jitters" in said or "end of its range" in said for said in smooth.findings)
    assert widths(found) == pytest.approx(widths(smooth), rel=0.1)
    said = any("derivatives use steps" in words for words in found.findings)
    assert said == (not found.warm_start.roughness.smooth)
    jitters = any(words.startswith("simulate jitters by 0.00") for words in found.findings)
    assert jitters == (rough is wiggling)


def test_a_simulator_that_does_not_repeat_is_said_and_has_right_intervals():
    rng = np.random.default_rng(5)

    def unsteady(values, time):
        signal = fall(values, time)
        return signal + rng.normal(0.0, 1e-3 * RISE_NOISE, signal.shape)

    found = found_with(unsteady, smooth=fall)
    assert widths(found) == pytest.approx(widths(found_with(fall)), rel=0.1)
    assert any("other numbers for the same values" in words for words in found.findings)


def delayed(values, sent):
    late = np.arange(sent.shape[1])[None] - np.round(values["delay"]).astype(int)[:, None]
    there = np.where(late >= 0, np.take_along_axis(sent, np.maximum(late, 0), 1), 0.0)
    return (values["gain"][:, None] * there)[:, :, None]


SENT = np.random.default_rng(1).uniform(-1.0, 1.0, 20).repeat(5)


@pytest.mark.parametrize("delay", [0, 7, 13, 20])
def test_a_whole_delay_is_found_and_its_neighbours_are_named(delay):
    ranges = {"gain": (0.1, 3.0), "delay": (0, 20)}
    found = found_with(delayed, ranges, {"gain": 1.3, "delay": delay}, SENT)
    middle, low, high = found.table()["delay"]
    assert round(middle) == delay
    assert delay - 0.5 <= low <= high <= delay + 0.5
    (words,) = [words for words in found.findings if "acts in steps" in words]
    assert f"delay acts in steps: {delay}" in words or delay in (0, 20)
    assert "worse by" in words
    assert not any("not measured" in words for words in found.findings)
    if delay == 7:  # a plateau leaves the other number its interval
        _, low, high = found.table()["gain"]
        right = 2.0 * 1.645 * RISE_NOISE / np.linalg.norm(SENT[:-7])
        assert high - low == pytest.approx(right, rel=0.15)


def test_both_signs_of_a_number_that_enters_as_a_square_are_named():
    def squared(values, time):
        return (values["g"][:, None] ** 2 * time)[:, :, None]

    found = found_with(squared, {"g": (-2.0, 2.0)}, {"g": 1.14})
    assert "two values of g explain the log alike: -1.14 and 1.14" in found.findings[0]
    middle, low, high = found.table()["g"]
    assert abs(middle) == pytest.approx(1.14, abs=0.01)
    assert low < -1.1
    assert high > 1.1
    assert not found.identified().told
    assert sorted(found.identified().several["g"]) == pytest.approx([-1.14, 1.14], abs=0.01)


def test_both_frequencies_that_even_samples_cannot_tell_are_named():
    def wave(values, time):
        return np.sin(values["frequency"][:, None] * time)[:, :, None]

    found = found_with(wave, {"frequency": (0.0, 100.0)}, {"frequency": 7.3}, 0.1 * np.arange(120))
    assert "two values of frequency explain the log alike: 7.3 and 70.1" in found.findings[0]


def test_rates_that_can_be_exchanged_are_two_answers():
    def decays(values, time):
        return sum(np.exp(-values[k][:, None] * time) for k in ("k1", "k2"))[:, :, None]

    ranges = {"k1": (0.01, 5.0), "k2": (0.01, 5.0)}
    found = found_with(decays, ranges, {"k1": 0.3, "k2": 2.0})
    assert found.findings[0].startswith("two answers explain the log alike: k1 0.")
    assert not found.identified().told


@pytest.mark.parametrize("ends", [(0.1, 1.1), (1.3, 3.0)])
def test_a_number_at_an_end_of_its_range_is_named(ends):
    found = found_with(fall, {**RANGES, "size": ends})
    end = min(ends, key=lambda bound: abs(bound - RISE["size"]))
    words = f"size is at the end of its range, {end:g}, and may be beyond it"
    assert words in found.findings


@pytest.mark.parametrize(("size", "good"), [(1e-3, False), (1.0, False), (1e3, True)])
def test_a_number_over_decades_asks_for_its_logarithm(size, good):
    def level(values, _):
        return np.tile(np.log(values["k"])[:, None, None], (1, 80, 1))

    robot = Robot(level, {"k": Number(1e-6, 1e6)}, {"level": "dB"})
    noise = np.random.default_rng(0).normal(0.0, 0.1, (80, 1))
    found = robot.infer([Trial(np.log(size) + noise)])
    assert found.good == good
    assert good == ("the log tells k to a millionth of the range" not in found.verdict)


def test_a_number_that_a_signal_follows_evenly_needs_no_smaller_steps(monkeypatch):
    """A difference over a large step is as the derivative says."""

    def refuse(*_):
        raise AssertionError("no smaller step is needed")

    def line(values, time):
        return (values["size"][:, None] * time + values["rate"][:, None])[:, :, None]

    monkeypatch.setattr(Near, "rough_step", refuse)
    roughness = found_with(line).warm_start.roughness
    assert roughness.looked.all()
    assert roughness.smooth
    assert roughness.jitter == 0.0
