"""What trials tell if one hypothesis holds."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from eea.core.angles import Floats
from eea.core.checks import ConfigurationError, brief
from eea.infer.box_normal import LEAST_PRECISION
from eea.infer.mixture import (
    LEAST_APART,
    LEAST_WEIGHT,
    PEAK_DISTANCE_SDS,
    Mixture,
    Mode,
    answers,
    holding,
)
from eea.infer.statement import Hypothesis, Number, Prior, RobotModel
from eea.infer.unknowns import FIXED_SLOT, Unknowns

INTERVAL_SAMPLES = 4000  # for medians and intervals
LEAST_SD = 1e-6  # share of a range, in a prior


@dataclass(frozen=True, eq=False)
class Branch:
    """One hypothesis, its probability, and the posterior if it holds."""

    hypothesis: Hypothesis
    probability: float
    parameters: Unknowns
    posterior: Mixture  #: The posterior if the simulator is right.
    doubted: Mixture  #: The posterior with the problem's ``discrepancy``.

    def prior(self, gone: Collection[str] = ()) -> Prior:
        """Return what is known of the numbers that all trials share, but of ``gone`` ones.

        Angles are left out: they may have changed since, even that of a seized servo.
        """
        names = self.parameters.names
        shared = self.parameters.common & ~self.parameters.circular
        entries = np.array([i for i in np.flatnonzero(shared) if names[i] not in gone], np.intp)
        theta = self.posterior.sample(INTERVAL_SAMPLES, np.random.default_rng(0))[:, entries]
        covariance = np.cov(theta, rowvar=False) + LEAST_SD**2 * np.eye(len(entries))
        return Prior(tuple(names[i] for i in entries), theta.mean(axis=0), covariance)

    def known(self, robot: RobotModel, gone: Collection[str] = ()) -> RobotModel:
        """Return a robot with the hypothesis as a fact, and with what the trials told as its prior.

        ``robot`` is that of the trials, or the same with other numbers of each trial. A number that
        has changed no longer has its healthy value: the prior tells it. One that the hypothesis
        fixes keeps its value, whatever else may have changed later. ``gone`` are numbers of the
        trials that later logs do not have.
        """
        prior = self.prior(gone)
        _check_same(robot, self.parameters.robot, prior.names)
        fixed = self.hypothesis.fixed
        moved = self.hypothesis.moves
        numbers = {
            name: _held(robot.table[name], fixed[name]) if name in fixed else number
            for name, number in robot.numbers.items()
        }
        numbers |= {name: replace(numbers[name], healthy=None) for name in moved}
        nominal = replace(robot.nominal, fixed=fixed, moves={})
        after = replace(robot, numbers=numbers, nominal=nominal, prior=None)
        prior = prior.of(self.parameters.robot, after)
        for name, share in zip(prior.names, prior.mean.tolist(), strict=True):
            number = after.table[name]
            if not 0.0 <= share <= 1.0:
                value = after.with_unit(name, number.low + share * (number.high - number.low))
                raise ConfigurationError(
                    f"the range of {name} must hold {value}, which is known; got {number}"
                )
        return replace(after, prior=prior)

    @property
    def cost(self) -> float:
        """The cost of the best mode: -log posterior up to a constant common to all hypotheses."""
        return min(mode.cost for mode in self.posterior.modes)

    @cached_property
    def answers(self) -> list[tuple[float, Mode]]:
        """The answers on the common numbers that are apart, with their probabilities."""
        return answers(self.posterior, self.parameters.common_entries())

    @cached_property
    def ambiguous(self) -> NDArray[np.intp]:
        """Which common numbers differ from answer to answer (n,)."""
        entries = self.parameters.common_entries()
        theta = np.array([mode.theta[entries] for _, mode in self.answers])
        if len(theta) < 2:
            return entries[:0]
        spread = np.array(
            [np.diag(m.covariance(LEAST_PRECISION))[entries] for _, m in self.answers]
        )
        reach = np.maximum(PEAK_DISTANCE_SDS * np.sqrt(spread.max(axis=0)), LEAST_APART)
        return np.asarray(entries[np.ptp(theta, axis=0) > reach])

    def told(self) -> tuple[Floats, Floats]:
        """Return the best values and standard deviations of all numbers (W,), as shares.

        Those of angles, and of numbers that vary from trial to trial, are 0.
        """
        parameters = self.parameters
        mode = self.posterior.modes[int(np.argmax(self.posterior.weights))]
        entries = parameters.slots[0]
        spread = np.sqrt(np.diag(mode.covariance(LEAST_PRECISION)))
        sd = np.where(entries == FIXED_SLOT, 0.0, spread[entries])
        numbers = parameters.robot.table.values()
        shared = np.array([not (one.varies or one.circular) for one in numbers])
        return np.where(shared, parameters.local(mode.theta[None])[0, 0], 0.0), sd * shared

    def _middle(self) -> Floats:
        """Return the medians (P,); between two answers of a robot there is none, so the best's."""
        middle = self.posterior.median()
        if not self.parameters.robot.parts and len(self.ambiguous):
            middle = middle.copy()
            middle[self.ambiguous] = self.answers[0][1].theta[self.ambiguous]
        return middle

    def table(self, mass: float) -> dict[str, tuple[float, float, float]]:
        """Return the median and the interval of everything, by name, in natural units.

        Where several answers explain the trials, a number has the value of the most probable one
        in place of the median, and the interval is that of all.
        """
        parameters = self.parameters
        low, high = self.doubted.interval(mass)
        low, high, middle = holding(low, high, self._middle(), parameters.circular)
        rows = map(tuple, parameters.natural(np.array([middle, low, high])).T.tolist())
        return dict(zip(parameters.names, rows, strict=True))


