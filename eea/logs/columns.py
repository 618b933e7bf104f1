"""Columns of a log by name: what ``--map`` says."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from aquafish_gym.utils.validation import InvalidArgumentError, UnknownNameError, brief, one_of
from eea.core.angles import Floats
from eea.logs.cells import TIME_UNITS
from eea.logs.streams import Recording, Stream

NUMBER = r"\d*\.?\d+(?:[eE][+-]?\d+)?"
TERM = re.compile(rf"(?P<sign>-?)\s*(?:(?P<factor>{NUMBER})\s*\*)?\s*(?P<name>.+)")
OFFSET = re.compile(rf"(?P<name>.+?)\s*(?P<offset>[+-]\s*{NUMBER})")
TIME = "time"
TRIAL = "trial"


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
    held: bool = False  #: Whether a row's value holds until the next, as a command does.
    optional: bool = False
    with_sensor: bool = False  #: Whether its stream must be that of the first quantity.
    advice: str = ""  #: What to do where a cell is no number.


class Term(NamedTuple):
    """A column, times a factor, plus an offset."""

    stream: Stream
    column: str
    factor: float
    offset: float

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
    """Return the size of the columns' unit, which the map or the file states."""
    if unit is not None:
        one_of(f"the unit of {name}", unit, quantity.units or ["none"])
    for term in terms:
        stated = term.stream.units.get(term.column) or unit
        converts = abs(term.factor) != 1.0 or term.offset != 0.0
        if converts or stated is None or not quantity.units:
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
