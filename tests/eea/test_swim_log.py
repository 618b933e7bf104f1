"""Recorded swims: their files, their windows, their times, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from aquafish_gym import simulate
from aquafish_gym.engines.api import TIMESTEP
from aquafish_gym.plans import AQUAFISH
from aquafish_gym.utils.validation import InvalidArgumentError
from eea import RecordedLog, SwimLog, read_log, write_log
from eea.fish.swim_log import log_columns
from eea.fish.windows import cubic_weights, log_windows

COMMANDS = [(0.5, -0.5, 1.0), (-0.3, 0.2, 0.5)]
LOG_COLUMNS = log_columns(AQUAFISH)
HEADING = ",".join(LOG_COLUMNS)
NAMES = ("time", "gyro", "commands", "trial")


def recorded(steps=64, **changed):
    gyro = simulate(None, COMMANDS, (0.3, 1.0, -2.0), steps, dtype="float64", record="gyro").gyro
    log = SwimLog.of_trials(COMMANDS, [RecordedLog(one) for one in gyro])
    return SwimLog(**({name: getattr(log, name).copy() for name in NAMES} | changed))


def same(one, other):
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in NAMES)


@pytest.mark.parametrize("name", ["swim.csv", "SWIM.TXT"])
def test_a_log_comes_back_from_a_file_to_the_bit(name, tmp_path):
    write_log(tmp_path / name, recorded())
    assert same(read_log(tmp_path / name), recorded())


def test_a_log_holds_the_samples_and_a_row_at_rest_before_them():
    gyro = simulate(None, COMMANDS, (0.3, 1.0, -2.0), 128, dtype="float64", record="gyro").gyro
    log = recorded(128)
    assert (len(log), log.seconds) == (2, pytest.approx((1.28, 1.28)))
    assert np.array_equal(log.gyro.reshape(2, 129, 3)[:, 1:], gyro)
    assert not log.gyro.reshape(2, 129, 3)[:, 0].any()
    logs = [RecordedLog(np.zeros((64, 3)))] * 2
    with pytest.raises(InvalidArgumentError, match="equally many"):
        SwimLog.of_trials(COMMANDS[:1], logs)
    with pytest.raises(InvalidArgumentError, match="64 samples; got 63"):
        SwimLog.of_trials([np.full((63, 3), 0.1)] * 2, logs)


def put(array, row, value, column=0):
    array = np.array(array, dtype=float)
    array.reshape(len(array), -1)[row, column] = value
    return array


LOG = recorded()
LATE = 1593335798.13 + LOG.time
WRONG = {
    "nan": ({"gyro": put(LOG.gyro, 7, np.nan, 1)}, "row 8: gyro_y must be finite; got nan"),
    "back": ({"time": put(LOG.time, 10, 0.05)}, "row 11: time must be later than the row before"),
    "no trial": ({"trial": np.ones(130)}, "row 66: time must be later"),
    "gap": (
        {"time": LOG.time + 0.5 * ((np.arange(130) > 40) & (np.arange(130) < 65))},
        "row 42: time must be later than the row before within trial 1, by at most 0.25 s",
    ),
    "slow": ({"time": 30 * LOG.time}, "at least 4 rows a second, with time in s"),
    "milliseconds": ({"time": 1e3 * LOG.time}, "is the time in ms[?]"),
    "nanoseconds": ({"time": (1e9 * LOG.time).astype(np.int64)}, "is the time in ns[?]"),
    "degrees": ({"gyro": np.rad2deg(LOG.gyro)}, r"gyro_\w must be at most 10 rad/s"),
    "command": ({"commands": put(LOG.commands, 2, 0.7)}, r"row 3: left_pectoral must be in"),
    "half": ({"trial": put(LOG.trial, 5, 1.5)}, "row 6: trial must be a whole number; got 1.5"),
    "twice": ({"trial": np.repeat([1, 2, 1], [50, 50, 30])}, "trial must .* in one block"),
    "short": (
        {"trial": np.repeat([1, 2], [120, 10]), "time": np.arange(130) * 0.01},
        "trial 2 must have at least 17 rows",
    ),
    "twice since 1970": (
        {"time": LATE - 0.01 * (np.arange(130) % 65 >= 50)},
        "row 51: .*it is that of row 50; if a row was written twice, leave one out",
    ),
    "back since 1970": (
        {"time": LATE - 0.03 * (np.arange(130) % 65 >= 50)}, "row 51: .*0.02 s earlier than row 50",
    ),
    "late since 1970": (
        {"time": LATE + 0.4 * (np.arange(130) % 65 >= 50)}, "row 51: .*0.41 s later than row 50",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_a_mistake_is_named_by_file_row_and_column(name, tmp_path):
    changed, message = WRONG[name]
    with pytest.raises(InvalidArgumentError, match=message) as told:
        recorded(**changed)
    assert "e+09" not in str(told.value) or name == "nanoseconds"
    if name == "nan":
        return  # in a file it is a reading that is missing
    path = tmp_path / "swim.csv"
    arrays = {part: changed.get(part, getattr(LOG, part)) for part in NAMES}
    table = np.column_stack([arrays[part] for part in NAMES])
    np.savetxt(path, table, delimiter=",", header=f"{HEADING},trial", comments="")
    with pytest.raises(InvalidArgumentError, match=f"log: {path}: .*{message}"):
        read_log(path)


ROW = "0,0,0,0,0,0,0\n"
TEXTS = {
    "missing": (HEADING.replace("gyro_x", "gyr_x") + "\n" + ROW, "must have one column gyro_x"),
    "word": (f"{HEADING}\n{ROW}x{ROW[1:]}", "row 2 must have numbers; time is 'x'"),
    "only short rows": (HEADING + "\n" + 2 * "0,0\n", "gyro_y must have numbers; all of its"),
    "words": (f"{HEADING},trial\n{ROW[:-1]},run1\n", "trial is 'run1': number the trials"),
    "empty": ("", "must have one column time"),
    "only a heading": (HEADING + "\n", "time must have at least one row"),
}


@pytest.mark.parametrize("name", TEXTS)
def test_a_table_that_is_no_log_is_refused(name, tmp_path):
    text, message = TEXTS[name]
    path = tmp_path / "swim.csv"
    path.write_text(text)
    with pytest.raises(InvalidArgumentError, match=f"log: {path}: .*({message})"):
        read_log(path)


@pytest.mark.parametrize("blank", ["", "nan", "NA"])
def test_a_table_of_two_rates_is_two_streams(blank, tmp_path):
    """Two trials, whose time begins again; commands come at a fifth of the rate, 0.2 ms later."""
    path = tmp_path / "swim.csv"
    lines = [f"{HEADING},trial"]
    columns = zip(LOG.time, LOG.gyro.tolist(), LOG.commands.tolist(), LOG.trial, strict=True)
    for row, (time, gyro, command, trial) in enumerate(columns):
        first = time == 0.0
        reading = [f"{time:.5f}", *map(repr, gyro), *3 * [blank], f"{trial}"]
        late = time - 1e-3 if first else time + 2e-4
        order = [f"{late:.5f}", *3 * [blank], *map(repr, command), f"{trial}"]
        if first:
            lines.append(",".join(order))
        lines.append(",".join(reading))
        if not first and row % 5 == 0:
            lines.append(",".join(order))
    path.write_text("\n".join(lines) + "\n")
    log = read_log(path)
    np.testing.assert_array_equal(log.gyro, LOG.gyro)
    np.testing.assert_allclose(log.time, LOG.time, atol=1e-9)
    np.testing.assert_array_equal(log.trial, LOG.trial)
    np.testing.assert_allclose(log.commands, LOG.commands, atol=1e-9)
    assert "have gyro_x, gyro_y, gyro_z: the others are of other rates" in log.remarks[0]
    assert "rows a second: its commands are held until its next row" in log.remarks[1]


def test_a_reading_that_is_missing_is_left_out_and_said(tmp_path):
    path = tmp_path / "swim.csv"
    gyro = put(LOG.gyro, 7, np.nan, 1)
    table = np.column_stack([LOG.time, gyro, LOG.commands, LOG.trial])
    np.savetxt(path, table, delimiter=",", header=f"{HEADING},trial", comments="")
    log = read_log(path)
    np.testing.assert_array_equal(log.gyro, np.delete(LOG.gyro, 7, axis=0))
    assert log.remarks[0].startswith("64 of 65 rows of the table have gyro_x, gyro_y, gyro_z")


def test_a_table_may_have_other_columns_in_any_order(tmp_path):
    log = recorded()
    columns = [log.trial, *log.commands.T, 20 + log.time, *log.gyro.T, log.time]
    names = ["Trial", *LOG_COLUMNS[4:], "temperature", *LOG_COLUMNS[1:4], " time"]
    path = tmp_path / "swim.csv"
    header = ",".join(names)
    np.savetxt(path, np.transpose(columns), "%.17g", ",", header=header, comments="\ufeff")
    path.write_text(path.read_text() + "\n\n")
    assert same(read_log(path), log)


def test_windows_of_simulated_trials_are_what_was_simulated():
    log = recorded(steps=100)
    cut = log_windows(log)
    assert (cut.remarks, cut.begun, cut.interval) == ((), 0, 100)
    assert np.array_equal(cut.series, np.array(COMMANDS)[:, None])
    assert np.array_equal(cut.gyro, log.gyro.reshape(2, 101, 3)[:, 1:])
    np.testing.assert_allclose(cut.time, np.tile(TIMESTEP * np.arange(1, 101), (2, 1)))
    np.testing.assert_allclose(cut.ends, [1.0, 2.0])


def test_commands_that_change_are_followed_on_the_logs_clock():
    time = np.arange(120) / 120.0
    commands = np.zeros((120, 3))
    commands[time >= 0.3, 0], commands[time >= 0.515, 0] = 0.4, -0.2
    gyro = np.random.default_rng(0).normal(size=(120, 3))
    cut = log_windows(SwimLog(time, gyro, commands))
    assert cut.interval == 1
    turned = TIMESTEP * np.cumsum(cut.series[0, :, 0])
    # The change after 0.515 s came with the row at 0.5167 s, which lies within a step.
    ends = TIMESTEP * np.arange(1, len(turned) + 1)
    done = 0.4 * np.clip(ends - 0.3, 0, 62 / 120 - 0.3) - 0.2 * np.clip(ends - 62 / 120, 0, None)
    np.testing.assert_allclose(turned, done, atol=1e-12)


def test_many_readings_are_averaged_and_unused_ones_reported():
    time = np.arange(30_000) / 1000.0
    gyro = np.stack([0.1 * time, np.sin(time), 0 * time], axis=1)
    cut = log_windows(SwimLog(time, gyro, np.full((30_000, 3), 0.2)))
    assert cut.gyro.shape == (1, 1023, 3)  # of 1024 the first is before the simulator's first step
    np.testing.assert_allclose(cut.gyro[0, :, 0], 0.1 * cut.time[0])
    assert cut.remarks == ("of the 30 s of trial 1 the first 10.2 s are used",)


def test_a_record_in_mid_swim_is_cut_into_windows():
    log = recorded(steps=700)
    cut = log_windows(log, moving=True)
    assert cut.gyro.shape == (2, 512, 3)
    assert cut.begun == 20
    assert np.array_equal(cut.spin, log.gyro[[20, 721]])
    assert np.array_equal(cut.gyro[0], log.gyro[21:533])
    assert cut.remarks[0] == "of the 7 s of trial 1 the first 5.32 s are used"
    np.testing.assert_allclose(cut.ends, [5.32, 12.32])  # s of swimming, over both trials
    seconds = log_windows(log, moving=True, seconds=1.0)
    assert seconds.gyro.shape == (12, 100, 3)
    np.testing.assert_allclose(seconds.ends, [t + i for t in (0.2, 7.2) for i in range(1, 7)])
    with pytest.raises(InvalidArgumentError, match="trial 1 must have at least 16 readings"):
        log_windows(recorded(steps=30), moving=True)


def test_a_trial_that_is_there_twice_is_refused_and_a_part_of_another_said():
    log = recorded()
    rows = log.blocks[0]
    time, gyro, commands = log.time[rows], log.gyro[rows], log.commands[rows]
    ones = np.ones(len(time), np.intp)

    def after(kept, commands_of):
        return SwimLog(
            np.concatenate([time, time[kept]]),
            np.concatenate([gyro, gyro[kept]]),
            np.concatenate([commands, commands_of[kept]]),
            np.concatenate([ones, 7 * ones[kept]]),
        )

    with pytest.raises(InvalidArgumentError, match="each there once; trial 1 and trial 7 are the"):
        log_windows(after(slice(None), commands))
    part, same = after(slice(30), commands), after(slice(None), commands)
    both = SwimLog(
        *(np.concatenate([vars(part)[n], vars(same)[n]]) for n in ("time", "gyro", "commands")),
        np.concatenate([part.trial + 20, same.trial]),
    )
    with pytest.raises(InvalidArgumentError, match="are the same"):
        log_windows(both)
    said = "trial 1 and trial 7 have samples in common, which count twice"
    assert any(one.startswith(said) for one in log_windows(after(slice(30), commands)).remarks)
    assert any(
        one.startswith(said) for one in log_windows(after(slice(None), 0.5 * commands)).remarks
    )


def test_a_simulation_is_interpolated_between_samples():
    ends = TIMESTEP * np.arange(1, 101)
    swung = np.sin(2 * np.pi * 2.0 * ends + 0.4)
    at = np.random.default_rng(0).uniform(TIMESTEP, 1.0, 500)
    first, weights = cubic_weights(at / TIMESTEP - 1.0, 100)
    seen = (weights * swung[first[:, None] + np.arange(4)]).sum(axis=1)
    assert np.abs(seen - np.sin(2 * np.pi * 2.0 * at + 0.4)).max() < 1e-5
    on, weights = cubic_weights(np.array([0.0, 1.0, 99.0]), 100)
    assert ((weights == 1.0).sum(axis=1) == 1).all()
    assert on.tolist() == [0, 0, 96]
