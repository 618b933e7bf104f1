"""Which numbers trials determine, which only in combination, and which trial would tell the rest.

Near the best fit the trials have the information ``D`` on the shares of all common numbers, after a
trial's own numbers are integrated out, and the prior has ``K``. A direction is untold if the trials
leave more than half of the prior's standard deviation along it: if an eigenvalue of ``K^-1 D`` is
below 3. As many numbers as there are untold directions are chosen to span them, by a QR
decomposition with pivoting (M. Gautier, "Numerical calculation of the base inertial parameters of
robots", 1991). Each other number then follows them: it is told as a sum with multiples of them.

Another trial with information ``N`` is worth ``log2 det((K + D + N) / (K + D)) / 2`` bits, to first
order and before it is performed (D. V. Lindley, "On a measure of the information provided by an
experiment", 1956).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr

from eea.core.angles import Floats
from eea.core.checks import ConfigurationError, TargetError, mapping
from eea.infer.box_normal import log_mass
from eea.infer.branch import Branch
from eea.infer.laplace import Laplace
from eea.infer.misfit import FINE, Misfit, Regression
from eea.infer.optima import Optima
from eea.infer.statement import Hypothesis, RobotModel
from eea.infer.trials import Observed, Trial
from eea.infer.unknowns import Unknowns

MOST_SDS = 40.0  # that a change is tried up to
TRIED_CHANGES = 8001


def least_change(spread: float, mean: float, sd: float, ends: Floats, odds: float) -> float:
    """Return the size of the least change that is more probable than none, if all is normal.

    Trials determine a change x to a standard deviation s, the ``spread``. Beforehand it is normal
    with ``mean`` m and ``sd`` w between its ``ends`` (2,), and of ``odds`` o. Then, with
    v^2 = s^2 + w^2, ::

        log odds = log(o s / v) + x^2 / (2 s^2) - (x - m)^2 / (2 v^2)
                   + log(mass between the ends after the trials / before)

    Infinity where no change between the ends is.
    """
    both = math.hypot(spread, sd)
    steps = spread * np.linspace(-MOST_SDS, MOST_SDS, TRIED_CHANGES)
    tried = steps[(steps >= ends[0]) & (steps <= ends[1])]
    centre = (tried * sd**2 + mean * spread**2) / both**2
    after = (ends - centre[:, None]) * both / (spread * sd)
    before = (ends - mean) / sd
    log_odds = math.log(odds * spread / both)
    log_odds = log_odds + 0.5 * (tried / spread) ** 2 - 0.5 * ((tried - mean) / both) ** 2
    log_odds = log_odds + log_mass(after[:, 0], after[:, 1]) - log_mass(before[0], before[1])
    return float(np.abs(tried[log_odds > 0.0]).min(initial=math.inf))


LEAST_PRECISION = 1e-9  # in 1/range^2: of a number that the trials do not determine
FLAT_SD = 1e3  # of a range: a normal prior of this sd is flat


def moved_alone(robot: RobotModel) -> dict[str, Hypothesis]:
    """Return the numbers that a hypothesis moves by themselves, with it."""
    alone: dict[str, Hypothesis] = {}
    for hypothesis in robot.alternatives:
        if len(hypothesis.moves) == 1 and hypothesis.changes == 1:
            (name,) = hypothesis.moves
            if not (robot.table[name].varies or robot.table[name].circular):
                alone.setdefault(name, hypothesis)
    return alone


def would_not_show(branches: Sequence[Branch], name: str) -> float | None:
    """Return the least change of a number that would be named; smaller ones would not show.

    See :func:`eea.infer.design.least_change`. None where that hypothesis was not fitted,
    infinity where no change within the range would show.
    """
    robot = branches[0].parameters.robot
    hypothesis = moved_alone(robot).get(name)
    fitted = [b for b in branches if hypothesis and b.hypothesis is hypothesis]
    if hypothesis is None or not fitted:
        return None
    parameters = fitted[0].parameters
    i = parameters.first_entry(name)
    low = robot.table[name].low
    span = robot.table[name].high - low
    # The change's own prior is no evidence.
    information = fitted[0].posterior.modes[0].information + LEAST_PRECISION * np.eye(
        len(parameters)
    )
    precision = 1.0 / np.linalg.inv(information)[i, i] - parameters.prior_precision[i]
    spread = span * max(precision, LEAST_PRECISION) ** -0.5
    if robot.prior is not None and name in robot.prior.names:  # what it was is not known exactly
        at = robot.prior.names.index(name)
        spread = math.hypot(spread, span * robot.prior.covariance[at, at] ** 0.5)
    change = hypothesis.moves[name]
    ends = low + span * np.array([parameters.low[i], parameters.high[i]]) - robot.usual[name]
    odds = hypothesis.odds / robot.nominal.odds
    return least_change(spread, change.mean or 0.0, min(change.sd, FLAT_SD * span), ends, odds)


UNTOLD_SHARE = 0.5  # of a prior's standard deviation: a number known less well is not told
STEP_SHARES = (1.0, 0.1, 0.01)  # of ``FINE.difference``: steps of central differences
NEARLY_AS_WELL = 3.0  # of cost: a fit of more is less than 1/20 as probable
APART_SDS = 2.0  # of a number's values in two fits: closer ones are the same
MOST_PLACES = 9  # of a number in a sentence
LEAST_COEFFICIENT = 1e-3  # in prior sds: derivatives by differences are not as accurate


class Combination(NamedTuple):
    """A number, or a sum of multiples of numbers, that the trials determine."""

    coefficients: Mapping[str, float]  #: By name, in natural units; the first is 1.
    value: float  #: At the best fit, in the first number's unit.
    sd: float  #: Its standard deviation.
    unit: str  #: Of the first number; empty where none is stated.

    @property
    def name(self) -> str:
        """The sum in words, as in ``first moment 1 + 0.3 mass 2``."""
        said = ""
        for name, factor in self.coefficients.items():
            sign = " - " if factor < 0.0 else " + "
            times = f"{abs(factor):.3g} "
            times = "" if times == "1 " else times
            said += f"{sign if said else ''}{times}{name}"
        return said

    @property
    def stated(self) -> str:
        """The sum, its value and its standard deviation."""
        places = max(0, -math.floor(math.log10(max(self.sd, 1e-300))))
        value = f"{self.value:.{min(places, MOST_PLACES)}f} {self.unit}".rstrip()
        return f"{self.name} = {value} (sd {self.sd:.1g})"


@dataclass(frozen=True, eq=False)
class Identified:
    """What trials determine of a robot's numbers, to first order at the best fit."""

    #: The numbers and sums that are told, in the order of the robot's numbers.
    told: tuple[Combination, ...]
    #: The numbers that are not told, each with the names of those that change with it unseen.
    untold: Mapping[str, tuple[str, ...]]
    #: The numbers and sums that several answers tell differently, with the value of each.
    several: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    #: Whether earlier trials told of the numbers, too, so that they may be known all the same.
    known_before: bool = False

    @property
    def findings(self) -> list[str]:
        """Sentences on what was measured, only together, and not at all."""
        alone = [one.stated for one in self.told if len(one.coefficients) == 1]
        said = [
            f"not measured, for {len(values)} values explain the trials alike: {name}"
            for name, values in self.several.items()
        ]
        said += [f"measured: {'; '.join(alone)}"] if alone else []
        return said + self.gaps

    @property
    def gaps(self) -> list[str]:
        """The sentences among the findings on what was not measured by itself."""
        sums = [one.stated for one in self.told if len(one.coefficients) > 1]
        said = [f"measured only together: {'; '.join(sums)}"] if sums else []
        each = [
            f"{name}, with which {' and '.join(others)} would change" if others else name
            for name, others in self.untold.items()
        ]
        what = "hardly better known than before" if self.known_before else "not measured"
        return said + ([f"{what}: {'; '.join(each)}"] if each else [])


