"""Which column is which: by the names that a map states, or guessed by names and sizes."""

from __future__ import annotations

import difflib
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from aquafish_gym.utils.validation import InvalidArgumentError, UnknownNameError, brief, one_of
from eea.core.angles import Floats
from eea.logs.streams import TIME_UNITS, Recording, Stream, without_unit

NUMBER = r"\d*\.?\d+(?:[eE][+-]?\d+)?"
TERM = re.compile(rf"(?P<sign>-?)\s*(?:(?P<factor>{NUMBER})\s*\*)?\s*(?P<name>.+)")
OFFSET = re.compile(rf"(?P<name>.+?)\s*(?P<offset>[+-]\s*{NUMBER})")
TIME = "time"
TRIAL = "trial"
GYROSCOPE = re.compile(r"gyr|angular_?vel|ang_?vel|omega|^w_|rollspeed|pitchspeed|yawspeed", re.I)
OTHER = re.compile(
    r"acc|bias|clip|cov|delta|deriv|_dt|err|fft|freq|health|innov|int_|integral|mag|offset|peak|"
    r"psd|scale|setpoint|snr|spectr|status|test|var|^cmd|/cmd",
    re.I,
)
#: The end of a column's name -> its axis.
AXES = (
    re.compile(r"(.*?)(?:x|\[0\]|_roll|rollspeed|_row)$", re.I),
    re.compile(r"(.*?)(?:y|\[1\]|_pitch|pitchspeed)$", re.I),
    re.compile(r"(.*?)(?:z|\[2\]|_yaw|yawspeed)$", re.I),
)
COMMANDS = re.compile(r"rcou|servo|actuator|motor|pwm|cmd|command|thrust|control", re.I)
NO_COMMANDS = re.compile(r"time|stamp|stat|mode|setpoint|angular_vel|gyr|allocator|limits", re.I)
#: Format -> the axes of its gyroscopes by convention: forward, right, down; or forward, left, up.
FRAMES = {"ArduPilot BIN": "FRD", "PX4 ULog": "FRD", "MCAP": "FLU"}
FASTEST_TURN = 10.0  # rad/s; swimming robots turn slower, so that greater numbers are degrees
TIME_COLUMN = re.compile(r"(time|stamp|^t$|clock|sec)", re.I)
#: s between two rows of a robot's log; one with fewer rows shows no motion.
USUAL_STEPS = (5e-4, 0.25)
#: s; what a column of whole numbers may count: sensors count in some that are no unit of their own.
TICKS = {**TIME_UNITS, "10ms": 1e-2, "100us": 1e-4}


def time_unit(unit: str) -> float | None:
    """Return a unit of time in s, or None; a number may stand before it.

    Examples
    --------
    >>> time_unit("ms"), time_unit("100us"), time_unit("rows")
    (0.001, 0.0001, None)
    """
    found = re.fullmatch(r"(\d*) ?(s|ms|us|ns)", unit)
    return round(int(found[1] or 1) * TIME_UNITS[found[2]], 12) if found else None


@dataclass(frozen=True)
class Quantity:
    """What a map may name, besides the time."""

    columns: tuple[str, ...]  #: Their names in a file that needs no map.
    units: Mapping[str, float]  #: Unit -> its size in the first unit.
    optional: bool = False
    with_sensor: bool = False  #: Whether its stream must be that of the first quantity.
    advice: str = ""  #: What to do where a cell is no number.


class Term(NamedTuple):
    """A column, times a factor, plus an offset."""

    stream: Stream
    column: str
    factor: float
    offset: float

    @property
    def converts(self) -> bool:
        """Whether its numbers are others than the column's but for their sign."""
        return abs(self.factor) != 1.0 or self.offset != 0.0

    def values(self, advice: str = "") -> Floats:
        """Return the numbers (T,); an error names a cell that is none, or a column of NaN."""
        cells = self.stream.numbers(self.column, advice)
        if len(cells) and np.isnan(cells).all():
            name = self.stream.full_name(self.column)
            raise InvalidArgumentError(f"{name} must have numbers; all of its cells are nan")
        return (
            cells if (self.factor, self.offset) == (1.0, 0.0) else self.factor * cells + self.offset
        )


