"""Joint inference: from observed trials to a posterior over all unknowns."""

from __future__ import annotations

import numbers
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from eea.core.angles import Floats
from eea.core.checks import (
    ConfigurationError,
    TargetError,
    callback,
    choice,
    finite,
    instance,
    mapping,
    real,
    whole,
)
from eea.core.config import FitConfig
from eea.core.floating import own_errors
from eea.core.session import MAXIMUM_SEED
from eea.infer.answer import Answer, WarmStart
from eea.infer.branch import Branch
from eea.infer.goodness import beside_rounding, of_rough_simulator
from eea.infer.misfit import FINE, LEAST_RELATIVE_SIGMA, Regression
from eea.infer.mixture import Mixture
from eea.infer.optima import Optima, as_they_are, improved
from eea.infer.recorder import LEAST_WIDENING, recorded, simulated, sound, widened
from eea.infer.scan import pose
from eea.infer.search import agreed, halved, polished, search
from eea.infer.simulating import OutOfBudgetError, Simulations
from eea.infer.statement import Hypothesis, RobotModel
from eea.infer.trials import LARGEST_NUMBER, Noise, Observed, Trial, noise_of
from eea.infer.unknowns import ALL_TRIALS, FIXED_PRECISION, Unknowns
from eea.infer.valleys import settled, stepped, with_others
from eea.infer.words import of_recorder, of_shared

ABSENT_SIZE_SHARE = 0.02  # of a range: smaller parts look like parts that do not move
HOPELESS_LOG_EVIDENCE = 50.0  # hypotheses whose log evidence is lower by this are not refitted
LEAST_PROBABILITY = 1e-4  # less probable hypotheses are left out


