"""Joint inference from recorded trials, whose channels each have noise of their own."""

from __future__ import annotations

import numbers
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from eea.core.angles import Floats
from eea.core.checks import ConfigurationError, choice, finite, instance, mapping, real, whole
from eea.core.config import FitConfig
from eea.core.floating import own_errors
from eea.core.session import MAXIMUM_SEED
from eea.joint.inference import fit
from eea.joint.joint_posterior import JointPosterior
from eea.joint.least_squares import FINE, LEAST_RELATIVE_SIGMA, Regression
from eea.joint.observed import LARGEST_NUMBER, Observed, Trial
from eea.joint.parameters import Parameters
from eea.joint.robot_model import RobotModel
from eea.joint.search import Optima
from eea.statistics.goodness_of_fit import LEAST_RELATIVE_RMS
from eea.statistics.noise import Noise, noise_of

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
) -> JointPosterior:
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
    usual, progress
        See :func:`eea.joint.inference.fit`.

    Raises
    ------
    ConfigurationError
        If trials have other channels than the robot, or settings are wrong.
    TargetError
        If no simulation stays finite.
    """
    instance("robot", robot, RobotModel)
    if robot.discrepancy is not None:
        raise ConfigurationError(
            "discrepancy must be None where the channels' noise is inferred: AR(1) noise is what a "
            "simulator leaves; got one"
        )
    whole("seed", seed, 0, MAXIMUM_SEED)
    config = RECORDED_CONFIG if config is None else config
    instance("config", config, FitConfig)
    if config.noise is not None:
        raise ConfigurationError(
            f"config must have noise=None: noise is given by channel; got {config.noise:g}"
        )
    observed = Observed.of(trials, robot)
    _check_enough(robot.varying(config.per_trial), observed, config, noise is not None)
    rng = np.random.default_rng(seed)
    if noise is not None:
        known = known_noise(noise, robot)
        config = replace(config, noise=1.0)  # times the channels' own
        return fit(
            replace(observed, noise=known), robot, config, rng, progress=progress, usual=usual
        )
    guess = first_guess(robot, observed)
    posterior: JointPosterior | None = None
    for _ in range(MOST_NOISE_ROUNDS):
        seen = replace(observed, noise=guess)
        posterior = fit(seen, robot, config, rng, posterior, progress)
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


def _check_enough(
    robot: RobotModel, observed: Observed, config: FitConfig, known_noise: bool
) -> None:
    """Raise a ConfigurationError if trials are too short, or a change has nowhere to start.

    Trials are too short where noise that is not known must be told from what the numbers explain.
    """
    groups = robot.groups if config.nuisances is None else config.nuisances
    for hypothesis in (robot.nominal, *robot.alternatives):
        of = Parameters.of(robot, len(observed), groups, hypothesis)
        if not known_noise and observed.size <= of.unknowns:
            raise ConfigurationError(
                f"trials must have more samples than the {of.unknowns} unknowns if "
                f"{hypothesis.name}; got {observed.size}"
            )
        for name in hypothesis.moves:
            if name not in robot.usual:
                raise ConfigurationError(
                    f"moves of {hypothesis.name!r} must be of numbers that are in whole, or that "
                    f"learn() has found; {name} is neither"
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


def only_rounding(noise: Noise, observed: Observed, robot: RobotModel) -> list[str]:
    """Return a sentence on each channel whose noise is only rounding beside its signal."""
    loudest = np.abs(observed.signal).max(axis=(0, 1))
    return [
        f"the noise of {name}, {sd:.1g} {unit}, is only rounding: by it any noise in a log counts "
        "as a change"
        for (name, unit), sd, most in zip(robot.channels.items(), noise.sd, loudest, strict=True)
        if sd < LEAST_RELATIVE_RMS * most
    ]


def _determined(optima: Optima) -> float:
    """Return how many unknowns the data determine, rather than the prior."""
    theta = optima.fits.theta[:1]
    parameters = optima.regression.parameters
    normal = optima.regression.misfit(FINE).linearise(theta).normal[0] / optima.sigma**2
    both = normal + parameters.prior_information
    return float(np.trace(np.linalg.pinv(both, hermitian=True) @ normal))


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
