"""Gaits: controllers evolved for a body, and how they swim on another.

``controllers`` is what steers a robot, ``scores`` how far it swims, ``search`` how one is evolved,
``learning`` PPO for comparison. ``gait.agent``, ``gait.evaluation`` and ``gait.sb3_env`` are names
that users import.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gait.controllers.controller import Controller
    from gait.controllers.policy import ControllerLike, HasPolicy, Policy
    from gait.scores.evaluation import Evaluation, evaluate
    from gait.scores.fitness import distances
    from gait.scores.rollout import Swim, random_poses, swim, swim_all
    from gait.search.evolve import EvolveConfig, Evolved, damaged_at_random, evolve_gait

__all__ = [
    "Controller",
    "ControllerLike",
    "Evaluation",
    "EvolveConfig",
    "Evolved",
    "HasPolicy",
    "Policy",
    "Swim",
    "damaged_at_random",
    "distances",
    "evaluate",
    "evolve_gait",
    "random_poses",
    "swim",
    "swim_all",
]


def __getattr__(name: str) -> Any:
    """Import a name when it is first used, so that a command handles Ctrl-C from the start."""
    rooms = (
        "controllers.controller", "controllers.policy", "scores.rollout", "scores.fitness",
        "scores.evaluation", "search.evolve",
    )  # fmt: skip
    for room in rooms if name in __all__ else ():
        module = import_module(f"gait.{room}")
        if hasattr(module, name):
            return getattr(module, name)
    raise AttributeError(f"module 'gait' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
