"""PyBullet as an engine: one robot in a world of its own; PyBullet itself is loaded when used."""

from aquafish_gym.engines.bullet.clients import return_client, take_client
from aquafish_gym.engines.bullet.world import AXES, HINGES, BulletWorld, simulate_bullet

__all__ = ["AXES", "HINGES", "BulletWorld", "return_client", "simulate_bullet", "take_client"]
