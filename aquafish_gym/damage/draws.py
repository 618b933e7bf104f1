"""The faults of many episodes as arrays: drawn from uniform numbers, and laid out as a table.

A robot draws one block of uniform numbers for an episode. Words, numbers and onsets follow from
the blocks of all robots at once.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.damage.faults import Fault, words_of
from aquafish_gym.damage.tiers import TIERS, Chance, Tier
from aquafish_gym.damage.transmit import STEP_ROUNDING
from aquafish_gym.damage.words import RANDOM, Words, can_grow, needs_number
from aquafish_gym.stages import NEVER, Stages
from aquafish_gym.utils.array_types import Flags, Floats, Rows

Parts = Mapping[str, Words]
Kind = tuple[str, str]  # a part and a word
#: Breaks a part in rows (n,) of a table's columns, in place: columns, rows, part, word, number
#: (n,), which is NaN for a word that takes none.
Break = Callable[[Mapping[str, NDArray[Any]], Rows, str, str, Floats], None]

NONE = -1  # the kind of a fault that an episode lacks
UNIFORMS_OF_A_PART = 4  # which way it breaks, which part, by how much, and the sign
LINEARITY = 1e-9  # relative; more than rounding


class Draws(NamedTuple):
    """The faults of P episodes, F each at most, in the order in which they apply."""

    kinds: list[Kind]  #: every part and word that occurs
    kind: Rows  #: (P, F) which of them; ``NONE`` where there is no fault
    number: Floats  #: (P, F) NaN where the word takes none
    onset: Floats  #: (P, F) s
    duration: Floats  #: (P, F) s, infinite until the end
    growth: Floats  #: (P, F) s; 0 is at once

    @property
    def used(self) -> list[tuple[int, Kind]]:
        """The numbers of the kinds that some episode has, with part and word."""
        return [(kind, self.kinds[kind]) for kind in np.unique(self.kind).tolist() if kind != NONE]

    def take(self, rows: Any) -> Draws:
        """Return some of the episodes."""
        return Draws(self.kinds, *(table[rows] for table in self[1:]))

    def faults(self, episode: int) -> list[Fault]:
        """Return the faults of an episode."""
        found = []
        for kind, number, onset, duration, growth in zip(
            *(table[episode].tolist() for table in self[1:]), strict=True
        ):
            if kind != NONE:
                part, word = self.kinds[kind]
                found.append(
                    Fault(
                        part,
                        word,
                        None if np.isnan(number) else number,
                        onset,
                        None if np.isinf(duration) else duration,
                        growth or None,
                    )
                )
        return found

    @staticmethod
    def join(several: Sequence[Draws], order: Rows) -> Draws:
        """Return the episodes of several draws, one after another, and then in an ``order``."""
        if len(several) == 1:
            return several[0].take(order)
        width = max(one.kind.shape[1] for one in several)
        kinds: list[Kind] = []
        tables: list[list[NDArray[Any]]] = [[] for _ in range(len(Draws._fields) - 1)]
        for one in several:
            kind = np.where(one.kind == NONE, NONE, one.kind + len(kinds))
            kinds += one.kinds
            missing = width - kind.shape[1]
            for table, values in zip(tables, (kind, *one[2:]), strict=True):
                table.append(np.pad(values, ((0, 0), (0, missing)), constant_values=NONE))
        return Draws(kinds, *(np.concatenate(table)[order] for table in tables))


def uniforms_of(faults: Sequence[Fault]) -> int:
    """Return how many uniform numbers an episode of some faults draws."""
    count = 0
    for fault in faults:
        count += isinstance(fault.onset, tuple)
        if fault.part == RANDOM:
            count += TIERS[fault.word].parts * UNIFORMS_OF_A_PART
    return count


def draw(faults: Sequence[Fault], uniforms: Floats, parts: Parts) -> Draws:
    """Return the faults of P episodes, drawn by ``uniforms`` (P, ``uniforms_of(faults)``).

    Random faults are of ``parts``. A fault of a tier that needs another part is left out.
    """
    count = len(uniforms)
    numbers = iter(uniforms.T)
    kinds: list[Kind] = []
    columns: list[tuple[Any, ...]] = []
    for fault in faults:
        onset: Any = fault.onset
        if isinstance(onset, tuple):
            early, late = onset
            onset = early + (late - early) * next(numbers)
        duration = np.inf if fault.duration is None else fault.duration
        growth = fault.growth or 0.0
        if fault.part == RANDOM:
            for kind, number, grows in _of_tier(TIERS[fault.word], parts, numbers, count, kinds):
                columns.append((kind, number, onset, duration, growth * grows))
        else:
            kinds.append((fault.part, fault.word))
            fixed = np.nan if fault.number is None else fault.number
            columns.append((len(kinds) - 1, fixed, onset, duration, growth))
    tables = np.empty((5, count, len(columns)))
    for i, column in enumerate(columns):
        for table, values in zip(tables, column, strict=True):
            table[:, i] = values
    return Draws(kinds, tables[0].astype(np.intp), *tables[1:])


class _Ways(NamedTuple):
    """The ways in which a tier breaks some parts: W of them, each fitting N parts at most."""

    cumulative: Floats  # (W,) probability of each way or one before it
    fits: Rows  # (W,) how many parts each fits
    part: Rows  # (W, N) which ones, as their numbers among all parts
    kind: Rows  # (W, N) of part and word
    grows: Flags  # (W, N) whether the number may grow
    takes: Flags  # (W, N) whether the word takes a number
    low: Floats  # (W,)
    high: Floats  # (W,)
    signed: Flags  # (W,) whether the number is negative half of the time


def _of_tier(
    tier: Tier, parts: Parts, numbers: Any, count: int, kinds: list[Kind]
) -> list[tuple[Rows, Floats, Flags]]:
    """Return kinds, numbers and whether these may grow (P,), of each part that a tier breaks."""
    known = _Known(tier, parts)
    begin = len(kinds)
    kinds += known.kinds
    taken = np.full((count, tier.parts), NONE)
    found = []
    for i in range(tier.parts):
        way_at, part_at, number_at, sign_at = (next(numbers) for _ in range(UNIFORMS_OF_A_PART))
        kind = np.full(count, NONE)
        number = np.full(count, np.nan)
        grows = np.zeros(count, np.bool_)
        # Robots of which the same parts are broken already have the same ways to break.
        for rows in _alike(taken[:, :i], len(parts)):
            ways = _ways(known, frozenset(taken[rows[0], :i].tolist()))
            if ways is None:
                continue
            way = np.searchsorted(ways.cumulative, way_at[rows], "right")
            way = np.minimum(way, len(ways.cumulative) - 1)
            place = np.floor(part_at[rows] * ways.fits[way]).astype(np.intp)
            low = ways.low[way]
            drawn = low + (ways.high[way] - low) * number_at[rows]
            drawn = np.where(ways.signed[way] & (sign_at[rows] < 0.5), -drawn, drawn)
            kind[rows] = ways.kind[way, place] + begin
            number[rows] = np.where(ways.takes[way, place], drawn, np.nan)
            grows[rows] = ways.grows[way, place]
            taken[rows, i] = ways.part[way, place]
        found.append((kind, number, grows))
    return found


def _alike(taken: Rows, parts: int) -> list[Rows]:
    """Return the numbers of the episodes (P, i) in groups of which the same parts are taken."""
    if not taken.shape[1]:
        return [np.arange(len(taken))]
    code = np.zeros(len(taken), np.intp)
    for column in np.sort(taken, axis=1).T:
        code = code * (parts + 1) + column - NONE
    return [np.flatnonzero(code == one) for one in np.unique(code)]


class _Known:
    """A tier and the parts that it may break. Equal ones are of the same objects."""

    def __init__(self, tier: Tier, parts: Parts) -> None:
        self.tier = tier
        self.parts = parts
        words = dict.fromkeys(chance.word for chance in tier.chances)
        self.kinds = [(name, word) for name in parts for word in words if word in parts[name]]

        # A tier of a user's may hold lists, which have no hash.
        chances = tuple((*chance[:-1], tuple(chance.parts)) for chance in tier.chances)
        self._key = (chances, id(parts))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Known) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)


@functools.lru_cache(maxsize=256)  # the parts of a key stay, so that no others have their identity
def _ways(known: _Known, gone: frozenset[int]) -> _Ways | None:
    """Return the ways to break what is not ``gone``; None if there is none."""
    names = list(known.parts)
    broken = {names[part] for part in gone if part != NONE}
    left = {name: words for name, words in known.parts.items() if name not in broken}
    ways = ways_to_break(known.tier, left)
    if not ways:
        return None
    number_of = {name: i for i, name in enumerate(names)}
    number_of_kind = {kind: i for i, kind in enumerate(known.kinds)}
    widest = max(len(fitting) for _, fitting in ways)
    shape = (len(ways), widest)
    part, kind = np.zeros(shape, np.intp), np.zeros(shape, np.intp)
    grows, takes = np.zeros(shape, np.bool_), np.zeros(shape, np.bool_)
    for i, (chance, fitting) in enumerate(ways):
        for j, name in enumerate(fitting):
            part[i, j] = number_of[name]
            kind[i, j] = number_of_kind[name, chance.word]
            grows[i, j] = can_grow(chance.word, known.parts[name][chance.word])
            takes[i, j] = needs_number(known.parts[name][chance.word])
    weights = np.array([chance.weight for chance, _ in ways])
    return _Ways(
        np.cumsum(weights) / weights.sum(),
        np.array([len(fitting) for _, fitting in ways]),
        part, kind, grows, takes,
        np.array([chance.low for chance, _ in ways]),
        np.array([chance.high for chance, _ in ways]),
        np.array([chance.word == "bias" for chance, _ in ways]),
    )  # fmt: skip


def ways_to_break(tier: Tier, parts: Parts) -> list[tuple[Chance, list[str]]]:
    """Return a tier's chances that fit any of the parts, each with those it fits."""
    fitting = (
        [part for part in parts if chance.word in parts[part] and part in (chance.parts or parts)]
        for chance in tier.chances
    )
    return [(chance, fits) for chance, fits in zip(tier.chances, fitting, strict=True) if fits]


