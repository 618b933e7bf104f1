"""MuJoCo as an engine: the same robot in water that nobody here wrote; see ``docs/physics.md``."""