class Prospect(NamedTuple):
    """What another trial is expected to tell."""

    bits: float  #: The expected information.
    identified: Identified  #: What all trials would determine, this one included.


class _Known(NamedTuple):
    """The common numbers of a fit and the information on them, in shares."""

    parameters: Unknowns
    theta: Floats  # (P,), all unknowns at the best fit
    others: Floats  # (k, P), at fits that explain the trials nearly as well
    entries: NDArray[np.intp]  # (n,), those of the common numbers
    prior: Floats  # (n, n)
    trials: Floats  # (n, n)


def identified(best: Optima) -> Identified:
    """Return what the trials determine, of their best fit."""
    known = _known(best)
    return _identified(known, known.trials)


def prospects(
    best: Optima, hypothesis: Hypothesis, trials: Mapping[str, Trial]
) -> dict[str, Prospect]:
    """Return what each of some trials would tell, the best first.

    Parameters
    ----------
    best, hypothesis
        The best fit so far, and what it takes to be true.
    trials
        By name. The values of their signals do not matter, only where there are samples.

    Raises
    ------
    ConfigurationError
        If there is none, or one has other channels than the robot.
    TargetError
        If the simulation of one does not stay finite.
    """
    mapping("trials", trials, Trial)
    if not trials:
        raise ConfigurationError("trials must be one or more, by name; got none")
    known = _known(best)
    now = known.prior + known.trials
    found = {}
    for name, trial in trials.items():
        more = _of_another(best, hypothesis, known, trial)
        bits = 0.5 * (np.linalg.slogdet(now + more)[1] - np.linalg.slogdet(now)[1]) / np.log(2.0)
        found[name] = Prospect(float(bits), _identified(known, known.trials + more))
    return dict(sorted(found.items(), key=lambda item: -item[1].bits))