class Spans(NamedTuple):
    """The steps at which the faults (P, F) of episodes begin, have their full size, and end."""

    first: Rows
    full: Rows
    end: Rows

    @classmethod
    def of(cls, draws: Draws, dt: float) -> Spans:
        """Return those of steps of ``dt`` s.

        A fault holds in the steps that begin at its onset or later, and in one at least.
        """
        # Rounding makes no step of its own.
        first = _capped(np.ceil(draws.onset / dt - STEP_ROUNDING))
        first[draws.kind == NONE] = NEVER
        growing = np.ceil(draws.growth / dt - STEP_ROUNDING)
        end = _capped(np.ceil((draws.onset + draws.duration) / dt - STEP_ROUNDING))
        end = np.maximum(first + 1, end)
        full = _capped(first + np.maximum(growing - 1.0, 0.0))
        return cls(first, np.minimum(full, end), end)


def _capped(steps: NDArray[Any]) -> Rows:
    capped: Rows = np.minimum(steps, NEVER).astype(np.intp)
    return capped


def make_stages(
    draws: Draws, dt: float, intact: Mapping[str, NDArray[Any]], break_part: Break
) -> Stages:
    """Return the table of P episodes, in steps of ``dt`` s.

    Parameters
    ----------
    draws
        The faults.
    dt
        The length of a step, s.
    intact
        The columns (P, ...) without them. "faults" (P,) counts the active ones.
    break_part
        What a fault does to rows.
    """
    spans = Spans.of(draws, dt)
    begins = np.concatenate([np.zeros((len(draws.kind), 1), np.intp), *spans], axis=1)
    table = _Table(draws, dt, spans, intact, break_part)
    stages = table.lay_out(begins)
    uneven = table.uneven(stages)
    if not uneven.any():
        return stages
    # What two growing faults make of one number does not grow evenly: it has a row a step.
    rows = np.flatnonzero(uneven)
    steps = stages.until[rows] - stages.since[rows]
    more = np.full((len(begins), steps.sum()), NEVER)
    entries = np.arange(steps.sum())
    starts = np.repeat(np.cumsum(steps) - steps, steps)
    more[np.repeat(stages.episode[rows], steps), entries] = (
        np.repeat(stages.since[rows], steps) + entries - starts
    )
    return table.lay_out(np.concatenate([begins, more], axis=1))


