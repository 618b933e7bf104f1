"""A robot for joint inference: a core ``Problem``, nuisances, hypotheses and a simulator."""

from __future__ import annotations

import math
import numbers
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

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
    text,
    whole,
)
from eea.core.problem import Problem

MOST_STRIDE = 4


class Simulate(Protocol):
    """A simulator of batches of trials."""

    def __call__(
        self, bodies: Floats, nuisances: Floats, commands: Floats, angles: Floats, fine: bool
    ) -> NDArray[Any]:
        """Return the signal (B, T, axes) of B trials.

        ``bodies`` (B, n) and ``commands`` (B, c) are in the problem's units, ``nuisances`` (B, k)
        in their own units and order, the hidden ``angles`` (B, h) in rad. ``commands`` may be
        another array of B rows, such as series. ``fine`` requests double precision. No trial may
        depend on the others; one that diverges gives a signal that is not finite.
        """


@dataclass(frozen=True)
class Nuisance:
    """One number besides the body that the robot's motion depends on.

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
        if not (isinstance(self.sd, float) and self.sd == math.inf):
            real(f"sd of {self.name}", self.sd, 1e-12)
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

    name: str  #: A clause for findings.
    #: Fixed values of dimensions and nuisances, by name.
    fixed: Mapping[str, float] = field(default_factory=dict)
    shared_angles: tuple[str, ...] = ()  #: Hidden angles that are the same in all trials.
    freed: tuple[str, ...] = ()  #: Switches that are inferred.
    part: str = ""  #: Name of the affected part, if any.
    changed: tuple[str, ...] = ()  #: Parameters whose prior is dropped.
    #: Number of changes. It is fitted only where no hypothesis with fewer explains the trials.
    changes: int = 1
    odds: float = 1.0  #: Prior probability relative to the others.

    def __post_init__(self) -> None:
        text("name", self.name)
        mapping("fixed", self.fixed, numbers.Real)
        for name, value in self.fixed.items():
            real(f"fixed {name}", value, -math.inf)
        for name in ("shared_angles", "freed", "changed"):
            object.__setattr__(self, name, all_of(name, getattr(self, name), str))
        text("part", self.part, empty=True)
        whole("changes", self.changes, 0, 1000)
        real("odds", self.odds, 0.0)


@dataclass(frozen=True)
class Part:
    """Dimensions that belong together, such as a fin's.

    Examples
    --------
    >>> sizes = {"tail.length": "length", "tail.width": "width"}
    >>> Part(sizes, area=("tail.length", "tail.width")).hint
    ''
    """

    sizes: Mapping[str, str]  #: Dimension -> its label, such as "length".
    area: tuple[str, ...] = ()  #: Two dimensions whose product is the part's area, if it has one.
    hint: str = ""  #: A clause on the trial that would determine the dimensions.

    def __post_init__(self) -> None:
        mapping("sizes", self.sizes, str)
        object.__setattr__(self, "area", all_of("area", self.area, str))
        text("hint", self.hint, empty=True)


#: Takes bodies, nuisances, commands and angles of B trials; returns (B, K, T, axes), rad/s.
DifferenceShapes = Callable[[Floats, Floats, NDArray[Any], Floats], Floats]


@dataclass(frozen=True)
class Calibration:
    """Factors of split-conformal prediction on the half widths of intervals.

    With these factors, 90% intervals hold 90% of each dimension in the calibration robots.

    Examples
    --------
    >>> calibration = Calibration((0.01, 0.1), ((0.8, 0.9), (1.0, 0.7)))
    >>> calibration.factors(0.0316).round(2)
    array([0.9, 0.8])
    """

    #: Noise divided by the signal's norm, ascending; one level for each row.
    levels: tuple[float, ...]
    rows: tuple[tuple[float, ...], ...]  #: A row for each level, a factor for each dimension.

    def __post_init__(self) -> None:
        levels = finite("levels", self.levels, (None,))
        if not len(levels) or (levels <= 0.0).any() or (np.diff(levels) <= 0.0).any():
            raise ConfigurationError(
                f"levels must be ascending and more than 0; got {brief(self.levels)}"
            )
        finite("rows", self.rows, (len(levels), None))

    def factors(self, level: float) -> Floats:
        """Return the factors (n,) at a level, constant beyond the first and the last level."""
        at = np.log(max(level, 1e-12))
        knots = np.log(self.levels)
        return np.array([np.interp(at, knots, row) for row in zip(*self.rows, strict=True)])


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

    def __post_init__(self) -> None:
        real("share", self.share, 0.0, 1.0)
        real("duration", self.duration, 1e-12)
        callback("shapes", self.shapes)
        if self.calibration is not None:
            instance("calibration", self.calibration, Calibration)


AS_COMMANDED = Hypothesis("every servo does as it is told")


@dataclass(frozen=True, eq=False)
class Prior:
    """A normal prior of some dimensions and nuisances, as shares of their ranges."""

    names: tuple[str, ...]
    mean: Floats  #: Mean (n,).
    covariance: Floats  #: Covariance (n, n).

    def __post_init__(self) -> None:
        count = len(all_of("names", self.names, str))
        for name, shape in {"mean": (count,), "covariance": (count, count)}.items():
            object.__setattr__(self, name, finite(name, getattr(self, name), shape))


@dataclass(frozen=True)
class JointProblem:
    """A robot whose body, nuisances and hidden angles are inferred together.

    Raises
    ------
    ConfigurationError
        If a name occurs twice, or a hypothesis or part refers to an unknown name.

    Examples
    --------
    A pendulum with a motor, of unknown length, whose gyroscope has a bias:

    >>> from eea.core.genome import action_layout, model_layout
    >>> def simulate(bodies, nuisances, commands, angles, fine):
    ...     time = 0.01 * np.arange(1, 65)
    ...     rate = bodies[:, :1] * np.sin(commands[:, :1] * time + angles)
    ...     return (rate + nuisances[:, :1])[:, :, None]
    >>> pendulum = Problem(
    ...     models=model_layout([("length", 2.0, 6)]),
    ...     actions=action_layout([("torque", -1.0, 1.0)]),
    ...     hidden=("angle",),
    ...     axes=1,
    ... )
    >>> joint = JointProblem(pendulum, simulate, (Nuisance("bias", -0.1, 0.1, 0.0, sd=0.05),))
    >>> joint.groups
    ('bias',)
    """

    problem: Problem
    simulate: Simulate
    nuisances: tuple[Nuisance, ...] = ()
    hypotheses: tuple[Hypothesis, ...] = ()  #: Alternatives to ``nominal``.
    parts: Mapping[str, Part] = field(default_factory=dict)  #: Parts by name, for the findings.
    nominal: Hypothesis = AS_COMMANDED  #: Hypothesis of the intact robot.
    prior: Prior | None = None  #: Prior that replaces uniform sizes and the nuisances' own priors.
    #: The unknown hidden angles, the only ones that ``simulate`` takes; None for all.
    hidden: tuple[str, ...] | None = None
    discrepancy: Discrepancy | None = None  #: Model discrepancy of ``simulate``.
    stride: int = MOST_STRIDE  #: Early stages of a search compare every n-th sample, at most.

    def __post_init__(self) -> None:
        instance("problem", self.problem, Problem)
        if not callable(self.simulate):
            raise ConfigurationError(f"simulate must be a function; got {brief(self.simulate)}")
        all_of("nuisances", self.nuisances, Nuisance)
        all_of("hypotheses", self.hypotheses, Hypothesis)
        mapping("parts", self.parts, Part)
        instance("nominal", self.nominal, Hypothesis)
        for name, kind in {"prior": Prior, "discrepancy": Discrepancy}.items():
            if getattr(self, name) is not None:
                instance(name, getattr(self, name), kind)
        whole("stride", self.stride, 1, 1000)
        hidden_names = self.problem.hidden if self.hidden is None else self.hidden
        object.__setattr__(self, "hidden", all_of("hidden", hidden_names, str))
        models = self.problem.models.names
        hidden = self.problem.hidden
        nuisances = tuple(nuisance.name for nuisance in self.nuisances)
        switches = [nuisance.name for nuisance in self.nuisances if nuisance.switch]
        names = (*models, *nuisances, *hidden)
        if len(set(names)) < len(names):
            twice = min(name for name in names if names.count(name) > 1)
            raise ConfigurationError(
                "dimensions, nuisances and hidden angles must have names of their own; "
                f"{twice!r} is given twice"
            )
        for name in self.hidden or ():
            choice("hidden", name, hidden)
        for hypothesis in (self.nominal, *self.hypotheses):
            for field_name, given, known in (
                ("fixed", hypothesis.fixed, (*models, *nuisances)),
                ("freed", hypothesis.freed, switches),
                ("changed", hypothesis.changed, (*models, *nuisances)),
                ("shared_angles", hypothesis.shared_angles, hidden),
                ("part", [hypothesis.part] if hypothesis.part else [], self.parts),
            ):
                for name in given:
                    choice(f"{field_name} of {hypothesis.name!r}", name, known)
        for part, of in self.parts.items():
            for dimension in (*of.sizes, *of.area):
                choice(f"a dimension of {part!r}", dimension, models)

    @property
    def groups(self) -> tuple[str, ...]:
        """The groups of nuisances that can be inferred or not."""
        return groups_of(self.nuisances)


def groups_of(nuisances: Iterable[Nuisance]) -> tuple[str, ...]:
    """Return the groups of nuisances that can be inferred or not."""
    chosen = (n.group for n in nuisances if not n.switch and not n.start)
    return tuple(dict.fromkeys(chosen))