@own_errors
def fit(
    observed: Observed,
    robot: RobotModel,
    config: FitConfig,
    rng: np.random.Generator,
    earlier: Answer | None = None,
    progress: Callable[[str], None] | None = None,
    doubt: Callable[[Optima], bool] | None = None,
    usual: Floats | None = None,
    samples: int = 0,
) -> Answer:
    """Return the posterior of a robot's numbers and hypotheses, given trials.

    Under a hypothesis h, with residuals r, the unknowns theta of all trials have the posterior ::

        -log p(theta | trials, h) = sum of r^2 / (2 sigma^2) - log p(theta | h) + constant

    Least squares finds its optima (:func:`~eea.infer.search.search`). A truncated normal
    distribution stands for each (:class:`~eea.infer.mixture.Mixture`), and their integral is the
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
        Called with the name of each hypothesis before it is fitted, and every few seconds, or a
        hundred simulations, with the number of trials that were simulated so far.
    doubt
        Called with the nominal fit if its residuals are more than noise. It returns whether the
        other hypotheses are worth fitting. None: they are.
    usual
        The misfits of known-good logs (n,), by which it is judged whether a hypothesis explains the
        trials; None judges by whether it leaves white noise.
    samples
        The number of samples behind the noise of ``config``, if it is an estimate.

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
        instance("earlier", earlier, Answer)
    callback("progress", progress)
    callback("doubt", doubt)
    if usual is not None and len(usual := finite("usual", usual, (None,))) < 2:
        raise ConfigurationError(f"usual must be the misfits of two logs or more; got {len(usual)}")
    whole("samples", samples, 0)
    check_nuisances(robot, config)
    finite("signal", observed.signal, (len(observed), None, len(robot.channels)))
    counter = _counting(robot)
    own = counter is None
    if counter is None:
        counter = Simulations(robot, progress, config.evaluations, config.seconds)
        robot = replace(robot, simulate=counter)
    config = within_budget(config, robot, len(observed))
    start = (earlier and earlier.warm_start) or WarmStart()
    groups = robot.groups if config.nuisances is None else config.nuisances
    roughness = start.roughness

    def optimize(hypothesis: Hypothesis, plain: Optima | None = None) -> Optima:
        parameters = Unknowns.of(robot, len(observed), groups, hypothesis)
        regression = Regression(parameters, observed, config.noise, usual, roughness, samples)
        before = start.optima.get(hypothesis.name)
        once = not start.explained or robot.prior is not None  # a misfit means a change
        known = None if before is None else carried_over(before, parameters)[:1]
        if counter.ended and known is not None:
            return as_they_are(regression, known)
        counter.begin(hypothesis.name if robot.alternatives else "fitting")
        try:
            return finished(_optimize(regression, config, rng, before, plain, once))
        except OutOfBudgetError as error:
            counter.end(str(error))
        except KeyboardInterrupt:
            if not counter.interruptible or (regression.seen.theta is None and known is None):
                raise
            counter.end("Ctrl-C")
        finally:
            counter.searching = False
        if regression.seen.theta is not None:
            return as_they_are(regression, regression.seen.theta[None])
        if known is not None:
            return as_they_are(regression, known)
        raise TargetError(f"{counter.ended} ended the search before any simulation stayed finite")

    def finished(optima: Optima) -> Optima:
        """Return optima with derivatives that suit the simulator, and those of other valleys."""
        nonlocal roughness
        if robot.discrepancy is not None:  # which states what its simulator errs by
            return optima
        optima, roughness = settled(optima, roughness)
        return stepped(with_others(optima))

    # Fit the robot as it should be, then the other hypotheses that are plausible.
    plain = optimize(robot.nominal)
    explained = plain.goodness.good
    alone = plain.mixture(plain)
    others: list[tuple[Hypothesis, Optima]] = []
    plausible = _plausible(robot, config, plain, alone, earlier)
    if plausible and not explained and doubt is not None and not doubt(plain):
        plausible = []
    for changes in sorted({h.changes for h in plausible}):
        for hypothesis in plausible:
            known = hypothesis.name in start.optima or not counter.ended
            if hypothesis.changes == changes and known:
                others.append((hypothesis, optimize(hypothesis, plain)))
        if any(optima.goodness.good for _, optima in others):
            break
    lowest = min((o for _, o in others), key=_least, default=plain)
    # Is the hypothesis better, or only its search?
    if _least(lowest) < _least(plain) and not counter.ended:
        plain = improved(plain, carried_over(lowest, plain.regression.parameters)[:1])
        alone = plain.mixture(plain)

    # Weigh them by their evidence.
    fitted = [(robot.nominal, plain), *others]
    best = min((optima for _, optima in fitted), key=lambda one: (one.sigma, _least(one)))
    mixtures = [alone if o is best is plain else o.mixture(best) for _, o in fitted]
    constants = [o.regression.parameters.log_prior_constant for _, o in fitted]
    evidence = np.array([m.log_evidence + c for m, c in zip(mixtures, constants, strict=True)])
    evidence += np.log([h.odds for h, _ in fitted])
    shares = np.exp(evidence - evidence.max())
    shares /= shares.sum()
    doubted = mixtures
    said: tuple[str, ...] = ()
    if robot.discrepancy is not None:
        modes, said = robot.discrepancy.doubts([o for _, o in fitted], best)
        doubted = [replace(m, modes=own) for m, own in zip(mixtures, modes, strict=True)]
    least = 0.0 if robot.healthy else LEAST_PROBABILITY  # what if it is broken after all?
    branches = tuple(
        Branch(
            fitted[i][0],
            float(shares[i]),
            fitted[i][1].regression.parameters,
            mixtures[i],
            doubted[i],
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
    goodness = optima[branches[0].hypothesis.name].goodness
    if roughness is not None:
        too_wide = [robot.names[slot] for slot in sorted(roughness.too_wide)]
        goodness = of_rough_simulator(goodness, roughness.jitter, too_wide)
    if own:
        counter.release()
    return Answer(
        branches,
        goodness,
        best.sigma,
        0 if config.noise else observed.size,
        WarmStart(optima, frozenset(dropped), explained, counter.count, roughness),
        observed.noise,
        (*counter.remarks, *of_shared(observed.shared), *said),
        counter.ended,
    )


def _counting(robot: RobotModel) -> Simulations | None:
    """Return what counts a robot's simulations, if a fit goes on."""
    counter = robot.simulate
    return counter if isinstance(counter, Simulations) and counter.counting else None


