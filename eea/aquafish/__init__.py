"""The one bridge between the algorithm and the fish of ``aquafish_gym``.

The names below are loaded with their rooms when they are first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from eea.aquafish.estimate import (
        MorphologyEstimate,
        estimate_from_logs,
        estimate_morphology,
        estimate_morphology_of,
        fish_actions,
        fish_eea,
        fish_models,
        fish_problem,
    )
    from eea.aquafish.gap import RealityGap
    from eea.aquafish.posterior_file import load_posterior, save_posterior
    from eea.aquafish.session import load_session, save_session
    from eea.aquafish.simulator import EngineSimulator
    from eea.aquafish.swims import Trace, estimate_from_swims
    from eea.aquafish.target import EngineTarget, Orientation
    from eea.aquafish.watch import watch_swim

__all__ = [
    "EngineSimulator",
    "EngineTarget",
    "MorphologyEstimate",
    "Orientation",
    "RealityGap",
    "Trace",
    "estimate_from_logs",
    "estimate_from_swims",
    "estimate_morphology",
    "estimate_morphology_of",
    "fish_actions",
    "fish_eea",
    "fish_models",
    "fish_problem",
    "load_posterior",
    "load_session",
    "save_posterior",
    "save_session",
    "watch_swim",
]
_ROOMS = {
    "Trace": "swims",
    "estimate_from_swims": "swims",
    "load_posterior": "posterior_file",
    "load_session": "session",
    "save_posterior": "posterior_file",
    "save_session": "session",
    "watch_swim": "watch",
}


def __getattr__(name: str) -> Any:
    if name in __all__:
        room = _ROOMS.get(name, "estimate")
        return getattr(import_module(f"eea.aquafish.{room}"), name)
    raise AttributeError(f"module 'eea.aquafish' has no attribute {name!r}")
