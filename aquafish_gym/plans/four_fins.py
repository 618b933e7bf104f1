"""Four turning flippers at the corners of a longer hull, as of a turtle or a plesiosaur."""

from __future__ import annotations

from aquafish_gym.plans.plan import BodyPlan, FinPlan, Hull, Sizes


def _flipper(end: str, side: str, x: float, y: float) -> FinPlan:
    return FinPlan(
        f"{end}_{side}",
        hinge=(x, y, 0.0),
        axis=(1.0, 0.0, 0.0),
        direction=(0.0, -1.0, 0.0),
        drive="turns",
        speed=0.5,
        nominal=Sizes(length=1.4, width=0.4, thickness=0.1),
        largest=Sizes(length=2.0, width=1.0, thickness=0.5),
        word=f"{end} {side} flipper",
    )


FOUR_FINS = BodyPlan(
    "four-fins",
    Hull(length=5.0, radius=0.5),
    (
        _flipper("fore", "left", -0.75, 1.5),
        _flipper("fore", "right", 0.75, 1.5),
        _flipper("hind", "left", -0.75, -1.5),
        _flipper("hind", "right", 0.75, -1.5),
    ),
)