class _Table:
    """Lays out the faults of episodes; see :func:`make_stages`."""

    def __init__(
        self,
        draws: Draws,
        dt: float,
        spans: Spans,
        intact: Mapping[str, NDArray[Any]],
        break_part: Break,
    ) -> None:
        self._draws = draws
        self._dt = dt
        self._spans = spans
        self._intact = intact
        self._break = break_part

    def lay_out(self, begins: Rows) -> Stages:
        """Return a table with a row for each step at which an episode (P, ...) ``begins`` one."""
        ordered = np.sort(begins, axis=1)
        ordered[:, 1:][ordered[:, 1:] == ordered[:, :-1]] = NEVER
        ordered.sort(axis=1)
        episode, _ = found = np.nonzero(ordered < NEVER)
        since = ordered[found]
        first = np.searchsorted(episode, np.arange(len(begins)))
        until = np.append(since[1:], NEVER)
        until[first[1:] - 1] = NEVER
        columns = self._columns(episode, since, since)
        columns["faults"] += self._active(episode, since).sum(axis=1)
        rates = {}
        growing = np.flatnonzero(self._growing(episode, since).any(axis=1))
        if len(growing):
            now = self._columns(episode[growing], since[growing], since[growing])
            later = self._columns(episode[growing], since[growing], since[growing] + 1)
            for name, column in later.items():
                if column.dtype.kind != "f":
                    continue
                rate = np.nan_to_num(column - now[name])  # NaN says that there is no number
                if rate.any():
                    rates[name] = np.zeros_like(columns[name])
                    rates[name][growing] = rate
        return Stages(first, since, until, columns, rates)

    def uneven(self, stages: Stages) -> Flags:
        """Return the rows (R,) whose columns do not grow evenly to the end."""
        uneven = np.zeros(len(stages.until), np.bool_)
        if not stages.rates:
            return uneven
        rows = np.flatnonzero(self._growing(stages.episode, stages.since).any(axis=1))
        last = stages.until[rows] - 1
        expected = stages.at(rows, last)
        found = self._columns(stages.episode[rows], stages.since[rows], last)
        for name in stages.rates:
            apart = ~np.isclose(found[name], expected[name], rtol=LINEARITY, atol=LINEARITY)
            uneven[rows] |= apart.reshape(len(rows), -1).any(axis=1)
        return uneven

    def _active(self, episode: Rows, since: Rows) -> Flags:
        """Return which faults (n, F) are active in rows that begin at steps (n,)."""
        first, _, end = (table[episode] for table in self._spans)
        active: Flags = (first <= since[:, None]) & (since[:, None] < end)
        return active

    def _growing(self, episode: Rows, since: Rows) -> Flags:
        full = self._spans.full[episode]
        growing: Flags = self._active(episode, since) & (since[:, None] < full)
        return growing

    def _columns(self, episode: Rows, since: Rows, step: Rows) -> dict[str, NDArray[Any]]:
        """Return the columns (n, ...) at steps (n,) of rows that begin at steps (n,)."""
        draws = self._draws
        columns = {name: column[episode] for name, column in self._intact.items()}
        kinds = np.where(self._active(episode, since), draws.kind[episode], NONE)
        numbers = draws.number[episode]
        growing = step[:, None] < self._spans.full[episode]
        for i, of_rows in enumerate(kinds.T):
            for kind in np.unique(of_rows[of_rows != NONE]).tolist():
                part, word = draws.kinds[kind]
                rows = np.flatnonzero(of_rows == kind)
                number = numbers[rows, i]
                wanted = words_of(part)[word]
                grows = growing[rows, i]
                if grows.any() and wanted is not None and wanted.neutral is not None:
                    those = episode[rows]
                    steps = step[rows] - self._spans.first[those, i] + 1
                    share = steps * self._dt / np.where(grows, draws.growth[those, i], 1.0)
                    grown = wanted.neutral + share * (number - wanted.neutral)
                    number = np.where(grows, grown, number)
                self._break(columns, rows, part, word, number)
        return columns