def named_columns(
    columns: Mapping[str, str], known: Sequence[str]
) -> dict[str, tuple[str | None, list[str]]]:
    """Return the unit, if given, and the texts of a map's names, which must be known."""
    found: dict[str, tuple[str | None, list[str]]] = {}
    for key, text in columns.items():
        name, _, unit = key.partition(":")
        one_of("map", name, known)
        if name in found:
            raise InvalidArgumentError(f"map must name {name} once; got it twice")
        parts = [part.strip() for part in text.split(",")]
        if not all(parts):
            raise InvalidArgumentError(f"{name} must have columns; got {brief(text)}")
        found[name] = (unit or None, parts)
    return found


def found_columns(recording: Recording, name: str) -> list[tuple[Stream, str]]:
    """Return the columns of a name, with or without that of the stream, in any case of letters."""
    every = [(stream, column) for stream in recording.streams for column in stream.columns]
    for cased in (str, str.lower):
        for whole in (True, False):
            found = [
                (stream, column)
                for stream, column in every
                if cased(stream.full_name(column) if whole else column) == cased(name)
            ]
            if found:
                return found
    return []


def found_term(recording: Recording, quantity: str, text: str, mapped: bool) -> Term:
    """Return the column that a text of a map names; or of a name, where nothing is mapped."""
    whole = TERM.fullmatch(text)
    name = text if whole is None else whole["name"]
    offset = 0.0
    found = found_columns(recording, name)
    if not found and (shifted := OFFSET.fullmatch(name)):
        name = shifted["name"]
        offset = float(shifted["offset"].replace(" ", ""))
        found = found_columns(recording, name)
    if len(found) > 1:
        places = ", ".join(stream.full_name(column) for stream, column in found)
        raise InvalidArgumentError(f"{quantity} must name one column; {name} is {brief(places)}")
    if not found:
        names = [one.full_name(column) for one in recording.streams for column in one.columns]
        if not mapped:
            has = brief(", ".join(names)) if names else "none: the file is empty"
            raise UnknownNameError(f"it must have one column {name}; it has {has}")
        near = difflib.get_close_matches(name, names, n=1, cutoff=0.6)
        hint = f"; did you mean {near[0]}?" if near else ""
        raise InvalidArgumentError(
            f"{quantity} must be a column of the log, as `aquafish logs` lists them; got "
            f"{brief(name)}{hint}"
        )
    factor = float(whole["factor"] or 1.0) if whole else 1.0
    return Term(*found[0], -factor if whole and whole["sign"] else factor, offset)


def unit_size(name: str, quantity: Quantity, unit: str | None, terms: list[Term]) -> float:
    """Return the size of the columns' unit, which the map or the file states.

    Columns with a factor or an offset are in the map's unit after it, or in the quantity's first
    if no column of the file is in another.
    """
    if unit is not None:
        one_of(f"the unit of {name}", unit, quantity.units or ["none"])
    elif any(term.converts for term in terms):
        _refuse_two_readings(name, quantity, terms)
    for term in terms:
        stated = term.stream.units.get(term.column) or unit
        if term.converts or stated is None or not quantity.units:
            continue
        column = term.stream.full_name(term.column)
        if stated not in quantity.units:
            raise InvalidArgumentError(
                f"{name} must be in {' or '.join(quantity.units)}; the file says that "
                f"{column} is in {stated}: convert it, as in {name}=0.5*{column}-1"
            )
        if unit not in (None, stated):
            raise InvalidArgumentError(
                f"{name} must be in {stated}, by which the file states {column}; got {unit}"
            )
        unit = stated
    return quantity.units[unit] if unit else 1.0


def _refuse_two_readings(name: str, quantity: Quantity, terms: list[Term]) -> None:
    """Refuse factors and offsets that may be meant before or after the file's unit is converted."""
    for term in terms:
        stated = term.stream.units.get(term.column)
        if quantity.units.get(stated or "", 1.0) != 1.0:
            raise InvalidArgumentError(
                f"{name} must say in which unit its columns are after a factor or an offset, as in "
                f"{name}:{stated}=, since the file states {term.stream.full_name(term.column)} in "
                f"{stated}"
            )


