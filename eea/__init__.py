"""The Estimation-Exploration Algorithm for robots that do not know where their fins are.

The algorithm, ``eea.core``, knows no robot: it asks a ``Target`` and a ``Simulator``, and needs
numpy only. ``eea.aquafish`` binds it to the fish of ``aquafish_gym``, ``eea.study`` repeats it in
numbers; both are loaded when first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from eea.core import (
    CONDITIONS,
    EEA,
    ConfigurationError,
    EEAConfig,
    Performed,
    Problem,
    RecordedLog,
    ReplayTarget,
    Result,
    RevealingTarget,
    RoundRecord,
    Simulator,
    Target,
    TargetError,
    Trials,
    recovery_config,
)

if TYPE_CHECKING:
    from eea.aquafish import (
        EngineSimulator,
        EngineTarget,
        MorphologyEstimate,
        estimate_from_logs,
        estimate_morphology,
        estimate_morphology_of,
        load_session,
        save_session,
    )
    from eea.study.presets import FIGURES, figure_config

__all__ = [
    "CONDITIONS",
    "EEA",
    "FIGURES",
    "ConfigurationError",
    "EEAConfig",
    "EngineSimulator",
    "EngineTarget",
    "MorphologyEstimate",
    "Performed",
    "Problem",
    "RecordedLog",
    "ReplayTarget",
    "Result",
    "RevealingTarget",
    "RoundRecord",
    "Simulator",
    "Target",
    "TargetError",
    "Trials",
    "estimate_from_logs",
    "estimate_morphology",
    "estimate_morphology_of",
    "figure_config",
    "load_session",
    "recovery_config",
    "save_session",
]


def __getattr__(name: str) -> Any:
    if name in ("FIGURES", "figure_config"):
        return getattr(import_module("eea.study.presets"), name)
    if name in __all__:
        return getattr(import_module("eea.aquafish"), name)
    raise AttributeError(f"module 'eea' has no attribute {name!r}")
