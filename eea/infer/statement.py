"""A robot, stated by its numbers and a simulator, and what can be asked about it."""

from __future__ import annotations

import inspect
import math
import numbers
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from itertools import combinations, islice
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from eea.core.angles import Floats
from eea.core.checks import (
    ConfigurationError,
    all_of,
    brief,
    callback,
    choice,
    finite,
    flag,
    instance,
    mapping,
    real,
    real_or_infinite,
    text,
    whole,
)

RANGE_SDS = 5.0  # on each side of a mean, for a number that states no range


@dataclass(frozen=True, init=False)
class Number:
    """One number of a robot: its range or its prior, and how it may differ.

    ``Number(0.2, 2.0)`` lies in a range, uniformly; it is what is sought. ``Number(0.0, sd=0.03)``
    is normal about a mean. ``Number(-1.0, 1.0, mean=0.0, sd=0.3)`` is the same, truncated to a
    range. ``Number.angle()`` is an angle that is unknown in each trial. As a change, in
    :class:`Hypothesis`, ``Number(0.0, sd=0.3)`` is one either way, ``Number(mean=0.0, sd=0.3,
    low=0.0)`` one upwards, and ``Number(0.0)`` one to anywhere in the range.

    Parameters
    ----------
    *ends
        The least and the greatest value, or the mean alone.
    low, high
        The same by name. Without them the range is five ``sd`` on each side of the mean, and as far
        as hypotheses move the number.
    mean
        The mean of the prior, and the value where the number is not inferred.
    sd
        The standard deviation of the prior; infinite is uniform over the range.
    unit
        For findings.
    healthy
        The value where nothing is broken. It has it unless a hypothesis moves it; what has none is
        always sought.
    varies
        Whether each trial has a value of its own, such as a speed at first or a sensor's bias. It
        is always inferred. Its prior is that of every trial: known-good logs do not narrow it.
    circular
        Whether it is an angle, in rad, over a whole turn.
    group
        Numbers with a prior that are inferred together or not at all (``FitConfig.nuisances``); by
        default each is a group of its own.
    switch
        Whether it has the value ``mean`` unless a hypothesis fixes or moves it. Unlike one with a
        ``healthy`` value it is not sought, so that samples of what is sought leave it out.
    valleys
        Number of equal parts of the range that are all tried, because no descent moves from one to
        another; 0 where a descent finds the best.

    Raises
    ------
    ConfigurationError
        If the range is empty, the mean or ``healthy`` is outside of it, or two fields contradict
        each other.

    Examples
    --------
    >>> Number(0.2, 2.0, healthy=0.6).sought, Number(0.0, sd=0.03).sought
    (True, False)
    >>> Number(mean=0.0, sd=0.2, low=0.0).low  # half of a normal: upwards only
    0.0
    """

    low: float
    high: float
    mean: float | None
    sd: float
    unit: str
    healthy: float | None
    varies: bool
    circular: bool
    group: str
    switch: bool
    valleys: int

    def __init__(
        self,
        *ends: float,
        low: float = -math.inf,
        high: float = math.inf,
        mean: float | None = None,
        sd: float = math.inf,
        unit: str = "",
        healthy: float | None = None,
        varies: bool = False,
        circular: bool = False,
        group: str = "",
        switch: bool = False,
        valleys: int = 0,
    ) -> None:
        if len(ends) == 2 and low == -math.inf and high == math.inf:
            low, high = ends
        elif len(ends) == 1 and mean is None:
            (mean,) = ends
        elif ends:
            raise ConfigurationError(
                "ends must be the least and the greatest value, or the mean alone, and each given "
                f"once; got {brief(ends)}"
            )
        given = locals()
        for name in self.__dataclass_fields__:
            object.__setattr__(self, name, given[name])
        self._check()

    def _check(self) -> None:
        real_or_infinite("low", self.low, -math.inf)
        real_or_infinite("high", self.high, -math.inf)
        real_or_infinite("sd", self.sd, 1e-12)
        if not self.low < self.high:
            raise ConfigurationError(
                f"low must be less than high; got {self.low:g} and {self.high:g}"
            )
        if self.mean is not None:
            real("mean", self.mean, -math.inf)
        if self.healthy is not None:
            real("healthy", self.healthy, self.low, self.high)
        text("unit", self.unit, empty=True)
        text("group", self.group, empty=True)
        for name in ("varies", "circular", "switch"):
            flag(name, getattr(self, name))
        whole("valleys", self.valleys, 0, 1000)
        for wrong, words in (
            (
                self.mean is None and math.isfinite(self.sd),
                "mean must be given with sd, as in Number(0.0, sd=0.1)",
            ),
            (
                self.switch and self.mean is None,
                "mean must be given with switch: the value unless a hypothesis says otherwise",
            ),
            (self.switch and self.varies, "switch and varies must not both be given"),
            (
                self.healthy is not None and not self.sought,
                "healthy must be of a number that lies in a range, without sd, varies, circular or "
                "switch",
            ),
            (
                self.circular
                and (self.low, self.high, self.mean, self.sd, self.switch, self.valleys)
                != (-math.pi, math.pi, None, math.inf, False, 0),
                "circular must be of an angle that may be any, such as Number.angle()",
            ),
            (
                bool(self.group) and not self.grouped,
                "group must be of a number with sd that all trials share, since others are always "
                "inferred",
            ),
        ):
            if wrong:
                raise ConfigurationError(f"{words}; got {self}")

    @classmethod
    def angle(cls, varies: bool = True, unit: str = "rad") -> Number:
        """Return an angle of any value: of each trial, or one for all trials."""
        return cls(-math.pi, math.pi, varies=varies, circular=True, unit=unit)

    @property
    def sought(self) -> bool:
        """Whether it lies in a range that all trials share, so that it is what is sought."""
        uniform = math.isinf(self.sd)
        return uniform and not (self.varies or self.circular or self.switch)

    @property
    def grouped(self) -> bool:
        """Whether it can be inferred or not, as its group is."""
        return not (self.sought or self.varies or self.circular or self.switch)

    def of_robot(self, name: str, changes: Sequence[Number]) -> Number:
        """Return the number with a finite range, which has room for changes, and with a mean."""
        low = self.low
        high = self.high
        mean = self.mean
        if mean is None:
            for end, value in (("low", low), ("high", high)):
                if math.isinf(value):
                    raise ConfigurationError(
                        f"{end} of {name} must be finite, or a mean and an sd be given; got {self}"
                    )
            mean = 0.5 * (low + high) if self.varies and not self.circular else None
        else:
            reach = RANGE_SDS * self.sd
            for change in changes:
                spread = math.hypot(self.sd, change.sd)
                far = abs(change.mean or 0.0) + RANGE_SDS * spread
                most = max(abs(change.low), abs(change.high)) + RANGE_SDS * self.sd
                reach = max(reach, min(far, most))
            low = mean - reach if math.isinf(low) else low
            high = mean + reach if math.isinf(high) else high
            if not (math.isfinite(low) and math.isfinite(high)):
                if math.isfinite(self.sd):
                    raise ConfigurationError(
                        f"low and high of {name} must be given, for a hypothesis moves it anywhere "
                        f"between them; got {self}"
                    )
                raise ConfigurationError(
                    f"{name} must have both ends or an sd, as in Number(0.0, 2.0) or "
                    f"Number({mean:g}, sd=0.1); got {self}"
                )
            if self.sought:
                raise ConfigurationError(
                    f"mean of {name} must be given with sd; a value where nothing is broken is "
                    f"healthy={mean:g}; got {self}"
                )
            real(f"mean of {name}", mean, low, high)
        group = self.group or (name if self.grouped else "")
        return replace(self, low=low, high=high, mean=mean, group=group)

    def __repr__(self) -> str:
        shown = [f"{x:g}" for x in (self.low, self.high) if math.isfinite(x)]
        names = [f.name for f in fields(self) if getattr(self, f.name) != _PLAIN.get(f.name)]
        if len(shown) == 2:
            names = [name for name in names if name not in ("low", "high")]
        else:
            shown = []
        return f"Number({', '.join([*shown, *(f'{n}={getattr(self, n)!r}' for n in names)])})"


