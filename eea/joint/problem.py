"""What a robot of joint inference may have besides its parameters: nuisances, hypotheses, parts."""

from __future__ import annotations

import math
import numbers
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from eea.core.angles import Floats
from eea.core.checks import (
    ConfigurationError,
    all_of,
    callback,
    finite,
    flag,
    instance,
    mapping,
    real,
    real_or_infinite,
    text,
    whole,
)
from eea.statistics.conformal import Calibration
from eea.statistics.normal import Normal


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
#: Takes the values and inputs of B trials, as a simulator does; returns (B, K, T, channels).
DifferenceShapes = Callable[[Values, Any], Floats]


@dataclass(frozen=True)
class Assumed:
    """A number that a simulator assumes and no fit seeks, unless the trials contradict it."""

    name: str  #: As in a sentence: "the density of the fins".
    value: float  #: As assumed.
    sd: float  #: How far it may be from that.
    unit: str  #: "times water's".
    about: str  #: What depends on it: "the thickness of the fins".

    def __post_init__(self) -> None:
        text("name", self.name)
        real(f"value of {self.name}", self.value, -math.inf)
        real(f"sd of {self.name}", self.sd, 1e-12)
        text(f"unit of {self.name}", self.unit)
        text(f"about of {self.name}", self.about)


@dataclass(frozen=True, eq=False)
class Discrepancy:
    """Size and shape of a simulator's errors; see ``eea.joint.discrepancy``."""

    share: float  #: Standard deviation of the error, as a share of the signal's rms.
    #: Time in which the error's correlation falls by a factor of e, in the unit of the trials'
    #: times, or in samples where trials have no times.
    duration: float
    #: Function that returns the differences of known shape, or None.
    shapes: DifferenceShapes | None = None
    calibration: Calibration | None = None  #: None leaves the intervals as they are.
    #: Numbers that become nuisances of the intervals where trials contradict them, and a function
    #: that returns the difference that one ``sd`` of each makes.
    assumed: tuple[Assumed, ...] = ()
    assumed_shapes: DifferenceShapes | None = None

    def __post_init__(self) -> None:
        real("share", self.share, 0.0, 1.0)
        real("duration", self.duration, 1e-12)
        callback("shapes", self.shapes)
        if self.calibration is not None:
            instance("calibration", self.calibration, Calibration)
        object.__setattr__(self, "assumed", all_of("assumed", self.assumed, Assumed))
        callback("assumed_shapes", self.assumed_shapes)
        if bool(self.assumed) != (self.assumed_shapes is not None):
            raise ConfigurationError(
                "assumed and assumed_shapes must be given together; got one without the other"
            )


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
