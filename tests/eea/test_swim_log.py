"""A recorded swim: what it holds, how it is kept in files, and what is refused in plain words."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from aquafish_gym import simulate
from aquafish_gym.engines.api import TIMESTEP
from aquafish_gym.utils.validation import InvalidArgumentError
from eea import RecordedLog, SwimLog, read_log, write_log
from eea.core.checks import ConfigurationError
from eea.fish.log_inference import log_windows
from eea.fish.sampling import cubic_weights
from eea.fish.swim_log import COLUMNS

COMMANDS = [(0.5, -0.5, 1.0), (-0.3, 0.2, 0.5)]
HEADING = ",".join(COLUMNS)


def recorded(steps: int = 64, **changed: Any) -> SwimLog:
    felt = simulate(None, COMMANDS, (0.3, 1.0, -2.0), steps, dtype="float64", record="gyro").gyro
    log = SwimLog.of_trials(COMMANDS, [RecordedLog(one) for one in felt])
    fields = {name: getattr(log, name).copy() for name in ("time", "gyro", "commands", "trial")}
    return SwimLog(**(fields | changed)) if changed else log


def same(one: SwimLog, other: SwimLog) -> bool:
    names = ("time", "gyro", "commands", "trial")
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in names)


@pytest.mark.parametrize("name", ["swim.csv", "swim.npz", "SWIM.CSV"])
def test_a_log_comes_back_from_a_file_to_the_bit(name, tmp_path):
    log = recorded()
    write_log(tmp_path / name, log)
    assert same(read_log(tmp_path / name), log)


def test_simulated_trials_have_a_row_at_rest_and_one_after_each_step():
    log = recorded(steps=64)
    assert (len(log), log.seconds) == (2, (0.64, 0.64))
    assert log.time[:4].tolist() == [0.0, 0.01, 0.02, 0.03]
    assert not log.gyro[[0, 65]].any()
    assert log.trial.tolist() == [1] * 65 + [2] * 65
    commands, traces = log.trials(steps=64)
    assert commands.tolist() == [list(command) for command in COMMANDS]
    assert np.array_equal(np.concatenate([t.gyro for t in traces]), log.gyro[log.time > 0])


def test_a_trial_in_mid_swim_begins_at_its_first_sample_and_keeps_its_commands():
    told, felt = np.repeat(COMMANDS, 32, axis=0), np.arange(192.0).reshape(64, 3) / 100
    log = SwimLog.of_trials([told], [RecordedLog(gyro=felt)], moving=True)
    assert np.array_equal(log.gyro, felt)
    assert np.array_equal(log.commands[:-1], told[1:])
    assert log.time[0] == TIMESTEP


def test_a_log_that_was_read_at_odd_times_is_interpolated_for_methods_that_want_a_grid():
    time = np.arange(150) / 75.0 + 3.0
    gyro = np.stack([time, -time, 0.5 * time], axis=1)
    _, (trace,) = SwimLog(time, gyro, np.full((150, 3), 0.2)).trials(steps=128)
    wanted = 3.0 + TIMESTEP * np.arange(1, 129)
    np.testing.assert_allclose(trace.gyro, np.stack([wanted, -wanted, 0.5 * wanted], axis=1))


def test_trials_for_other_methods_are_long_enough_and_of_one_command():
    log = recorded(steps=64)
    with pytest.raises(InvalidArgumentError, match="steps must be at most 64, as many as trial 1"):
        log.trials(steps=128)
    told = log.commands.copy()
    told[20] = 0.1
    with pytest.raises(InvalidArgumentError, match="trial 1 must hold one command; it changes"):
        recorded(commands=told).trials(steps=64)


def test_commands_and_logs_must_be_of_one_another():
    logs = [RecordedLog(np.zeros((64, 3)))] * 2
    with pytest.raises(ConfigurationError, match="equally many, and at least one; got 1 and 2"):
        SwimLog.of_trials(COMMANDS[:1], logs)
    with pytest.raises(InvalidArgumentError, match="one for each of its 64 samples; got 63"):
        SwimLog.of_trials([np.full((63, 3), 0.1)] * 2, logs)
    with pytest.raises(InvalidArgumentError, match=r"commands of trial 2\[0, 2\] must lie in"):
        SwimLog.of_trials([COMMANDS[0], (0.1, 0.1, -0.1)], logs)


def put(array: Any, row: int, value: Any, column: int = 0) -> Any:
    array = np.array(array, dtype=float)
    array.reshape(len(array), -1)[row, column] = value
    return array


LOG = recorded()
WRONG = {
    "nan": ({"gyro": put(LOG.gyro, 7, np.nan, 1)}, "row 8: gyro_y is nan, and must be a finite"),
    "inf": ({"commands": put(LOG.commands, 3, -np.inf, 2)}, "row 4: caudal is -inf"),
    "nan time": ({"time": put(LOG.time, 0, np.nan)}, "row 1: time is nan"),
    "back": (
        {"time": put(LOG.time, 10, 0.05)},
        "row 11: time goes back to 0.05 s within trial 1; if another trial begins there",
    ),
    "still": ({"time": put(LOG.time, 10, 0.09)}, "row 11: time stands still at 0.09 s"),
    "no trial": ({"trial": np.ones(130)}, "row 66: time goes back to 0 s within trial 1"),
    "gap": (
        {"time": LOG.time + 0.5 * ((np.arange(130) > 40) & (np.arange(130) < 65))},
        "row 42: there is a gap of 0.51 s before it",
    ),
    "slow": ({"time": 6 * LOG.time}, "at least 20 rows a second; it has one in 0.06 s"),
    "ms": ({"time": 1000 * LOG.time}, "one in 10 s; is time in milliseconds"),
    "degrees": ({"gyro": np.rad2deg(LOG.gyro)}, r"no such fish turns faster than 10; is this in d"),
    "command": (
        {"commands": put(LOG.commands, 2, 0.7)},
        r"row 3: left_pectoral must lie in \[-0.5, 0.5\] rev/s; got 0.7",
    ),
    "tail": ({"commands": put(LOG.commands, 2, -0.1, 2)}, r"caudal must lie in \[0, 1\] Hz"),
    "half": ({"trial": put(LOG.trial, 5, 1.5)}, "row 6: trial must be a whole number; got 1.5"),
    "twice": (
        {"trial": np.repeat([1, 2, 1], [50, 50, 30])},
        "row 101: trial 1 begins again after it had ended",
    ),
    "short": ({"trial": np.repeat([1, 2], [110, 20])}, "trial 2 must have at least 33 rows"),
}


@pytest.mark.parametrize("name", WRONG)
@pytest.mark.parametrize("kind", ["csv", "npz"])
def test_a_mistake_is_named_by_file_row_and_column(name, kind, tmp_path):
    changed, message = WRONG[name]
    if name == "short":
        changed = changed | {"time": np.arange(130) * 0.01}
    with pytest.raises(InvalidArgumentError, match=message):
        recorded(**changed)
    path = tmp_path / f"swim.{kind}"
    names = ("time", "gyro", "commands", "trial")
    arrays = {part: changed.get(part, getattr(LOG, part)) for part in names}
    if kind == "npz":
        np.savez(path, **arrays)
    else:
        table = np.column_stack([arrays[part] for part in names])
        np.savetxt(path, table, delimiter=",", header=f"{HEADING},trial", comments="")
    with pytest.raises(InvalidArgumentError, match=f"log: {path}: .*{message}"):
        read_log(path)


ROW = "0,0,0,0,0,0,0\n"
TEXTS = {
    "missing": (
        HEADING.replace("gyro_x", "gyr_x") + "\n" + ROW,
        "the heading must have a column gyro_x; is it what is called 'gyr_x'",
    ),
    "no heading": (ROW * 40, "the heading must have a column time"),
    "trail": (HEADING + ",trail\n", "a column trial; is it what is called 'trail'"),
    "twice": (HEADING + ",time\n", "the column time twice"),
    "word": (HEADING + "\n" + ROW + ROW.replace("0,", "x,", 1), "row 2: time must be a number"),
    "comma": (
        HEADING.replace(",", ";") + "\n" + "0,01;0;0;0;0;0;0\n",
        "row 1: time must be a number; got '0,01'",
    ),
    "ragged": (HEADING + "\n" + ROW + "0,0\n", "row 2 must have 7 cells, as the heading; it has 2"),
    "empty": ("", "the heading must have a column time"),
    "only a heading": (HEADING + "\n", "there must be rows; there is none"),
    "nul": (HEADING + "\n0,0,\0,0,0,0,0\n", r"row 1: gyro_y must be a number"),
}


@pytest.mark.parametrize("name", TEXTS)
def test_a_table_that_is_none_is_refused(name, tmp_path):
    text, message = TEXTS[name]
    path = tmp_path / "swim.csv"
    path.write_text(text)
    with pytest.raises(InvalidArgumentError, match=f"log: {path}: .*{message}"):
        read_log(path)


def test_a_table_may_have_other_columns_any_order_and_another_separator(tmp_path):
    log = recorded()
    columns = [log.trial, *log.commands.T, 20 + log.time, *log.gyro.T, log.time]
    names = ["Trial", *COLUMNS[4:], "temperature", *COLUMNS[1:4], " time"]
    path = tmp_path / "swim.csv"
    np.savetxt(
        path, np.transpose(columns), "%.17g", "\t", header="\t".join(names), comments="\ufeff"
    )
    path.write_text(path.read_text() + "\n\n")
    assert same(read_log(path), log)


def test_what_is_no_log_is_refused_in_a_sentence(tmp_path):
    for name, content, message in (
        ("swim.txt", b"", "the ending of log must be one of .csv, .npz; got '.txt'"),
        ("swim.csv", b"\xff\xfe\x00", "it is no text, as a CSV is"),
        ("swim.npz", b"time,gyro", "is not a whole archive of arrays"),
    ):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InvalidArgumentError, match=message):
            read_log(tmp_path / name)
    with pytest.raises(InvalidArgumentError, match="No such file"):
        read_log(tmp_path / "none.csv")
    with pytest.raises(InvalidArgumentError, match="the ending of path"):
        write_log(tmp_path / "swim.json", recorded())
    np.savez(tmp_path / "other.npz", time=LOG.time, gyr=LOG.gyro, commands=LOG.commands)
    with pytest.raises(InvalidArgumentError, match=r"no others; it holds 'commands, gyr, time'"):
        read_log(tmp_path / "other.npz")


def test_a_huge_file_is_refused_before_it_is_read(tmp_path):
    for name in ("swim.csv", "swim.npz"):
        with (tmp_path / name).open("wb") as file:
            file.truncate(65 * 2**20)
        with pytest.raises(InvalidArgumentError, match="log must have at most 67108864 bytes"):
            read_log(tmp_path / name)


def test_an_npz_of_one_trial_needs_no_numbers(tmp_path):
    np.savez(
        tmp_path / "swim.npz", time=LOG.time[:65], gyro=LOG.gyro[:65], commands=LOG.commands[:65]
    )
    assert read_log(tmp_path / "swim.npz").trial.tolist() == [1] * 65


def test_windows_of_simulated_trials_are_what_was_simulated():
    (cut, names, _, remarks), log = log_windows(recorded(steps=100)), recorded(steps=100)
    assert (names, remarks, cut.begun, cut.interval) == (("trial 1", "trial 2"), (), 0, 100)
    assert np.array_equal(cut.series, np.array(COMMANDS)[:, None])
    assert np.array_equal(cut.gyro, log.gyro.reshape(2, 101, 3)[:, 1:])
    np.testing.assert_allclose(cut.time, np.tile(TIMESTEP * np.arange(1, 101), (2, 1)))


def test_commands_that_change_are_followed_on_the_logs_clock():
    time = np.arange(120) / 120.0
    told = np.zeros((120, 3))
    told[time >= 0.3, 0], told[time >= 0.515, 0] = 0.4, -0.2
    gyro = np.random.default_rng(0).normal(size=(120, 3))
    cut, *_ = log_windows(SwimLog(time, gyro, told))
    assert cut.interval == 1
    turned = TIMESTEP * np.cumsum(cut.series[0, :, 0])
    # The change after 0.515 s came with the row at 0.5167 s, which lies within a step.
    ends = TIMESTEP * np.arange(1, len(turned) + 1)
    done = 0.4 * np.clip(ends - 0.3, 0, 62 / 120 - 0.3) - 0.2 * np.clip(ends - 62 / 120, 0, None)
    np.testing.assert_allclose(turned, done, atol=1e-12)
    assert set(np.unique(cut.series[0, :, 0]).round(3)) == {0.0, 0.4, -0.2, 0.2}


def test_many_readings_are_averaged_and_what_is_too_long_is_said():
    time = np.arange(30_000) / 1000.0
    gyro = np.stack([0.1 * time, np.sin(time), 0 * time], axis=1)
    cut, _, _, remarks = log_windows(SwimLog(time, gyro, np.full((30_000, 3), 0.2)))
    assert cut.gyro.shape == (1, 1023, 3)  # of 1024 the first is before the simulator's first step
    assert cut.time is not None
    np.testing.assert_allclose(cut.gyro[0, :, 0], 0.1 * cut.time[0])
    assert remarks == ("of the 30 s of trial 1 the first 10.2 s are used",)


def test_a_swim_is_cut_into_windows_with_what_was_felt_before():
    log = recorded(steps=700)
    cut, names, ends, remarks = log_windows(log, moving=True)
    assert cut.gyro.shape == (2, 512, 3)
    assert (names, cut.begun) == (("trial 1 from 0.2 s", "trial 2 from 0.2 s"), 20)
    assert np.array_equal(cut.spin, log.gyro[[20, 721]])
    assert np.array_equal(cut.gyro[0], log.gyro[21:533])
    assert remarks[0] == "of the 7 s of trial 1 the first 5.32 s are used"
    np.testing.assert_allclose(ends, 5.32)
    seconds = log_windows(log, moving=True, seconds=1.0)
    assert seconds.windows.gyro.shape == (12, 100, 3)  # of each trial those that it holds
    np.testing.assert_allclose(seconds.ends, 2 * [1.2, 2.2, 3.2, 4.2, 5.2, 6.2])
    with pytest.raises(InvalidArgumentError, match="trial 1 must have at least 32 samples"):
        log_windows(recorded(steps=40), moving=True)


def test_a_swim_is_looked_at_between_samples():
    ends = TIMESTEP * np.arange(1, 101)
    swung = np.sin(2 * np.pi * 2.0 * ends + 0.4)
    at = np.random.default_rng(0).uniform(TIMESTEP, 1.0, 500)
    first, weights = cubic_weights(at / TIMESTEP - 1.0, 100)
    seen = (weights * swung[first[:, None] + np.arange(4)]).sum(axis=1)
    assert np.abs(seen - np.sin(2 * np.pi * 2.0 * at + 0.4)).max() < 1e-5
    on, weights = cubic_weights(np.array([0.0, 1.0, 99.0]), 100)
    assert ((weights == 1.0).sum(axis=1) == 1).all()
    assert on.tolist() == [0, 0, 96]