_CHANGE = ("low", "high", "mean", "sd")  # what a number says that is a change
_PLAIN = {n: one.default for n, one in inspect.signature(Number.__init__).parameters.items()}


@dataclass(frozen=True)
class Hypothesis:
    """An alternative such as a seized servo, compared with others by evidence.

    Examples
    --------
    >>> seized = {"tail": Number.angle(varies=False)}  # whose servo stands still
    >>> Hypothesis("the tail is seized", fixed={"tail servo": 0.0}, moves=seized).odds
    1.0
    """

    name: str  #: A clause, for people.
    #: Values of numbers that it fixes.
    fixed: Mapping[str, float] = field(default_factory=dict)
    #: The numbers that have changed, each by how much; see :class:`Number`. An angle of each trial
    #: moves to one in all trials, ``Number.angle(varies=False)``.
    moves: Mapping[str, Number] = field(default_factory=dict)
    part: str = ""  #: The name of the part that it concerns, if any.
    #: A hypothesis of more changes is fitted only where none of fewer explains the trials.
    changes: int = 1
    odds: float = 1.0  #: Its prior probability, relative to that of the others.
    hint: str = ""  #: Which trial would tell it from others, as "descend faster".

    def __post_init__(self) -> None:
        text("name", self.name)
        mapping("fixed", self.fixed, numbers.Real)
        for name, value in self.fixed.items():
            real(f"fixed {name}", value, -math.inf)
        mapping("moves", self.moves, Number)
        if both := sorted({*self.fixed} & {*self.moves}):
            raise ConfigurationError(
                f"{self.name!r} must fix or move a number, not both; got {both[0]} in both"
            )
        for name, change in self.moves.items():
            _check_change(f"moves of {name}", change)
        text("part", self.part, empty=True)
        text("hint", self.hint, empty=True)
        whole("changes", self.changes, 0, 1000)
        real("odds", self.odds, 1e-300)


