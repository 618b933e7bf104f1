"""Priors of a body: its earlier posterior, and the ways in which each fin may have changed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations, product

import numpy as np

from aquafish_gym.morphology import DIMENSIONS, FIN_WORDS, FINS, Morphology
from aquafish_gym.utils.validation import InvalidArgumentError, instance, sequence
from eea.core.checks import ConfigurationError, choice, real
from eea.fish.hypotheses import SERVO, fault_hypothesis
from eea.fish.joint import fish_joint
from eea.fish.simulator import EngineSimulator
from eea.joint.goodness_of_fit import Goodness
from eea.joint.joint_posterior import HypothesisPosterior, JointPosterior
from eea.joint.parameters import Parameters
from eea.joint.plausibility import check_posterior
from eea.joint.posterior import Mode, Posterior
from eea.joint.problem import Hypothesis, JointProblem

CHANGE_PROBABILITY = 0.1  # probability for each fin
MOST_CHANGES = 2  # maximum number of fins that changed
UNCHANGED_NAME = "nothing has changed"


def known_body(
    body: Morphology, noise: float, nuisances: Sequence[str] | None = None
) -> JointPosterior:
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
    joint = fish_joint(EngineSimulator(1))
    for name in () if nuisances is None else sequence("nuisances", nuisances):
        choice("nuisances", name, joint.groups)
    names = [d.name for d in DIMENSIONS]
    known = Hypothesis("the body is known", dict(zip(names, body.to_array().tolist(), strict=True)))
    joint = replace(joint, nominal=known, hypotheses=())
    parameters = Parameters.of(joint, 1, joint.groups if nuisances is None else nuisances)
    mean = parameters.prior_mean
    mode = Mode(mean, parameters.prior_information, 0.0, np.zeros(len(mean)))
    posterior = Posterior(
        parameters.names, parameters.low, parameters.high, parameters.circular, [mode]
    )
    goodness = Goodness(noise, 1.0, 1.0, 1.0, 1.0, good=True, verdict="the body is known")
    branch = HypothesisPosterior(known, 1.0, parameters, posterior, posterior)
    return JointPosterior((branch,), goodness, noise, 0)


def check_belief(argument: str, belief: object, joint: JointProblem) -> None:
    """Raise an InvalidArgumentError unless ``belief`` is a sensible posterior of this fish."""
    instance(argument, belief, JointPosterior)
    assert isinstance(belief, JointPosterior)
    try:
        check_posterior(belief)
    except ConfigurationError as error:
        raise InvalidArgumentError(f"{argument} must be a posterior: {error}") from None
    known = belief.branches[0].parameters.joint.problem.models
    for found, wanted in zip(known.variables, joint.problem.models.variables, strict=False):
        if (found.name, found.low, found.high) != (wanted.name, wanted.low, wanted.high):
            raise InvalidArgumentError(
                f"{argument} must be a posterior of this fish, with {wanted.name} from "
                f"{wanted.low:g} to {wanted.high:g}; "
                f"it has {found.name} from {found.low:g} to {found.high:g}"
            )
    if len(known) != len(joint.problem.models):
        raise InvalidArgumentError(
            f"{argument} must be a posterior of this fish, which has {len(joint.problem.models)} "
            f"sizes; it has {len(known)}"
        )


def since(joint: JointProblem, prior: JointPosterior | Morphology) -> JointProblem:
    """Return a problem with a prior: the earlier body, with changes of at most two fins.

    The prior is the most probable hypothesis of a posterior. Each fin changed with a probability of
    0.1: it has other sizes, its servo another speed, or it is missing. Changes of two fins are
    tried only where no change of one explains the trials. There is no model discrepancy: the prior
    was fitted with this simulator.
    """
    if not isinstance(prior, JointPosterior):
        prior = known_body(Morphology.coerce(prior), 1.0, ())
    check_belief("prior", prior, joint)
    best = prior.branches[0]
    was = Hypothesis(UNCHANGED_NAME, best.hypothesis.fixed, freed=best.hypothesis.freed)
    odds = CHANGE_PROBABILITY / (1.0 - CHANGE_PROBABILITY) / len(_changes(FINS[0]))
    hypotheses = [
        replace(_joined(was, ways), changes=count, odds=odds**count)
        for count in range(1, MOST_CHANGES + 1)
        for fins in combinations(FINS, count)
        for ways in product(*map(_changes, fins))
    ]
    return replace(
        joint, nominal=was, hypotheses=tuple(hypotheses), prior=best.prior(), discrepancy=None
    )


def _changes(fin: str) -> list[Hypothesis]:
    """Return the possible changes of a fin, all equally probable."""
    weak = fault_hypothesis(fin, "weak")
    return [
        Hypothesis(
            f"the {FIN_WORDS[fin]} has other sizes",
            changed=tuple(d.name for d in DIMENSIONS if d.fin == fin),
        ),
        replace(weak, name=f"the {SERVO[fin]} has another speed", changed=weak.freed),
        fault_hypothesis(fin, "missing"),
    ]


def _joined(was: Hypothesis, ways: tuple[Hypothesis, ...]) -> Hypothesis:
    """Return several changes of a robot as one hypothesis."""
    changed = tuple(name for way in ways for name in way.changed)
    fixed = {name: value for name, value in was.fixed.items() if name not in changed}
    freed = dict.fromkeys([*was.freed, *(name for way in ways for name in way.freed)])
    for way in ways:
        fixed |= way.fixed
    return Hypothesis(
        " and ".join(way.name for way in ways), fixed, freed=tuple(freed), changed=changed
    )
