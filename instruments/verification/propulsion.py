"""What the reactive terms make of swimming: a tail's thrust and a swimmer's speed and course.

:func:`held_rows` is of a tail on a body held still, beside Lighthill's theory;
:func:`swimming_rows` is how fast a tail alone swims, with and without the terms;
:func:`course_rows` is how long it stays on course.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from aquafish_gym.engines.api import TIMESTEP, simulate
from aquafish_gym.imu import ImuLog
from aquafish_gym.morphology import Morphology
from aquafish_gym.physics.added_mass import (
    finite_span,
)
from aquafish_gym.physics.dynamics import forces, on_body
from aquafish_gym.physics.hydrodynamics import DENSITY
from aquafish_gym.physics.kinematics import State
from aquafish_gym.physics.layout import layout, robot_of
from aquafish_gym.physics.reactive import added_water
from aquafish_gym.physics.robot import Fin, Robot
from aquafish_gym.plans import AQUAFISH
from instruments.verification.paper_robot import CAUDAL_Y, HULL, SWEEP

Array = NDArray[np.float64]


TAILS = {"prototype": 0.4, "thin": 0.02}  # thickness
FREQUENCIES = (0.25, 0.5, 0.75, 1.0)  # Hz
# Beats from rest: the first are the time to settle, over the others the speed is measured. Many
# more would let the pitch that rounding starts grow, where a robot's course is unstable.
BEATS = (40, 50)
BODY_LENGTH = 2 * HULL.nose


def tail_body(thickness: float, pectorals: bool) -> Array:
    """Return nine sizes: the nominal body's but for the tail's thickness, or its tail alone."""
    sizes = Morphology.nominal().to_array()
    for i, dimension in enumerate(AQUAFISH.dimensions):
        if dimension.fin != "caudal" and not pectorals:
            sizes[i] = 0.0
        elif dimension.name == "caudal.thickness":
            sizes[i] = thickness
    return sizes


def bessel_j1(x: float) -> float:
    """Return the Bessel function J1 of a small x, by its series."""
    return math.fsum(
        (-1) ** k * (x / 2) ** (2 * k + 1) / (math.factorial(k) * math.factorial(k + 1))
        for k in range(12)
    )


def lighthill_thrust(fin: Fin, frequency: float) -> float:
    """Return the mean thrust of a tail on a body held still, in closed form.

    The mean over a cycle of 1/2 m w^2 cos(angle), with w = length * rate and
    angle = SWEEP sin(phase), is 1/2 m length^2 omega^2 SWEEP J1(SWEEP).
    """
    m = DENSITY * math.pi / 4 * fin.width**2 * finite_span(fin.width, fin.length)
    omega = 2 * math.pi * frequency
    return float(0.5 * m * fin.length**2 * omega**2 * SWEEP * bessel_j1(SWEEP))


def held_thrust(robot: Robot, frequency: float, points: int = 64) -> tuple[float, float]:
    """Return the mean force forward on a body held still, by drag and by the reactive terms."""
    still, omega = (0.0, 0.0, 0.0), 2 * math.pi * frequency
    drag = reactive = 0.0
    for phase in 2 * math.pi * (np.arange(points) + 0.5) / points:
        c, s = math.cos(phase), math.sin(phase)
        rates = (0.0, 0.0, SWEEP * omega * c)
        joints = (1.0, 0.0, 1.0, 0.0, c, s)
        state = State((0.0, 0.0, 0.0, 1.0), still, still, still, joints, rates)
        push = (0.0, 0.0, -SWEEP * omega**2 * s)
        drag += on_body(AQUAFISH, state, forces(AQUAFISH, robot, state, still))[0][1] / points
        reactive += added_water(AQUAFISH, robot, state, push, still).force[1] / points
    return drag, reactive


def held_rows() -> list[dict[str, object]]:
    """Return each tail's mean thrust at 1 Hz on a body held still."""
    rows: list[dict[str, object]] = []
    for tail, thickness in TAILS.items():
        robot = robot_of(layout(AQUAFISH).robots(tail_body(thickness, False)[None])[:, 0].tolist())
        drag, reactive = held_thrust(robot, 1.0)
        closed = lighthill_thrust(robot.fins[-1], 1.0)
        rows.append({"tail": tail, "drag": drag, "reactive": reactive, "lighthill": closed})
    return rows


