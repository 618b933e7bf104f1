"""PyBullet and the compiled engine are one robot."""

from __future__ import annotations

import numpy as np
import pytest

import aquafish_gym
from aquafish_gym.morphology import MAXIMA

pytest.importorskip("pybullet")


def trials(count: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return (
        rng.uniform(0, 1, (count, 9)) * MAXIMA,
        rng.uniform([-0.5, -0.5, 0], [0.5, 0.5, 1], (count, 3)),
        rng.uniform(-np.pi, np.pi, (count, 3)),
    )


@pytest.mark.parametrize(
    ("substeps", "current"), [(1, (0.0, 0.0, 0.0)), (1, (0.3, -0.2, 0.1)), (4, (0.0, 0.0, 0.0))]
)
def test_lanes_equal_pybullet(substeps: int, current: tuple[float, float, float]) -> None:
    """Over 20 random bodies, commands and angles and 5.12 s; two of the bodies are extremes."""
    bodies, commands, angles = trials(20, seed=0)
    bodies[0], bodies[1] = 0.0, MAXIMA
    ours, bullets = (
        aquafish_gym.simulate(
            bodies, commands, angles, steps=512, engine=engine, dtype="float64",
            substeps=substeps, current=current, record="pose",
        )
        for engine in ("numba", "pybullet")
    )  # fmt: skip
    for name in ("rpy", "gyro", "position", "quaternion"):
        difference = abs(getattr(ours, name) - getattr(bullets, name))
        assert difference.max() < 1e-9, name
    turns = np.exp(1j * ours.fin_angles) - np.exp(1j * bullets.fin_angles)
    assert abs(turns).max() < 1e-9