def _check_change(argument: str, change: Number) -> None:
    """Raise a ConfigurationError unless a number says only what a change has."""
    ends = {} if change.circular else {name: getattr(change, name) for name in _CHANGE}
    plain = Number.angle(varies=False) if change.circular else Number(**ends)
    if change != plain:
        raise ConfigurationError(
            f"{argument} must be ends, a mean and an sd, or an angle of all trials; got {change}, "
            f"so state {plain}"
        )


@dataclass(frozen=True)
class Part:
    """Parameters that belong together, such as a fin's sizes.

    Examples
    --------
    >>> sizes = {"tail.length": "length", "tail.width": "width"}
    >>> Part(sizes, area=("tail.length", "tail.width")).hint
    ''
    """

    sizes: Mapping[str, str]  #: Parameter -> its label, such as "length".
    area: tuple[str, ...] = ()  #: Two parameters whose product is the part's area, if it has one.
    hint: str = ""  #: Which trial would determine them.

    def __post_init__(self) -> None:
        mapping("sizes", self.sizes, str)
        object.__setattr__(self, "area", all_of("area", self.area, str))
        text("hint", self.hint, empty=True)


Values = Mapping[str, Floats]  # by name, (B,) each, in natural units


class Discrepancy(Protocol):
    """The errors of a simulator, beside noise, as one kind of robot knows them.

    What a robot without one leaves is noise, which may be coloured. The fish has
    ``eea.fish.simulator_error``.
    """

    def slow_p(self, regression: Any, theta: Floats) -> float:
        """Return the p-value of slow residuals at an optimum ``theta`` (P,) of a regression."""

    def doubts(self, fits: Sequence[Any], best: Any) -> tuple[list[list[Any]], tuple[str, ...]]:
        """Return the modes of hypotheses' ``fits`` with these errors, and sentences on them.

        ``best`` is the best of the fits, each of them :class:`eea.infer.optima.Optima`.
        """


