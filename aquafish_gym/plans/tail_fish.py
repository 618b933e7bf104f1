"""A tail that sweeps, and two small sweeping fins under the hull: for water with added mass."""

from __future__ import annotations

import math

from aquafish_gym.plans.plan import BodyPlan, FinPlan, Hull, Sizes


def _fin(side: str, x: float) -> FinPlan:
    """Return a fin on the hull's flank that points aft and flaps out and in."""
    return FinPlan(
        f"{side}_fin",
        hinge=(x, 0.5, 0.0),
        axis=(0.0, 0.0, 1.0),
        direction=(math.copysign(math.sin(_SPREAD), x), -math.cos(_SPREAD), 0.0),
        drive="sweeps",
        speed=1.0,
        sweep=math.radians(25.0),
        nominal=Sizes(length=0.8, width=0.4, thickness=0.05),
        largest=Sizes(length=1.0, width=0.5, thickness=0.25),
    )


_SPREAD = math.radians(45.0)  # of the fins from the hull

_TAIL = FinPlan(
    "tail",
    hinge=(0.0, -2.5, 0.0),
    axis=(0.0, 0.0, 1.0),
    direction=(0.0, -1.0, 0.0),
    drive="sweeps",
    speed=2.0,
    sweep=math.radians(30.0),
    nominal=Sizes(length=1.4, width=1.2, thickness=0.05),
    largest=Sizes(length=2.0, width=2.0, thickness=0.25),
)

TAIL_FISH = BodyPlan(
    "tail-fish", Hull(length=5.0, radius=0.6), (_TAIL, _fin("left", -0.6), _fin("right", 0.6))
)
