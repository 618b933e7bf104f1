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

from eea.core.checks import (
    ConfigurationError,
    TargetError,
    all_of,
    brief,
    choice,
    finite,
    flag,
    real,
    whole,
)
from eea.core.config import MAXIMUM_ROUNDS, MAXIMUM_TRIAL_STEPS
from eea.infer.answer import Answer
from eea.infer.branch import Branch
from eea.infer.goodness import Goodness
from eea.infer.known import Known
from eea.infer.mixture import Mode
from eea.infer.robot import Robot
from eea.infer.statement import Hypothesis, Number, Part, Prior
from eea.infer.trials import LARGEST_NUMBER, Noise
from eea.infer.unknowns import Unknowns

ROUNDING_TOLERANCE = 1e-6  # in shares of a range, rad, or probability
MOST_INFORMATION = 1e30  # 1/range^2 or 1/rad^2; a size that a hypothesis fixes has 1e12
MOST_COST = 1e15
OMITTED_PROBABILITY = 0.01  # of all hypotheses together that are less probable than 1e-4


def check_posterior(belief: Answer) -> None:
    """Raise a ConfigurationError if no fit can return a posterior.

    Optima lie in the ranges, informations are symmetric without negative eigenvalues,
    probabilities sum to 1, and all numbers are finite and of a plausible size.
    """
    # In the unit of the robot's own sensors, so only what no signal can have is refused.
    real("its sigma", belief.sigma, 1.0 / LARGEST_NUMBER, LARGEST_NUMBER)
    shares = [branch.probability for branch in belief.branches]
    for share in shares:
        real("its probability", share, 0.0, 1.0)
    real("its probabilities' sum", sum(shares), 1.0 - OMITTED_PROBABILITY, 1.0 + ROUNDING_TOLERANCE)
    _check_goodness(belief.goodness)
    for branch in belief.branches:
        for part in (branch.posterior, branch.doubted):
            for mode in part.modes:
                check_mode(mode, branch.parameters)
            with np.errstate(all="ignore"):
                weights = part.weights
            if not (np.isfinite(weights).all() and abs(weights.sum() - 1.0) < ROUNDING_TOLERANCE):
                raise ConfigurationError("its modes must have probabilities that sum to 1")


def check_mode(mode: Mode, parameters: Unknowns) -> None:
    """Raise a ConfigurationError if a mode is out of range or no normal distribution."""
    size = len(parameters)
    low = np.where(parameters.circular, -np.pi, parameters.low)
    high = np.where(parameters.circular, np.pi, parameters.high)
    for name, array, shape in (
        ("theta", mode.theta, (size,)),
        ("gradient", mode.gradient, (size,)),
        ("information", mode.information, (size, size)),
    ):
        if np.shape(array) != shape or not np.isfinite(array).all():
            raise ConfigurationError(f"its {name} must be finite, of shape {shape}")
    real("its cost", mode.cost, -MOST_COST, MOST_COST)
    outside = (mode.theta < low - ROUNDING_TOLERANCE) | (mode.theta > high + ROUNDING_TOLERANCE)
    if outside.any():
        i = int(outside.argmax())
        raise ConfigurationError(
            f"its theta of {parameters.names[i]} must lie in [{low[i]:.4g}, {high[i]:.4g}]; "
            f"it is {mode.theta[i]:.4g}"
        )
    diagonal = np.diag(mode.information)
    if diagonal.min() < -ROUNDING_TOLERANCE or diagonal.max() > MOST_INFORMATION:
        raise ConfigurationError(
            f"its information must be at least 0 and at most {MOST_INFORMATION:g} on the diagonal; "
            f"it is from {diagonal.min():.4g} to {diagonal.max():.4g}"
        )
    scale = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    unit = mode.information / np.outer(scale, scale)
    if np.abs(unit - unit.T).max() > ROUNDING_TOLERANCE:
        raise ConfigurationError("its information must be symmetric")
    if np.linalg.eigvalsh(unit).min() < -ROUNDING_TOLERANCE * size:
        raise ConfigurationError("its information must have no negative eigenvalue")


def _check_goodness(goodness: Goodness) -> None:
    """Raise a ConfigurationError if numbers of a goodness of fit are not probabilities."""
    flag("its good", goodness.good)
    real("its rms", goodness.rms, 0.0)
    for name in ("size_p", "whiteness_p", "peak_p", "p", "slow_p"):
        value = getattr(goodness, name)
        if value is not None or name not in ("size_p", "slow_p"):
            real(f"its {name}", value, 0.0, 1.0)
    if goodness.unexplained is not None:
        real("its unexplained share", goodness.unexplained, 0.0)
    if not isinstance(goodness.verdict, str):
        raise ConfigurationError("its verdict must be a sentence")


POSTERIOR_SCHEMA = "eea.posterior/6"
ARRAYS = ("header", "theta", "information", "cost", "gradient")
MOST_SLOTS = 10**7  # numbers in the slots of all trials


