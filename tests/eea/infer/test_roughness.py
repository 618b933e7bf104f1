"""Rough simulators, whole numbers, several answers and ends of ranges: right, and said."""

import numpy as np
import pytest

from eea import Number, Robot, Trial
from eea.infer.roughness import Near

NOISE = 0.05


def fall(values, time):
    """Return a smooth signal of two numbers."""
    rise = 1.0 - np.exp(-values["rate"][:, None] * time)
    return (values["size"][:, None] * rise)[:, :, None]


TIME = np.linspace(0.1, 5.0, 60)
TRUE = {"size": 1.2, "rate": 0.8}
RANGES = {"size": (0.1, 3.0), "rate": (0.1, 3.0)}


def log_of(simulate, true, inputs, noise=NOISE, seed=0):
    rng = np.random.default_rng(seed)
    signal = simulate({name: np.array([value]) for name, value in true.items()}, inputs[None])[0]
    return Trial(signal + rng.normal(0.0, noise, signal.shape), inputs)


def found_with(simulate, parameters=RANGES, true=TRUE, inputs=TIME, smooth=None, noise=NOISE):
    numbers = {name: Number(*ends) for name, ends in parameters.items()}
    robot = Robot(simulate=simulate, numbers=numbers, channels={"y": "V"})
    return robot.infer([log_of(smooth or simulate, true, inputs, noise)])


def widths(found):
    return np.array([high - low for _, low, high in found.table().values()])


def wiggling(values, time):
    """Return the signal with a jitter of a thousandth of the noise."""
    jitter = np.sin(1e9 * values["size"][:, None] + 1e8 * values["rate"][:, None] + 1e5 * time)
    return fall(values, time) + 1e-3 * NOISE * jitter[:, :, None]


def single(values, time):
    """Return the signal in single precision."""
    rise = 1.0 - np.exp(-values["rate"][:, None].astype(np.float32) * time.astype(np.float32))
    return (values["size"][:, None].astype(np.float32) * rise)[:, :, None]


@pytest.mark.parametrize("rough", [wiggling, single])
def test_a_rough_simulator_gives_the_intervals_of_a_smooth_one(rough):
    found = found_with(rough, smooth=fall)
    assert widths(found) == pytest.approx(widths(found_with(fall)), rel=0.1)
    said = any("derivatives use steps" in words for words in found.findings)
    assert said == (not found.warm_start.roughness.smooth)


def test_jitter_is_said():
    found = found_with(wiggling, smooth=fall)
    assert any(words.startswith("simulate jitters by 0.00") for words in found.findings)


def test_a_smooth_simulator_keeps_the_usual_steps():
    found = found_with(fall)
    assert found.warm_start.roughness.smooth
    assert not any("jitters" in words for words in found.findings)


def test_a_simulator_that_does_not_repeat_is_said_and_has_right_intervals():
    rng = np.random.default_rng(5)

    def unsteady(values, time):
        signal = fall(values, time)
        return signal + rng.normal(0.0, 1e-3 * NOISE, signal.shape)

    found = found_with(unsteady, smooth=fall)
    assert widths(found) == pytest.approx(widths(found_with(fall)), rel=0.1)
    assert any("other numbers for the same values" in words for words in found.findings)


def delayed(values, sent):
    late = np.arange(sent.shape[1])[None] - np.round(values["delay"]).astype(int)[:, None]
    there = np.where(late >= 0, np.take_along_axis(sent, np.maximum(late, 0), 1), 0.0)
    return (values["gain"][:, None] * there)[:, :, None]


@pytest.mark.parametrize("delay", [0, 3, 13, 20])
def test_a_whole_delay_is_found_and_its_neighbours_are_named(delay):
    sent = np.random.default_rng(1).uniform(-1.0, 1.0, 20).repeat(5)
    ranges = {"gain": (0.1, 3.0), "delay": (0, 20)}
    found = found_with(delayed, ranges, {"gain": 1.3, "delay": delay}, sent)
    middle, low, high = found.table()["delay"]
    assert round(middle) == delay
    assert delay - 0.5 <= low <= high <= delay + 0.5
    (words,) = [words for words in found.findings if "acts in steps" in words]
    assert f"delay acts in steps: {delay}" in words or delay in (0, 20)
    assert "worse by" in words
    assert not any("not measured" in words for words in found.findings)


def test_a_plateau_leaves_the_other_numbers_their_intervals():
    sent = np.random.default_rng(1).uniform(-1.0, 1.0, 20).repeat(5)
    ranges = {"gain": (0.1, 3.0), "delay": (0, 20)}
    found = found_with(delayed, ranges, {"gain": 1.3, "delay": 7}, sent)
    _, low, high = found.table()["gain"]
    moved = np.concatenate([np.zeros(7), sent[:-7]])
    right = 2.0 * 1.645 * NOISE / np.linalg.norm(moved)
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
    end = min(ends, key=lambda bound: abs(bound - TRUE["size"]))
    words = f"size is at the end of its range, {end:g}, and may be beyond it"
    assert words in found.findings


def test_a_number_within_its_range_is_not_at_its_end():
    assert not any("end of its range" in words for words in found_with(fall).findings)


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
