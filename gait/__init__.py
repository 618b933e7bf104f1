"""Gaits: controllers evolved for a body, and how they do on another.

``gait.transfer.transfer`` compares two bodies, ``gait.baselines`` trains stable-baselines3
for comparison, and ``gait.plots`` draws.
"""

from gait.controller import Controller, Policy
from gait.evolve import EvolveConfig, Evolved, evolve_gait
from gait.rollout import Swim, random_poses, swim, swim_all

__all__ = [
    "Controller",
    "EvolveConfig",
    "Evolved",
    "Policy",
    "Swim",
    "evolve_gait",
    "random_poses",
    "swim",
    "swim_all",
]
