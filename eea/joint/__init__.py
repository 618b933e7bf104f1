"""Joint inference: body, nuisances and hidden angles of all trials in one least-squares fit.

It knows no robot and needs numpy and scipy only. Names load their modules when first used, since
``scipy.stats`` takes a second to import.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from eea.joint.inference import fit
    from eea.joint.joint_posterior import JointPosterior
    from eea.joint.problem import Hypothesis, JointProblem, Nuisance, Part
    from eea.joint.session import JointInference

_MODULES = {
    "Hypothesis": "problem",
    "JointInference": "session",
    "JointPosterior": "joint_posterior",
    "JointProblem": "problem",
    "Nuisance": "problem",
    "Part": "problem",
    "fit": "inference",
}
__all__ = [
    "Hypothesis",
    "JointInference",
    "JointPosterior",
    "JointProblem",
    "Nuisance",
    "Part",
    "fit",
]


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return getattr(import_module(f"eea.joint.{_MODULES[name]}"), name)
    raise AttributeError(f"module 'eea.joint' has no attribute {name!r}")