def within_budget(config: FitConfig, robot: RobotModel, trials: int) -> FitConfig:
    """Return settings whose first scan takes a third of the budget at most."""
    poses = bool(robot.varying or robot.angles)
    while config.evaluations is not None and config.bodies > 2:
        scan = config.bodies * trials * (config.poses if poses else 1)
        if 3 * scan <= config.evaluations:
            break
        config = halved(config)
    return config


def check_nuisances(robot: RobotModel, config: FitConfig) -> None:
    """Raise a ConfigurationError if the settings name a group of numbers that is not there."""
    for name in config.nuisances or ():
        choice("nuisances", name, robot.groups)


def _least(optima: Optima) -> float:
    """Return the sum of squared residuals of the best fit."""
    return float(optima.fits.squares[0])


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
    A few descents come first: if all end in one optimum that leaves nothing but noise, they are the
    search.
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
        if earlier.alone and len(earlier.regression.observed) == trials:
            return replace(polished(regression, starts), alone=True)  # only the noise differs
    if plain is None:
        before = agreed(regression, rng, config) if starts is None else None
        if before is not None and before.goodness.good:
            return before
        return search(regression, rng, config, starts, once, before=before)
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
    alone: Mixture,
    earlier: Answer | None,
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
    place = robot.sought.index
    least = np.minimum(plain.fits.theta[0], alone.interval(0.9)[0])
    absent = {
        name
        for name, part in robot.parts.items()
        if any(least[place(dimension)] < ABSENT_SIZE_SHARE for dimension in part.area)
    }
    return [h for h in likely if h.name in probable or h.part in absent]


def carried_over(earlier: Optima, parameters: Unknowns) -> Floats:
    """Return optima of fewer trials or of another hypothesis as vectors (K, P).

    Fixed parameters stay fixed. An angle common to all trials takes its value of the first trial;
    angles of single trials take the common value.
    """
    theta: Floats = np.tile(parameters.prior_mean, (len(earlier.fits.theta), 1))
    before = earlier.regression.parameters
    keys = zip(before.entry_slots.tolist(), before.entry_trials.tolist(), strict=True)
    column = {key: i for i, key in enumerate(keys)}
    for i in range(len(parameters)):
        slot = int(parameters.entry_slots[i])
        sources = [(slot, e) for e in (int(parameters.entry_trials[i]), ALL_TRIALS, 0)]
        source = next((column[source] for source in sources if source in column), None)
        if source is not None and parameters.prior_precision[i] < FIXED_PRECISION:
            theta[:, i] = earlier.fits.theta[:, source]
    return theta


#: Hypotheses are always weighed: "nothing is broken" is a finding with a probability.
RECORDED_CONFIG = FitConfig(alternatives="always")
MOST_NOISE_ROUNDS = 6


@own_errors
def infer(
    robot: RobotModel,
    trials: Sequence[Trial],
    seed: int = 0,
    config: FitConfig | None = None,
    noise: Mapping[str, float] | Noise | None = None,
    usual: Floats | None = None,
    progress: Callable[[str], None] | None = None,
    interruptible: bool = False,
    samples: int = 0,
) -> Answer:
    """Return the posterior of a robot given recorded trials.

    Parameters
    ----------
    robot, trials
        The robot, and what was recorded of it.
    seed
        Of the starting points.
    config
        Settings of the fit; None weighs all hypotheses.
    noise
        The standard deviation of each channel's noise, by name, if it is known, or the ``noise``
        of another posterior or of a reference. None estimates it,
        and how neighbouring samples correlate, from what the best fit leaves: the trials are
        fitted again until it stays the same.
    usual, progress, samples
        See :func:`eea.infer.fit.fit`.
    interruptible
        Whether Ctrl-C ends the search as a budget does, with the best so far as the answer.

    Raises
    ------
    ConfigurationError
        If trials have other channels than the robot, two are the same recording, or settings are
        wrong.
    TargetError
        If no simulation stays finite.
    """
    instance("robot", robot, RobotModel)
    callback("progress", progress)
    if robot.discrepancy is not None:
        raise ConfigurationError(
            "discrepancy must be None where the channels' noise is inferred: AR(1) noise is what a "
            "simulator leaves; got one"
        )
    whole("seed", seed, 0, MAXIMUM_SEED)
    config = recorded_config(config)
    observed = Observed.of(trials, robot)
    check_enough(robot, observed, config, noise is not None)
    counter = Simulations(robot, progress, config.evaluations, config.seconds, interruptible)
    robot = replace(robot, simulate=counter)
    try:
        return _infer(robot, observed, seed, config, noise, usual, samples)
    finally:
        counter.release()


