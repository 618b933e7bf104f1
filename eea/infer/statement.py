"""A robot, stated by its numbers and a simulator, and what can be asked about it."""

from __future__ import annotations

import inspect
import math
import numbers
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations, islice
from typing import TYPE_CHECKING, Any, Protocol

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


@dataclass(frozen=True)
class Normal:
    """A normal distribution, truncated to [low, high]; with an infinite ``sd`` it is uniform.

    Examples
    --------
    >>> Normal(0.0, 0.2, low=0.0).low  # half of it: upwards only
    0.0
    """

    mean: float
    sd: float
    low: float = -math.inf
    high: float = math.inf

    def __post_init__(self) -> None:
        real("mean", self.mean, -math.inf)
        for name, least in (("sd", 1e-12), ("low", -math.inf), ("high", -math.inf)):
            real_or_infinite(name, getattr(self, name), least)
        if not self.low < self.high:
            raise ConfigurationError(
                f"low must be less than high; got {self.low:g} and {self.high:g}"
            )


@dataclass(frozen=True)
class Nuisance:
    """One number besides the parameters that the robot's signal depends on.

    The prior is a normal distribution about ``nominal``, truncated to the range; with an infinite
    ``sd`` it is uniform. Nuisances of one ``group`` are inferred together or not at all.

    Raises
    ------
    ConfigurationError
        If the range is empty, or the nominal value outside of it.

    Examples
    --------
    >>> Nuisance("lag", 0.0, 0.1, nominal=0.0, sd=0.03).group
    'lag'
    """

    name: str
    low: float
    high: float
    nominal: float  #: Value where it is not inferred.
    sd: float = math.inf  #: Standard deviation of the prior.
    group: str = ""  #: By default the name.
    switch: bool = False  #: Whether it is nominal unless a hypothesis changes it.
    #: Whether it is part of a trial's initial state, like the hidden angles: always inferred, for
    #: each trial.
    start: bool = False
    #: Number of equal parts of the range that are all tried, because no descent moves from one to
    #: another; 0 where a descent finds the best.
    valleys: int = 0

    def __post_init__(self) -> None:
        text("name", self.name)
        text("group", self.group, empty=True)
        real(f"low of {self.name}", self.low, -math.inf)
        real(f"high of {self.name}", self.high, math.nextafter(self.low, math.inf))
        real(f"nominal of {self.name}", self.nominal, self.low, self.high)
        real_or_infinite(f"sd of {self.name}", self.sd, 1e-12)
        flag(f"switch of {self.name}", self.switch)
        flag(f"start of {self.name}", self.start)
        whole(f"valleys of {self.name}", self.valleys, 0, 1000)
        if not self.group:
            object.__setattr__(self, "group", self.name)


@dataclass(frozen=True)
class Hypothesis:
    """An alternative such as a seized servo, compared with others by evidence.

    Examples
    --------
    >>> Hypothesis("the left servo is dead", {"left servo": 0.0}).shared_angles
    ()
    """

    name: str  #: A clause, for people.
    #: Values of parameters and nuisances that it fixes.
    fixed: Mapping[str, float] = field(default_factory=dict)
    shared_angles: tuple[str, ...] = ()  #: Hidden angles that are the same in all trials.
    freed: tuple[str, ...] = ()  #: Switches that are inferred.
    part: str = ""  #: The name of the part that it concerns, if any.
    #: The parameters and nuisances that have changed, each by how much: ``Normal(0, 0.3)`` is a
    #: change either way, ``Normal(0, 0.3, low=0)`` one upwards, and ``Normal(0, inf)`` one to
    #: anywhere in the range.
    moves: Mapping[str, Normal] = field(default_factory=dict)
    #: A hypothesis of more changes is fitted only where none of fewer explains the trials.
    changes: int = 1
    odds: float = 1.0  #: Its prior probability, relative to that of the others.
    hint: str = ""  #: Which trial would tell it from others, as "descend faster".

    def __post_init__(self) -> None:
        text("name", self.name)
        mapping("fixed", self.fixed, numbers.Real)
        for name, value in self.fixed.items():
            real(f"fixed {name}", value, -math.inf)
        mapping("moves", self.moves, Normal)
        if both := sorted({*self.fixed} & {*self.moves}):
            raise ConfigurationError(
                f"{self.name!r} must fix or move a number, not both; got {both[0]} in both"
            )
        for name in ("shared_angles", "freed"):
            object.__setattr__(self, name, all_of(name, getattr(self, name), str))
        text("part", self.part, empty=True)
        text("hint", self.hint, empty=True)
        whole("changes", self.changes, 0, 1000)
        real("odds", self.odds, 1e-300)


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

        ``best`` is the best of the fits, each of them :class:`eea.infer.search.Optima`.
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