def _known(best: Optima) -> _Known:
    """Return the information on the common numbers at a best fit."""
    parameters = best.regression.parameters
    theta = best.fits.theta[0]
    entries = parameters.common_entries()
    prior = parameters.proper_prior[np.ix_(entries, entries)]
    trials = _of_trials(best.regression, theta, best.precision, entries)
    likely = best.fits.cost[1:] <= best.fits.cost[0] + NEARLY_AS_WELL
    return _Known(parameters, theta, best.fits.theta[1:][likely], entries, prior, trials)


def _of_trials(
    regression: Regression, theta: Floats, weight: float, entries: NDArray[np.intp]
) -> Floats:
    """Return the trials' own information (n, n) on some entries at a vector (P,)."""
    prior = regression.parameters.prior_information
    both = weight * _normal(regression, theta) + prior
    both += np.diag(regression.misfit(FINE).plateau_precision)
    near = Laplace(theta, both, np.zeros(len(theta)))
    left = near.marginal(entries, regression.parameters.uniform_precision)
    return np.asarray(left.information - prior[np.ix_(entries, entries)])


def _of_another(best: Optima, hypothesis: Hypothesis, known: _Known, trial: Trial) -> Floats:
    """Return the information (n, n) that a trial would have on the common numbers."""
    robot = known.parameters.robot
    one = Unknowns.of(robot, 1, known.parameters.groups, hypothesis)
    theta = one.prior_mean.copy()
    bases = map(known.parameters.base, known.entries.tolist())
    entries = np.array([one.first_entry(name) for name in bases], dtype=np.intp)
    theta[entries] = known.theta[known.entries]
    observed = replace(Observed.of([trial], robot), noise=best.regression.observed.noise)
    regression = Regression(one, observed, None, roughness=best.regression.roughness)
    return _of_trials(regression, theta, best.precision, entries)


