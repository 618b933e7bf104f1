"""Gaits: controllers evolved for a body, and how they swim on another.

``controllers`` is what steers a robot, ``scores`` how far it swims, ``search`` how one is evolved,
``learning`` PPO for comparison. ``gait.agent``, ``gait.controller``, ``gait.evaluation``,
``gait.network`` and ``gait.sb3_env`` are names that users import.
"""

import lazy_loader

# Imported when first used, so that a command handles Ctrl-C from the start; __init__.pyi has the
# same names for type checkers.
__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "controllers.controller": ["Controller"],
        "controllers.policy": ["ControllerLike", "HasPolicy", "Policy"],
        "scores.evaluation": ["Evaluation", "evaluate"],
        "scores.fitness": ["distances"],
        "scores.rollout": ["Swim", "random_poses", "swim", "swim_all"],
        "search.evolve": ["EvolveConfig", "Evolved", "damaged_at_random", "evolve_gait"],
    },
)
