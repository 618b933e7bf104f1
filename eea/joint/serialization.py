"""A joint posterior as a few arrays of numbers, and back: for a file without pickle.

The array ``header`` is UTF-8 of JSON: names, ranges, hypotheses and the goodness of fit. The other
arrays have a row for each mode, one hypothesis after the other, padded with zeros.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eea.core.checks import ConfigurationError, TargetError, brief, finite, whole
from eea.core.config import MAXIMUM_ROUNDS, MAXIMUM_TRIAL_STEPS
from eea.core.genome import BitLayout, Variable
from eea.core.problem import Problem
from eea.joint.goodness_of_fit import Goodness
from eea.joint.joint_posterior import HypothesisPosterior, JointPosterior
from eea.joint.parameters import Parameters
from eea.joint.plausibility import check_mode, check_posterior
from eea.joint.posterior import Mode, Posterior
from eea.joint.problem import Hypothesis, JointProblem, Nuisance, Part

POSTERIOR_SCHEMA = "eea.posterior/4"
ARRAYS = ("header", "theta", "information", "cost", "gradient")
MOST_SLOTS = 10**7  # numbers in the slots of all trials


def to_arrays(posterior: JointPosterior) -> dict[str, NDArray[Any]]:
    """Return all of a posterior except its simulator and warm start, for :func:`from_arrays`."""
    parameters = posterior.branches[0].parameters
    joint = parameters.joint
    problem = parameters.joint.problem
    parts = [part for branch in posterior.branches for part in (branch.posterior, branch.doubted)]
    modes = [mode for part in parts for mode in part.modes]
    header = {
        "schema": POSTERIOR_SCHEMA,
        "models": [asdict(variable) for variable in problem.models.variables],
        "actions": [asdict(variable) for variable in problem.actions.variables],
        "hidden": problem.hidden,
        "axes": problem.axes,
        "nuisances": [asdict(nuisance) for nuisance in joint.nuisances],
        "hypotheses": [asdict(hypothesis) for hypothesis in joint.hypotheses],
        "nominal": asdict(joint.nominal),
        "unknown": joint.hidden,
        "parts": {name: asdict(part) for name, part in joint.parts.items()},
        "sigma": posterior.sigma,
        "samples": posterior.samples,
        "goodness": asdict(posterior.goodness),
        "trials": len(parameters.slots),
        "branches": [
            {
                "hypothesis": branch.hypothesis.name,
                "probability": branch.probability,
                "parameters": branch.parameters.names,
                "modes": [len(branch.posterior.modes), len(branch.doubted.modes)],
            }
            for branch in posterior.branches
        ],
    }
    size = max(len(mode.theta) for mode in modes)
    theta, gradient = np.zeros((2, len(modes), size))
    information = np.zeros((len(modes), size, size))
    for i, mode in enumerate(modes):
        own = slice(len(mode.theta))
        theta[i, own] = mode.theta
        gradient[i, own] = mode.gradient
        information[i, own, own] = mode.information
    return {
        "header": np.frombuffer(json.dumps(header).encode(), np.uint8),
        "theta": theta.ravel(),
        "information": information.ravel(),
        "cost": np.array([mode.cost for mode in modes]),
        "gradient": gradient.ravel(),
    }


def from_arrays(arrays: Mapping[str, NDArray[Any]]) -> JointPosterior:
    """Return the posterior that :func:`to_arrays` wrote; it cannot simulate.

    Raises
    ------
    ConfigurationError
        If the arrays do not describe a posterior, or a posterior of another version.
    """
    try:
        header = json.loads(arrays["header"].tobytes())
        schema = header["schema"]
        if schema == POSTERIOR_SCHEMA:
            return _read(header, arrays)
    except ConfigurationError:
        raise
    except (LookupError, TypeError, ValueError, OverflowError, RecursionError) as error:
        raise ConfigurationError(f"it does not describe a posterior: {brief(error)}") from None
    raise ConfigurationError(
        f"its schema must be {POSTERIOR_SCHEMA}; it is {brief(schema)}: "
        "infer again with this version"
    )


def _read(header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> JointPosterior:
    joint = JointProblem(
        Problem(
            BitLayout([Variable(**variable) for variable in header["models"]]),
            BitLayout([Variable(**variable) for variable in header["actions"]]),
            tuple(header["hidden"]),
            header["axes"],
        ),
        _no_simulator,
        tuple(Nuisance(**nuisance) for nuisance in header["nuisances"]),
        tuple(Hypothesis(**hypothesis) for hypothesis in header["hypotheses"]),
        {name: Part(**part) for name, part in header["parts"].items()},
        Hypothesis(**header["nominal"]),
        hidden=tuple(header["unknown"]),
    )
    trials = header["trials"]
    whole("its number of trials", trials, 1, MAXIMUM_ROUNDS)
    slots = len(joint.problem.models) + len(joint.nuisances) + len(header["unknown"])
    whole("its numbers in all trials", trials * slots, 1, MOST_SLOTS)
    whole("its samples", header["samples"], 0, trials * MAXIMUM_TRIAL_STEPS * joint.problem.axes)
    for name in ARRAYS[1:]:
        finite(f"its {name}", arrays[name], (None,))
    for row in header["branches"]:
        for count in row["modes"]:
            whole("its number of modes", count, 1, arrays["cost"].size)
    cost = arrays["cost"].tolist()
    theta, gradient = (arrays[name].reshape(len(cost), -1) for name in ("theta", "gradient"))
    information = arrays["information"].reshape(*theta.shape, -1)
    hypotheses = {h.name: h for h in (joint.nominal, *joint.hypotheses)}
    branches = []
    first = 0
    for row in header["branches"]:
        hypothesis = hypotheses[row["hypothesis"]]
        names = row["parameters"]
        per_trial = {n.group for n in joint.nuisances if f"{n.name}@1" in names}
        inferred = per_trial | {n.group for n in joint.nuisances if n.name in names}
        parameters = Parameters.of(joint, trials, inferred, hypothesis, per_trial)
        if list(parameters.names) != names:
            raise ConfigurationError(f"its parameters must be {brief(parameters.names)}")
        own = slice(len(names))
        parts = []
        for count in row["modes"]:
            modes = [
                Mode(theta[i, own], information[i, own, own], cost[i], gradient[i, own])
                for i in range(first, first + count)
            ]
            first += count
            for mode in modes:
                check_mode(mode, parameters)
            parts.append(
                Posterior(
                    parameters.names, parameters.low, parameters.high, parameters.circular, modes
                )
            )
        inside, doubted = parts
        branches.append(
            HypothesisPosterior(hypothesis, row["probability"], parameters, inside, doubted)
        )
    goodness = Goodness(**header["goodness"])
    belief = JointPosterior(tuple(branches), goodness, header["sigma"], header["samples"])
    check_posterior(belief)
    if first != len(cost):
        raise ConfigurationError(f"its modes must be {first}; there are {len(cost)}")
    return belief


def _no_simulator(*_: Any, **__: Any) -> NDArray[Any]:
    raise TargetError("a posterior that was read from a file cannot simulate")