def _infer(
    robot: RobotModel,
    observed: Observed,
    seed: int,
    config: FitConfig,
    noise: Mapping[str, float] | Noise | None,
    usual: Floats | None,
    samples: int,
) -> Answer:
    """Fit trials, and again by the readings that a recorder has left sound."""
    rng = np.random.default_rng(seed)
    answer = _fitted(robot, observed, rng, config, noise, usual, samples)
    found = recorded(answer.best_fit)
    if not found or answer.ended:
        return replace(answer, caveats=(*answer.caveats, *of_recorder(found, robot, False)))
    counts = observed.there
    signal = observed.signal
    sd = np.zeros(len(robot.channels))
    for _ in range(MOST_SOUND_ROUNDS):
        kept = sound(observed, found, signal, sd)
        if (kept == counts).all():
            break
        enough = kept.any(axis=(0, 1)).all() and kept.sum() > _most_unknowns(answer)
        if not enough:
            return replace(answer, caveats=(*answer.caveats, *of_recorder(found, robot, False)))
        counts = kept
        apart = replace(observed, weight=kept.astype(np.float64))
        answer = _fitted(robot, apart, rng, config, noise, usual, samples)
        signal = simulated(answer.best_fit, observed)
        sd = _noise_of(answer).sd
    before = _noise_of(answer)
    wide = widened(answer.best_fit, found, before)
    louder = wide.sd > LEAST_WIDENING * before.sd
    found = [one for one in found if one.kind != "steps" or louder[one.channel]]
    if louder.any():
        observed = replace(observed, weight=counts.astype(np.float64))
        answer = _fitted(robot, observed, rng, config, wide, usual, samples)
        if usual is None:
            rest = int(counts[:, :, ~louder].sum())
            residuals = answer.best_fit.residuals
            most = _most_unknowns(answer)
            tested = beside_rounding(answer.goodness, residuals, louder, rest, most, robot.noun)
            answer = replace(answer, goodness=tested)
    return replace(answer, caveats=(*answer.caveats, *of_recorder(found, robot, True)))


MOST_SOUND_ROUNDS = 3  # of fits without the readings at an end


def _noise_of(answer: Answer) -> Noise:
    """Return the noise of each channel by an answer."""
    assert answer.noise is not None
    return answer.noise._replace(sd=answer.sigma * answer.noise.sd)


def _most_unknowns(answer: Answer) -> int:
    """Return the unknowns of the hypothesis that has most, of those that were fitted."""
    assert answer.warm_start is not None
    fitted = answer.warm_start.optima.values()
    return max(one.regression.parameters.unknowns for one in fitted)


def _fitted(
    robot: RobotModel,
    observed: Observed,
    rng: np.random.Generator,
    config: FitConfig,
    noise: Mapping[str, float] | Noise | None,
    usual: Floats | None,
    samples: int,
) -> Answer:
    """Fit trials with known noise, or again until the noise that they leave stays the same."""
    if noise is not None:
        known = known_noise(noise, robot)
        config = replace(config, noise=1.0)  # times the channels' own
        seen = replace(observed, noise=known)
        return fit(seen, robot, config, rng, usual=usual, samples=samples)
    guess = first_guess(robot, observed)
    posterior: Answer | None = None
    for _ in range(MOST_NOISE_ROUNDS):
        seen = replace(observed, noise=guess)
        posterior = fit(seen, robot, config, rng, posterior)
        start = posterior.warm_start
        assert start is not None
        # While the guess is too loud, a hypothesis that is right may be unlikely.
        fits = [one for one in start.optima.values() if one.regression.observed is seen]
        found = noise_left([min(fits, key=lambda one: one.sigma)])
        posterior = replace(posterior, warm_start=replace(start, dropped=frozenset()))
        if found.alike(guess):
            break
        guess = found
    assert posterior is not None
    return posterior


