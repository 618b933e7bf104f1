"""Joint inference: from observed trials to a posterior over all unknowns."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eea.core.angles import Floats
from eea.core.checks import ConfigurationError, callback, choice, finite, instance
from eea.core.config import FitConfig
from eea.core.floating import own_errors
from eea.joint.assumptions import contradiction
from eea.joint.evidence import log_prior_constant, mixture, with_doubt
from eea.joint.hypothesis_posterior import HypothesisPosterior
from eea.joint.initialization import pose
from eea.joint.joint_posterior import JointPosterior, WarmStart
from eea.joint.least_squares import Regression
from eea.joint.observed import Observed
from eea.joint.parameters import FIXED_PRECISION, Parameters
from eea.joint.problem import Hypothesis, Values
from eea.joint.robot_model import RobotModel
from eea.joint.search import Optima, halved, improved, search
from eea.statistics.posterior import Posterior

ABSENT_SIZE_SHARE = 0.02  # of a range: smaller parts look like parts that do not move
HOPELESS_LOG_EVIDENCE = 50.0  # hypotheses whose log evidence is lower by this are not refitted
SILENT_SECONDS = 4.0  # of a search, after which its progress is said again
LEAST_PROBABILITY = 1e-4  # less probable hypotheses are left out


@own_errors
def fit(
    observed: Observed,
    robot: RobotModel,
    config: FitConfig,
    rng: np.random.Generator,
    earlier: JointPosterior | None = None,
    progress: Callable[[str], None] | None = None,
    doubt: Callable[[Optima], bool] | None = None,
    usual: Floats | None = None,
) -> JointPosterior:
    """Return the posterior of parameters, nuisances, hidden angles and hypotheses, given trials.

    Under a hypothesis h, with residuals r, the unknowns theta of all trials have the posterior ::

        -log p(theta | trials, h) = sum of r^2 / (2 sigma^2) - log p(theta | h) + constant

    Least squares finds its optima (:func:`~eea.joint.search.search`). A truncated normal
    distribution stands for each (:func:`~eea.joint.evidence.mixture`), and their integral is the
    evidence::

        p(h | trials) = p(trials | h) / (sum over g of p(trials | g))

    Parameters
    ----------
    observed
        All trials.
    robot, config
        The robot and the settings.
    rng
        Draws the starting points.
    earlier
        The posterior after fewer of these trials, whose optima are starting points.
    progress
        Called with the name of each hypothesis before it is fitted, and every four seconds with the
        number of trials that were simulated so far.
    doubt
        Called with the nominal fit if its residuals are more than noise. It returns whether the
        other hypotheses are worth fitting. None: they are.
    usual
        The misfits of known-good logs (n,), by which it is judged whether a hypothesis explains the
        trials; None judges by whether it leaves white noise.

    Raises
    ------
    ConfigurationError
        If ``config`` names an unknown nuisance, or the signal is not finite or has another shape.
    TargetError
        If no simulation stays finite.
    """
    instance("observed", observed, Observed)
    instance("robot", robot, RobotModel)
    instance("config", config, FitConfig)
    instance("rng", rng, np.random.Generator)
    if earlier is not None:
        instance("earlier", earlier, JointPosterior)
    callback("progress", progress)
    callback("doubt", doubt)
    if usual is not None and len(usual := finite("usual", usual, (None,))) < 2:
        raise ConfigurationError(f"usual must be the misfits of two logs or more; got {len(usual)}")
    check_nuisances(robot, config)
    finite("signal", observed.signal, (len(observed), None, len(robot.channels)))
    counter = _Counter(robot, progress)
    robot = replace(robot.varying(config.per_trial), simulate=counter)
    start = (earlier and earlier.warm_start) or WarmStart()
    groups = robot.groups if config.nuisances is None else config.nuisances

    def optimize(hypothesis: Hypothesis, plain: Optima | None = None) -> Optima:
        parameters = Parameters.of(robot, len(observed), groups, hypothesis)
        regression = Regression(parameters, observed, config.noise, usual)
        before = start.optima.get(hypothesis.name)
        counter.begin(hypothesis.name)
        once = not start.explained or robot.prior is not None  # a misfit means a change
        return _optimize(regression, config, rng, before, plain, once)

    # Fit the robot as it should be, then the other hypotheses that are plausible.
    plain = optimize(robot.nominal)
    explained = plain.goodness.good
    alone = mixture(plain, plain)
    others: list[tuple[Hypothesis, Optima]] = []
    plausible = _plausible(robot, config, plain, alone, earlier)
    if plausible and not explained and doubt is not None and not doubt(plain):
        plausible = []
    for changes in sorted({h.changes for h in plausible}):
        others += [(h, optimize(h, plain)) for h in plausible if h.changes == changes]
        if any(optima.goodness.good for _, optima in others):
            break
    lowest = min((o for _, o in others), key=_least, default=plain)
    if _least(lowest) < _least(plain):  # Is the hypothesis better, or only its search?
        plain = improved(plain, carried_over(lowest, plain.regression.parameters)[:1])
        alone = mixture(plain, plain)

    # Weigh them by their evidence.
    fitted = [(robot.nominal, plain), *others]
    best = min((optima for _, optima in fitted), key=lambda one: (one.sigma, _least(one)))
    mixtures = [alone if o is best is plain else mixture(o, best) for _, o in fitted]
    constants = [log_prior_constant(o.regression.parameters) for _, o in fitted]
    evidence = np.array([m.log_evidence + c for m, c in zip(mixtures, constants, strict=True)])
    evidence += np.log([h.odds for h, _ in fitted])
    shares = np.exp(evidence - evidence.max())
    shares /= shares.sum()
    # A log that no hypothesis explains says nothing of what its simulator assumes.
    assumed = contradiction(best) if best.goodness.good else None
    contradicted = assumed is not None and assumed.contradicted
    least = 0.0 if robot.whole else LEAST_PROBABILITY  # what if it is broken after all?
    branches = tuple(
        HypothesisPosterior(
            fitted[i][0],
            float(shares[i]),
            fitted[i][1].regression.parameters,
            mixtures[i],
            with_doubt(mixtures[i], fitted[i][1], best, contradicted),
        )
        for i in np.argsort(-shares, kind="stable")
        if shares[i] > least
    )

    # Keep the starting points for a fit of more trials.
    optima = {**start.optima, **{h.name: o for h, o in fitted}}
    hopeless = {
        fitted[i][0].name for i in np.flatnonzero(evidence < evidence.max() - HOPELESS_LOG_EVIDENCE)
    }
    dropped = (start.dropped | hopeless) - {robot.nominal.name}
    return JointPosterior(
        branches,
        optima[branches[0].hypothesis.name].goodness,
        best.sigma,
        0 if config.noise else observed.size,
        WarmStart(optima, frozenset(dropped), explained, counter.robots),
        observed.noise,
        () if assumed is None else assumed.findings,
    )


def check_nuisances(robot: RobotModel, config: FitConfig) -> None:
    """Raise a ConfigurationError if the settings name a group of nuisances that is not there."""
    for name in config.nuisances or ():
        choice("nuisances", name, robot.groups)
    for name in config.per_trial:
        choice("per_trial", name, robot.groups)


def _least(optima: Optima) -> float:
    """Return the sum of squared residuals of the best fit."""
    return float(optima.fits.squares[0])


class _Counter:
    """A simulator that counts robots, and says every few seconds that the search goes on."""

    def __init__(self, robot: RobotModel, progress: Callable[[str], None] | None) -> None:
        self._robot = robot
        self._progress = progress
        self._said = time.monotonic()
        self._doing = ""
        self.robots = 0

    def begin(self, hypothesis: str) -> None:
        """Say what is fitted from now on."""
        self._doing = hypothesis
        self._say(hypothesis)

    def _say(self, words: str) -> None:
        self._said = time.monotonic()
        if self._progress is not None:
            self._progress(words)

    def __call__(self, values: Values, inputs: Any, fine: bool = True) -> NDArray[Any]:
        if time.monotonic() - self._said > SILENT_SECONDS:
            self._say(f"{self._doing}, after {self.robots} simulated trials")
        self.robots += len(next(iter(values.values())))
        return self._robot.signal(values, inputs, fine)


def _optimize(
    regression: Regression,
    config: FitConfig,
    rng: np.random.Generator,
    earlier: Optima | None,
    plain: Optima | None,
    once: bool,
) -> Optima:
    """Fit all trials under a hypothesis, also from ``earlier`` and from the nominal fit's optima.

    ``once``: one scan without restarts, because no robot explained the earlier trials. Alternatives
    get one scan, too. Later rounds halve their descents, because most alternatives are wrong.
    """
    parameters = regression.parameters
    trials = len(regression.observed)
    starts = None
    if earlier is not None:
        starts = carried_over(earlier, parameters)
        posed, _ = pose(regression, starts, config.poses, rng)
        for trial in range(len(earlier.regression.observed), trials):
            entries = parameters.own_entries(trial)
            starts[:, entries] = posed[:, entries]
    if plain is None:
        return search(regression, rng, config, starts, once)
    as_commanded = carried_over(plain, parameters)
    # Where no robot explains the trials, the searches of worse hypotheses are not completed.
    rival = np.inf if plain.goodness.good else _least(plain)
    if starts is None:
        return search(regression, rng, config, as_commanded, rival=rival)
    known = np.concatenate([starts, as_commanded])
    return search(regression, rng, halved(config), known, rival=rival)


def _plausible(
    robot: RobotModel,
    config: FitConfig,
    plain: Optima,
    alone: Posterior,
    earlier: JointPosterior | None,
) -> list[Hypothesis]:
    """Return the alternative hypotheses to fit, given the nominal fit and its posterior."""
    if config.alternatives == "never":
        return []
    start = (earlier and earlier.warm_start) or WarmStart()
    likely = [h for h in robot.alternatives if h.name not in start.dropped]
    if config.alternatives == "always" or not plain.goodness.good:
        return likely
    # Probable hypotheses stay: a small fin explains the trials nearly as well as a missing one.
    probable = {branch.hypothesis.name for branch in earlier.branches} if earlier else set()
    place = list(robot.parameters).index
    least = np.minimum(plain.fits.theta[0], alone.interval(0.9)[0])
    absent = {
        name
        for name, part in robot.parts.items()
        if any(least[place(dimension)] < ABSENT_SIZE_SHARE for dimension in part.area)
    }
    return [h for h in likely if h.name in probable or h.part in absent]


def carried_over(earlier: Optima, parameters: Parameters) -> Floats:
    """Return optima of fewer trials or of another hypothesis as vectors (K, P).

    Fixed parameters stay fixed. An angle common to all trials takes its value of the first trial;
    angles of single trials take the common value.
    """
    theta: Floats = np.tile(parameters.prior_mean, (len(earlier.fits.theta), 1))
    column = {name: i for i, name in enumerate(earlier.regression.parameters.names)}
    for i, name in enumerate(parameters.names):
        sources = (name, name.partition("@")[0], f"{name}@1")
        source = next((column[source] for source in sources if source in column), None)
        if source is not None and parameters.prior_precision[i] < FIXED_PRECISION:
            theta[:, i] = earlier.fits.theta[:, source]
    return theta
