"""What a recorder does to a signal is told from noise, from switches and from counts."""

from __future__ import annotations

import numpy as np
import pytest

from eea import FitConfig, Number, Robot, Trial

ROWS = 200
TIME = 0.05 * np.arange(ROWS)
QUICK = FitConfig(bodies=4, poses=2, descents=2, polished=1, restarts=0)
MASS = 0.9


def roll(values, push):
    """Return a reading and an integral of a push (B, T)."""
    reading = values["gain"][:, None] * push + values["offset"][:, None]
    return np.stack([reading, 0.05 * values["drift"][:, None] * np.cumsum(push, axis=1)], axis=-1)


CART = Robot(
    roll,
    {"gain": Number(0.0, 3.0), "offset": Number(0.0, sd=1.0), "drift": Number(0.0, 3.0)},
    {"encoder": "m", "gauge": "V"},
)


def exactly(truth, push):
    return roll({name: np.array([value]) for name, value in truth.items()}, push[None])[0]


def drawn(rng, noise):
    """Return the truth, a push and a recorded signal (T, 2)."""
    truth = {"gain": rng.uniform(0.5, 2.5), "offset": 0.5 * rng.normal(), "drift": 1.5}
    push = np.sin(rng.uniform(0.5, 2.0) * TIME + rng.uniform(0.0, 6.0))
    signal = exactly(truth, push)
    return truth, push, signal + noise * rng.normal(size=signal.shape)


def rounded(signal, step):
    return step * np.round(signal / step)


def said_of(signal, push, robot=CART):
    return robot.infer([Trial(signal, push)], config=QUICK).caveats


def test_intervals_hold_where_readings_come_in_steps():
    held = 0
    for seed in range(10):
        truth, push, signal = drawn(np.random.default_rng(seed), 0.05)
        found = CART.infer([Trial(rounded(signal, 0.5), push)], config=QUICK)
        assert found.good, found.verdict
        assert found.findings[-2:] == [
            f"the readings of {name} come in steps of 0.5 {unit}, wider than the noise: they count "
            "as rounded to the nearest, neither down nor towards 0, and their noise as louder"
            for name, unit in CART.channels.items()
        ]
        for name, (_, low, high) in found.table(MASS).items():
            held += low <= truth[name] <= high
            assert high - low < 0.5
    assert held >= 25  # of 30: 90% intervals


@pytest.mark.parametrize("kind", ["noise", "single", "fine", "exact", "square", "exact square"])
def test_a_clean_signal_has_no_finding(kind):
    rng = np.random.default_rng(0)
    for _ in range(5):
        truth, push, signal = drawn(rng, 0.0 if "exact" in kind else 0.2)
        if "square" in kind:
            noise = signal - exactly(truth, push)
            push = np.sign(push)
            signal = exactly(truth, push) + noise
        signal = rounded(signal, 0.1) if kind == "fine" else signal
        assert said_of(signal.astype(np.float32) if kind == "single" else signal, push) == ()


@pytest.mark.parametrize("most", [0.1, 0.3, 0.9, 8.0])
def test_switches_and_counts_are_not_rounded_readings(most):
    def rate(values, push):
        return (values["rate"][:, None] * (1.0 + push))[:, :, None]

    counter = Robot(rate, {"rate": Number(0.0, 20.0)}, {"count": ""})
    rng = np.random.default_rng(1)
    for _ in range(10):
        push = np.sin(TIME + rng.uniform(0.0, 6.0))
        expected = 0.5 * most * (1.0 + push)
        signal = rng.poisson(expected) if most > 1.0 else rng.random(ROWS) < expected
        assert said_of(signal[:, None].astype(float), push, counter) == ()


def test_a_channel_at_its_end_and_a_held_reading_are_named():
    _, push, signal = drawn(np.random.default_rng(3), 0.2)
    end = np.quantile(signal[:, 0], 0.85)
    signal[:, 0] = np.minimum(signal[:, 0], end)
    assert said_of(signal, push) == (
        f"encoder is at its end, {end:g} m, in 30 of 200 rows: they are left out",
    )
    signal[signal[:, 0] == end, 0] = np.nan
    assert said_of(signal, push) == ()
    signal[:, 1] = np.repeat(signal[::5, 1], 5)
    said = "gauge repeats the reading before in 160 of 200 rows: they are left out"
    assert said_of(signal, push) == (said,)
    signal[np.arange(ROWS) % 5 > 0, 1] = np.nan
    assert said_of(signal, push) == ()


@pytest.mark.parametrize("kind", ["two rows", "decimals", "by chance", "rest", "filled up"])
def test_intervals_hold_where_readings_are_repeated(kind):
    held = good = 0
    count = 10 if kind == "by chance" else 5
    for seed in range(count):
        rng = np.random.default_rng(seed)
        truth, push, signal = drawn(rng, 0.2)
        if kind == "rest":
            push[40:] = 0.0  # 160 readings at rest, without noise
            noise = np.where(push == 0.0, 0.0, 0.2 * rng.normal(size=ROWS))
            signal = exactly(truth, push) + noise[:, None]
        elif kind == "filled up":
            signal[150:] = signal[149]
        else:
            again = np.arange(ROWS) % 2 > 0 if kind != "by chance" else rng.random(ROWS) < 0.5
            fresh = np.maximum.accumulate(np.where(again, 0, np.arange(ROWS)))
            signal = signal[fresh] if kind != "decimals" else np.round(signal[fresh], 3)
        found = CART.infer([Trial(signal, push)], config=QUICK)
        good += found.good
        assert all("they are left out" in said for said in found.findings[-2:])
        held += sum(low <= truth[n] <= high for n, (_, low, high) in found.table(MASS).items())
    assert good >= count - max(count // 15, 1)
    assert held >= 2.5 * count  # 90% intervals of three numbers
