"""Gaits: controllers evolved for a body, and how they swim on another.

``controllers`` is what steers a robot, ``scores`` how far it swims, ``search`` how one is evolved,
``learning`` PPO for comparison. ``gait.agent``, ``gait.evaluation`` and ``gait.sb3_env`` are names
that users import.
"""

import lazy_loader

# The names of __init__.pyi, imported when first used, so that a command handles Ctrl-C early.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