class Gyroscope(NamedTuple):
    """Three columns that may be a gyroscope's rates."""

    stream: Stream
    columns: tuple[str, str, str]
    unit: str  #: "rad/s" or "deg/s"
    reason: str  #: Why it may be this unit.
    frame: str  #: The axes, "FRD" or "FLU"; "" if nothing tells them.

    @property
    def names(self) -> tuple[str, str, str]:
        """The columns' names, with that of the stream."""
        x, y, z = (self.stream.full_name(column) for column in self.columns)
        return x, y, z

    @property
    def unit_suffix(self) -> str:
        """What a map adds to "gyro" for a unit that the file does not state."""
        return ":deg/s" if self.unit == "deg/s" and self.reason != "stated" else ""


def gyroscopes(recording: Recording) -> list[Gyroscope]:
    """Return what may be gyroscopes, the fastest first."""
    found = []
    for stream in recording.streams:
        groups: dict[str, list[str | None]] = defaultdict(lambda: [None] * len(AXES))
        for column in stream.columns:
            name = stream.full_name(column)
            if not GYROSCOPE.search(name) or OTHER.search(name):
                continue
            for axis, pattern in enumerate(AXES):
                if match := pattern.fullmatch(without_unit(column)):
                    groups[match[1]][axis] = column
        for x, y, z in groups.values():
            if x is not None and y is not None and z is not None:
                unit, reason = _unit(recording.format, stream, (x, y, z))
                frame = FRAMES.get(recording.format, "")
                found.append(Gyroscope(stream, (x, y, z), unit, reason, frame))
    return sorted(found, key=lambda gyro: -len(gyro.stream))


def _unit(kind: str, stream: Stream, columns: tuple[str, str, str]) -> tuple[str, str]:
    stated = stream.units.get(columns[0])
    if stated:
        return stated, "stated"
    words = " ".join([stream.name, *columns]).lower()
    if re.search(r"deg|dps", words):
        return "deg/s", "by its name"
    if re.search(r"rad", words):
        return "rad/s", "by its name"
    if kind in FRAMES:  # they are in SI units
        return "rad/s", f"usual in {kind}"
    most = max(float(np.nanmax(np.abs(stream.numbers(one)), initial=0.0)) for one in columns)
    if most > FASTEST_TURN:
        return "deg/s", f"it reaches {most:.3g}"
    return "rad/s", f"at most {most:.3g}"


def commands(recording: Recording) -> list[str]:
    """Return the names of columns that may command servos, and that change."""
    return [
        stream.full_name(column)
        for stream in recording.streams
        for column, cells in stream.columns.items()
        if COMMANDS.search(stream.full_name(column))
        and not NO_COMMANDS.search(stream.full_name(column))
        and column not in stream.clocks
        and cells.dtype != object
        and np.unique(cells[np.isfinite(cells)]).size > 1
    ]


def time_columns(stream: Stream) -> Iterator[tuple[str, float, str]]:
    """Yield the clocks of a stream: a column, s per tick, and why.

    They are those of the format; of a table the columns that mostly go forward and are named like a
    time. Their unit is guessed by the usual step, which is between 0.5 ms and 0.25 s in robots'
    logs. Where whole numbers may be in several units, the reason names all.
    """
    for clock, tick in stream.clocks.items():
        yield clock, tick, "by the format"
    for name, cells in stream.columns.items():
        if name in stream.clocks or cells.dtype == object:
            continue
        if not TIME_COLUMN.search(without_unit(name)):
            continue
        there = cells[np.isfinite(cells)]
        if len(there) < max(2, len(cells) - 1) or not np.median(np.diff(there)) > 0.0:
            continue  # a last row may be cut
        stated = stream.units.get(name, "")
        if known := time_unit(stated):
            yield name, known, f"in {stated}"
        elif possible := possible_units(there):
            usual = float(np.median(np.diff(there)))
            reason = f"in {possible[0]}, by its usual step of {usual:.3g}"
            for unit in possible[1:]:
                reason += (
                    f"; or in {unit}, if it has {1.0 / (usual * TICKS[unit]):.3g} rows a second"
                )
            yield name, TICKS[possible[0]], reason


def possible_units(times: Floats, longest: float = USUAL_STEPS[1]) -> list[str]:
    """Return the units of time in which a column's usual step is 0.5 ms to ``longest`` s.

    Only whole numbers may be in ticks that are no unit of their own.
    """
    usual = float(np.median(np.diff(times)))
    whole = bool((times == np.round(times)).all())
    return [
        unit
        for unit, tick in TICKS.items()
        if USUAL_STEPS[0] <= usual * tick <= longest and (whole or unit in TIME_UNITS)
    ]
