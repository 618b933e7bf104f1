"""A joint posterior as a few arrays of numbers, and back: for a file without pickle.

The array ``header`` is UTF-8 of JSON: names, ranges, hypotheses and the goodness of fit. The modes
of all hypotheses follow one another in flat arrays of float64: ``theta``, ``information``,
``gradient`` and ``cost``.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eea.core.angles import Floats
from eea.core.checks import ConfigurationError, TargetError, brief, flag, instance, real, whole
from eea.core.config import MAXIMUM_ROUNDS, MAXIMUM_STEPS
from eea.core.genome import BitLayout, Variable
from eea.core.problem import Problem
from eea.joint.goodness_of_fit import Goodness
from eea.joint.joint_posterior import HypothesisPosterior, JointPosterior
from eea.joint.parameters import Parameters
from eea.joint.posterior import Mode, Posterior
from eea.joint.problem import AS_COMMANDED, Hypothesis, JointProblem, Nuisance, Part

SCHEMA = "eea.belief/1"
#: Every array, and its number of dimensions.
ARRAYS = {"header": 1, "theta": 1, "information": 1, "gradient": 1, "cost": 1}
MOST_HEADER, MOST_SLOTS = 2**22, 10**7  # bytes; numbers that all trials are simulated with
LEAST_SIGMA = 1e-300


def to_arrays(posterior: JointPosterior) -> dict[str, NDArray[Any]]:
    """Return all of a posterior except its simulator and warm start, for :func:`from_arrays`."""
    parameters = posterior.branches[0].parameters
    joint, problem = parameters.joint, parameters.joint.problem
    modes = [mode for branch in posterior.branches for mode in branch.posterior.modes]
    header = {
        "schema": SCHEMA,
        "problem": {
            "models": [asdict(variable) for variable in problem.models.variables],
            "actions": [asdict(variable) for variable in problem.actions.variables],
            "hidden": problem.hidden,
            "axes": problem.axes,
        },
        "nuisances": [
            asdict(n) | {"sd": None if math.isinf(n.sd) else n.sd} for n in joint.nuisances
        ],
        "hypotheses": [asdict(hypothesis) for hypothesis in joint.hypotheses],
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
                "modes": len(branch.posterior.modes),
            }
            for branch in posterior.branches
        ],
    }
    text = json.dumps(header, allow_nan=False).encode()
    return {
        "header": np.frombuffer(text, np.uint8),
        "theta": np.concatenate([mode.theta for mode in modes]),
        "information": np.concatenate([mode.information.ravel() for mode in modes]),
        "gradient": np.concatenate([mode.gradient for mode in modes]),
        "cost": np.array([mode.cost for mode in modes]),
    }


def from_arrays(arrays: Mapping[str, NDArray[Any]]) -> JointPosterior:
    """Return the posterior that :func:`to_arrays` wrote; it can do everything except simulate.

    Raises
    ------
    ConfigurationError
        If an array is missing, or they do not describe a posterior.
    """
    try:
        header = json.loads(np.asarray(arrays["header"], np.uint8)[:MOST_HEADER].tobytes())
        return _read(
            header, {name: np.array(arrays[name], np.float64) for name in list(ARRAYS)[1:]}
        )
    except ConfigurationError as error:
        raise ConfigurationError(f"an archive of a posterior is wrong: {error}") from None
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, RecursionError) as error:
        raise ConfigurationError(
            f"an archive of a posterior lacks something: {brief(error)}"
        ) from None


def _read(header: Mapping[str, Any], flat: dict[str, Floats]) -> JointPosterior:
    if header["schema"] != SCHEMA:
        raise ConfigurationError(f"its schema must be {SCHEMA}; it is {brief(header['schema'])}")
    joint, trials = _joint(header), header["trials"]
    whole("its number of trials", trials, 1, MAXIMUM_ROUNDS)
    slots = len(joint.problem.models) + len(joint.nuisances) + len(joint.problem.hidden)
    whole("its numbers in all trials", slots * trials, 1, MOST_SLOTS)
    branches = tuple(_branch(row, joint, trials, flat) for row in header["branches"])
    if not branches or any(len(rest) for rest in flat.values()):
        raise ConfigurationError("its arrays must hold as many numbers as its header says")
    if not 0.5 < sum(branch.probability for branch in branches) < 1.5:
        raise ConfigurationError("its probabilities must sum to 1")
    real("its sigma", header["sigma"], LEAST_SIGMA)
    whole("its samples", header["samples"], 0, trials * MAXIMUM_STEPS * joint.problem.axes)
    goodness = _goodness(header["goodness"])
    return JointPosterior(branches, goodness, float(header["sigma"]), header["samples"])


def _goodness(row: Mapping[str, Any]) -> Goodness:
    found = Goodness(**row)
    real("its rms", found.rms, 0.0)
    for name in ("whiteness_p", "peak_p", "p", *(["size_p"] if found.size_p is not None else [])):
        real(f"its {name}", getattr(found, name), 0.0, 1.0)
    flag("its good", found.good)
    instance("its verdict", found.verdict, str)
    return found


def _joint(header: Mapping[str, Any]) -> JointProblem:
    row = header["problem"]
    models, actions = (
        BitLayout([Variable(**variable) for variable in row[part]])
        for part in ("models", "actions")
    )
    nuisances = [
        Nuisance(**one | {"sd": math.inf if one["sd"] is None else one["sd"]})
        for one in header["nuisances"]
    ]
    hypotheses = [
        Hypothesis(**one | {name: tuple(one[name]) for name in ("shared_angles", "freed")})
        for one in header["hypotheses"]
    ]
    parts = {
        name: Part(
            dict(one["sizes"]), one["area"] and (one["area"][0], one["area"][1]), one["hint"]
        )
        for name, one in header["parts"].items()
    }
    problem = Problem(models, actions, tuple(row["hidden"]), row["axes"])
    return JointProblem(problem, _no_simulator, tuple(nuisances), tuple(hypotheses), parts)


def _no_simulator(*_: Any, **__: Any) -> NDArray[Any]:
    raise TargetError("a posterior that was read from a file cannot simulate")


def _branch(
    row: Mapping[str, Any], joint: JointProblem, trials: int, flat: dict[str, Floats]
) -> HypothesisPosterior:
    """Return a hypothesis's posterior, and take its numbers from the front of the arrays."""
    known = {h.name: h for h in (AS_COMMANDED, *joint.hypotheses)}
    hypothesis, names = known[row["hypothesis"]], tuple(row["parameters"])
    whole("a branch's number of modes", row["modes"], 1)
    real("a branch's probability", row["probability"], 0.0, 1.0)
    own = {n.group for n in joint.nuisances if f"{n.name}@1" in names}
    inferred = own | {n.group for n in joint.nuisances if n.name in names}
    parameters = Parameters.of(joint, trials, inferred, hypothesis, own)
    if parameters.names != names:
        raise ConfigurationError(f"its parameters must be {brief(parameters.names)}")
    modes = []
    for _ in range(row["modes"]):
        theta, gradient = (_take(flat, name, len(names)) for name in ("theta", "gradient"))
        information = _take(flat, "information", len(names) ** 2)
        cost = float(_take(flat, "cost", 1)[0])
        modes.append(Mode(theta, information.reshape(2 * (len(names),)), cost, gradient))
    posterior = Posterior(names, parameters.low, parameters.high, parameters.circular, tuple(modes))
    return HypothesisPosterior(hypothesis, float(row["probability"]), parameters, posterior)


def _take(flat: dict[str, Floats], name: str, count: int) -> Floats:
    front, flat[name] = flat[name][:count], flat[name][count:]
    if len(front) < count:
        raise ConfigurationError(f"its {name} must hold as many numbers as its header says")
    return front
