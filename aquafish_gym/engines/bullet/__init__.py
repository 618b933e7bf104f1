"""PyBullet as an engine: one robot in a world of its own; PyBullet itself is loaded when used."""
