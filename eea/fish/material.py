"""What hull and fins are made of: masses and skin friction, which the engines take as given."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aquafish_gym.morphology import DIMENSIONS, FINS
from aquafish_gym.physics.hydrodynamics import NORMAL_DRAG, SKIN_FRICTION
from eea.core.angles import Floats
from eea.fish.simulator_error import Assumed

THICKNESS = "the thickness of the fins"
# Fins of aluminium or weighted plastic are 1 to 2.7 times as dense as water; a rough or ribbed skin
# has several times the friction of a smooth one.
ASSUMED = (
    Assumed("the density of the fins", 1.0, 1.0, "times water's", THICKNESS),
    Assumed("their skin friction", 1.0, 4.0, "times a smooth plate's", THICKNESS),
)
MATERIAL_CHANGE = 0.1  # of each, to find the difference that it makes
_PLACES = {d.name: i for i, d in enumerate(DIMENSIONS)}


@dataclass(frozen=True)
class Material:
    """Factors on what the engines assume of the robot's material."""

    hull: float = 1.0  #: On the hull's mass.
    density: float = 1.0  #: On the fins' mass.
    #: On the fins' skin friction, which acts as a thicker edge would that weighs nothing. Of the
    #: drag edge on it is exact for square fins, else the mean of both edges.
    friction: float = 1.0

    def fields(self, bodies: Floats, drag: Floats) -> dict[str, Floats]:
        """Return a scenario's fields of bodies (B, 9) with the factors ``drag`` (B, 2)."""
        bodies = bodies.copy()
        density = np.full((len(bodies), len(FINS)), self.density)
        if self.friction != 1.0:
            for i, fin in enumerate(FINS):
                width, length, thickness = (
                    _PLACES[f"{fin}.{size}"] for size in ("width", "length", "thickness")
                )
                rub = 2.0 * (self.friction - 1.0) * SKIN_FRICTION / NORMAL_DRAG
                was = bodies[:, thickness].copy()
                bodies[:, thickness] += rub * 0.5 * (bodies[:, width] + bodies[:, length])
                density[:, i] *= was / np.maximum(bodies[:, thickness], 1e-12)
        # A heavier hull moves as if all else weighed less and met less drag.
        return {"body": bodies, "drag": drag / self.hull, "fin_density": density / self.hull}


#: Materials that differ from the assumed one by ``MATERIAL_CHANGE`` in one of ``ASSUMED``.
OTHER_MATERIALS = (
    Material(density=1.0 + MATERIAL_CHANGE),
    Material(friction=1.0 + MATERIAL_CHANGE),
)
