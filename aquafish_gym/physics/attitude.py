"""Attitude as roll, pitch and yaw: yaw about z, then pitch about x, then roll about y (long axis).

Two triples describe every attitude: (roll, pitch, yaw) and (roll + pi, pi - pitch, yaw + pi), each
up to whole turns. A log that keeps pitch within +-90 degrees therefore jumps by pi in roll and yaw
when the robot pitches past the vertical. :func:`continue_attitude` takes, of all triples that
describe a sample, the one nearest to the sample before. Logged signals are then continuous, pitch
may pass 90 degrees, and the triple still describes the true attitude. Only this code deals with it.
"""

from __future__ import annotations

import math

from aquafish_gym.physics.arithmetic import (
    TAU,
    Matrix,
    Number,
    Vector,
    arctangent2,
    floor,
    fma,
    sine_cosine,
    square_root,
    where_less,
)


def attitude(r: Matrix) -> Vector:
    """Return (roll, pitch, yaw) of a rotation matrix from body to world, pitch in +-pi/2."""
    pitch = arctangent2(r[2][1], square_root(fma(r[2][0], r[2][0], r[2][2] * r[2][2])))
    return (arctangent2(-r[2][0], r[2][2]), pitch, arctangent2(-r[0][1], r[1][1]))


def nearest_turn(angle: Number, reference: Number) -> Number:
    """Return ``angle`` plus the whole turns that bring it nearest to ``reference``."""
    return fma(-TAU, floor(fma(angle - reference, 1 / TAU, 0.5)), angle)


def continue_attitude(before: Vector, now: Vector) -> Vector:
    """Return the triple that describes the same attitude as ``now`` and lies nearest ``before``.

    Straight-line code for any scalar backend. Near means the sum of absolute differences.
    """
    r1 = nearest_turn(now[0], before[0])
    p1 = nearest_turn(now[1], before[1])
    y1 = nearest_turn(now[2], before[2])
    r2 = nearest_turn(now[0] + math.pi, before[0])
    p2 = nearest_turn(math.pi - now[1], before[1])
    y2 = nearest_turn(now[2] + math.pi, before[2])
    d1 = abs(r1 - before[0]) + abs(p1 - before[1]) + abs(y1 - before[2])
    d2 = abs(r2 - before[0]) + abs(p2 - before[1]) + abs(y2 - before[2])
    return (where_less(d2, d1, r2, r1), where_less(d2, d1, p2, p1), where_less(d2, d1, y2, y1))


def directions(rpy: Vector) -> tuple[Vector, Vector]:
    """Return the world's up (z) and north (y) in body axes, for roll, pitch and yaw in rad."""
    rs, rc = sine_cosine(rpy[0] * (1 / TAU))
    ps, pc = sine_cosine(rpy[1] * (1 / TAU))
    ys, yc = sine_cosine(rpy[2] * (1 / TAU))
    up = (-pc * rs, ps, pc * rc)
    north = (ys * rc + yc * ps * rs, yc * pc, ys * rs - yc * ps * rc)
    return up, north
