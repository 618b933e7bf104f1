"""Joint inference: from observed trials to a posterior over all that is unknown."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

from eea.core.angles import Floats
from eea.core.checks import choice, finite
from eea.core.config import FitConfig
from eea.joint.diagnostics import groups
from eea.joint.goodness_of_fit import Goodness, effective_count, goodness_of_fit
from eea.joint.initialization import pose
from eea.joint.joint_posterior import HypothesisPosterior, JointPosterior, WarmStart
from eea.joint.least_squares import FINE, Observed, Regression
from eea.joint.parameters import SURE, Parameters
from eea.joint.posterior import Mode, Posterior
from eea.joint.problem import AS_COMMANDED, Hypothesis, JointProblem, Simulate
from eea.joint.search import Optima, halved, improved, search

ABSENT = 0.02  # of a range: a smaller part is hard to tell from one that does not move
HOPELESS = 50.0  # in log evidence: hypotheses worse by this are not fitted again
LEAST_PROBABILITY = 1e-4  # less probable hypotheses are left out


def fit(
    observed: Observed,
    joint: JointProblem,
    config: FitConfig,
    rng: np.random.Generator,
    earlier: JointPosterior | None = None,
) -> JointPosterior:
    """Return the posterior over body, nuisances, hidden angles and hypotheses, given some trials.

    Under a hypothesis h, with residuals r, the unknowns theta of all trials have the posterior ::

        -log p(theta | trials, h) = sum of r^2 / (2 sigma^2) - log p(theta | h) + constant

    Least squares finds its optima (:func:`~eea.joint.search.search`). A truncated normal
    distribution stands for each (:func:`mixture`), and their integral is the evidence::

        p(h | trials) = p(trials | h) / (sum over g of p(trials | g))

    Parameters
    ----------
    observed
        All trials.
    joint, config
        The robot and the settings.
    rng
        Draws the starting points.
    earlier
        The posterior after fewer of these trials, whose optima are starting points.

    Raises
    ------
    ConfigurationError
        If the robot has no such nuisance, or the signal is not finite or has another shape.
    TargetError
        If no simulation stays finite.
    """
    check_nuisances(joint, config)
    finite("signal", observed.signal, (len(observed), None, joint.problem.axes))
    counter = _Counter(joint.simulate)
    task = _Task(observed, replace(joint, simulate=counter), config, rng, earlier)

    # Fit the robot as commanded, then the other hypotheses that are plausible.
    plain = task.optimize(AS_COMMANDED)
    explained = task.goodness(plain).good
    alone = mixture(plain, plain)
    others = [(h, task.optimize(h, plain)) for h in task.plausible(plain, alone)]
    lowest = min((o for _, o in others), key=_least, default=plain)
    if _least(lowest) < _least(plain):  # was it the hypothesis, or a better search?
        plain = improved(plain, carried_over(lowest, plain.regression.parameters)[:1])
        alone = mixture(plain, plain)

    # Weigh them by their evidence.
    fitted = [(AS_COMMANDED, plain), *others]
    best = min((optima for _, optima in fitted), key=lambda optima: optima.sigma)
    mixtures = [alone if o is best is plain else mixture(o, best) for _, o in fitted]
    constants = [log_prior_constant(o.regression.parameters) for _, o in fitted]
    evidence = np.array([m.log_evidence + c for m, c in zip(mixtures, constants, strict=True)])
    shares = np.exp(evidence - evidence.max())
    shares /= shares.sum()  # all hypotheses are equally probable a priori
    branches = tuple(
        HypothesisPosterior(
            fitted[i][0], float(shares[i]), fitted[i][1].regression.parameters, mixtures[i]
        )
        for i in np.argsort(-shares, kind="stable")
        if shares[i] > LEAST_PROBABILITY
    )

    # Leave what the fit of more trials starts from.
    optima = {**task.start.optima, **{h.name: o for h, o in fitted}}
    hopeless = {fitted[i][0].name for i in np.flatnonzero(evidence < evidence.max() - HOPELESS)}
    dropped = (task.start.dropped | hopeless) - {AS_COMMANDED.name}
    return JointPosterior(
        branches,
        task.goodness(optima[branches[0].hypothesis.name]),
        best.sigma,
        0 if config.noise else observed.signal.size,
        WarmStart(optima, frozenset(dropped), explained, counter.robots),
    )


def check_nuisances(joint: JointProblem, config: FitConfig) -> None:
    """Raise a ConfigurationError if the settings name a group of nuisances that is not there."""
    for name in config.nuisances or ():
        choice("nuisances", name, joint.groups)
    for name in config.per_trial:
        choice("per_trial", name, joint.groups)


def _least(optima: Optima) -> float:
    """Return the sum of squared residuals of the best fit."""
    return float(optima.fits.squares[0])


class _Counter:
    """A simulator that counts robots."""

    def __init__(self, simulate: Simulate) -> None:
        self._simulate, self.robots = simulate, 0

    def __call__(
        self, bodies: Floats, nuisances: Floats, commands: Floats, angles: Floats, fine: bool
    ) -> NDArray[Any]:
        self.robots += len(bodies)
        return self._simulate(bodies, nuisances, commands, angles, fine)


@dataclass(frozen=True, eq=False)
class _Task:
    """One fit; see :func:`fit`."""

    observed: Observed
    joint: JointProblem
    config: FitConfig
    rng: np.random.Generator
    earlier: JointPosterior | None

    @property
    def start(self) -> WarmStart:
        """What the earlier fit left."""
        return (self.earlier and self.earlier.warm_start) or WarmStart()

    def goodness(self, optima: Optima) -> Goodness:
        """Test whether the best fit leaves nothing but noise."""
        return goodness_of_fit(
            optima.residuals, len(optima.regression.parameters), self.config.noise
        )

    def optimize(self, hypothesis: Hypothesis, plain: Optima | None = None) -> Optima:
        """Fit all trials under a hypothesis, also from earlier optima and ``plain`` ones."""
        config, observed = self.config, self.observed
        groups = self.joint.groups if config.nuisances is None else config.nuisances
        parameters = Parameters.of(self.joint, len(observed), groups, hypothesis, config.per_trial)
        regression = Regression(parameters, observed, config.noise)
        earlier, starts = self.start.optima.get(hypothesis.name), None
        if earlier is not None:
            starts = carried_over(earlier, parameters)
            posed, _ = pose(regression, starts, config.poses, self.rng)
            for trial in range(len(earlier.regression.observed), len(observed)):
                entries = parameters.own_entries(trial)
                starts[:, entries] = posed[:, entries]
        if plain is None:
            # Trials that no body explained are not searched again and again.
            once = not self.start.explained
        else:  # most alternatives are wrong: they are searched once, and later with half the effort
            once = True
            as_commanded = carried_over(plain, parameters)
            starts = as_commanded if starts is None else np.concatenate([starts, as_commanded])
            if earlier is not None:
                config = halved(config)
        return search(regression, self.rng, config, starts, lambda o: once or self.goodness(o).good)

    def plausible(self, plain: Optima, alone: Posterior) -> list[Hypothesis]:
        """Return the alternative hypotheses to fit, given the fit as commanded."""
        when = self.config.alternatives
        if when == "never":
            return []
        names = {h.name for h in self.joint.hypotheses} - self.start.dropped
        if when == "doubt" and self.goodness(plain).good:
            # Those that were probable stay: a small fin explains a missing one nearly as well.
            branches = () if self.earlier is None else self.earlier.branches
            probable = {branch.hypothesis.name for branch in branches}
            absent = self._perhaps_absent(plain, alone)
            names &= probable | {h.name for h in self.joint.hypotheses if h.part in absent}
        return [h for h in self.joint.hypotheses if h.name in names]

    def _perhaps_absent(self, plain: Optima, alone: Posterior) -> set[str]:
        """Return the names of parts that may have next to no area."""
        least = np.minimum(plain.fits.theta[0], alone.interval(0.9)[0])
        return {
            name
            for name, part in zip(self.joint.parts, groups(self.joint), strict=True)
            if part.area and min(least[side.place] for side in part.area) < ABSENT
        }


def mixture(optima: Optima, best: Optima) -> Posterior:
    """Return the posterior of optima at the noise that the ``best`` fit of all leaves.

    Where its residuals are correlated, only the effective number of samples counts.
    """
    residuals = best.residuals
    weight = effective_count(residuals) / residuals.size / best.sigma**2
    parameters, theta = optima.regression.parameters, optima.fits.theta
    linear = optima.regression.misfit(FINE).linearise(theta)
    away = theta - parameters.prior_mean
    modes = tuple(
        Mode(
            theta[k],
            weight * linear.normal[k] + parameters.prior_information,
            float(0.5 * weight * optima.fits.squares[k] + parameters.prior_cost(theta[k])),
            weight * linear.gradient[k] + parameters.prior_information @ away[k],
        )
        for k in range(len(theta))
    )
    return Posterior(parameters.names, parameters.low, parameters.high, parameters.circular, modes)


def log_prior_constant(parameters: Parameters) -> float:
    """Return the constant of the log prior, which differs between sets of parameters."""
    informed = parameters.prior_precision > 0.0
    sd, mean = parameters.prior_precision[informed] ** -0.5, parameters.prior_mean[informed]
    high, low = log_ndtr((1.0 - mean) / sd), log_ndtr(-mean / sd)
    mass = high + np.log1p(-np.exp(low - high))
    normal = -(0.5 * np.log(2.0 * np.pi) + np.log(sd) + mass).sum()
    return float(normal - np.count_nonzero(parameters.circular) * np.log(2.0 * np.pi))


def carried_over(earlier: Optima, parameters: Parameters) -> Floats:
    """Return optima of fewer trials or of another hypothesis as vectors (K, P).

    What a hypothesis fixes stays fixed. An angle common to all trials takes that of the first
    trial, and the trials' own angles take a common one.
    """
    theta: Floats = np.tile(parameters.prior_mean, (len(earlier.fits.theta), 1))
    column = {name: i for i, name in enumerate(earlier.regression.parameters.names)}
    for i, name in enumerate(parameters.names):
        sources = (name, name.partition("@")[0], f"{name}@1")
        source = next((column[source] for source in sources if source in column), None)
        if source is not None and parameters.prior_precision[i] < SURE:
            theta[:, i] = earlier.fits.theta[:, source]
    return theta
