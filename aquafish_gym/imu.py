"""What the robot feels: roll, pitch and yaw, and its gyro (Sec. 3.1).

Attitude is yaw about z, then pitch about x, then roll about y (the long axis). Two triples
describe every attitude: (roll, pitch, yaw) and (roll + pi, pi - pitch, yaw + pi), each up to
whole turns. A log that keeps pitch within +-90 degrees therefore jumps by pi in roll and yaw
when the robot pitches past the vertical. Here, and only here, that is mended: each sample
takes the triple, of all that describe it, nearest to the sample before
(:func:`continue_attitude`), so that the logged signals are continuous, pitch may pass 90
degrees, and the triple still describes the true attitude.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.physics.arithmetic import (
    TAU,
    Matrix,
    Number,
    Vector,
    arctangent2,
    floor,
    fma,
    where_less,
)

Floats = NDArray[np.floating]


@dataclass(frozen=True)
class ImuLog:
    """B robots' samples at T steps, taken after each step.

    Attributes
    ----------
    rpy
        (B, T, 3) roll, pitch, yaw in rad, continuous.
    gyro
        (B, T, 3) angular velocity in body axes, rad/s; None if it was not recorded.
    position
        (B, T, 3) of the capsule's centre in the world, units of 5 cm; only with
        ``record="pose"``.
    quaternion
        (B, T, 4) from body to world, (x, y, z, w); only with ``record="pose"``.
    fin_angles
        (B, T, 3) left and right pectoral angle and caudal phase in (-pi, pi]: the truth, which
        no IMU knows; only with ``record="pose"``.
    diverged
        (B,) whether a robot left the finite numbers; its samples are then NaN from there on.
    """

    rpy: Floats
    gyro: Floats | None
    position: Floats | None
    quaternion: Floats | None
    fin_angles: Floats | None
    diverged: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.rpy)


def attitude(r: Matrix) -> Vector:
    """Return (roll, pitch, yaw) of a rotation matrix from body to world, pitch in +-pi/2."""
    pitch = arctangent2(r[2][1], math.sqrt(fma(r[2][0], r[2][0], r[2][2] * r[2][2])))
    return (arctangent2(-r[2][0], r[2][2]), pitch, arctangent2(-r[0][1], r[1][1]))


def nearest_turn(angle: Number, reference: Number) -> Number:
    """Return ``angle`` plus the whole turns that bring it nearest to ``reference``."""
    return fma(-TAU, floor(fma(angle - reference, 1 / TAU, 0.5)), angle)


def continue_attitude(before: Vector, now: Vector) -> Vector:
    """Return the triple that describes the same attitude as ``now`` and lies nearest ``before``.

    Straight-line code for any carrier. Near means the sum of absolute differences.
    """
    r1 = nearest_turn(now[0], before[0])
    p1 = nearest_turn(now[1], before[1])
    y1 = nearest_turn(now[2], before[2])
    r2 = nearest_turn(now[0] + math.pi, before[0])
    p2 = nearest_turn(math.pi - now[1], before[1])
    y2 = nearest_turn(now[2] + math.pi, before[2])
    d1 = abs(r1 - before[0]) + abs(p1 - before[1]) + abs(y1 - before[2])
    d2 = abs(r2 - before[0]) + abs(p2 - before[1]) + abs(y2 - before[2])
    return (
        where_less(d2, d1, r2, r1),
        where_less(d2, d1, p2, p1),
        where_less(d2, d1, y2, y1),
    )


def unwrap_rpy(rpy: NDArray[np.floating]) -> NDArray[np.float64]:
    """Make a log of attitudes (T, 3), in rad, continuous; the first sample is kept.

    The engines' logs are so already. This is for a physical robot's, before it is compared with
    theirs.
    """
    out = np.array(rpy, dtype=np.float64)
    for t in range(1, len(out)):
        out[t] = continue_attitude(tuple(out[t - 1]), tuple(out[t]))
    return out