@dataclass(frozen=True, eq=False)
class Prior:
    """A normal prior of some parameters and nuisances, as shares of their ranges."""

    names: tuple[str, ...]
    mean: Floats  #: Mean (n,).
    covariance: Floats  #: Covariance (n, n).

    def __post_init__(self) -> None:
        count = len(all_of("names", self.names, str))
        for name, shape in {"mean": (count,), "covariance": (count, count)}.items():
            object.__setattr__(self, name, finite(name, getattr(self, name), shape))

    def of(self, robot: RobotModel, other: RobotModel) -> Prior:
        """Return it, which is of a robot's ranges, as shares of those of another robot."""
        before = [robot.table[name] for name in self.names]
        after = [other.table.get(name, robot.table[name]) for name in self.names]
        span = np.array([number.high - number.low for number in before])
        wide = np.array([number.high - number.low for number in after])
        moved = np.array([b.low - a.low for b, a in zip(before, after, strict=True)])
        scale = span / wide
        mean = moved / wide + scale * self.mean
        return Prior(self.names, mean, np.outer(scale, scale) * self.covariance)


CHANGE_ODDS = 0.1  # of a change of any number, relative to none


def together(hypotheses: Sequence[Hypothesis], most: int) -> Iterator[Hypothesis]:
    """Yield the hypotheses, and those that up to ``most`` of them hold at once.

    Combinations of more are fitted only where none of fewer explains the trials. Those of one part,
    or of the same numbers, are left out.
    """
    yield from hypotheses
    for count in range(2, most + 1):
        for some in combinations(hypotheses, count):
            names = [n for one in some for n in {*one.fixed, *one.moves, one.part}]
            names = [name for name in names if name]
            if len(set(names)) == len(names):
                yield joined(some)


def joined(several: Sequence[Hypothesis]) -> Hypothesis:
    """Return several hypotheses as one."""
    fixed: dict[str, float] = {}
    moves: dict[str, Number] = {}
    for one in several:
        fixed |= one.fixed
        moves |= one.moves
    return Hypothesis(
        " and ".join(one.name for one in several),
        fixed,
        moves,
        changes=sum(one.changes for one in several),
        odds=math.prod(one.odds for one in several),
    )


def any_change(names: Collection[str]) -> list[Hypothesis]:
    """Return the hypotheses that each of some numbers may be anywhere in its range."""
    odds = CHANGE_ODDS / max(len(names), 1)
    anywhere = Number(0.0)
    return [Hypothesis(f"{name} has changed", moves={name: anywhere}, odds=odds) for name in names]


#: Unit of a channel -> a whole turn in it: a channel of the kind "rad, wraps" may jump by it.
TURNS = {"rad": 2.0 * math.pi, "deg": 360.0, "rev": 1.0}
WRAPS = "wraps"
QUATERNION = "quaternion"  # the unit of four channels: q and -q are one attitude
MOST_STRIDE = 4
MOST_AT_ONCE = 3
MOST_ALTERNATIVES = 2000  # 200, of 200 numbers, take nine minutes of one core
NOTHING_BROKEN = Hypothesis("nothing is broken")


