"""The bridge between the algorithms and the fish of ``aquafish_gym``.

The names below are loaded with their rooms when they are first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from eea.fish.estimate import (
        MorphologyEstimate,
        estimate_morphology,
        estimate_morphology_of,
        fish_eea,
    )
    from eea.fish.fins import fins_after
    from eea.fish.gap import RealityGap
    from eea.fish.log_checks import LogCheck, check_log
    from eea.fish.log_inference import infer_log, watch_swim
    from eea.fish.posterior_file import load_posterior, save_posterior
    from eea.fish.prior import known_body
    from eea.fish.simulator import EngineSimulator, fish_problem
    from eea.fish.swim_log import SwimLog, read_log, write_log
    from eea.fish.target import EngineTarget
    from eea.fish.windows import Start

__all__ = [
    "EngineSimulator",
    "EngineTarget",
    "LogCheck",
    "MorphologyEstimate",
    "RealityGap",
    "Start",
    "SwimLog",
    "check_log",
    "estimate_morphology",
    "estimate_morphology_of",
    "fins_after",
    "fish_eea",
    "fish_problem",
    "infer_log",
    "known_body",
    "load_posterior",
    "read_log",
    "save_posterior",
    "watch_swim",
    "write_log",
]
_ROOMS = {
    "EngineSimulator": "simulator",
    "EngineTarget": "target",
    "LogCheck": "log_checks",
    "RealityGap": "gap",
    "Start": "windows",
    "SwimLog": "swim_log",
    "check_log": "log_checks",
    "fins_after": "fins",
    "fish_problem": "simulator",
    "infer_log": "log_inference",
    "known_body": "prior",
    "load_posterior": "posterior_file",
    "read_log": "swim_log",
    "save_posterior": "posterior_file",
    "watch_swim": "log_inference",
    "write_log": "swim_log",
}


def __getattr__(name: str) -> Any:
    if name in __all__:
        room = _ROOMS.get(name, "estimate")
        return getattr(import_module(f"eea.fish.{room}"), name)
    raise AttributeError(f"module 'eea.fish' has no attribute {name!r}")
