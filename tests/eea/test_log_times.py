"""Logs of uneven rows: packets, changes of rate, repeated readings, commands between rows."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from aquafish_gym import Damage, Morphology, simulate
from aquafish_gym.engines.api import TIMESTEP
from aquafish_gym.engines.compiled.single import CompiledWorld
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.validation import InvalidArgumentError
from eea import FitConfig, SwimLog, check_log, infer_log, load_posterior, save_posterior, watch_swim
from eea.fish.known import known_body
from eea.fish.log_changes import LogChange
from eea.fish.swim_log import new_readings, restamped
from eea.fish.windows import MOST_UNKNOWN_CHANGES, log_windows
from eea.logs.stamps import bunches_of, even_times
from fish_swims import together

BODY = Damage.parse("left_pectoral:length=0.5").apply(Morphology.nominal())
PLAIN = FitConfig(nuisances=())
NOISE, HOLD = 0.01, 1.5  # rad/s, s
LOW = np.array([-0.5, -0.5, 0.2])
HIGH = np.array([0.5, 0.5, 1.0])


def at_rate(rate, seconds):
    return np.arange(round(seconds * rate) + 1) / rate


def swim(time, seed=3, memory=0.0, stamps=None):
    """Return the log of a swim sampled at ``time``, with noise that has a ``memory``."""
    rng = np.random.default_rng(seed)
    steps = int(np.ceil(100 * time[-1] - 1e-9)) + 1
    series = rng.uniform([-0.5, -0.5, 0.0], [0.5, 0.5, 1.0], (int(steps / 100 / HOLD) + 1, 3))
    held = np.repeat(series, round(100 * HOLD), axis=0)[:steps]
    angles = rng.uniform(-np.pi, np.pi, 3)
    felt = simulate(BODY, held[None], angles, steps, dtype="float64", record="gyro", interval=1)
    rates = np.concatenate([np.zeros((1, 3)), np.asarray(felt.gyro)[0]])
    noise = rng.standard_normal((len(time), 3))
    for i in range(1, len(time) if memory else 0):
        noise[i] = memory * noise[i - 1] + (1 - memory**2) ** 0.5 * noise[i]
    seen = CubicSpline(0.01 * np.arange(steps + 1), rates)(time) + NOISE * noise
    commands = series[(time / HOLD + 1e-9).astype(int)]
    return SwimLog(time if stamps is None else stamps, seen, commands)


def arrivals(time, size, apart=2e-4, late=0.0):
    """Return the stamps of rows that arrive in packets, each up to a few ``late`` s late."""
    row = np.arange(len(time))
    place, pace = row % size, time[1] - time[0]
    delays = late * np.random.default_rng(0).exponential(size=len(time))[row - place]
    return time[0] + pace * (row - place + size - 1) + apart * place + delays


def found_within(log, least=7):
    """Infer a body, which must explain the log and be near the true one; return its noise."""
    found = infer_log(log, PLAIN, truth=BODY, threads=1)
    low, high = found.interval(0.9)
    true = BODY.to_array()
    assert found.belief.good, found.belief.verdict
    assert found.objective_fitness > 0.98
    assert ((low <= true) & (true <= high)).sum() >= least
    return found.belief.sigma


@pytest.mark.parametrize(
    ("rate", "size", "apart"),
    [(100, 2, 1e-6), (100, 10, 2e-4), (200, 8, 1e-5), (1000, 30, 1e-5), (40, 4, 2e-4)],
)
def test_packets_stamped_on_arrival_are_stamped_evenly(rate, size, apart):
    time = at_rate(rate, 6.0)
    log = swim(time, stamps=arrivals(time, size, apart))
    even, (said,) = restamped(log)
    np.testing.assert_allclose(np.diff(even.time), 1 / rate, rtol=1e-3)
    assert f"rows 1 to {len(time)}: the times come in bunches" in said
    assert f"evenly sampled, every {1 / rate:g} s" in said
    true, cut = log_windows(swim(time)), log_windows(log)
    np.testing.assert_allclose(cut.time, true.time, atol=2e-3)
    np.testing.assert_array_equal(cut.gyro, true.gyro)


def test_late_packets_are_stamped_evenly_and_lost_ones_refused():
    time = at_rate(100, 12.0)
    log = swim(time, stamps=arrivals(time, 4, 1e-4, late=0.003))
    assert np.abs(np.diff(restamped(log)[0].time) - 0.01).max() < 1e-5
    kept = np.ones(len(time), dtype=bool)
    kept[600:608] = False
    lossy = SwimLog(log.time[kept], log.gyro[kept], log.commands[kept])
    with pytest.raises(InvalidArgumentError, match="packets are missing or late; restamp the rows"):
        log_windows(lossy)


def test_packets_in_part_of_a_log_or_in_one_trial_leave_the_rest_as_it_is():
    time = at_rate(100, 10.0)
    part = time.copy()
    part[300:700] = arrivals(time, 5)[300:700]
    even, _ = restamped(swim(time, stamps=part))
    np.testing.assert_allclose(even.time, time, atol=1e-3)
    np.testing.assert_array_equal(even.time[700:], time[700:])
    mixed = together(swim(time, 4), swim(time, 3, stamps=arrivals(time, 5)))
    even, (said,) = restamped(mixed)
    assert said.startswith("trial 1, rows 1002 to 2002: the times come in bunches")
    np.testing.assert_array_equal(even.time[:1001], time)


def test_readings_in_true_bursts_are_averaged_where_they_are():
    time = (0.05 * np.arange(200)[:, None] + 0.001 * np.arange(10)).ravel()
    log = swim(time)
    assert len(bunches_of(time, 0.01)) == 1
    assert restamped(log)[1] == []
    cut = log_windows(log)
    np.testing.assert_allclose(np.diff(cut.time[0]), 0.05, atol=1e-3)


def test_bunches_of_which_the_motion_does_not_tell_are_refused():
    time = at_rate(100, 6.0)
    log = swim(time, stamps=arrivals(time, 6))
    noise = NOISE * np.random.default_rng(0).standard_normal((len(time), 3))
    with pytest.raises(InvalidArgumentError, match=r"trial 1, rows 1 to 601: .*restamp the rows"):
        log_windows(SwimLog(log.time, noise, log.commands))


@pytest.mark.parametrize("size", [4, 40])
def test_packets_that_no_log_can_hold_are_named(size):
    """Of identical stamps, or more than 0.25 s apart."""
    time = at_rate(100, 6.0)
    stamps = arrivals(time, size, 0.0 if size == 4 else 1e-4)
    with pytest.raises(InvalidArgumentError, match=r"row \d+: time .*bunches.*: restamp the rows"):
        swim(time, stamps=stamps)


@pytest.mark.parametrize("kept", [0.3, 0.42, 0.5, 0.6, 0.75, 0.9])
@pytest.mark.parametrize("jitter", [0.0, 2e-4, 5e-4])
def test_rows_that_are_lost_by_chance_leave_no_bunches(kept, jitter):
    for seed in range(30):
        rng = np.random.default_rng(seed)
        time = 0.01 * np.flatnonzero(rng.random(800) < kept)
        time += jitter * np.clip(rng.normal(size=len(time)), -2.0, 2.0)
        assert bunches_of(time, 0.01) == []
        signal = np.sin(3.0 * time)[:, None] + rng.normal(0.0, 0.01, (len(time), 1))
        assert even_times(time, signal, 0.01, 0.25, str)[1] == []


def test_packets_stamped_in_whole_milliseconds_are_bunches():
    """Their steps are whole, too: of one and of two milliseconds, and then of a wait."""
    rng = np.random.default_rng(3)
    packets = 0.04 * np.arange(100)[:, None] + 0.001 * np.cumsum(rng.integers(1, 3, (100, 4)), 1)
    assert sum(len(found.starts) for found in bunches_of(packets.ravel(), 0.01)) == 100


def test_one_short_step_in_ten_is_no_clock_of_its_own():
    """No step has the length of the tenth quantile, between the short and the long ones."""
    steps = np.where(np.arange(56) % 10 < 1, 1e-4, 0.01)
    assert bunches_of(np.append(0.0, np.cumsum(steps)), 0.01) == []


def test_gaps_and_changes_of_rate_are_no_bunches():
    fast, slow = at_rate(1000, 4.0), 4.0 + at_rate(50, 4.0)[1:]
    holes = np.ones(len(fast), dtype=bool)
    for start in range(100, 3900, 150):
        holes[start : start + 40] = False
    for time in (np.append(fast[holes], slow), at_rate(100, 8.0)[np.arange(801) % 7 != 0]):
        assert bunches_of(time, 0.01) == []
    rng = np.random.default_rng(0)
    assert bunches_of(at_rate(100, 8.0) + 0.002 * np.clip(rng.normal(size=801), -2, 2), 0.01) == []


@pytest.mark.parametrize("memory", [pytest.param(0.0, marks=pytest.mark.slow), 0.97])
def test_a_rate_that_changes_is_averaged_by_time(memory):
    """Readings are averaged where they are closer than 0.01 s; what that gains is measured."""
    fast = at_rate(1000, 4.0)
    kept = np.ones(len(fast), dtype=bool)
    for start in (500, 1203, 2500, 3333):
        kept[start : start + 120] = False
    log = swim(np.concatenate([fast[kept], 4.0 + at_rate(50, 6.0)[1:]]), memory=memory)
    cut = log_windows(log)
    steps = np.diff(cut.time[0])
    assert steps.min() > 0.004
    np.testing.assert_allclose(steps[-250:], 0.02)
    assert cut.weight is not None
    np.testing.assert_array_equal(cut.weight[0, -250:], 1.0)
    gained = float(np.median(cut.weight[0, :250]))
    assert gained == pytest.approx(10**0.5, rel=0.15) if memory == 0.0 else gained < 2.0
    if memory == 0.0:  # at 100 Hz the other is not white: no body explains it
        assert found_within(log) == pytest.approx(NOISE, rel=0.1)
        watched = watch_swim(log, known_body(BODY, NOISE, ()), threads=1)
        assert watched.noticed is None, str(watched)


@pytest.mark.slow  # windows of three rates are fitted
def test_trials_of_other_rates_and_lengths_are_used_each_in_full():
    log = together(
        swim(at_rate(100, 5.0), 3), swim(at_rate(20, 8.0), 4), swim(at_rate(1000, 3.0), 5),
        swim(at_rate(104, 0.4), 6),
    )  # fmt: skip
    cut = log_windows(log)
    assert cut.remarks == ()
    assert cut.observed.counts == (500, 160, 299, 41)
    np.testing.assert_allclose(cut.ends, [5.0, 13.0, 16.0, 16.0 + 42 / 104])
    assert found_within(log) == pytest.approx(NOISE, rel=0.1)


@pytest.mark.parametrize("rate", [30, 100, 104, 200, 1000])
def test_windows_of_a_second_are_of_a_second_at_any_rate(rate):
    cut = log_windows(swim(at_rate(rate, 6.3)), moving=True, seconds=1.0)
    np.testing.assert_allclose(np.diff(cut.ends), 1.0, atol=1 / rate)
    assert len(cut.ends) == 6
    assert cut.remarks == ()
    changing = np.concatenate([at_rate(rate, 4.0), 4.0 + at_rate(50, 4.2)[1:]])
    cut = log_windows(swim(changing), moving=True, seconds=1.0)
    np.testing.assert_allclose(np.diff(cut.ends), 1.0, atol=1 / min(rate, 50))
    assert len(cut.ends) == 8
    assert cut.observed.counts[-1] == 50


def repeated(log, rate):
    """Return a log that repeats the reading of a gyroscope at a lower rate."""
    last = np.searchsorted(log.time, np.floor(log.time * rate + 1e-9) / rate - 1e-9)
    return SwimLog(log.time, log.gyro[last], log.commands)


@pytest.mark.parametrize(
    ("rows", "rate"),
    [(300, 100), (100, 50), pytest.param(100, 90, marks=pytest.mark.slow), (1000, 33)],
)
def test_rows_that_repeat_a_reading_are_left_out(rows, rate):
    log = repeated(swim(at_rate(rows, 8.0)), rate)
    new = new_readings(log, 0)
    assert len(new) == pytest.approx(8.0 * rate, abs=2)
    cut = log_windows(log)
    said = f"in trial 1 {len(log.time) - len(new)} rows repeat the reading of the row before"
    assert cut.remarks[0].startswith(said)
    if rate == 90:
        assert found_within(log, least=6) == pytest.approx(NOISE, rel=0.15)


def test_rows_that_are_equal_for_another_reason_are_kept():
    time = at_rate(100, 6.0)
    log = swim(time)
    rest = np.where(time[:, None] < 1.0, 0.0, log.gyro)  # it stands still first, without noise
    rest[300:400] = rest[300]  # and in between, without a command
    told = log.commands.copy()
    told[295:402] = 0.0
    coarse = np.round(log.gyro / 0.2) * 0.2
    for gyro, commands in ((rest, told), (coarse, log.commands), (0.0 * rest, told)):
        assert len(new_readings(SwimLog(time, gyro, commands), 0)) == len(time)


def test_a_driver_that_stops_in_mid_swim_is_named():
    log = swim(at_rate(100, 6.0))
    gyro = log.gyro.copy()
    gyro[200:250] = gyro[200]
    with pytest.raises(
        InvalidArgumentError, match=r"row 202: gyro_x, .* repeat the row before for 0.5"
    ):
        log_windows(SwimLog(log.time, gyro, log.commands))


def test_times_since_1970_change_nothing():
    log = swim(at_rate(100, 3.0))
    one, other = log_windows(log), log_windows(SwimLog(log.time + 2.0**30, log.gyro, log.commands))
    np.testing.assert_allclose(other.time, one.time, atol=1e-6)
    np.testing.assert_array_equal(other.series, one.series)
    assert other.regular


def performed(times, values, steps):
    """Return the mean command (steps, 3) in each 0.01 s of ``values`` from ``times`` on."""
    turned = np.cumsum(values[:-1] * np.diff(times)[:, None], axis=0)
    turned = np.concatenate([np.zeros((1, 3)), turned])
    edges = TIMESTEP * np.arange(steps + 1)
    passed = np.stack([np.interp(edges, times, axis) for axis in turned.T], axis=1)
    return np.clip(np.diff(passed, axis=0) / TIMESTEP, [-0.5, -0.5, 0.0], [0.5, 0.5, 1.0])


def switching_swim(rows, seed, seconds=8.0, apart=(0.8, 2.2), rest=True, become=None):
    """Return a log with a row every ``rows`` steps, and the times when its commands changed, s.

    They change anywhere between rows. The robot may become another after 6 s.
    """
    rng = np.random.default_rng(seed)
    times = [0.4 * rows * TIMESTEP if rest else 0.0]
    while times[-1] < seconds:
        times.append(times[-1] + rng.uniform(*apart))
    values = rng.uniform(LOW, HIGH, (len(times), 3))
    steps = round(seconds / TIMESTEP)
    series = performed(np.array([-1.0, *times]), np.vstack([np.zeros(3), values]), steps)
    world = CompiledWorld()
    angles = rng.uniform(-np.pi, np.pi, 3)
    world.start(Scenario.create(BODY, fin_angles=angles))
    rates = [np.zeros(3)]
    for step, command in enumerate(series.tolist()):
        if become is not None and step == 600:
            world.update(Scenario.create(become))
        world.advance(tuple(command))
        rates.append(np.array(world.state().spin))
    first = rows if rest else 200
    at = np.arange(first, steps + 1, rows)
    gyro = np.array(rates)[at] + rng.normal(0.0, SLOW_NOISE, (len(at), 3))
    time = TIMESTEP * at
    commands = values[np.searchsorted(times, time + 1e-9, "right") - 1]
    return SwimLog(time, gyro, commands), np.array(times)


def test_changes_between_close_rows_are_at_their_rows():
    for rows in (0.001, 0.005, 0.01):
        time = rows * np.arange(400)
        commands = np.where(time[:, None] < 0.3, [0.1, 0.2, 0.3], [0.4, -0.2, 0.8])
        cut = log_windows(SwimLog(time, np.sin(time)[:, None] * np.ones(3), commands))
        assert cut.changes is None
        assert cut.unknown() == 0


def test_each_change_between_rows_that_are_far_apart_is_unknown_within_them():
    log, times = switching_swim(5, seed=1)
    cut = log_windows(log)
    assert cut.changes is not None
    assert cut.unknown() == cut.unknown(0) == np.sum(times < log.time[-1])
    begin = log.time[0] - 0.05
    begun = times[: cut.unknown()]
    assert (begin + TIMESTEP * cut.changes.earliest[0] < begun).all()
    assert (begun <= begin + TIMESTEP * cut.changes.latest[0]).all()
    shares = (begun - begin) / TIMESTEP - cut.changes.earliest[0]
    shares /= cut.changes.latest[0] - cut.changes.earliest[0]
    found = cut.commands(np.array([0, 0]), [np.array([share, 1.0]) for share in shares])
    values = log.commands[np.searchsorted(log.time, begun)]
    wanted = performed(np.append(begun, 99.0) - begin, np.vstack([values, values[-1:]]), 700)
    np.testing.assert_allclose(found[0, 5:700], wanted[5:], atol=1e-9)
    np.testing.assert_allclose(found[1], cut.series[0], atol=1e-12)  # at the rows


def test_a_log_may_have_rows_of_both_kinds():
    fast = 0.001 * np.arange(2000)
    time = np.append(fast, 2.0 + 0.02 * np.arange(200))
    commands = np.full((len(time), 3), 0.3)
    commands[time >= 1.0, 0] = -0.2
    commands[time >= 3.01, 1] = 0.1
    cut = log_windows(SwimLog(time, np.sin(time)[:, None] * np.ones(3), commands))
    assert cut.changes is not None
    assert cut.unknown() == 1
    np.testing.assert_allclose(cut.changes.earliest, [[300.0]])
    np.testing.assert_allclose(cut.changes.latest, [[302.0]])
    np.testing.assert_allclose(cut.changes.jump, [[[0.0, -0.2, 0.0]]])


def test_a_command_in_each_row_begins_at_its_row_and_the_output_says_so():
    rng = np.random.default_rng(0)
    time = 0.2 * np.arange(60)
    gyro = rng.normal(0.0, 0.1, (60, 3))
    cut = log_windows(SwimLog(time, gyro, rng.uniform(LOW, HIGH, (60, 3))))
    assert cut.changes is None
    assert cut.remarks == (
        "in trial 1 the commands change in most rows: each is taken to begin at its row, since the "
        "readings do not tell when between two rows",
    )


def test_a_window_of_many_changes_is_shorter():
    log, times = switching_swim(2, seed=0, seconds=18.0, apart=(0.2, 0.3))
    assert len(times) > MOST_UNKNOWN_CHANGES + 5
    cut = log_windows(log)
    assert MOST_UNKNOWN_CHANGES - 5 < cut.unknown() < MOST_UNKNOWN_CHANGES + 5
    assert cut.remarks == ("of the 18 s of trial 1 the first 9.98 s are used",)


SLOW_NOISE = 0.02  # rad/s


@pytest.mark.parametrize("rows", [pytest.param(4, marks=pytest.mark.slow), 10])
def test_a_slow_log_gives_the_body_and_when_its_commands_changed(rows, tmp_path):
    log, times = switching_swim(rows, seed=3)
    found = infer_log(log, truth=BODY, threads=1)
    assert found.belief is not None
    assert found.belief.good, found.belief.verdict
    assert found.objective_fitness > 0.93
    low, high = found.interval(0.9)
    truth = BODY.to_array()
    assert ((low <= truth) & (truth <= high)).sum() >= 7
    begin = log.time[0] - rows * TIMESTEP
    last = begin + np.ceil((times - begin) / (rows * TIMESTEP) - 1e-9) * rows * TIMESTEP
    table = found.belief.table(0.99)
    for k, share in enumerate(1.0 - (last - times) / (rows * TIMESTEP), 1):
        if f"change {k} of the command@1" in table:
            _, least, most = table[f"change {k} of the command@1"]
            assert least - 0.02 <= share <= most + 0.02
    save_posterior(tmp_path / "slow.npz", found.belief)
    assert load_posterior(tmp_path / "slow.npz").table() == found.belief.table()


@pytest.mark.slow
def test_times_within_a_step_are_unknown_only_where_a_log_needs_them():
    log, _ = switching_swim(1, seed=5, apart=(0.3, 0.6))
    found = infer_log(log, truth=BODY, threads=1)
    assert found.belief is not None
    assert found.belief.good, found.belief.verdict
    assert "change 2 of the command@1" in found.belief.table()
    rng = np.random.default_rng(5)
    series = np.repeat(rng.uniform(LOW, HIGH, (8, 3)), 100, axis=0)
    swum = simulate(BODY, series[None], (0.3, 1.0, -2.0), 800, dtype="float64", interval=1)
    log = SwimLog.of_trials([series], [swum])
    found = infer_log(log, truth=BODY, threads=1)
    assert found.belief is not None
    assert not any("change" in name for name in found.belief.table())


@pytest.mark.slow
def test_a_slow_log_with_a_mistake_is_explained_without_it():
    log, _ = switching_swim(5, seed=4, seconds=6.0)
    wrong = SwimLog(log.time, log.gyro[:, [1, 0, 2]], log.commands)
    fits = check_log(wrong, threads=1).fits
    assert fits[0].change.axes == LogChange(axes=("y", "x", "z")).axes


@pytest.mark.parametrize("rows", [*(pytest.param(n, marks=pytest.mark.slow) for n in (1, 10)), 5])
def test_a_slow_swim_of_an_unchanged_body_raises_no_alarm_and_of_a_broken_one_does(rows):
    belief = known_body(BODY, SLOW_NOISE, ())
    swims = {"seed": 2, "seconds": 12.0, "rest": False}
    log, _ = switching_swim(rows, **swims)
    assert watch_swim(log, belief, threads=1).noticed is None
    broken = Damage.parse("caudal:length=0.5").apply(BODY)
    log, _ = switching_swim(rows, **swims, become=broken)
    noticed = watch_swim(log, belief, threads=1, until_noticed=True).noticed
    assert noticed is not None
    assert noticed > 4.0