def groups_of(nuisances: Iterable[Nuisance]) -> tuple[str, ...]:
    """Return the groups of nuisances that can be inferred or not."""
    chosen = (n.group for n in nuisances if not n.switch and not n.start)
    return tuple(dict.fromkeys(chosen))


CHANGE_ODDS = 0.1  # of a change of any number, relative to none


def together(hypotheses: Sequence[Hypothesis], most: int) -> Iterator[Hypothesis]:
    """Yield the hypotheses, and those that up to ``most`` of them hold at once.

    Combinations of more are fitted only where none of fewer explains the trials. Those of one part,
    or of the same numbers, are left out.
    """
    yield from hypotheses
    for count in range(2, most + 1):
        for some in combinations(hypotheses, count):
            names = [n for one in some for n in {*one.fixed, *one.moves, *one.freed, one.part}]
            names = [name for name in names if name]
            if len(set(names)) == len(names):
                yield joined(some)


def joined(several: Sequence[Hypothesis]) -> Hypothesis:
    """Return several hypotheses as one."""
    fixed: dict[str, float] = {}
    moves: dict[str, Normal] = {}
    for one in several:
        fixed |= one.fixed
        moves |= one.moves
    return Hypothesis(
        " and ".join(one.name for one in several),
        fixed,
        tuple(name for one in several for name in one.shared_angles),
        tuple(name for one in several for name in one.freed),
        moves=moves,
        changes=sum(one.changes for one in several),
        odds=math.prod(one.odds for one in several),
    )


def any_change(whole: Mapping[str, float]) -> list[Hypothesis]:
    """Return the hypotheses that each number in ``whole`` may be anywhere in its range."""
    odds = CHANGE_ODDS / max(len(whole), 1)
    return [
        Hypothesis(f"{name} has changed", moves={name: Normal(0.0, math.inf)}, odds=odds)
        for name in whole
    ]


MOST_STRIDE = 4
MOST_AT_ONCE = 3
MOST_ALTERNATIVES = 2000  # 200, of 200 numbers, take nine minutes of one core
NUISANCE_RANGE_SDS = 5.0  # on each side of the mean of a nuisance that is given as a Normal
NOTHING_BROKEN = Hypothesis("nothing is broken")


class Simulate(Protocol):
    """A simulator of batches of trials."""

    def __call__(self, values: Values, inputs: Any, /) -> NDArray[Any]:
        """Return the signal (B, T, channels) of B trials.

        ``values`` has the parameters, nuisances and hidden angles by name, (B,) each, in natural
        units and rad. ``inputs`` (B, ...) are the trials' own: a command, a series of them, or what
        else was given with them; None where nothing was. No trial may depend on the others; one
        that diverges gives a signal that is not finite, or masked: an exception would end the
        search. Trials of unequal length may be simulated
        for as long as the longest. A simulator may take a third argument, ``fine``: whether double
        precision is asked for.
        """


