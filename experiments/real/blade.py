"""What a propeller loses when its blades are cut: blade element and momentum theory.

An annulus of the disc takes the thrust of the blades' elements, which are lifting lines with
Prandtl's loss at the tip, and gives it to the air as momentum. The blade's outline is that of the
whole propeller in the data's photograph: a chord of 7.5 mm that narrows towards the hub, and a tip
rounded over the last 2.5 mm. A round tip is why the first half millimetre costs little. No flight
is used.

With pitches of 15 to 25 mm, chords of 6.5 to 7.5 mm, radii of 22.5 to 23.5 mm, tips rounded over
2 to 3 mm and drag coefficients of 0.03 to 0.08, the loss of thrust differs by less than 10%. What
such a theory lacks, as on so short a blade, is more than that: see ``BLADE`` of
:mod:`experiments.real.quadrotor`.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from experiments.real.crazypad import WHOLE_LENGTH_MM, Floats

RADIUS_MM = WHOLE_LENGTH_MM / 2.0
HUB_MM = 4.0
CHORD_MM = 7.5
NARROW_MM = 14.0  # nearer to the hub, the chord goes with radius^0.7
ROUNDED_MM = 2.5
PITCH_MM = 20.0  # of a turn
CAMBER_RAD = np.deg2rad(3.0)  # lift at no angle of attack is that of so much angle
LIFT_SLOPE = 5.5  # 1/rad
DRAG = 0.05
ELEMENTS = 400
ITERATIONS = 300
LONGEST_CUT_MM = 20.0  # of a propeller, both blades together
STEP_MM = 0.25


class Loss(NamedTuple):
    """What propellers give at the same speed, over whole ones; logarithms."""

    thrust: Floats
    torque_per_thrust: Floats


def loss(cuts: Floats) -> Loss:
    """Return the loss of propellers that are shorter by ``cuts``, mm, as much on each blade."""
    knots, thrust, torque = _table()
    return Loss(np.interp(cuts, knots, thrust), np.interp(cuts, knots, torque - thrust))


@cache
def _table() -> tuple[Floats, Floats, Floats]:
    knots = np.arange(0.0, LONGEST_CUT_MM + STEP_MM, STEP_MM)
    given = np.log([rotor(cut / 2.0) for cut in knots])
    thrust, torque = (given - given[0]).T
    return knots, thrust, torque


def rotor(blade_cut: float) -> tuple[float, float]:
    """Return thrust and torque of two blades that are each shorter by these lengths, mm.

    They are for the density and the angular speed 1, in mm^4 and mm^5.
    """
    radius = RADIUS_MM - blade_cut
    edges = np.linspace(HUB_MM, radius, ELEMENTS + 1)
    r = (edges[1:] + edges[:-1]) / 2.0
    chord = CHORD_MM * np.minimum(1.0, r / NARROW_MM) ** 0.7
    inward = np.clip((RADIUS_MM - r) / ROUNDED_MM, 0.0, 1.0)  # from the tip of the whole blade
    chord = chord * np.sqrt(1.0 - (1.0 - inward) ** 2)
    angle = np.arctan(PITCH_MM / (2.0 * np.pi * r)) + CAMBER_RAD
    lift_per_angle = LIFT_SLOPE * 2.0 * chord / (np.pi * radius)  # times the solidity
    inflow = np.full(ELEMENTS, 0.1)  # axial speed over the tip's
    for _ in range(ITERATIONS):
        distance = (radius - r) / (radius * inflow)
        tip_loss = 2.0 / np.pi * np.arccos(np.exp(-np.clip(distance, 1e-6, 50.0)))
        share = lift_per_angle / (16.0 * tip_loss)
        new = share * (np.sqrt(1.0 + 2.0 * angle * r / (share * radius)) - 1.0)
        inflow += 0.3 * (new - inflow)
    inflow_angle = inflow * radius / r
    lift = LIFT_SLOPE * (angle - inflow_angle)
    pressed = r**2 * chord * np.diff(edges)  # two blades times half the square of the speed
    thrust = float((pressed * lift).sum())
    torque = float((pressed * r * (lift * inflow_angle + DRAG)).sum())
    return thrust, torque
