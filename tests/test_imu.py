"""Attitude angles: the convention, and the one place where their jumps are mended."""

from __future__ import annotations

import math
from itertools import accumulate

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from aquafish_gym.physics.attitude import attitude, continue_attitude


def rotation_matrix(roll: float, pitch: float, yaw: float) -> NDArray[np.float64]:
    """Yaw about z, then pitch about x, then roll about y."""
    cr, sr, cp, sp, cy, sy = (f(a) for a in (roll, pitch, yaw) for f in (math.cos, math.sin))
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    about_x = np.array([[1, 0, 0], [0, cp, -sp], [0, sp, cp]])
    about_y = np.array([[cr, 0, sr], [0, 1, 0], [-sr, 0, cr]])
    return about_z @ about_x @ about_y


def as_rows(matrix: NDArray[np.float64]) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(float(x) for x in row) for row in matrix)


angle = st.floats(-math.pi + 1e-6, math.pi - 1e-6)


@given(angle, st.floats(-1.5, 1.5), angle)
def test_attitude_inverts_the_convention(roll: float, pitch: float, yaw: float) -> None:
    found = attitude(as_rows(rotation_matrix(roll, pitch, yaw)))  # type: ignore[arg-type]
    assert_allclose(found, (roll, pitch, yaw), atol=1e-12)


@given(angle, angle, angle, st.tuples(angle, angle, angle))
def test_continuing_keeps_the_attitude_and_is_nearest(
    roll: float, pitch: float, yaw: float, before: tuple[float, float, float]
) -> None:
    now = continue_attitude(before, (roll, pitch, yaw))
    assert_allclose(rotation_matrix(*now), rotation_matrix(roll, pitch, yaw), atol=1e-9)
    reach = np.abs(np.subtract(now, before)).sum()
    for turns in np.ndindex(3, 3, 3):
        whole = 2 * math.pi * (np.array(turns) - 1)
        for same in ((roll, pitch, yaw), (roll + math.pi, math.pi - pitch, yaw + math.pi)):
            assert reach <= np.abs(np.array(same) + whole - before).sum() + 1e-9


def test_a_robot_that_loops_the_loop_pitches_on_without_a_jump() -> None:
    pitch = np.linspace(0, 4 * math.pi, 400)
    felt = [attitude(as_rows(rotation_matrix(0.0, p, 0.0))) for p in pitch]  # type: ignore[arg-type]
    assert abs(np.diff(felt, axis=0)).max() > 3, "the raw angles jump"
    continuous = list(accumulate(felt, continue_attitude))
    assert_allclose(continuous, np.stack([0 * pitch, pitch, 0 * pitch], axis=1), atol=1e-9)