def rivals(branches: Sequence[Branch]) -> dict[str, list[str]]:
    """Return the hypotheses that may hold as well as the first, and the numbers that differ there.

    These are numbers that all trials share and that are no angles, fixed or inferred, whose values
    are as far apart as those of different answers of one hypothesis.
    """
    middle, sd = branches[0].told()
    found = {}
    for branch in branches[1:]:
        other, wide = branch.told()
        reach = np.maximum(PEAK_DISTANCE_SDS * np.maximum(sd, wide), LEAST_APART)
        apart = np.flatnonzero(np.abs(other - middle) > reach)
        if branch.probability >= LEAST_WEIGHT and len(apart):
            found[branch.hypothesis.name] = [branch.parameters.robot.names[i] for i in apart]
    return found


def _check_same(robot: RobotModel, before: RobotModel, known: Sequence[str]) -> None:
    """Raise a ConfigurationError unless a robot has the channels and the ``known`` numbers."""
    if list(robot.channels) != list(before.channels):
        raise ConfigurationError(
            f"channels of robot must be those of the trials, {brief(list(before.channels))}; got "
            f"{brief(list(robot.channels))}"
        )
    for name in known:
        if name not in robot.table:
            raise ConfigurationError(
                f"numbers of robot must be those that the trials told; {name} is missing"
            )
        was = before.table[name]
        now = robot.table[name]
        kinds = [(n.unit, n.healthy, n.varies, n.circular, n.switch) for n in (was, now)]
        if kinds[0] != kinds[1]:
            raise ConfigurationError(f"{name} of robot must be such as {was}; got {now}")


def _held(number: Number, value: float) -> Number:
    """Return a number that has a value unless a hypothesis fixes or moves it."""
    if number.sought:  # where no value is healthy, the prior tells it
        return number if number.healthy is None else replace(number, healthy=value)
    low = min(number.low, value)
    high = max(number.high, value)
    return replace(
        number, low=low, high=high, mean=value, sd=math.inf, varies=False, group="", switch=True
    )


def mixed(
    branches: Sequence[Branch],
    count: int,
    rng: np.random.Generator,
    draw: Callable[[Branch, int], Floats],
) -> Floats:
    """Return ``count`` draws, as many of each hypothesis as its probability makes of them."""
    shares = np.array([branch.probability for branch in branches])
    counts = rng.multinomial(count, shares / shares.sum())
    drawn = [draw(one, int(times)) for one, times in zip(branches, counts, strict=True) if times]
    return np.concatenate(drawn)
