"""Joint inference: all unknowns of all trials fitted together, with honest intervals.

It knows no robot, and needs numpy and scipy only. The names below are loaded with their rooms when
they are first used, since scipy's statistics take a second.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from eea.joint.belief import JointBelief
    from eea.joint.calibration import Coverage, coverage, rank_uniformity, ranks
    from eea.joint.findings import Group
    from eea.joint.goodness import Goodness, effective_count, goodness_of_fit
    from eea.joint.inference import JointInference
    from eea.joint.posterior import Mode, Posterior, intervals
    from eea.joint.problem import Hypothesis, JointProblem, Nuisance, Part

_ROOMS = {
    "JointBelief": "belief",
    "Coverage": "calibration",
    "coverage": "calibration",
    "rank_uniformity": "calibration",
    "ranks": "calibration",
    "Group": "findings",
    "Goodness": "goodness",
    "effective_count": "goodness",
    "goodness_of_fit": "goodness",
    "JointInference": "inference",
    "Mode": "posterior",
    "Posterior": "posterior",
    "intervals": "posterior",
    "Hypothesis": "problem",
    "JointProblem": "problem",
    "Nuisance": "problem",
    "Part": "problem",
}
__all__ = [
    "Coverage",
    "Goodness",
    "Group",
    "Hypothesis",
    "JointBelief",
    "JointInference",
    "JointProblem",
    "Mode",
    "Nuisance",
    "Part",
    "Posterior",
    "coverage",
    "effective_count",
    "goodness_of_fit",
    "intervals",
    "rank_uniformity",
    "ranks",
]


def __getattr__(name: str) -> Any:
    if name in _ROOMS:
        return getattr(import_module(f"eea.joint.{_ROOMS[name]}"), name)
    raise AttributeError(f"module 'eea.joint' has no attribute {name!r}")
