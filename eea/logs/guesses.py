"""Guesses at what the columns of a log are, from their names and sizes."""

from __future__ import annotations

import re
from collections import defaultdict
from typing import NamedTuple

import numpy as np

from eea.core.angles import Floats
from eea.logs.cells import TIME_UNITS, without_unit
from eea.logs.columns import time_unit
from eea.logs.streams import Recording, Stream

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
SI_FORMATS = frozenset(FRAMES)
FASTEST_TURN = 10.0  # rad/s; swimming robots turn slower, so that greater numbers are degrees
TIME_COLUMN = re.compile(r"(time|stamp|^t$|clock|sec)", re.I)
#: s between two rows of a robot's log; one with fewer rows shows no motion.
USUAL_STEPS = (5e-4, 0.25)
#: What a column of whole numbers may count; sensors count in some that are no unit of their own.
TICKS = {unit: time_unit(unit) or 0.0 for unit in ("s", "ms", "us", "ns", "10ms", "100us")}


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
    if kind in SI_FORMATS:
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


def time_column(stream: Stream) -> tuple[str, float, str] | None:
    """Return the clock of a stream: a column, s per tick, and why; None if nothing looks like one.

    The first column that mostly goes forward and is named like a time is taken. Its unit is guessed
    by the usual step, which is between 0.5 ms and 0.25 s in robots' logs. Where whole numbers may
    be in two units, the reason names both.
    """
    for clock, tick in stream.clocks.items():
        return clock, tick, "by the format"
    for name, cells in stream.columns.items():
        if not TIME_COLUMN.search(without_unit(name)) or cells.dtype == object:
            continue
        there = cells[np.isfinite(cells)]
        if len(there) < max(2, len(cells) - 1) or not np.median(np.diff(there)) > 0.0:
            continue  # a last row may be cut
        stated = stream.units.get(name, "")
        known = time_unit(stated)
        if known:
            return name, known, f"in {stated}"
        usual = float(np.median(np.diff(there)))
        possible = possible_units(there)
        if possible:
            reason = f"in {possible[0]}, by its usual step of {usual:.3g}"
            for unit in possible[1:]:
                reason += (
                    f"; or in {unit}, if it has {1.0 / (usual * TICKS[unit]):.3g} rows a second"
                )
            return name, TICKS[possible[0]], reason
    return None


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


def usual_tick(stream: Stream, name: str) -> float | None:
    """Return the s per tick of a column, which its unit or its usual step tells; None otherwise."""
    cells = stream.numbers(name)
    if known := time_unit(stream.units.get(name, "")):
        return known
    possible = possible_units(cells) if len(cells) > 1 else []
    return TICKS[possible[0]] if possible else None
