"""A robot, stated by its numbers and a simulator: the problem of joint inference."""

from __future__ import annotations

import inspect
import math
import numbers
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pkgutil import resolve_name
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from eea.core.angles import Floats
from eea.core.checks import (
    ConfigurationError,
    all_of,
    brief,
    choice,
    instance,
    mapping,
    real,
    text,
    whole,
)
from eea.joint.combinations import any_change, together
from eea.joint.problem import (
    Discrepancy,
    Hypothesis,
    Normal,
    Nuisance,
    Part,
    Prior,
    Values,
    groups_of,
)

MOST_STRIDE = 4
MOST_AT_ONCE = 3
NUISANCE_RANGE_SDS = 5.0  # on each side of the mean of a nuisance that is given as a Normal
NOTHING_BROKEN = Hypothesis("nothing is broken")


class Simulate(Protocol):
    """A simulator of batches of trials."""

    def __call__(self, values: Values, inputs: Any, /) -> NDArray[Any]:
        """Return the signal (B, T, channels) of B trials.

        ``values`` has the parameters, nuisances and hidden angles by name, (B,) each, in natural
        units and rad. ``inputs`` (B, ...) are the trials' own: a command, a series of them, or what
        else was given with them; None where nothing was. No trial may depend on the others; one
        that diverges gives a signal that is not finite. Trials of unequal length may be simulated
        for as long as the longest. A simulator may take a third argument, ``fine``: whether double
        precision is asked for.
        """


@dataclass(frozen=True, eq=False)
class Robot:
    """A robot whose parameters, nuisances and hidden angles are inferred together.

    Parameters
    ----------
    parameters
        The numbers that are sought, by name, each with its range (low, high).
    simulate
        See :class:`Simulate`.
    channels
        The unit of each channel of the signal, by name, in the order of its last axis.
    whole
        The values of parameters where nothing is broken. They are so unless a hypothesis moves
        them; parameters without one are always sought.
    nuisances
        What the signal depends on besides: a distribution by name, or
        :class:`~eea.joint.problem.Nuisance` for what is seldom needed, such as groups.
    each_trial
        The nuisances that vary from trial to trial.
    hidden
        The names of angles, in rad, that are unknown at the start of each trial.
    hypotheses
        What may have changed or broken. None: each number in ``whole`` may be anywhere in its
        range, with odds of 0.1 in all.
    at_once
        How many of the hypotheses may hold at the same time.
    units
        The units of parameters and nuisances, by name, for the findings.
    parts
        Parameters that belong together, for the findings.
    nominal
        What holds unless something is broken.
    prior
        Instead of uniform parameters and the nuisances' own priors.
    discrepancy
        How far ``simulate`` may be from the robot.
    stride
        Early stages of a search compare every n-th sample, at most.
    loudest
        Noise of unknown size is none if it is louder, in the channels' unit.

    Raises
    ------
    ConfigurationError
        If a name occurs twice, a range is empty, or a hypothesis or part refers to an unknown name.

    Examples
    --------
    A pendulum with a motor, of unknown length, whose gyroscope has a bias:

    >>> def swing(values, torque):
    ...     time = 0.01 * np.arange(1, 65)
    ...     phase = torque[:, :1] * time + values["angle"][:, None]
    ...     rate = values["length"][:, None] * np.sin(phase) + values["bias"][:, None]
    ...     return rate[:, :, None]
    >>> pendulum = Robot(
    ...     parameters={"length": (0.0, 2.0)},
    ...     simulate=swing,
    ...     channels={"gyro": "rad/s"},
    ...     nuisances={"bias": Normal(0.0, 0.05)},
    ...     hidden=("angle",),
    ... )
    >>> pendulum.names
    ('length', 'bias', 'angle')
    """

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
        for name, kind in {"prior": Prior, "discrepancy": Discrepancy}.items():
            if getattr(self, name) is not None:
                instance(name, getattr(self, name), kind)
        if not (isinstance(self.loudest, float) and self.loudest == math.inf):
            real("loudest", self.loudest, 0.0)
        whole("stride", self.stride, 1, 1000)
        whole("at_once", self.at_once, 1, MOST_AT_ONCE)
        for name in (*self.names, *self.channels):
            text("a name of parameters, nuisances, hidden angles or channels", name)
            if "@" in name:  # which a trial's own numbers have before its number
                raise ConfigurationError(f"a name must have no @; got {name!r}")
        if len(set(self.names)) < len(self.names):
            twice = min(name for name in self.names if self.names.count(name) > 1)
            raise ConfigurationError(
                "parameters, nuisances and hidden angles must have names of their own; "
                f"{twice!r} is given twice"
            )
        for name, value in self.whole.items():
            choice("whole", name, self.parameters)
            real(f"whole {name}", value, *self.parameters[name])
        for name in self.units:
            choice("units", name, self.names)
        for name in self.each_trial:
            choice("each_trial", name, self._nuisance_names)
        for hypothesis in (self.nominal, *self.alternatives):
            self._check(hypothesis)
        known = [hypothesis.name for hypothesis in (self.nominal, *self.alternatives)]
        if len(set(known)) < len(known):
            twice = max(known, key=known.count)
            raise ConfigurationError(
                f"hypotheses must have names of their own; {twice!r} is given twice"
            )
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
        return tuple(together(stated, self.at_once))

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

    @cached_property
    def takes_precision(self) -> bool:
        """Whether ``simulate`` has the argument ``fine``."""
        try:
            return "fine" in inspect.signature(self.simulate).parameters
        except (TypeError, ValueError):
            return False

    # What they return is declared in modules that import this one.
    def infer(self, trials: Sequence[Any], seed: int = 0, **options: Any) -> Any:
        """Return the posterior given recorded trials; see :func:`eea.joint.recorded.infer`.

        ``options`` are its ``config``, ``noise`` and ``progress``.
        """
        return resolve_name("eea.joint.recorded:infer")(self, trials, seed, **options)

    def learn(
        self,
        known_good: Sequence[Any],
        sessions: Sequence[object] | None = None,
        seed: int = 0,
        **options: Any,
    ) -> Any:
        """Return what logs that are known to be good tell; see :func:`eea.joint.reference.learn`.

        ``sessions`` label the logs' sessions, in their order: a session, or build, is a time in
        which the robot is not repaired. ``options`` is ``config``.
        """
        learn = resolve_name("eea.joint.reference:learn")
        return learn(self, known_good, sessions, seed, **options)


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
