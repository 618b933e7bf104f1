"""Trials of any robot, read from a recorder's log."""

from __future__ import annotations

import difflib
import functools
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from aquafish_gym.utils.storage import DamagedFileError
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    UnknownNameError,
    brief,
    finite_array,
    one_of,
    sequence,
)
from eea.core.angles import Floats
from eea.core.checks import ConfigurationError, real, real_or_infinite
from eea.infer.statement import check_kinds, quaternions_of, turn_of
from eea.infer.trials import Trial
from eea.logs.alignment import (
    SILENT_STEPS,
    Series,
    by_trial,
    held_means,
    known_part,
    locate,
    refuse_holes,
)
from eea.logs.columns import (
    TIME,
    TRIAL,
    Quantity,
    found_columns,
    possible_units,
    time_unit,
)
from eea.logs.stamps import Bunches, even_times, new_rows
from eea.logs.streams import Recording
from eea.logs.tables import read_recording

#: Units that are converted into each other -> their sizes.
CONVERTED: tuple[Mapping[str, float], ...] = (
    {"rad": 1.0, "deg": np.pi / 180.0, "rev": 2.0 * np.pi},
    {"rad/s": 1.0, "deg/s": np.pi / 180.0, "dps": np.pi / 180.0, "rpm": np.pi / 30.0},
    {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "km": 1e3},
    {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3, "km/h": 1.0 / 3.6},
    {"m/s^2": 1.0, "m/s2": 1.0, "m/s/s": 1.0, "g": 9.80665, "mg": 9.80665e-3},
    {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    {"Pa": 1.0, "hPa": 1e2, "mbar": 1e2, "kPa": 1e3, "bar": 1e5},
    {"V": 1.0, "mV": 1e-3},
    {"A": 1.0, "mA": 1e-3},
    {"Hz": 1.0, "kHz": 1e3},
    {"N": 1.0, "mN": 1e-3},
    {"T": 1.0, "uT": 1e-6, "G": 1e-4, "mG": 1e-7},
)
EVEN_SHARE = 0.25  # of a step: rows that are further from even times need a stated step
MOST_SAMPLES_PER_ROW = 1000.0
#: Steps of a stretch of bunches that is short enough to stay as it is.
SHORT_STRETCH_STEPS = 25
LONGEST_STEP_SECONDS = 3600.0  # a recorder's usual step, to tell its unit


class _Options(NamedTuple):
    """How rows become samples; see :func:`read_trials`."""

    step: float | None
    split_gap: float
    longest_hold: float | None
    interpolate: frozenset[str]


def read_trials(
    path: str | os.PathLike[str],
    channels: Mapping[str, str],
    *,
    step: float | None = None,
    between: Sequence[float] | Sequence[Sequence[float]] | None = None,
    split_gap: float = np.inf,
    longest_hold: float | None = None,
    interpolate: Sequence[str] = (),
    **columns: str,
) -> list[Trial]:
    """Return the trials of a robot in a CSV, Parquet, ArduPilot BIN, PX4 ULog or MCAP file.

    Each keyword names a column: those with the name of a channel are the signal, ``time`` and
    ``trial`` are what they say, and all others are the inputs, in their order.

    **One clock.** All columns are put on the times of the log's clock. Samples are every ``step`` s
    from the first row of the first channel on. **The signal is not interpolated**: a sample is the
    mean of the channel's readings within half a step of its time, and NaN where there is none.
    **Inputs are held** from each of their rows to the next; an input of a sample is the mean over
    the step that ends with the sample. So a simulator first takes a step with the input, and then
    records the sample; the first row, before any step, is none. Without inputs it is a sample.

    Rows that were stamped on arrival in packets get even times, if ``step`` is given; those in
    which a driver repeats a channel's last reading until the next are left out. ``remarks`` say so.

    Parameters
    ----------
    path
        The file. All formats but CSV need the extra ``logs``. ``aquafish logs`` lists its columns.
    channels
        The robot's channels, in their order, and their units: ``robot.channels``. A column whose
        file states another unit of the same kind is converted; one whose file states none is taken
        to be in the channel's unit.
    step
        Time from a sample to the next, s, as the simulator has it. None for that of the first
        channel's rows, which must be even.
    between
        The part to read, s after the first channel's first row, or several parts, each a trial.
    split_gap
        A longer time without a row of the first channel, s, begins another trial. Otherwise its
        samples are NaN.
    longest_hold
        The longest time that an input is held after a row, s; infinite for an input that is logged
        when it changes. None for three of its usual steps.
    interpolate
        Inputs that are measured, such as a voltage: they are interpolated at the samples' times.
    **columns
        ``STREAM.COLUMN``, with a minus for the opposite, or ``FACTOR*STREAM.COLUMN+OFFSET``. A name
        may end in a unit that the file does not state, as in ``**{"gyro:deg/s": "gz"}`` or
        ``"time:us"``. Where ``trial`` changes, another trial begins; in a table its time may begin
        again.

    Returns
    -------
    list of Trial
        Each with its signal (T, channels), its inputs (T, inputs) or None, and ``remarks`` on what
        was done and left out.

    Raises
    ------
    InvalidArgumentError
        If a column is missing, has another unit or clock, or an input is unknown at a sample. The
        message names the file, the nearest column, and what to do.
    MissingExtraError
        If the format needs the extra ``logs``.

    Examples
    --------
    >>> from eea import write_log, SwimLog
    >>> time = 0.01 * np.arange(65)
    >>> write_log("spin.csv", SwimLog(time, np.ones((65, 3)), np.full((65, 3), 0.4)))
    >>> (trial,) = read_trials("spin.csv", {"yaw rate": "rad/s"}, speed="left_pectoral",
    ...                        **{"yaw rate": "-gyro_z"})
    >>> trial.signal.shape, trial.inputs.shape, float(trial.signal[0, 0])
    ((64, 1), (64, 1), -1.0)
    """
    if step is not None:
        real("step", step, 1e-9, 1e6)
    real_or_infinite("split_gap", split_gap, 0.0)
    if longest_hold is not None:
        real_or_infinite("longest_hold", longest_hold, 0.0)
    parts = _parts(between)
    quantities = _quantities(channels, columns)
    inputs = [name for name in quantities if name not in channels and name != TRIAL]
    for name in sequence("interpolate", interpolate):
        one_of("interpolate", name, inputs)
    options = _Options(step, float(split_gap), longest_hold, frozenset(interpolate))
    recording = read_recording(path)
    found = []
    try:
        text = next((text for key, text in columns.items() if _name(key) == TRIAL), None)
        tables = list(by_trial(recording, text))
        if parts and len(tables) > 1:
            raise InvalidArgumentError("between must be None where a table has several trials")
        for table in tables:
            series, remarks = locate(table, quantities, columns)
            _refuse_unknown_unit(table, columns, series[next(iter(channels))])
            if step is not None:
                series = _evenly_stamped(series, list(channels), step, remarks)
            begin = float(series[next(iter(channels))].time[0])
            series = {name: one._replace(time=one.time - begin) for name, one in series.items()}
            for name, one in series.items():
                _refuse_infinite(name, one)
            for four in quaternions_of(channels):
                series |= _continuous(series, list(channels)[four])
            for name in channels:
                series[name] = _new_readings(name, series[name], remarks)
            first = series[next(iter(channels))]
            for span in _spans(first, series.get(TRIAL), parts, options.split_gap):
                made = _trial(series, channels, inputs, span, options)
                said = dict.fromkeys([*recording.remarks, *remarks, *made.remarks])
                found.append(replace(made, remarks=tuple(said)))
    except UnknownNameError as error:
        raise DamagedFileError(f"log: {path}: {error}; name it by {TIME}=COLUMN") from None
    except (InvalidArgumentError, ConfigurationError) as error:
        raise DamagedFileError(f"log: {path}: {error}") from None
    return found


def _name(key: str) -> str:
    """Return a keyword without its unit."""
    return key.partition(":")[0]


def _parts(between: Any) -> list[tuple[float, float]]:
    if between is None:
        return []
    several = (
        np.ndim(between) == 2
        if isinstance(between, np.ndarray)
        else isinstance(next(iter(sequence("between", between)), None), list | tuple | np.ndarray)
    )
    times = finite_array("between", between, (None, 2) if several else (None,), 0.0)
    rows = times.reshape(-1, 2) if several or len(times) == 2 else np.empty((0, 2))
    if not len(rows) or (rows[:, 0] >= rows[:, 1]).any():
        raise InvalidArgumentError(
            "between must be two times, s, the second later, or several such pairs; got "
            f"{brief(between)}"
        )
    return [(begin, end) for begin, end in rows.tolist()]


def _quantities(channels: Mapping[str, str], columns: Mapping[str, str]) -> dict[str, Quantity]:
    """Return what to look for: the channels, the inputs in their order, and the trial."""
    sound = isinstance(channels, Mapping) and channels
    if not sound or not all(isinstance(word, str) for pair in channels.items() for word in pair):
        raise InvalidArgumentError(
            "channels must be the units of the channels by name, as robot.channels is; got "
            f"{brief(channels)}"
        )
    check_kinds(channels)
    names = [_name(key) for key in columns]
    for key, text in columns.items():
        if not isinstance(text, str):
            raise InvalidArgumentError(f"{key} must be the name of a column; got {brief(text)}")
    for name in channels:
        if name not in names:
            others = [one for one in names if one not in channels]
            near = difflib.get_close_matches(name, others, n=1)
            hint = f"; did you mean it by {near[0]}?" if near else ""
            raise InvalidArgumentError(
                f"{name} must have a column, as it is a channel; the keywords name "
                f"{', '.join(names) or 'none'}{hint}"
            )
        if name in (TIME, TRIAL):
            raise InvalidArgumentError(f"channels must have other names than {TIME} and {TRIAL}")
    found = {name: Quantity((name,), _units(unit)) for name, unit in channels.items()}
    for name in names:
        if name not in (*channels, TIME):
            advice = ": number the trials" if name == TRIAL else ""
            found.setdefault(name, Quantity((name,), {}, advice=advice))
    return found


def _units(unit: str) -> dict[str, float]:
    """Return the units that are converted to a channel's, and their sizes in it.

    Examples
    --------
    >>> {name: round(size, 4) for name, size in _units("deg").items()}
    {'rad': 57.2958, 'deg': 1.0, 'rev': 360.0}
    """
    own = unit.partition(",")[0].strip()
    family = next((one for one in CONVERTED if own in one), {own: 1.0} if own else {})
    return {name: size / family[own] for name, size in family.items()}


def _refuse_unknown_unit(recording: Recording, columns: Mapping[str, str], first: Series) -> None:
    """Raise InvalidArgumentError if the times' unit is neither stated nor clear from their step."""
    key, text = next(
        ((key, text) for key, text in columns.items() if _name(key) == TIME), (TIME, TIME)
    )
    places = found_columns(recording, text)
    column = places[0][1] if places else text
    stream = first.stream
    if key != TIME or column not in stream.columns or column in stream.clocks:
        return
    if time_unit(stream.units.get(column, "")) is not None or len(first.time) < 2:
        return
    times = stream.numbers(column)[first.rows]
    possible = possible_units(times, LONGEST_STEP_SECONDS)
    if possible and possible != ["s"]:
        usual = float(np.median(np.diff(times)))
        raise InvalidArgumentError(
            f"{column} must have a unit, since its usual step of {usual:.3g} may be in "
            f"{' or '.join(possible)}: name it, as in time:{possible[0]}={column}"
        )


def _refuse_infinite(name: str, one: Series) -> None:
    infinite = np.flatnonzero(np.isinf(one.values[:, 0]))
    if len(infinite):
        row = int(one.rows[infinite[0]]) + 1
        raise InvalidArgumentError(
            f"row {row} must be finite, or empty where a reading is missing; {name} is "
            f"{one.values[infinite[0], 0]:g}"
        )


def _evenly_stamped(
    series: Mapping[str, Series], channels: Sequence[str], step: float, remarks: list[str]
) -> dict[str, Series]:
    """Return the series with even times where a stream was stamped on arrival in packets."""
    found = dict(series)
    done = set()
    for channel in channels:
        one = series[channel]
        if one.stream.name in done or not (np.diff(one.time) >= 0.0).all():
            continue  # a step back is refused later
        done.add(one.stream.name)

        def name(where: Bunches, one: Series = one) -> str:
            since = one.time - one.time[0]
            return f"{one.label}, {since[where.first]:.6g} to {since[where.last]:.6g} s"

        try:
            time, said = even_times(one.time, one.values, step, SHORT_STRETCH_STEPS * step, name)
        except InvalidArgumentError as error:
            remarks.append(f"{error}; here they are taken as they are")
            continue
        remarks += said
        for other, its in series.items():
            if said and its.stream is one.stream:
                found[other] = its._replace(time=np.interp(its.time, one.time, time))
    return found


def _new_readings(name: str, one: Series, remarks: list[str]) -> Series:
    """Return the rows of a channel without those in which a driver repeats its last reading."""
    kept = new_rows(one.values, np.zeros(len(one.time), np.bool_))
    if not kept.all():
        remarks.append(
            f"{(~kept).sum()} of {len(kept)} rows of {one.label} repeat the last reading of {name} "
            "until the next: they are left out"
        )
    return one.only(kept)


def _spans(
    first: Series, trial: Series | None, parts: Sequence[tuple[float, float]], split_gap: float
) -> Iterator[tuple[float, float]]:
    """Yield the times of the first and the last row of each trial, s."""
    refuse_holes(first, first.time, np.inf)
    for begin, end in parts or [(0.0, np.inf)]:
        time = first.time[first.within(begin, end)]
        edge = np.diff(time) > split_gap
        if trial is not None:
            rows = np.searchsorted(trial.time, time, "right") - 1
            label = np.where(rows >= 0, trial.values[rows, 0], np.nan)
            edge |= np.diff(label) != 0.0  # also before the first label
        starts = [0, *(np.flatnonzero(edge) + 1).tolist()]
        for start, stop in pairwise([*starts, len(time)]):
            if trial is None or not np.isnan(label[start]):
                yield float(time[start]), float(time[stop - 1])


def _trial(
    series: Mapping[str, Series],
    channels: Mapping[str, str],
    inputs: Sequence[str],
    span: tuple[float, float],
    options: _Options,
) -> Trial:
    """Return the samples from one time to another, s, as far as all inputs are known."""
    begin, end = span
    first = series[next(iter(channels))]
    remarks: list[str] = []
    known = (begin, end)
    for name in inputs:
        known = _known(series[name], known, options)
    time = first.time[(first.time >= known[0]) & (first.time <= known[1])]
    if not len(time):
        raise InvalidArgumentError(
            f"{first.label} must have rows from {begin:.6g} to {end:.6g} s at which "
            f"{', '.join(inputs)} are known: do their clocks differ?"
        )
    for left, words in ((time[0] - begin, "first"), (end - time[-1], "last")):
        if left > 0.0:
            remarks.append(f"the {words} {left:.3g} s have no known input: they are left out")
    step = options.step or _even_step(first.label, time)
    count = round((float(time[-1] - time[0])) / step)
    if count < 1 and inputs:
        raise InvalidArgumentError(
            f"a trial must have two rows of {first.label}, since its inputs act from one to the "
            f"next; that from {begin:.6g} to {end:.6g} s has {len(time)}"
        )
    if count > MOST_SAMPLES_PER_ROW * len(time):
        raise InvalidArgumentError(
            f"step must leave at most {MOST_SAMPLES_PER_ROW:g} samples for each row; {step:g} s "
            f"makes {count} of {len(time)}: state a longer one, between=, or split_gap="
        )
    grid = time[0] + step * np.arange(count + 1)
    signal = np.column_stack([
        _samples(series[name], grid[0], step, count + 1, turn_of(unit))
        for name, unit in channels.items()
    ])  # fmt: skip
    if inputs:
        signal = signal[1:]
    if not np.isfinite(signal).any():
        raise InvalidArgumentError(f"a trial must have readings; none is after {begin:.6g} s")
    if twice := int((np.diff(time) == 0.0).sum()):
        remarks.append(f"{twice} rows of {first.label} have the stamp of the row before")
    remarks.append(f"a sample every {step:.6g} s, {len(signal)} in all")
    for name, values in zip(channels, signal.T, strict=True):
        if missing := int(np.isnan(values).sum()):
            remarks.append(f"{missing} samples of {name} have no reading")
    held = []
    for name in inputs:
        one = series[name]
        if name in options.interpolate:
            held.append(np.interp(grid[1:], one.time, one.values[:, 0]))
            words = "is interpolated at the samples"
        else:
            held.append(held_means(grid, one.time, one.values)[:-1, 0])
            words = "is held from each row to the next, and averaged over the step before a sample"
        remarks.append(f"{name} ({one.label}, {one.rate}) {words}")
    return Trial(signal, np.column_stack(held) if held else None, tuple(remarks))


def _continuous(series: Mapping[str, Series], names: Sequence[str]) -> dict[str, Series]:
    """Return the four channels of a quaternion at the rows that have all, without changes of sign.

    A recorder may give q at one row and -q, the same attitude, at the next.
    """
    four = [series[name] for name in names]
    if any(one.stream is not four[0].stream for one in four):
        raise InvalidArgumentError(
            f"{', '.join(names)} must be columns of one stream, as they are a quaternion"
        )
    rows = functools.reduce(np.intersect1d, [one.rows for one in four])
    if not len(rows):
        raise InvalidArgumentError(f"{', '.join(names)} must have a row with all of them")
    kept = [np.isin(one.rows, rows) for one in four]
    values = np.column_stack([one.values[own, 0] for one, own in zip(four, kept, strict=True)])
    opposite = (values[1:] * values[:-1]).sum(axis=1) < 0.0
    values[1:][np.cumsum(opposite) % 2 == 1] *= -1.0
    return {
        name: one._replace(rows=rows, time=one.time[own], values=column[:, None])
        for name, one, own, column in zip(names, four, kept, values.T, strict=True)
    }


def _known(one: Series, span: tuple[float, float], options: _Options) -> tuple[float, float]:
    """Return the part of a span, s, in which an input is known; refuse a hole in it."""
    refuse_holes(one, one.time, np.inf)
    longest = options.longest_hold
    if longest is None:
        longest = SILENT_STEPS * one.usual_step
    try:
        return known_part(one, *span, longest)
    except InvalidArgumentError as error:
        needed = np.diff(one.held(*span)).max()
        raise InvalidArgumentError(
            f"{error}; if it is held that long, longest_hold={1.1 * needed:.2g}; if it is logged "
            "when it changes, longest_hold=inf"
        ) from None


def _even_step(label: str, time: Floats) -> float:
    """Return the step of even rows, s, of which some may be missing."""
    if len(time) < 2:
        return 1.0
    steps = np.diff(time)
    usual = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    if usual > 0.0:
        even = float(time[-1] - time[0]) / max(1.0, float(np.rint(steps / usual).sum()))
        place = (time - time[0]) / even
        if np.abs(place - np.rint(place)).max() <= EVEN_SHARE:
            return even
    else:
        raise InvalidArgumentError(
            f"{label} must have times that go on; its {len(time)} rows have one, {time[0]:g} s"
        )
    raise InvalidArgumentError(
        f"{label} has uneven rows, {usual:.3g} s apart by their median: state the time from one "
        f"sample of the simulator to the next, as in step={usual:.2g}"
    )


def _samples(one: Series, begin: float, step: float, count: int, turn: float) -> Floats:
    """Return the means (count,) of the readings within half a step of each sample.

    Readings that are a ``turn`` apart are the same.
    """
    place = np.rint((one.time - begin) / step)
    inside = (place >= 0) & (place < count)
    place = place[inside].astype(np.intp)
    values = one.values[inside, 0]
    readings = np.bincount(place, minlength=count)
    reference = np.zeros(count)
    if np.isfinite(turn):  # the mean of angles is near one of them
        reference[place] = values
        apart = values - reference[place]
        values = reference[place] + apart - turn * np.rint(apart / turn)
    sums = np.bincount(place, values, count)
    means: Floats = np.divide(sums, readings, out=np.full(count, np.nan), where=readings > 0)
    return means