class Simulate(Protocol):
    """A simulator of batches of trials."""

    def __call__(self, values: Values, inputs: Any, /) -> NDArray[Any]:
        """Return the signal (B, T, channels) of B trials.

        ``values`` has the numbers by name, (B,) each, in natural units and rad. ``inputs``
        (B, ...) are the trials' own: a command, a series of them, or what else was given with
        them; None where nothing was. No trial may depend on the others; one that diverges gives a
        signal that is not finite, or masked: an exception would end the search. Trials of unequal
        length may be simulated for as long as the longest. A simulator may take a third argument,
        ``fine``: whether double precision is asked for.
        """


@dataclass(frozen=True, eq=False)
class RobotModel:
    """What is known of a robot, checked; :class:`Robot` describes the fields."""

    simulate: Simulate
    numbers: Mapping[str, Number]
    channels: Mapping[str, str]
    hypotheses: Sequence[Hypothesis] | None = None
    at_once: int = 1
    parts: Mapping[str, Part] = field(default_factory=dict)
    nominal: Hypothesis = NOTHING_BROKEN
    prior: Prior | None = None
    discrepancy: Discrepancy | None = None
    stride: int = MOST_STRIDE
    loudest: float = math.inf
    plan: str | Mapping[str, Any] | None = None

    def __post_init__(self) -> None:
        if not callable(self.simulate):
            raise ConfigurationError(f"simulate must be a function; got {brief(self.simulate)}")
        mapping("channels", self.channels, str)
        if not self.channels:
            raise ConfigurationError("channels must be one or more; got none")
        check_kinds(self.channels)
        mapping("numbers", self.numbers, Number)
        if not self.numbers:
            raise ConfigurationError("numbers must be one or more, by name; got none")
        if self.hypotheses is not None:
            object.__setattr__(
                self, "hypotheses", all_of("hypotheses", self.hypotheses, Hypothesis)
            )
        mapping("parts", self.parts, Part)
        instance("nominal", self.nominal, Hypothesis)
        if self.prior is not None:
            instance("prior", self.prior, Prior)
            # Its shares are of these ranges, which hypotheses widen: without them they stay so.
            object.__setattr__(self, "numbers", self.table)
        if self.discrepancy is not None:
            for name in ("slow_p", "doubts"):
                callback(f"{name} of discrepancy", getattr(self.discrepancy, name, 0))
        real_or_infinite("loudest", self.loudest, 0.0)
        if self.plan is not None and not isinstance(self.plan, str):
            mapping("plan", self.plan, object)
        whole("stride", self.stride, 1, 1000)
        whole("at_once", self.at_once, 1, MOST_AT_ONCE)
        for name in (*self.numbers, *self.channels):
            text("a name of numbers or channels", name)
            if "@" in name:  # which a trial's own numbers have before its number
                raise ConfigurationError(f"a name must have no @; got {name!r}")
        for hypothesis in self.hypotheses or ():
            if not (hypothesis.fixed or hypothesis.moves):
                raise ConfigurationError(
                    f"{hypothesis.name!r} must fix or move a number, as a hypothesis of what is "
                    "broken; got neither"
                )
        for hypothesis in (self.nominal, *self.alternatives):
            self._check(hypothesis)
        _check_distinct("hypotheses", [h.name for h in (self.nominal, *self.alternatives)])
        for part, of in self.parts.items():
            for name in (*of.sizes, *of.area):
                choice(f"a number of {part!r}", name, self.sought)

    def _check(self, hypothesis: Hypothesis) -> None:
        ranges = [name for name, number in self.table.items() if not number.circular]
        movable = [n for n, one in self.table.items() if one.varies or not one.circular]
        for field_name, given, known in (
            ("fixed", hypothesis.fixed, ranges),
            ("moves", hypothesis.moves, movable),
            ("part", [hypothesis.part] if hypothesis.part else [], self.parts),
        ):
            for name in given:
                choice(f"{field_name} of {hypothesis.name!r}", name, known)
        for name, value in hypothesis.fixed.items():
            if name in self.sought:  # one with a prior that fails may be beyond its range
                number = self.table[name]
                real(f"fixed {name} of {hypothesis.name!r}", value, number.low, number.high)
        for name, change in hypothesis.moves.items():
            number = self.table[name]
            if change.circular != number.circular:
                valid = "Number.angle(varies=False)" if number.circular else "Number(0.0, sd=0.1)"
                raise ConfigurationError(
                    f"moves of {hypothesis.name!r} must be such as {valid} of {name}; got {change}"
                )
            low = number.low
            high = number.high
            was = self.usual.get(name)
            if was is not None and not low - change.high < was < high - change.low:
                raise ConfigurationError(
                    f"moves of {hypothesis.name!r} must stay within [{low:g}, {high:g}] of {name}, "
                    f"which is {was:g} before; got {change}"
                )

    def fixed(self, hypothesis: Hypothesis) -> dict[str, float]:
        """Return what has a fixed value if a hypothesis holds: what is whole and does not move."""
        kept = {name: v for name, v in self.healthy.items() if name not in hypothesis.moves}
        return {**kept, **hypothesis.fixed}

    @cached_property
    def table(self) -> dict[str, Number]:
        """The numbers with their ranges and means: sought ones, others, of each trial, angles."""
        changes = [h.moves for h in self.hypotheses or ()]
        found = {
            name: number.of_robot(name, [moves[name] for moves in changes if name in moves])
            for name, number in self.numbers.items()
        }
        order = sorted(found.items(), key=lambda row: _rank(row[1]))
        return dict(order)

    @cached_property
    def sought(self) -> tuple[str, ...]:
        """The names of the numbers that lie in a range and that all trials share."""
        return tuple(name for name, number in self.table.items() if number.sought)

    @cached_property
    def healthy(self) -> dict[str, float]:
        """The values of numbers where nothing is broken, of those that state one."""
        return {n: one.healthy for n, one in self.table.items() if one.healthy is not None}

    @cached_property
    def varying(self) -> tuple[str, ...]:
        """The names of the numbers of each trial, except angles."""
        return tuple(n for n, one in self.table.items() if one.varies and not one.circular)

    @cached_property
    def angles(self) -> tuple[str, ...]:
        """The names of the angles."""
        return tuple(name for name, number in self.table.items() if number.circular)

    @cached_property
    def usual(self) -> dict[str, float]:
        """What is known of numbers before any trial, if nothing is broken."""
        found = {
            name: number.mean
            for name, number in self.table.items()
            if number.mean is not None and not number.sought and not number.circular
        }
        if self.prior is not None:
            for name, share in zip(self.prior.names, self.prior.mean.tolist(), strict=True):
                if name in self.table:  # what is known of the robot at rest is known in mid-swim
                    number = self.table[name]
                    found[name] = number.low + (number.high - number.low) * share
        return {**found, **self.healthy}

    def without_healthy(self) -> Self:
        """Return the robot whose numbers are all sought."""
        freed = {name: replace(number, healthy=None) for name, number in self.numbers.items()}
        return replace(self, numbers=freed)

    @cached_property
    def alternatives(self) -> tuple[Hypothesis, ...]:
        """What may hold instead of ``nominal``: hypotheses, and several of them at once."""
        stated = any_change(self.healthy) if self.hypotheses is None else self.hypotheses
        found = tuple(islice(together(stated, self.at_once), MOST_ALTERNATIVES + 1))
        if len(found) > MOST_ALTERNATIVES:
            raise ConfigurationError(
                f"hypotheses must be at most {MOST_ALTERNATIVES}, each of which is fitted; those "
                f"of {len(stated)} changes, {self.at_once} at once, are more: lower at_once, or "
                "state the hypotheses that matter"
            )
        return found

    @property
    def names(self) -> tuple[str, ...]:
        """The names of all numbers of a trial, in the order of ``table``."""
        return tuple(self.table)

    @cached_property
    def low(self) -> Floats:
        """The least value of each sought number (n,)."""
        return np.array([self.table[name].low for name in self.sought], np.float64)

    @cached_property
    def high(self) -> Floats:
        """The greatest value of each sought number (n,)."""
        return np.array([self.table[name].high for name in self.sought], np.float64)

    @property
    def span(self) -> Floats:
        """The widths of the sought numbers' ranges (n,)."""
        return self.high - self.low

    @property
    def groups(self) -> tuple[str, ...]:
        """The groups of numbers that can be inferred or not."""
        return tuple(dict.fromkeys(one.group for one in self.table.values() if one.group))

    @cached_property
    def channel_units(self) -> dict[str, str]:
        """The units of the channels, without their kind."""
        return {name: unit.partition(",")[0].strip() for name, unit in self.channels.items()}

    @cached_property
    def turns(self) -> Floats:
        """A whole turn of each channel (C,), infinite for one that does not wrap."""
        return np.array([turn_of(unit) for unit in self.channels.values()])

    @cached_property
    def quaternions(self) -> list[slice]:
        """The groups of four channels that are quaternions."""
        return quaternions_of(self.channels)

    @property
    def unit(self) -> str:
        """The unit of the signal, if all channels have the same; else nothing."""
        units = set(self.channel_units.values())
        return units.pop() if len(units) == 1 else ""

    @property
    def noun(self) -> str:
        """What findings call that which is sought: a body, if it has parts with sizes."""
        return "body" if self.parts else "robot"

    def with_unit(self, name: str, value: float, digits: int = 3) -> str:
        """Return a value of a number with its unit, where it has one."""
        return f"{value:.{digits}g} {self.table[name].unit}".strip()

    def signal(self, values: Values, inputs: Any, fine: bool) -> NDArray[Any]:
        """Return what ``simulate`` returns, in double precision where it can and ``fine`` asks."""
        if self._takes_precision:
            return self.simulate(values, inputs, fine)  # type: ignore[call-arg]
        return self.simulate(values, inputs)

    @cached_property
    def _takes_precision(self) -> bool:
        try:
            return "fine" in inspect.signature(self.simulate).parameters
        except (TypeError, ValueError):
            return False