def to_arrays(posterior: Answer) -> dict[str, NDArray[Any]]:
    """Return all of a posterior except its simulator and warm start, for :func:`from_arrays`."""
    parameters = posterior.branches[0].parameters
    robot = posterior.robot
    parts = [part for branch in posterior.branches for part in (branch.posterior, branch.doubted)]
    modes = [mode for part in parts for mode in part.modes]
    header: dict[str, Any] = {
        "schema": POSTERIOR_SCHEMA,
        "numbers": {name: asdict(number) for name, number in robot.table.items()},
        "channels": robot.channels,
        "hypotheses": [asdict(hypothesis) for hypothesis in robot.alternatives],
        "nominal": asdict(robot.nominal),
        "parts": {name: asdict(part) for name, part in robot.parts.items()},
        "prior": robot.prior and _listed(vars(robot.prior)),
        "noise": posterior.noise and _listed(posterior.noise._asdict()),
        "sigma": posterior.sigma,
        "samples": posterior.samples,
        "goodness": asdict(posterior.goodness),
        "trials": len(parameters.slots),
        "branches": [
            {
                "hypothesis": branch.hypothesis.name,
                "probability": branch.probability,
                "parameters": branch.parameters.names,
                "groups": sorted(branch.parameters.groups),
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
    if robot.plan is not None:
        header["plan"] = robot.plan
    if posterior.caveats:
        header["caveats"] = posterior.caveats
    if (learned := posterior.learned) is not None:
        header["learned"] = {
            "misfits": np.asarray(learned.misfits).tolist(),
            "findings": learned.findings,
            "spread": _listed(vars(learned.spread)),
        }
    return {
        "header": np.frombuffer(json.dumps(header).encode(), np.uint8),
        "theta": theta.ravel(),
        "information": information.ravel(),
        "cost": np.array([mode.cost for mode in modes]),
        "gradient": gradient.ravel(),
    }


def from_arrays(arrays: Mapping[str, NDArray[Any]]) -> Answer:
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


def _read(header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Answer:
    robot = Robot(
        _no_simulator,
        {name: Number(**number) for name, number in header["numbers"].items()},
        header["channels"],
        tuple(map(_hypothesis, header["hypotheses"])),
        parts={name: Part(**part) for name, part in header["parts"].items()},
        nominal=_hypothesis(header["nominal"]),
        prior=header["prior"] and Prior(**header["prior"]),
        plan=header.get("plan"),
    )
    noise = header["noise"]
    if noise is not None:
        channels = (len(robot.channels),)
        noise = Noise(**{name: finite(f"its {name}", noise[name], channels) for name in noise})
        if not ((noise.sd > 0.0) & (np.abs(noise.correlation) < 1.0)).all():
            raise ConfigurationError(f"its noise must be that of a fit; got {brief(noise)}")
    trials = header["trials"]
    whole("its number of trials", trials, 1, MAXIMUM_ROUNDS)
    slots = len(robot.names)
    whole("its numbers in all trials", trials * slots, 1, MOST_SLOTS)
    whole("its samples", header["samples"], 0, trials * MAXIMUM_TRIAL_STEPS * len(robot.channels))
    for name in ARRAYS[1:]:
        finite(f"its {name}", arrays[name], (None,))
    for row in header["branches"]:
        for count in row["modes"]:
            whole("its number of modes", count, 1, arrays["cost"].size)
    cost = arrays["cost"].tolist()
    theta, gradient = (arrays[name].reshape(len(cost), -1) for name in ("theta", "gradient"))
    information = arrays["information"].reshape(*theta.shape, -1)
    hypotheses = {h.name: h for h in (robot.nominal, *robot.alternatives)}
    branches = []
    first = 0
    for row in header["branches"]:
        hypothesis = hypotheses[row["hypothesis"]]
        names = row["parameters"]
        groups = all_of("its groups", row["groups"], str)
        parameters = Unknowns.of(robot, trials, groups, hypothesis)
        if list(parameters.names) != names:
            raise ConfigurationError(f"its parameters must be {brief(parameters.names)}")
        own = slice(len(names))
        parts = []
        for count in row["modes"]:
            modes = [
                Mode(theta[i, own], information[i, own, own], gradient[i, own], float(cost[i]))
                for i in range(first, first + count)
            ]
            first += count
            for mode in modes:
                check_mode(mode, parameters)
            parts.append(parameters.posterior(modes))
        inside, doubted = parts
        branches.append(Branch(hypothesis, row["probability"], parameters, inside, doubted))
    goodness = Goodness(**header["goodness"])
    caveats = all_of("its caveats", header.get("caveats", ()), str)
    belief = Answer(
        tuple(branches),
        goodness,
        header["sigma"],
        header["samples"],
        noise=noise,
        caveats=caveats,
        learned=_learned(header.get("learned"), robot),
    )
    check_posterior(belief)
    if first != len(cost):
        raise ConfigurationError(f"its modes must be {first}; there are {len(cost)}")
    return belief


def _learned(stated: Mapping[str, Any] | None, robot: Robot) -> Known | None:
    """Return what was learned from known-good logs, if anything."""
    if stated is None:
        return None
    misfits = finite("its misfits", stated["misfits"], (None,))
    if len(misfits) < 2 or misfits.min() <= 0.0:
        raise ConfigurationError("its misfits must be positive, of two known-good logs or more")
    spread = Prior(**stated["spread"])
    for name in spread.names:
        choice("its spread", name, robot.table)
    findings = all_of("its findings", stated["findings"], str)
    return Known(robot, None, misfits=misfits, findings=tuple(findings), spread=spread)


def _listed(arrays: Mapping[str, Any]) -> dict[str, Any]:
    return {name: np.asarray(array).tolist() for name, array in arrays.items()}


def _hypothesis(stated: Mapping[str, Any]) -> Hypothesis:
    moves = {name: Number(**change) for name, change in stated["moves"].items()}
    return Hypothesis(**{**stated, "moves": moves})


def _no_simulator(*_: Any, **__: Any) -> NDArray[Any]:
    raise TargetError("a posterior that was read from a file cannot simulate")
