"""The paper's robot in numbers, for instruments that state its mechanics in another way."""

from __future__ import annotations

from aquafish_gym.physics.added_mass import hull_added_mass
from aquafish_gym.physics.robot import MINIMUM_FIN_MASS, hull_numbers
from aquafish_gym.plans import AQUAFISH

HULL = hull_numbers(AQUAFISH.hull)
RADIUS, NOSE = HULL.radius, HULL.nose
CYLINDER = 2 * (NOSE - RADIUS)
BODY_MASS, BODY_INERTIA = HULL.mass, HULL.inertia
BODY_ADDED_MASS, BODY_ADDED_INERTIA = hull_added_mass(AQUAFISH.hull)
LEAST_FIN_MASS = MINIMUM_FIN_MASS * BODY_MASS
CAPSULE_STATIONS, ROLL_AREA = HULL.stations, HULL.roll_area
PECTORAL_X, PECTORAL_Y, _ = AQUAFISH.fins[1].hinge
CAUDAL_Y = AQUAFISH.fins[2].hinge[1]
SWEEP = AQUAFISH.fins[-1].sweep  # rad: the caudal angle is SWEEP sin(phase)
MOUNT_X = (RADIUS + PECTORAL_X) / 2
MOUNT_WIDTH = PECTORAL_X - RADIUS