@dataclass(frozen=True, eq=False)
class RobotModel:
    """What is known of a robot, checked; :class:`Robot` describes the fields."""

    parameters: Mapping[str, tuple[float, float]]
    simulate: Simulate
    channels: Mapping[str, str]
    whole: Mapping[str, float] = field(default_factory=dict)
    nuisances: Mapping[str, Normal] | Sequence[Nuisance] = ()
    each_trial: Sequence[str] = ()
    hidden: Sequence[str] = ()
    hypotheses: Sequence[Hypothesis] | None = None
    at_once: int = 1
    units: Mapping[str, str] = field(default_factory=dict)
    parts: Mapping[str, Part] = field(default_factory=dict)
    nominal: Hypothesis = NOTHING_BROKEN
    prior: Prior | None = None
    discrepancy: Discrepancy | None = None
    stride: int = MOST_STRIDE
    loudest: float = math.inf

    def __post_init__(self) -> None:
        if not isinstance(self.parameters, Mapping) or not self.parameters:
            raise ConfigurationError(
                f"parameters must be ranges (low, high) by name; got {brief(self.parameters)}"
            )
        ranges = {name: _checked_range(name, ends) for name, ends in self.parameters.items()}
        object.__setattr__(self, "parameters", ranges)
        if not callable(self.simulate):
            raise ConfigurationError(f"simulate must be a function; got {brief(self.simulate)}")
        mapping("channels", self.channels, str)
        if not self.channels:
            raise ConfigurationError("channels must be one or more; got none")
        mapping("whole", self.whole, numbers.Real)
        for name in ("each_trial", "hidden"):
            object.__setattr__(self, name, all_of(name, getattr(self, name), str))
        if self.hypotheses is not None:
            object.__setattr__(
                self, "hypotheses", all_of("hypotheses", self.hypotheses, Hypothesis)
            )
        mapping("units", self.units, str)
        mapping("parts", self.parts, Part)
        instance("nominal", self.nominal, Hypothesis)
        if self.prior is not None:
            instance("prior", self.prior, Prior)
        if self.discrepancy is not None:
            for name in ("slow_p", "doubts"):
                callback(f"{name} of discrepancy", getattr(self.discrepancy, name, 0))
        real_or_infinite("loudest", self.loudest, 0.0)
        whole("stride", self.stride, 1, 1000)
        whole("at_once", self.at_once, 1, MOST_AT_ONCE)
        for name in (*self.names, *self.channels):
            text("a name of parameters, nuisances, hidden angles or channels", name)
            if "@" in name:  # which a trial's own numbers have before its number
                raise ConfigurationError(f"a name must have no @; got {name!r}")
        _check_distinct("parameters, nuisances and hidden angles", self.names)
        for name, value in self.whole.items():
            choice("whole", name, self.parameters)
            real(f"whole {name}", value, *self.parameters[name])
        for name in self.units:
            choice("units", name, self.names)
        for name in self.each_trial:
            choice("each_trial", name, self._nuisance_names)
        for hypothesis in (self.nominal, *self.alternatives):
            self._check(hypothesis)
        _check_distinct("hypotheses", [h.name for h in (self.nominal, *self.alternatives)])
        for part, of in self.parts.items():
            for name in (*of.sizes, *of.area):
                choice(f"a parameter of {part!r}", name, self.parameters)

    def _check(self, hypothesis: Hypothesis) -> None:
        switches = [nuisance.name for nuisance in self.nuisance_list if nuisance.switch]
        for field_name, given, known in (
            ("fixed", hypothesis.fixed, self.ranges),
            ("moves", hypothesis.moves, self.ranges),
            ("freed", hypothesis.freed, switches),
            ("shared_angles", hypothesis.shared_angles, self.hidden),
            ("part", [hypothesis.part] if hypothesis.part else [], self.parts),
        ):
            for name in given:
                choice(f"{field_name} of {hypothesis.name!r}", name, known)
        for name, value in hypothesis.fixed.items():
            if name in self.parameters:  # a nuisance that fails may be beyond its range
                real(f"fixed {name} of {hypothesis.name!r}", value, *self.parameters[name])
        for name, change in hypothesis.moves.items():
            low, high = self.ranges[name]
            was = self.usual.get(name)
            if was is not None and not low - change.high < was < high - change.low:
                raise ConfigurationError(
                    f"moves of {hypothesis.name!r} must stay within [{low:g}, {high:g}] of {name}, "
                    f"which is {was:g} before; got {change}"
                )

    def fixed(self, hypothesis: Hypothesis) -> dict[str, float]:
        """Return what has a fixed value if a hypothesis holds: what is whole and does not move."""
        kept = {name: v for name, v in self.whole.items() if name not in hypothesis.moves}
        return {**kept, **hypothesis.fixed}

    @property
    def _nuisance_names(self) -> tuple[str, ...]:
        return tuple(nuisance.name for nuisance in self.nuisance_list)

    @cached_property
    def nuisance_list(self) -> tuple[Nuisance, ...]:
        """The nuisances, with their names, ranges and groups."""
        changes = [h.moves for h in self.hypotheses or ()]
        return _as_nuisances(self.nuisances, changes)

    @cached_property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """The least and the greatest value of each parameter and nuisance."""
        return {**self.parameters, **{n.name: (n.low, n.high) for n in self.nuisance_list}}

    @cached_property
    def usual(self) -> dict[str, float]:
        """What is known of parameters and nuisances before any trial, if nothing is broken."""
        found = {nuisance.name: nuisance.nominal for nuisance in self.nuisance_list}
        if self.prior is not None:
            for name, share in zip(self.prior.names, self.prior.mean.tolist(), strict=True):
                low, high = self.ranges[name]
                found[name] = low + (high - low) * share
        return {**found, **self.whole}

    @cached_property
    def alternatives(self) -> tuple[Hypothesis, ...]:
        """What may hold instead of ``nominal``: hypotheses, and several of them at once."""
        stated = any_change(self.whole) if self.hypotheses is None else self.hypotheses
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
        """The names of all numbers of a trial: parameters, nuisances, hidden angles."""
        return (*self.parameters, *self._nuisance_names, *self.hidden)

    @cached_property
    def low(self) -> Floats:
        """The least value of each parameter (n,)."""
        return np.array([low for low, _ in self.parameters.values()], np.float64)

    @cached_property
    def high(self) -> Floats:
        """The greatest value of each parameter (n,)."""
        return np.array([high for _, high in self.parameters.values()], np.float64)

    @property
    def span(self) -> Floats:
        """The widths of the parameters' ranges (n,)."""
        return self.high - self.low

    @property
    def groups(self) -> tuple[str, ...]:
        """The groups of nuisances that can be inferred or not."""
        return groups_of(self.nuisance_list)

    @property
    def unit(self) -> str:
        """The unit of the signal, if all channels have the same; else nothing."""
        units = set(self.channels.values())
        return units.pop() if len(units) == 1 else ""

    @property
    def noun(self) -> str:
        """What findings call that which is sought: a body, if it has parts with sizes."""
        return "body" if self.parts else "robot"

    def with_unit(self, name: str, value: float, digits: int = 3) -> str:
        """Return a value of a parameter or nuisance with its unit, where it has one."""
        return f"{value:.{digits}g} {self.units.get(name, '')}".strip()

    def varying(self, groups: Collection[str]) -> RobotModel:
        """Return the robot whose nuisances of some groups vary from trial to trial, too."""
        names = [n.name for n in self.nuisance_list if n.group in groups and not n.start]
        return replace(self, each_trial=tuple(dict.fromkeys([*self.each_trial, *names])))

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