def _normal(regression: Regression, theta: Floats) -> Floats:
    """Return J^T J (P, P) at a vector (P,), by central differences.

    Errors of derivatives would pass for information along directions that have none. Each number
    has the step of three that fits: at ``FINE.difference`` rounding is small, but where a trial
    magnifies small differences only a smaller step is small enough.
    """
    parameters = regression.parameters
    misfit = regression.misfit(FINE)
    if regression.roughness is not None and not regression.roughness.smooth:
        return np.asarray(misfit.linearise(theta[None]).normal[0])
    inside = np.clip(theta, parameters.low + FINE.difference, parameters.high - FINE.difference)
    slopes = np.array([_slopes(misfit, inside, FINE.difference * share) for share in STEP_SHARES])
    if not np.isfinite(slopes).all():
        raise TargetError("the simulation of a trial does not stay finite near the best fit")
    first, second = np.linalg.norm(np.diff(slopes, axis=0), axis=2)  # (P,) each
    # The error of a central difference falls by 100 from step to step, and rounding rises by 10.
    step = np.where(first <= second, 0, np.where(50.0 * second > first, 1, 2))
    chosen = slopes[step, np.arange(len(theta))]
    return np.asarray(chosen @ chosen.T)


def _slopes(misfit: Misfit, theta: Floats, step: float) -> Floats:
    """Return the derivatives (P, N) of the residuals at a vector (P,), by central differences."""
    steps = step * np.eye(len(theta))
    residuals = misfit.residuals(np.concatenate([theta + steps, theta - steps]))
    rise = residuals[: len(theta)] - residuals[len(theta) :]
    return np.asarray(rise.reshape(len(theta), -1) / (2.0 * step), np.float64)


def _identified(known: _Known, trials: Floats) -> Identified:
    """Return what information (n, n) on the common numbers determines."""
    parameters = known.parameters
    names = [parameters.names[i] for i in known.entries]
    if not names:
        return Identified((), {})
    size = np.diag(np.linalg.inv(known.prior)) ** 0.5  # (n,), the prior's standard deviations
    root = np.linalg.cholesky(known.prior)
    half = np.linalg.solve(root, np.linalg.solve(root, trials).T)
    values, vectors = np.linalg.eigh(0.5 * (half + half.T))
    weak = values < UNTOLD_SHARE**-2 - 1.0
    untold = np.linalg.solve(root.T, vectors[:, weak]) / size[:, None]  # (n, k), in prior sds
    count = untold.shape[1]
    order = qr(untold.T, pivoting=True, mode="r")[1] if count else np.arange(len(names))
    free = np.sort(order[:count])
    follows = np.zeros((len(names), count))  # prior sds of each number for one of each free one
    if count:
        follows = untold @ np.linalg.inv(untold[free])
    scaled = np.linalg.inv(known.prior + trials) / np.outer(size, size)
    natural = parameters.natural(known.theta)[known.entries]
    unit = size * (parameters.natural(np.ones(len(parameters)))
                   - parameters.natural(np.zeros(len(parameters))))[known.entries]  # fmt: skip
    elsewhere = parameters.natural(known.others)[:, known.entries]
    told: list[Combination] = []
    several: dict[str, tuple[float, ...]] = {}
    moved: dict[str, tuple[str, ...]] = {names[j]: () for j in free}
    for i in np.setdiff1d(np.arange(len(names)), free):
        sd = _spread(scaled, i, free, follows[i])
        seen = np.abs(follows[i]) > max(sd, LEAST_COEFFICIENT)
        sd = _spread(scaled, i, free[seen], follows[i][seen])
        factors = -follows[i][seen] * unit[i] / unit[free[seen]]
        one = Combination(
            {names[i]: 1.0}
            | dict(zip([names[j] for j in free[seen]], factors.tolist(), strict=True)),
            float(natural[i] + factors @ natural[free[seen]]),
            float(sd * unit[i]),
            parameters.robot.table[names[i]].unit,
        )
        values = elsewhere[:, i] + elsewhere[:, free[seen]] @ factors
        values = values[np.abs(values - one.value) > APART_SDS * one.sd]
        if len(values):
            several[one.name] = (one.value, *values.tolist())
            continue
        told.append(one)
        for j in free[seen]:
            moved[names[j]] = (*moved[names[j]], names[i])
    return Identified(tuple(told), moved, several, parameters.robot.prior is not None)


def _spread(covariance: Floats, i: int, free: NDArray[np.intp], follows: Floats) -> float:
    """Return the standard deviation of a number minus what follows the free ones."""
    way = np.zeros(len(covariance))
    way[i] = 1.0
    way[free] = -follows
    return float(np.sqrt(way @ covariance @ way))