def recorded_config(config: FitConfig | None) -> FitConfig:
    """Return settings of a fit of recorded trials, without noise; None weighs all hypotheses."""
    config = RECORDED_CONFIG if config is None else config
    instance("config", config, FitConfig)
    if config.noise is not None:
        raise ConfigurationError(
            f"config must have noise=None: noise is given by channel; got {config.noise:g}"
        )
    return config


def check_enough(
    robot: RobotModel, observed: Observed, config: FitConfig, known_noise: bool
) -> None:
    """Raise a ConfigurationError if trials are too short, or a change has nowhere to start.

    Trials are too short where noise that is not known must be told from what the numbers explain.
    """
    groups = robot.groups if config.nuisances is None else config.nuisances
    for hypothesis in (robot.nominal, *robot.alternatives):
        of = Unknowns.of(robot, len(observed), groups, hypothesis)
        if not known_noise and observed.size <= of.unknowns:
            raise ConfigurationError(
                f"trials must have more samples than the {of.unknowns} unknowns if "
                f"{hypothesis.name}; got {observed.size}"
            )
        for name in hypothesis.moves:
            if name not in robot.usual and name not in robot.angles:
                raise ConfigurationError(
                    f"moves of {hypothesis.name!r} must be of numbers that have a mean, say what "
                    f"is healthy, or were found by learn(); {name} is none of these"
                )


def noise_left(optima: Sequence[Optima]) -> Noise:
    """Return the noise that the best fits of one or more logs leave, of each channel."""
    left = []
    there = []
    loudest = []
    for one in optima:
        observed = replace(one.regression.observed, noise=None)
        plain = Regression(one.regression.parameters, observed, None)
        trials, samples, channels = observed.signal.shape
        flat = plain.misfit(FINE).residuals(one.fits.theta[:1])[0]
        left.append(flat.reshape(trials, channels, samples))
        there.append(observed.there.swapaxes(1, 2))
        loudest.append(np.abs(observed.signal).max(axis=(0, 1)))
    least = LEAST_RELATIVE_SIGMA * np.maximum(np.max(loudest, axis=0), 1e-12)
    return noise_of(left, there, sum(map(_determined, optima)), least)


def _determined(optima: Optima) -> float:
    """Return how many unknowns the data determine, rather than the prior."""
    theta = optima.fits.theta[:1]
    misfit = optima.regression.misfit(FINE)
    linear = misfit.linearise(theta)
    weight = optima.sigma**-2
    near = misfit.laplace(theta, linear, weight)[0]
    return float(np.trace(near.covariance() @ (weight * linear.normal[0])))


def first_guess(robot: RobotModel, observed: Observed) -> Noise:
    """Return noise as loud as each channel's signal about its mean, and white."""
    channels = range(observed.signal.shape[2])
    rows = [observed.signal[:, :, c][observed.there[:, :, c]] for c in channels]
    for name, row in zip(robot.channels, rows, strict=True):
        if not len(row):
            raise ConfigurationError(
                f"a channel of unknown noise must have a sample in some trial; {name} has none"
            )
    spread = [float(row.std()) or float(np.abs(row).max(initial=0.0)) or 1.0 for row in rows]
    return Noise(np.array(spread), np.zeros(len(spread)))


def known_noise(noise: Mapping[str, float] | Noise, robot: RobotModel) -> Noise:
    """Return known noise, by the channels' names or as it was found, as it is reckoned with."""
    if isinstance(noise, Noise):
        each = (len(robot.channels),)
        return Noise(*(finite(f"{n} of noise", getattr(noise, n), each) for n in noise._fields))
    mapping("noise", noise, numbers.Real)
    for name in noise:
        choice("noise", name, robot.channels)
    for name in robot.channels:
        if name not in noise:
            raise ConfigurationError(f"noise must be that of every channel; {name} has none")
        real(f"noise of {name}", noise[name], 1.0 / LARGEST_NUMBER)
    sd = np.array([float(noise[name]) for name in robot.channels])
    return Noise(sd, np.zeros(len(sd)))
