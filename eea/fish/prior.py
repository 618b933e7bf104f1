"""Priors of a body: its earlier posterior, and the ways in which each fin may have changed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations, product

import numpy as np
from scipy.special import chdtrc

from aquafish_gym.morphology import DIMENSIONS, FIN_WORDS, FINS, Morphology
from aquafish_gym.utils.validation import InvalidArgumentError, instance, sequence
from eea.core.checks import ConfigurationError, choice, real
from eea.fish.hypotheses import ANYWHERE, SERVO, fault_hypothesis
from eea.fish.joint import fish_robot
from eea.fish.simulator import EngineSimulator
from eea.fish.windows import LogWindows
from eea.infer.answer import Answer
from eea.infer.branch import Branch
from eea.infer.file import check_posterior
from eea.infer.goodness import Goodness
from eea.infer.mixture import Mode
from eea.infer.robot import Robot
from eea.infer.statement import Hypothesis, RobotModel, joined
from eea.infer.unknowns import Unknowns

CHANGE_PROBABILITY = 0.1  # of each fin
MOST_CHANGES = 2  # fins at once
#: rad/s: a good gyroscope's, at 100 readings a second. Less noise is not counted with, since
#: simulations are not exact where readings are between their steps.
LEAST_GYRO_NOISE = 1e-3
LOUDER_P_VALUE = 0.01  # below it a log's noise is louder than the posterior's
UNCHANGED_NAME = "nothing has changed"


def known_body(body: Morphology, noise: float, nuisances: Sequence[str] | None = None) -> Answer:
    """Return the posterior of a body that is known without trials, such as the intact body.

    Parameters
    ----------
    body
        The body.
    noise
        Standard deviation of the gyroscope's noise, rad/s.
    nuisances
        Groups of nuisances that are unknown, with their own priors; None for all. The others are
        nominal.

    Raises
    ------
    ConfigurationError
        If the noise is not a finite number of at least 1e-9, or a nuisance is unknown.

    Examples
    --------
    >>> belief = known_body(Morphology.nominal(), noise=0.01)
    >>> np.allclose(belief.model, Morphology.nominal().to_array())
    True
    """
    real("noise", noise, 1e-9)
    instance("body", body, Morphology)
    robot = fish_robot(EngineSimulator(1))
    for name in () if nuisances is None else sequence("nuisances", nuisances):
        choice("nuisances", name, robot.groups)
    names = [d.name for d in DIMENSIONS]
    known = Hypothesis("the body is known", dict(zip(names, body.to_array().tolist(), strict=True)))
    robot = replace(robot, nominal=known, hypotheses=())
    parameters = Unknowns.of(robot, 1, robot.groups if nuisances is None else nuisances)
    mean = parameters.prior_mean
    mode = Mode(mean, parameters.prior_information, np.zeros(len(mean)), 0.0)
    posterior = parameters.posterior([mode])
    goodness = Goodness(noise, 1.0, 1.0, 1.0, 1.0, good=True, verdict="the body is known")
    branch = Branch(known, 1.0, parameters, posterior, posterior)
    return Answer((branch,), goodness, noise, 0)


def _ranges(robot: RobotModel) -> dict[str, tuple[float, float]]:
    """Return the ranges of what is sought, by name."""
    return {name: (robot.table[name].low, robot.table[name].high) for name in robot.sought}


def check_belief(argument: str, belief: object, robot: Robot) -> None:
    """Raise an InvalidArgumentError unless ``belief`` is a sensible posterior of this fish."""
    instance(argument, belief, Answer)
    assert isinstance(belief, Answer)
    try:
        check_posterior(belief)
    except ConfigurationError as error:
        raise InvalidArgumentError(f"{argument} must be a posterior: {error}") from None
    found = _ranges(belief.robot)
    stated = _ranges(robot)
    for (name, ends), (wanted, known) in zip(found.items(), stated.items(), strict=False):
        if (name, *ends) != (wanted, *known):
            raise InvalidArgumentError(
                f"{argument} must be a posterior of this fish, with {wanted} from "
                f"{known[0]:g} to {known[1]:g}; it has {name} from {ends[0]:g} to {ends[1]:g}"
            )
    if len(found) != len(stated):
        raise InvalidArgumentError(
            f"{argument} must be a posterior of this fish, which has {len(stated)} "
            f"sizes; it has {len(found)}"
        )


def noise_now(belief: Answer, windows: LogWindows) -> tuple[float, int]:
    """Return the sd of a log's noise, rad/s, and the number of samples that tell it; 0 if given.

    The noise is that of the posterior, unless the log itself is noisier: the trials of a posterior
    may have had none, as in a simulation, or another gyroscope's.

    Raises
    ------
    InvalidArgumentError
        If the trials had no noise, and the log's readings are too far apart to tell its own.
    """
    found = windows.noise
    if found is None and belief.samples and belief.sigma < LEAST_GYRO_NOISE:
        raise InvalidArgumentError(
            f"belief must know the gyroscope's noise: its trials had none ({belief.sigma:.1g} "
            "rad/s), and the log has too few readings while a command stays the same to tell it; "
            "infer with FitConfig(noise=0.01), --noise 0.01 of infer or --joint.noise 0.01 of run"
        )
    known = max(belief.sigma, LEAST_GYRO_NOISE)
    if found is not None:
        sigma, samples = found
        if chdtrc(samples, samples * (sigma / known) ** 2) < LOUDER_P_VALUE:
            return found
    return known, belief.samples


def since(robot: Robot, prior: Answer | Morphology) -> Robot:
    """Return a robot that had a body until some of its fins changed, or none.

    The prior is the most probable hypothesis of a posterior. Each fin changed with a probability of
    0.1: it has other sizes, its servo another speed, or it is missing. Changes of two fins are
    tried only where no change of one explains the trials. There is no model discrepancy: the prior
    was fitted with this simulator.
    """
    if not isinstance(prior, Answer):
        prior = known_body(Morphology.coerce(prior), 1.0, ())
    check_belief("prior", prior, robot)
    best = prior.branches[0]
    was = Hypothesis(UNCHANGED_NAME, best.hypothesis.fixed)
    odds = CHANGE_PROBABILITY / (1.0 - CHANGE_PROBABILITY) / len(_changes(FINS[0]))
    hypotheses = [
        replace(_joined(was, ways), changes=count, odds=odds**count)
        for count in range(1, MOST_CHANGES + 1)
        for fins in combinations(FINS, count)
        for ways in product(*map(_changes, fins))
    ]
    return replace(
        robot, nominal=was, hypotheses=tuple(hypotheses), prior=best.prior(), discrepancy=None
    )


def _changes(fin: str) -> list[Hypothesis]:
    """Return the possible changes of a fin, all equally probable."""
    return [
        Hypothesis(
            f"the {FIN_WORDS[fin]} has other sizes",
            moves={d.name: ANYWHERE for d in DIMENSIONS if d.fin == fin},
        ),
        replace(fault_hypothesis(fin, "weak"), name=f"the {SERVO[fin]} has another speed"),
        fault_hypothesis(fin, "missing"),
    ]


def _joined(was: Hypothesis, ways: tuple[Hypothesis, ...]) -> Hypothesis:
    """Return several changes of a robot as one hypothesis."""
    found = joined(ways)
    kept = {name: value for name, value in was.fixed.items() if name not in found.moves}
    return replace(found, fixed={**kept, **found.fixed})
