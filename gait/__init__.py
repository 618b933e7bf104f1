"""Gaits: controllers evolved for a body, and how they swim on another.

``controllers`` is what steers a robot, ``swims`` how far it swims, ``search`` how one is evolved,
``learning`` PPO for comparison. ``gait.sb3_env`` is a name that users import.
"""

from importlib.util import find_spec

import lazy_loader

for _name in ("cma", "matplotlib", "neat", "scipy"):
    if find_spec(_name) is None:
        from aquafish_gym.utils.validation import MissingExtraError, install_advice

        raise MissingExtraError(f"gait needs {_name}: {install_advice('gait')}")

# Imported when first used, so that a command handles Ctrl-C from the start; __init__.pyi has the
# same names for type checkers.
__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "controllers.agents": ["Agent", "ControllerAgent"],
        "controllers.controller": ["Controller"],
        "search.evolve": ["EvolveConfig", "Evolved", "damaged_at_random", "evolve_gait"],
        "swims.evaluation": ["Evaluation", "evaluate"],
        "swims.poses": ["random_poses"],
        "swims.scores": ["distances", "scores"],
        "swims.swim": ["Swim", "swim"],
    },
)
