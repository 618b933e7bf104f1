"""The paper's robot in numbers, for studies of its tail and its hull."""

from __future__ import annotations

from aquafish_gym.physics.added_mass import hull_added_mass
from aquafish_gym.physics.robot import MINIMUM_FIN_MASS, hull_numbers
from aquafish_gym.plans import AQUAFISH

HULL = hull_numbers(AQUAFISH.hull)
BODY_MASS, BODY_INERTIA = HULL.mass, HULL.inertia
BODY_ADDED_MASS, BODY_ADDED_INERTIA = hull_added_mass(AQUAFISH.hull)
LEAST_FIN_MASS = MINIMUM_FIN_MASS * BODY_MASS
CAUDAL_Y = AQUAFISH.fins[-1].hinge[1]
SWEEP = AQUAFISH.fins[-1].sweep  # rad: the caudal angle is SWEEP sin(phase)