def turn_of(unit: str) -> float:
    """Return a whole turn of a channel that wraps, in its unit; infinite for another channel."""
    plain, _, kind = unit.partition(",")
    return TURNS[plain.strip()] if kind else math.inf


def quaternions_of(channels: Mapping[str, str]) -> list[slice]:
    """Return the places of the channels that are quaternions, four of each."""
    places = [i for i, unit in enumerate(channels.values()) if unit.strip() == QUATERNION]
    return [slice(i, i + 4) for i in places[::4]]


def check_kinds(channels: Mapping[str, str]) -> None:
    """Raise a ConfigurationError for a channel of an unknown kind."""
    for name, stated in channels.items():
        unit, comma, kind = (part.strip() for part in stated.partition(","))
        said = WRAPS in stated.lower() or comma
        if said and (kind != WRAPS or unit not in TURNS):
            known = ", ".join(f"'{unit}, {WRAPS}'" for unit in TURNS)
            raise ConfigurationError(
                f"the unit of {name} must be a plain one, or one of {known}; got {stated!r}"
            )
    four = [unit.strip() == QUATERNION for unit in channels.values()]
    run = 0
    for one in (*four, False):
        if not one and run % 4:
            raise ConfigurationError(
                f"channels of the unit {QUATERNION!r} must be four, one after the other; got {run}"
            )
        run = run + 1 if one else 0


def _check_distinct(what: str, names: Sequence[str]) -> None:
    for name in names:
        if names.count(name) > 1:
            raise ConfigurationError(
                f"{what} must have names of their own; {name!r} is given twice"
            )


def _rank(number: Number) -> int:
    """Return where a number stands in the vector of unknowns."""
    if number.circular:
        return 3
    if number.varies:
        return 2
    return 0 if number.sought else 1
