"""The Estimation-Exploration Algorithm for robots that do not know where their fins are.

The algorithm, ``eea.core``, knows no robot: it asks a ``Target`` and a ``Simulator``, and needs
numpy only. ``eea.joint``, which needs scipy too, is the method beyond the paper: it infers body,
angles and nuisances together. ``eea.fish`` binds both to the fish of ``aquafish_gym``,
``eea.study`` repeats them in numbers. All but the core are loaded when first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from eea import core, fish
from eea.core import *  # noqa: F403

if TYPE_CHECKING:
    from eea.fish import *  # noqa: F403
    from eea.joint.problem import Hypothesis, JointProblem, Nuisance
    from eea.joint.session import JointInference
    from eea.study.presets import FIGURES, figure_config

_MODULES = {
    "FIGURES": "study.presets",
    "Hypothesis": "joint.problem",
    "JointInference": "joint.session",
    "JointProblem": "joint.problem",
    "Nuisance": "joint.problem",
    "figure_config": "study.presets",
}
__all__ = ["FIGURES", "Hypothesis", "JointInference", "JointProblem", "Nuisance", "figure_config"]
__all__ += core.__all__
__all__ += fish.__all__


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return getattr(import_module(f"eea.{_MODULES[name]}"), name)
    if name in fish.__all__:
        return getattr(fish, name)
    raise AttributeError(f"module 'eea' has no attribute {name!r}")
