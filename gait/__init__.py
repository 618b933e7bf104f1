"""Gaits: controllers evolved for a body, and how they swim on another.

``gait.transfer`` compares two bodies, ``gait.learning`` trains PPO for comparison, ``gait.plots``
draws.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gait.controller import Controller
    from gait.evaluation import Evaluation, evaluate
    from gait.evolve import EvolveConfig, Evolved, damaged_at_random, evolve_gait
    from gait.fitness import distances
    from gait.policy import ControllerLike, HasPolicy, Policy
    from gait.rollout import Swim, random_poses, swim, swim_all

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
    rooms = ("controller", "evaluation", "evolve", "fitness", "policy", "rollout")
    for room in rooms if name in __all__ else ():
        module = import_module(f"gait.{room}")
        if hasattr(module, name):
            return getattr(module, name)
    raise AttributeError(f"module 'gait' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
