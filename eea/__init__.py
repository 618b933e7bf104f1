"""The Estimation-Exploration Algorithm for robots that do not know where their fins are.

The algorithm knows no robot: it asks a ``Target`` and a ``Simulator``, and needs numpy only.
``eea.aquafish.fish`` binds it to the fish of ``aquafish_gym`` and is loaded when first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from eea.core.algorithm import EEA, Result, RoundRecord
from eea.core.checks import ConfigurationError, TargetError
from eea.core.config import CONDITIONS, EEAConfig, recovery_config
from eea.core.experiment import RevealingTarget, Simulator, Target, Trials
from eea.study.presets import FIGURES, figure_config

if TYPE_CHECKING:
    from eea.aquafish.fish import (
        EngineSimulator,
        EngineTarget,
        MorphologyEstimate,
        estimate_morphology,
        estimate_morphology_of,
    )

__all__ = [
    "CONDITIONS",
    "EEA",
    "FIGURES",
    "ConfigurationError",
    "EEAConfig",
    "EngineSimulator",
    "EngineTarget",
    "MorphologyEstimate",
    "Result",
    "RevealingTarget",
    "RoundRecord",
    "Simulator",
    "Target",
    "TargetError",
    "Trials",
    "estimate_morphology",
    "estimate_morphology_of",
    "figure_config",
    "recovery_config",
]


def __getattr__(name: str) -> Any:
    if name in __all__:
        return getattr(import_module("eea.aquafish.fish"), name)
    raise AttributeError(f"module 'eea' has no attribute {name!r}")
