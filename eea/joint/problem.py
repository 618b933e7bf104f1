"""What joint inference is told of a robot: a core ``Problem``, its nuisances, and how it moves."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from numpy.typing import NDArray

from eea.core.angles import Floats
from eea.core.checks import ConfigurationError, choice, flag, instance, real, whole
from eea.core.problem import Problem


class Simulate(Protocol):
    """How the robot would move: a whole batch a call."""

    def __call__(
        self, bodies: Floats, nuisances: Floats, commands: Floats, angles: Floats, fine: bool
    ) -> NDArray[Any]:
        """Return the signal (B, T, axes) of B trials.

        ``bodies`` (B, n) and ``commands`` (B, c) are in the problem's units, ``nuisances`` (B, k)
        in those of its nuisances and their order, the hidden ``angles`` (B, h) in rad. Instead of
        a command each, ``commands`` holds whatever array of B was observed: series of them, say.
        ``fine`` asks for double precision; else what is fastest will do. No trial may depend on
        the others, and one that left the finite numbers answers with some that are not.
        """


@dataclass(frozen=True)
class Nuisance:
    """One number that the robot's motion depends on besides its body: a plugin.

    The prior is a normal one about ``nominal``, cut off at the ends of the range; with ``sd``
    infinite it is uniform there. Nuisances of one ``group`` are inferred together or not at all.

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
    nominal: float  #: Its value where it is not inferred.
    sd: float = math.inf  #: Of the prior.
    group: str = ""  #: Its own name if not given.
    #: Whether it is nominal, and not inferred, unless a hypothesis says otherwise.
    switch: bool = False
    #: Whether it is what a trial begins with, as the hidden angles are: each trial has its own, and
    #: it is always inferred.
    start: bool = False
    #: Into how many parts of equal width its range falls, such that a descent does not get from
    #: one to the next: each is tried. 0 where a descent finds the best by itself.
    valleys: int = 0

    def __post_init__(self) -> None:
        real(f"low of {self.name}", self.low, -math.inf)
        real(f"high of {self.name}", self.high, math.nextafter(self.low, math.inf))
        real(f"nominal of {self.name}", self.nominal, self.low, self.high)
        if self.sd != math.inf:
            real(f"sd of {self.name}", self.sd, 1e-12)
        flag(f"switch of {self.name}", self.switch)
        flag(f"start of {self.name}", self.start)
        whole(f"valleys of {self.name}", self.valleys, 0, 1000)
        if not self.group:
            object.__setattr__(self, "group", self.name)


@dataclass(frozen=True)
class Hypothesis:
    """Something that may be the case or not, such as a seized servo: compared by evidence.

    Examples
    --------
    >>> Hypothesis("the left servo is dead", {"left servo": 0.0}).shared_angles
    ()
    """

    name: str  #: A clause, as a person would say it.
    #: Dimensions and nuisances that then have a value.
    fixed: Mapping[str, float] = field(default_factory=dict)
    #: Hidden angles that are then the same in all trials.
    shared_angles: tuple[str, ...] = ()
    #: Switches that are then inferred, with the prior that they have.
    freed: tuple[str, ...] = ()
    part: str = ""  #: The name of the part that it is about, if it is about one.


@dataclass(frozen=True)
class Part:
    """Dimensions that belong together, such as a fin's, for what is said of them.

    Examples
    --------
    >>> Part({"tail.length": "length", "tail.width": "width"}, ("length", "width")).labels
    ('length', 'width')
    """

    sizes: Mapping[str, str]  #: Dimension -> what it is called beside the part.
    #: Which two of those make an area by their product, without which the part is absent.
    area: tuple[str, str] | None = None
    hint: str = ""  #: What trial would tell them apart.

    @property
    def dimensions(self) -> tuple[str, ...]:
        """The dimensions' names."""
        return tuple(self.sizes)

    @property
    def labels(self) -> tuple[str, ...]:
        """What they are called."""
        return tuple(self.sizes.values())


AS_COMMANDED = Hypothesis("every servo does as it is told")


@dataclass(frozen=True)
class JointProblem:
    """A robot whose body, nuisances and hidden angles are to be inferred together.

    Raises
    ------
    ConfigurationError
        If a name is given twice, or a hypothesis speaks of what there is not.

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
    hypotheses: tuple[Hypothesis, ...] = ()  #: Besides that every servo does as it is told.
    parts: Mapping[str, Part] = field(default_factory=dict)  #: By name, for the findings.

    def __post_init__(self) -> None:
        instance("problem", self.problem, Problem)
        nuisances = [nuisance.name for nuisance in self.nuisances]
        names = [*self.problem.models.names, *nuisances, *self.problem.hidden]
        twice = {name for name in names if names.count(name) > 1}
        if twice:
            raise ConfigurationError(
                "dimensions, nuisances and hidden angles must have names of their own; "
                f"{min(twice)!r} is given twice"
            )
        for hypothesis in self.hypotheses:
            for name in hypothesis.fixed:
                known = [*self.problem.models.names, *nuisances]
                choice(f"what is fixed in {hypothesis.name!r}", name, known)
            switches = [n.name for n in self.nuisances if n.switch]
            for name in hypothesis.freed:
                choice(f"what is freed in {hypothesis.name!r}", name, switches)
            for name in hypothesis.shared_angles:
                choice(f"an angle of {hypothesis.name!r}", name, self.problem.hidden)
            if hypothesis.part:
                choice(f"the part of {hypothesis.name!r}", hypothesis.part, self.parts)
        for name, part in self.parts.items():
            for dimension in part.dimensions:
                choice(f"a dimension of {name!r}", dimension, self.problem.models.names)

    @property
    def groups(self) -> tuple[str, ...]:
        """The groups of nuisances that can be inferred or not, each once, in their order."""
        chosen = (n.group for n in self.nuisances if not n.switch and not n.start)
        return tuple(dict.fromkeys(chosen))
