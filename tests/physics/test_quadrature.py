"""The fins' quadrature against 64 x 64 Gauss points on each of the three plates.

``python tests/physics/test_quadrature.py`` prints the study's table.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from aquafish_gym.physics.hydrodynamics import NORMAL_DRAG, SKIN_FRICTION
from harness import drag

Array = NDArray[np.float64]
NODES, WEIGHTS = np.polynomial.legendre.leggauss(64)


def reference(size: Array, velocity: Array, spin: Array) -> Array:
    """Integrate the law over three whole plates through the fin's middle: (6,) wrench."""
    middle = np.array([0.0, -size[1] / 2, 0.0])
    total = np.zeros(6)
    for normal in range(3):
        first, second = (i for i in range(3) if i != normal)
        points = np.zeros((64, 64, 3)) + middle
        points[..., first] += (NODES * size[first] / 2)[:, None]
        points[..., second] += (NODES * size[second] / 2)[None, :]
        areas = np.outer(WEIGHTS, WEIGHTS) / 4 * size[first] * size[second]
        v = velocity + np.cross(spin, points)
        along = np.zeros(3)
        along[normal] = NORMAL_DRAG - 2 * SKIN_FRICTION
        law = v * (2 * SKIN_FRICTION + along)
        force = -0.5 * (areas * np.linalg.norm(v, axis=-1))[..., None] * law
        total[:3] += force.sum(axis=(0, 1))
        total[3:] += np.cross(points, force).sum(axis=(0, 1))
    return total


def study(sizes: Array, seed: int) -> tuple[float, float]:
    """Return the rms error of force and of torque, each relative to its rms."""
    rng = np.random.default_rng(seed)
    count = len(sizes)
    motion = np.concatenate([0.5 * rng.normal(size=(3, count)), 1.5 * rng.normal(size=(3, count))])
    motion[3] += rng.uniform(-np.pi, np.pi, count)
    rule = drag("floats", sizes.T, motion)
    truth = np.stack(
        [reference(s, m[:3], m[3:]) for s, m in zip(sizes, motion.T, strict=True)], axis=1
    )
    rms = np.sqrt(((rule - truth) ** 2).reshape(2, -1).mean(axis=1))
    return tuple(rms / np.sqrt((truth**2).reshape(2, -1).mean(axis=1)))  # type: ignore[return-value]


FINS = {
    "any pectoral": lambda rng: rng.uniform(0, [1, 2, 0.5], (200, 3)),
    "any caudal": lambda rng: rng.uniform(0, [1, 2, 0.5], (200, 3)),
    "nominal pectoral": lambda _: np.tile([0.4, 1.6, 0.1], (200, 1)),
    "nominal caudal": lambda _: np.tile([0.6, 1.4, 0.4], (200, 1)),
}


@pytest.mark.parametrize("fin", FINS)
def test_force_and_torque_are_within_one_percent(fin: str) -> None:
    force, torque = study(FINS[fin](np.random.default_rng(0)), seed=1)
    assert force < 0.01
    assert torque < 0.01


if __name__ == "__main__":
    for name, sizes in FINS.items():
        print(
            "{:18s} force {:.2%} torque {:.2%}".format(
                name, *study(sizes(np.random.default_rng(0)), 1)
            )
        )