def _check_distinct(what: str, names: Sequence[str]) -> None:
    for name in names:
        if names.count(name) > 1:
            raise ConfigurationError(
                f"{what} must have names of their own; {name!r} is given twice"
            )


def _checked_range(name: str, ends: object) -> tuple[float, float]:
    """Return the two ends of a parameter's range."""
    if not isinstance(ends, list | tuple) or len(ends) != 2:
        raise ConfigurationError(
            f"parameters must be ranges (low, high) by name; got {brief(ends)} of {brief(name)}"
        )
    low, high = ends
    real(f"low of {name}", low, -math.inf)
    real(f"high of {name}", high, math.nextafter(low, math.inf))
    return float(low), float(high)


def _as_nuisances(
    given: Mapping[str, Normal] | Sequence[Nuisance], changes: Sequence[Mapping[str, Normal]]
) -> tuple[Nuisance, ...]:
    """Return nuisances from distributions by name, or as they are; ranges have room for changes."""
    if not isinstance(given, Mapping):
        return all_of("nuisances", given, Nuisance)
    mapping("nuisances", given, Normal)
    found = []
    for name, normal in given.items():
        text("the name of a nuisance", name)
        if math.isfinite(normal.sd):  # the prior is about its mean
            real(f"mean of {name}", normal.mean, normal.low, normal.high)
        reach = NUISANCE_RANGE_SDS * normal.sd
        for change in (moves[name] for moves in changes if name in moves):
            far = abs(change.mean) + NUISANCE_RANGE_SDS * math.hypot(normal.sd, change.sd)
            reach = max(reach, far)
        low = max(normal.low, normal.mean - reach)
        high = min(normal.high, normal.mean + reach)
        if not (math.isfinite(low) and math.isfinite(high)):
            raise ConfigurationError(
                f"{name} must have a finite range or spread; got {brief(normal)}"
            )
        found.append(Nuisance(name, low, high, min(max(normal.mean, low), high), normal.sd))
    return tuple(found)


if TYPE_CHECKING:  # they load scipy, and a statement needs none
    pass