def straight_swims(
    bodies: Array, log: ImuLog, frequency: float, first: int, end: int
) -> tuple[Array, Array]:
    """Return the speed (B,), units/s, and Strouhal's number (B,) of robots that swim straight.

    Strouhal's number is frequency times the tail tip's whole excursion across the path, over the
    speed; infinite where the robot does not swim forward.

    Parameters
    ----------
    bodies
        (B, 9) sizes.
    log
        Recorded with the pose.
    frequency
        Of the tail, Hz.
    first, end
        The samples between which to measure.
    """
    position, quaternion, fins = (
        np.asarray(part, np.float64)[:, first - 1 : end]
        for part in (log.position, log.quaternion, log.fin_angles)
    )
    turns = Rotation.from_quat(quaternion.reshape(-1, 4)).as_matrix()
    turns = turns.reshape(*position.shape, 3)
    heading = turns[:, 1:, :, 1].mean(axis=1)
    heading /= np.linalg.norm(heading, axis=1, keepdims=True)
    aside = np.cross(heading, (0.0, 0.0, 1.0))
    moved = np.einsum("bi,bi->b", position[:, -1] - position[:, 0], heading)
    speed: Array = moved / ((end - first) * TIMESTEP)
    angle, length = SWEEP * np.sin(fins[..., 2]), bodies[:, None, 7]
    tip = np.stack(
        [length * np.sin(angle), CAUDAL_Y - length * np.cos(angle), np.zeros_like(angle)], axis=2
    )
    path = position + np.einsum("btij,btj->bti", turns, tip)
    excursion = np.ptp(np.einsum("bti,bi->bt", path, aside), axis=1)
    forward = speed > 0.001
    strouhal: Array = np.where(
        forward, frequency * excursion / np.where(forward, speed, 1.0), np.inf
    )
    return speed, strouhal


def swim_straight(
    bodies: Array, frequency: float, reactive: bool, beats: tuple[int, int] = BEATS
) -> list[tuple[float, float | None]]:
    """Return speed in body lengths/s and Strouhal's number of robots that beat their tails.

    Parameters
    ----------
    bodies
        (B, 9) sizes.
    frequency
        Of the tail, Hz.
    reactive
        Whether with the reactive terms.
    beats
        From rest to where measuring begins, and to where it ends.
    """
    first, end = (round(n / (frequency * TIMESTEP)) for n in beats)
    log = simulate(
        bodies, (0.0, 0.0, frequency), steps=end, dtype="float64", record="pose", reactive=reactive
    )
    speeds, strouhal = straight_swims(bodies, log, frequency, first, end)
    return [
        (float(v) / BODY_LENGTH, float(st) if math.isfinite(st) else None)
        for v, st in zip(speeds, strouhal, strict=True)
    ]


def swimming_rows(beats: tuple[int, int] = BEATS) -> list[dict[str, object]]:
    """Return how fast tails swim, alone and with the nominal pectorals trailing."""
    cases = [(tail, pectorals) for tail in TAILS for pectorals in (False, True)]
    bodies = np.array([tail_body(TAILS[tail], pectorals) for tail, pectorals in cases])
    return [
        {
            "tail": tail,
            "pectorals": pectorals,
            "frequency": frequency,
            "reactive": reactive,
            "speed": speed,
            "strouhal": strouhal,
        }
        for reactive in (False, True)
        for frequency in FREQUENCIES
        for (tail, pectorals), (speed, strouhal) in zip(
            cases, swim_straight(bodies, frequency, reactive, beats), strict=True
        )
    ]


# A vertical current so weak starts no more than a disturbance.
DISTURBANCE, OFF_COURSE, WATCHED = 1e-3, 0.5, 300  # units/s, rad, beats


def course_rows(watched: int = WATCHED) -> list[dict[str, object]]:
    """Return after how many beats at 1 Hz a slight disturbance has pitched a swimmer off course.

    None if it holds its course for as long as it was ``watched``.
    """
    rows: list[dict[str, object]] = []
    for reactive in (False, True):
        for tail, thickness in TAILS.items():
            for pectorals in (False, True):
                log = simulate(
                    tail_body(thickness, pectorals), (0.0, 0.0, 1.0),
                    steps=round(watched / TIMESTEP), dtype="float64", record="pose",
                    current=(0.0, 0.0, DISTURBANCE), reactive=reactive,
                )  # fmt: skip
                assert log.quaternion is not None
                x, y, z, w = log.quaternion[0].T
                off = np.abs(2 * (y * z + x * w)) > math.sin(OFF_COURSE)  # of the body's axis
                beats = float(np.argmax(off)) * TIMESTEP if off.any() else None
                rows.append(
                    {"tail": tail, "pectorals": pectorals, "reactive": reactive, "beats": beats}
                )
    return rows
