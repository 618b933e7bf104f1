"""Trials of any robot from the five formats: one clock, units, holes, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from aquafish_gym.utils.validation import InvalidArgumentError
from eea import read_trials
from eea.core.checks import ConfigurationError
from log_files import PULSES, RATES, TIME, write_bin, write_mcap

pytestmark = pytest.mark.usefixtures("read_here")


def csv(tmp_path, **columns):
    """Write a table; a cell that is NaN is empty."""
    path = tmp_path / "log.csv"
    rows = [",".join(columns)]
    for row in zip(*columns.values(), strict=True):
        rows.append(",".join("" if cell != cell else str(cell) for cell in row))
    path.write_text("\n".join([*rows, ""]))
    return path


def read(path, **options):
    return read_trials(path, {"rate": "rad/s"}, rate="x", **options)


def test_a_faster_recorder_is_averaged_and_a_slower_one_leaves_gaps(tmp_path):
    time = 0.001 * np.arange(101)
    slow = np.where(np.arange(101) % 20 == 0, 5.0 * time, np.nan)
    path = csv(tmp_path, time=time, x=time, y=slow)
    (trial,) = read_trials(path, {"x": "rad", "y": "m"}, step=0.01, x="x", y="y")
    assert trial.signal.shape == (11, 2), "without inputs the first row is a sample"
    np.testing.assert_allclose(trial.signal[1:-1, 0], 0.01 * np.arange(1, 10), atol=1e-9)
    np.testing.assert_array_equal(np.isnan(trial.signal[:, 1]), np.arange(11) % 2 == 1)
    np.testing.assert_allclose(trial.signal[::2, 1], 0.1 * np.arange(6), atol=1e-12)
    assert "5 samples of y have no reading" in trial.remarks


@pytest.mark.parametrize("between", [(0.0, 1.2), (1.2, 2.0), (1.1, 1.3)])
def test_a_hole_of_an_input_counts_where_only_one_side_of_it_is_read(between, tmp_path):
    time = 0.01 * np.arange(301)
    held = np.where((time < 1.0) | (time > 1.5), time > 1.5, np.nan)
    path = csv(tmp_path, time=time, x=np.sin(time), u=held)
    with pytest.raises(InvalidArgumentError, match=r"u must have no hole .*longest_hold=") as told:
        read(path, u="u", between=between)
    longest = float(str(told.value).partition("longest_hold=")[2].partition(";")[0])
    (trial,) = read(path, u="u", between=between, longest_hold=longest)
    assert trial.inputs is not None
    assert not trial.inputs[:20].any(), "it is held until the next row"
    (before,) = read(path, u="u", between=(0.0, 1.01))
    assert before.inputs is not None
    assert not before.inputs.any()


def test_rows_that_were_lost_are_missing_samples_on_the_same_clock(tmp_path):
    time = 0.01 * np.arange(50)
    jitter = np.random.default_rng(0).uniform(-0.002, 0.002, 50) * (time > 0)
    kept = (np.arange(50) < 20) | (np.arange(50) >= 30)
    path = csv(tmp_path, time=(time + jitter)[kept], x=np.arange(50.0)[kept])
    (trial,) = read(path, step=0.01)
    np.testing.assert_array_equal(trial.signal[:, 0], np.where(kept, np.arange(50), np.nan))
    first, second = read(path, step=0.01, split_gap=0.05)
    np.testing.assert_array_equal(first.signal[:, 0], np.arange(20))
    np.testing.assert_array_equal(second.signal[:, 0], np.arange(30, 50))


def test_rows_stamped_on_arrival_in_packets_get_even_times(tmp_path):
    row = np.arange(400)
    stamps = 0.01 * (row - row % 8 + 7) + 2e-4 * (row % 8)
    signal = np.sin(0.05 * row).round(6)
    path = csv(tmp_path, time=stamps, x=signal)
    (trial,) = read(path, step=0.01)
    np.testing.assert_allclose(trial.signal[:392, 0], signal[:392], atol=1e-6)
    assert any("in bunches, as of packets stamped on arrival; the ro" in t for t in trial.remarks)
    path = csv(tmp_path, time=stamps, x=np.sin(5.0 * stamps).round(6))  # sampled so
    (trial,) = read(path, step=0.01)
    assert np.isnan(trial.signal).sum() > 200


def test_readings_that_a_driver_repeats_are_missing(tmp_path):
    row = np.arange(300)
    slow = np.sin(0.05 * (row - row % 5)).round(6)
    path = csv(tmp_path, time=0.01 * row, x=np.cos(0.05 * row).round(6), y=slow)
    (trial,) = read_trials(path, {"x": "rad", "y": "rad"}, x="x", y="y")
    assert np.isfinite(trial.signal[:, 0]).all()
    np.testing.assert_array_equal(np.isfinite(trial.signal[:, 1]), row % 5 == 0)
    assert any("rows of y repeat the last reading of y until the next" in t for t in trial.remarks)
    gear = np.repeat(np.random.default_rng(0).integers(0, 3, 60), 5)  # whole numbers are no repeats
    path = csv(tmp_path, time=0.01 * row, x=gear)
    assert np.isfinite(read(path)[0].signal).all()


def test_an_uneven_clock_needs_a_stated_step(tmp_path):
    time = np.cumsum(np.random.default_rng(0).uniform(0.002, 0.01, 60))
    path = csv(tmp_path, time=time, x=time)
    with pytest.raises(InvalidArgumentError, match=r"uneven rows, .*step=0.00"):
        read(path)
    assert len(read(path, step=0.01)[0].signal) == 1 + round((time[-1] - time[0]) / 0.01)


def test_an_input_is_the_mean_over_the_step_that_ends_with_its_sample(tmp_path):
    path = tmp_path / "log.mcap"
    write_mcap(path, behind=-0.005)  # the pulses are stamped 5 ms late
    (trial,) = read_trials(path, {"rate": "rad/s"}, rate="/imu.turn.x", pulse="/servos.data[0]")
    assert any("first 0.01 s have no known input" in line for line in trial.remarks)
    change = int(np.flatnonzero(np.diff(PULSES[:, 0]))[0])
    at = 10 * (change + 1)  # the row 5 ms before the change
    one, other = PULSES[change : change + 2, 0]
    np.testing.assert_allclose(
        trial.inputs[at - 2 : at + 1, 0], [one, (one + other) / 2, other], atol=1e-3
    )
    np.testing.assert_allclose(trial.signal[:, 0], RATES[2:, 0], atol=1e-6)


def test_measured_inputs_are_interpolated(tmp_path):
    time = 0.01 * np.arange(51)
    volts = np.where(np.arange(51) % 10 == 0, 3.0 * time, np.nan)
    path = csv(tmp_path, time=time, x=time, volts=volts)
    (trial,) = read(path, volts="volts", interpolate=["volts"])
    np.testing.assert_allclose(trial.inputs[:, 0], 3.0 * time[1:], atol=1e-9)
    with pytest.raises(ValueError, match=r"interpolate must be one of volts; .*mean 'volts'"):
        read(path, volts="volts", interpolate=["volt"])


def test_an_input_that_is_logged_when_it_changes_needs_a_word(tmp_path):
    time = 0.01 * np.arange(400)
    mode = np.full(400, np.nan)
    mode[[0, 5, 10, 15, 300]] = [0, 1, 2, 3, 4]
    path = csv(tmp_path, time=time, x=time, mode=mode)
    with pytest.raises(InvalidArgumentError, match=r"mode must have no hole .*longest_hold=inf"):
        read(path, mode="mode")
    (trial,) = read(path, mode="mode", longest_hold=np.inf)
    assert trial.inputs[:, 0].tolist() == [0] * 5 + [1] * 5 + [2] * 5 + [3] * 285 + [4] * 99
    path = csv(tmp_path, time=time, x=time, u=np.where(time == 0.0, 0.5, np.nan))
    (trial,) = read(path, u="u", longest_hold=np.inf)
    assert "u (u, one row) is held from each row to the next" in " ".join(trial.remarks)


def test_trials_are_the_blocks_of_a_column_and_parts_of_the_time(tmp_path):
    time = np.tile(0.01 * np.arange(30), 2)
    path = csv(tmp_path, time=time, x=np.arange(60), u=np.arange(60), run=np.repeat([7, 3], 30))
    first, second = read(path, u="u", trial="run")
    np.testing.assert_array_equal(first.signal[:, 0], np.arange(1, 30))
    np.testing.assert_array_equal(second.signal[:, 0], np.arange(31, 60))
    np.testing.assert_allclose(second.inputs[:, 0], np.arange(30, 59))
    with pytest.raises(InvalidArgumentError, match="between must be None where a table has sev"):
        read(path, u="u", trial="run", between=(0.0, 0.1))
    with pytest.raises(InvalidArgumentError, match=r"must not go back in time; .* 0.29 to 0 s"):
        read(path, u="u")
    path = csv(tmp_path, time=0.01 * np.arange(60), x=np.arange(60))
    one, other = read(path, between=[(0.05, 0.1), (0.2, 0.3)])
    assert one.signal[:, 0].tolist() == [5, 6, 7, 8, 9, 10]
    assert other.signal[:, 0].tolist() == list(range(20, 31))
    for wrong in ((0.1, 0.1), (5.0, 9.0), (0.0,), [(0.0, 1.0), (2.0, 1.0)]):
        with pytest.raises(InvalidArgumentError, match="between must "):
            read(path, between=wrong)


def test_a_trial_may_be_of_another_stream(tmp_path):
    path = tmp_path / "log.BIN"
    write_bin(path)
    columns = {"rate": "IMU.GyrY", "pulse": "RCOU.C2", "trial": "RCOU.C1"}
    first, second = read_trials(path, {"rate": "rad/s"}, **columns)
    at = 10 * int(np.flatnonzero(np.diff(PULSES[:, 0]))[0]) + 10
    np.testing.assert_allclose(first.signal[:, 0], RATES[1:at, 0], atol=1e-6)
    np.testing.assert_allclose(second.signal[:, 0], RATES[at + 1 :, 0], atol=1e-6)


def test_units_are_those_of_the_channels(tmp_path):
    path = csv(tmp_path, **{"time": TIME, "x [deg/s]": np.full(120, 90.0), "y": np.ones(120)})
    for unit, columns, value in (
        ("rad/s", {"rate": "x [deg/s]"}, np.pi / 2),
        ("deg/s", {"rate": "-x [deg/s]"}, -90.0),
        ("deg/s", {"rate:rad/s": "y"}, np.rad2deg(1.0)),
    ):
        (trial,) = read_trials(path, {"rate": unit}, **columns)
        np.testing.assert_allclose(trial.signal, value, atol=1e-12)
    with pytest.raises(InvalidArgumentError, match=r"force must be in N .*x .* is in deg/s"):
        read_trials(path, {"force": "N"}, force="x [deg/s]")
    with pytest.raises(InvalidArgumentError, match="the unit of rate must be one of rad/s"):
        read_trials(path, {"rate": "rad/s"}, **{"rate:deg": "y"})


@pytest.mark.parametrize(("column", "text"), [("x", "2*x"), ("x", "x+1"), ("x", "-1.01*x")])
def test_a_factor_on_a_column_in_another_unit_must_say_which_it_leaves(tmp_path, column, text):
    stated = f"{column} [deg/s]"
    path = csv(tmp_path, **{"time": TIME, stated: np.full(120, 90.0)})
    text = text.replace(column, stated)
    said = r"rate must say in which unit .* as in rate:deg/s=, since the file states x .* in deg/s"
    with pytest.raises(InvalidArgumentError, match=said):
        read_trials(path, {"rate": "rad/s"}, rate=text)
    (in_degrees,) = read_trials(path, {"rate": "rad/s"}, **{"rate:deg/s": text})
    (in_radians,) = read_trials(path, {"rate": "rad/s"}, **{"rate:rad/s": text})
    np.testing.assert_allclose(in_degrees.signal, np.deg2rad(in_radians.signal))
    (as_stated,) = read_trials(path, {"rate": "deg/s"}, rate=text)
    np.testing.assert_allclose(as_stated.signal, in_radians.signal)


@pytest.mark.parametrize(("unit", "turn"), [("deg", 360.0), ("rad", 2.0 * np.pi), ("rev", 1.0)])
def test_angles_that_wrap_are_averaged_near_one_of_them(tmp_path, unit, turn):
    time = 0.005 * np.arange(9)
    heading = np.where(np.arange(9) % 2, 179.0, -179.0) * turn / 360.0
    path = csv(tmp_path, time=time, x=heading)
    (trial,) = read_trials(path, {"heading": f"{unit}, wraps"}, step=0.01, heading="x")
    assert (np.abs(np.abs(trial.signal) / turn - 0.5) <= 1.0 / 360.0).all()


def test_an_attitude_is_averaged_whichever_sign_it_is_given_in(tmp_path):
    half = 0.5 * np.linspace(0.0, 3.0, 121)
    attitude = np.stack([np.cos(half), 0.6 * np.sin(half), np.zeros(121), 0.8 * np.sin(half)])
    names = ("w", "x", "y", "z")
    channels = dict.fromkeys(names, "quaternion")
    signs = np.random.default_rng(5).choice([-1.0, 1.0], 121)
    found = []
    for rows in (attitude, signs * attitude):
        columns = dict(zip(names, rows, strict=True))
        path = csv(tmp_path, time=0.01 * np.arange(121), **columns)
        found += read_trials(path, channels, step=0.04, w="w", x="x", y="y", z="z")
    plain, other = found
    np.testing.assert_allclose(other.signal, signs[0] * plain.signal, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(plain.signal, axis=1), 1.0, atol=1e-3)


def test_a_reading_of_an_attitude_has_all_four(tmp_path):
    columns = {name: np.full(120, 0.5) for name in "wxyz"}
    columns["y"][3] = np.nan
    channels = dict.fromkeys("wxyz", "quaternion")
    (trial,) = read_trials(csv(tmp_path, time=TIME, **columns), channels, **{n: n for n in "wxyz"})
    assert np.isnan(trial.signal[3]).all()
    assert np.isnan(trial.signal).sum() == 4
    columns["z"] = np.full(120, np.nan)
    columns["z"][3] = 0.5
    with pytest.raises(InvalidArgumentError, match="w, x, y, z must have a row with all of them"):
        read_trials(csv(tmp_path, time=TIME, **columns), channels, **{n: n for n in "wxyz"})


def test_a_kind_of_channel_that_does_not_exist_is_refused(tmp_path):
    path = csv(tmp_path, time=TIME, x=np.zeros(120))
    with pytest.raises(ConfigurationError, match="the unit of heading must be a plain one, or"):
        read_trials(path, {"heading": "deg, wrapped"}, heading="x")


def test_a_unit_of_time_that_is_not_clear_is_asked_for(tmp_path):
    path = csv(tmp_path, stamp=np.arange(50), x=np.arange(50))
    with pytest.raises(InvalidArgumentError, match=r"may be in s or ms or 10ms: .*time:s=stamp"):
        read(path, time="stamp")
    assert "a sample every 1 s, 50 in all" in read(path, **{"time:s": "stamp"})[0].remarks
    assert "a sample every 0.001 s, 50 in all" in read(path, **{"time:ms": "stamp"})[0].remarks


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ({"time": [0.0, 0.1, 0.2], "x": [0.0, np.inf, 0.0]}, "row 2 must be finite.*rate is inf"),
        ({"time": [0.0, 0.1, 0.2], "x": [0.0, 1e101, 0.0]}, "signal must be at most 1e.100"),
        ({"time": [0.0, 0.1], "x": [0.0, "ERR"]}, "row 2 must have numbers; x is 'ERR'"),
        ({"time": [1.0, 1.0], "x": [0.0, 1.0]}, "x must have times that go on; its 2 rows have"),
        ({"stamp": [0.0, 0.1], "x": [0.0, 1.0]}, "one column time; .*name it by time=COLUMN"),
        ({"time": [0, 0.1, 0.2, 1e6], "x": [0, 1, 2, 3]}, "step must leave at most 1000 samples"),
    ],
)
def test_a_table_that_cannot_be_a_trial_is_refused(rows, said, tmp_path):
    path = csv(tmp_path, **rows)
    with pytest.raises(InvalidArgumentError, match=f"log: {path}: .*{said}"):
        read(path, step=0.1 if "1000 samples" in said else None)


def test_stamps_that_come_twice_are_said(tmp_path):
    row = np.arange(60)
    path = csv(tmp_path, time=0.01 * (row // 2), x=row)
    (trial,) = read(path)
    np.testing.assert_array_equal(trial.signal[:, 0], 0.5 + 2.0 * np.arange(30))
    assert "30 rows of x have the stamp of the row before" in trial.remarks


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        ({"rate": "IMU.GirX"}, "rate must be a column of the log.*did you mean IMU.GyrX"),
        ({"rates": "IMU.GyrX"}, "rate must have a column.*did you mean it by rates"),
        ({"rate": "IMU.GyrX,IMU.GyrY"}, "rate must have one column; got"),
        ({"rate": "IMU.GyrX", "pulse": "RCOU.C9"}, "pulse must be a col.*mean RCOU.C"),
        ({"rate": "RCOU.C1"}, "rate must be in rad/s or .*RCOU.C1 is in us"),
        ({"rate": "IMU.GyrX", "time": "IMU.Time"}, "time must be a column.*mean IMU.TimeUS"),
    ],
)
def test_a_mistake_is_refused_with_the_nearest(columns, said, tmp_path):
    path = tmp_path / "log.BIN"
    write_bin(path)
    with pytest.raises(InvalidArgumentError, match=said) as told:
        read_trials(path, {"rate": "rad/s"}, **columns)
    assert "map" not in str(told.value)
