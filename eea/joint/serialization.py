"""A belief as a few arrays of numbers, and back: for a file that needs no pickle.

What is no array (names, ranges, hypotheses, the verdict) is JSON in the array ``header``. The
modes of all branches stand one after another, each branch's as long as its parameters are many.
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
from eea.core.checks import ConfigurationError, TargetError, brief, whole
from eea.core.config import MAXIMUM_ROUNDS
from eea.core.genome import BitLayout, Variable
from eea.core.problem import Problem
from eea.joint.goodness_of_fit import Goodness
from eea.joint.joint_posterior import HypothesisPosterior, JointPosterior
from eea.joint.parameters import Parameters
from eea.joint.posterior import Mode, Posterior
from eea.joint.problem import AS_COMMANDED, Hypothesis, JointProblem, Nuisance, Part

SCHEMA = "eea.belief/1"
#: Every array of an archive, and how many dimensions each has.
ARRAYS = {"header": 1, "theta": 1, "information": 1, "gradient": 1, "cost": 1}
MOST_HEADER, MOST_SLOTS = 2**22, 10**7  # bytes; numbers that all trials are simulated with


def to_arrays(belief: JointPosterior) -> dict[str, NDArray[Any]]:
    """Return all of a belief but the simulator, which ``from_arrays`` reads back exactly.

    Returns
    -------
    dict
        ``header``, UTF-8 of JSON as bytes, and float64 ``theta`` and ``gradient`` (P, ...),
        ``information`` (P * P, ...) and ``cost`` (1, ...) of every mode, in their order, flat.
    """
    joint = belief.branches[0].parameters.joint
    modes = [mode for branch in belief.branches for mode in branch.posterior.modes]
    header = {
        "schema": SCHEMA,
        "problem": _problem_to_dict(joint.problem),
        "nuisances": [
            asdict(n) | {"sd": None if math.isinf(n.sd) else n.sd} for n in joint.nuisances
        ],
        "hypotheses": [asdict(hypothesis) for hypothesis in joint.hypotheses],
        "parts": {name: asdict(part) for name, part in joint.parts.items()},
        "sigma": belief.sigma,
        "samples": belief.samples,
        "goodness": asdict(belief.goodness),
        "trials": belief.branches[0].parameters.trials,
        "branches": [
            {
                "hypothesis": branch.hypothesis.name,
                "probability": branch.probability,
                "parameters": list(branch.parameters.names),
                "modes": len(branch.posterior.modes),
            }
            for branch in belief.branches
        ],
    }
    text = json.dumps(header, allow_nan=False).encode()
    return {
        "header": np.frombuffer(text, np.uint8),
        "theta": np.concatenate([mode.theta for mode in modes]),
        "information": np.concatenate([mode.information.ravel() for mode in modes]),
        "gradient": np.concatenate([_slope(mode) for mode in modes]),
        "cost": np.array([mode.cost for mode in modes]),
    }


def from_arrays(arrays: Mapping[str, NDArray[Any]]) -> JointPosterior:
    """Return the belief that ``to_arrays`` wrote; it can do all but simulate.

    Raises
    ------
    ConfigurationError
        If an array is missing, or they do not describe a belief.
    """
    try:
        header = json.loads(np.asarray(arrays["header"], np.uint8)[:MOST_HEADER].tobytes())
        if header["schema"] != SCHEMA:
            raise ConfigurationError(
                f"its schema must be {SCHEMA}; it is {brief(header['schema'])}"
            )
        joint = _joint(header)
        whole("its number of trials", header["trials"], 1, MAXIMUM_ROUNDS)
        slots = len(joint.problem.models) + len(joint.nuisances) + len(joint.problem.hidden)
        whole("its numbers in all trials", slots * header["trials"], 1, MOST_SLOTS)
        flat = {
            name: np.array(arrays[name], np.float64)
            for name in ("theta", "information", "gradient", "cost")
        }
        branches = tuple(_branch(row, joint, header["trials"], flat) for row in header["branches"])
        if not branches or any(len(rest) for rest in flat.values()):
            raise ConfigurationError("its arrays must hold as many numbers as its header says")
        shares = np.array([branch.probability for branch in branches], dtype=np.float64)
        if not (shares >= 0.0).all() or not 0.5 < shares.sum() < 1.5:
            raise ConfigurationError(f"its probabilities must sum to 1; got {brief(shares)}")
        whole("its samples", header["samples"], 0)
        goodness = Goodness(**header["goodness"])
        return JointPosterior(branches, goodness, float(header["sigma"]), header["samples"])
    except ConfigurationError as error:
        raise ConfigurationError(f"an archive of a posterior is wrong: {error}") from None
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, RecursionError) as error:
        raise ConfigurationError(
            f"an archive of a posterior lacks something: {brief(error)}"
        ) from None


def _problem_to_dict(problem: Problem) -> dict[str, Any]:
    return {
        "models": [asdict(variable) for variable in problem.models.variables],
        "actions": [asdict(variable) for variable in problem.actions.variables],
        "hidden": list(problem.hidden),
        "axes": problem.axes,
    }


def _joint(header: Mapping[str, Any]) -> JointProblem:
    told = header["problem"]
    models, actions = (
        BitLayout([Variable(**variable) for variable in told[part]])
        for part in ("models", "actions")
    )
    nuisances = [
        Nuisance(**row | {"sd": math.inf if row["sd"] is None else row["sd"]})
        for row in header["nuisances"]
    ]
    hypotheses = [
        Hypothesis(
            row["name"],
            row["fixed"],
            tuple(row["shared_angles"]),
            tuple(row.get("freed", ())),
            row.get("part", ""),
        )
        for row in header["hypotheses"]
    ]
    return JointProblem(
        Problem(models, actions, tuple(told["hidden"]), told["axes"]),
        _no_simulator,
        tuple(nuisances),
        tuple(hypotheses),
        {name: _part(row) for name, row in header["parts"].items()},
    )


def _part(row: Mapping[str, Any]) -> Part:
    area = None if row["area"] is None else (row["area"][0], row["area"][1])
    return Part(dict(row["sizes"]), area, row["hint"])


def _no_simulator(*_: Any, **__: Any) -> NDArray[Any]:
    raise TargetError("a posterior that was read from a file cannot simulate")


def _branch(
    row: Mapping[str, Any], joint: JointProblem, trials: int, flat: dict[str, Floats]
) -> HypothesisPosterior:
    """Return a branch, and take its numbers from the front of the arrays."""
    known = {h.name: h for h in (AS_COMMANDED, *joint.hypotheses)}
    hypothesis, names = known[row["hypothesis"]], tuple(row["parameters"])
    whole("a branch's number of modes", row["modes"], 1)
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


def _slope(mode: Mode) -> Floats:
    assert mode.gradient is not None
    return mode.gradient
