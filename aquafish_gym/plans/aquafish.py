"""The robot of the paper: two flippers that turn, and a tail that sweeps (Fig. 1, Sec. 3.1).

The hull and the hinges are a camera's fit of the paper's Fig. 4: radius 0.491, cylinder 3.07 long,
pectorals 0.749 aside and 0.997 behind the nose. Ranges of sizes: Sec. 3.1. Nominal sizes: Fig. 1
(flippers 2 x 8 cm, tail 7 cm long, 3 cm tall, 2 cm thick); the flippers' thickness is not in the
paper (assumed).
"""

from __future__ import annotations

import math

from aquafish_gym.plans.plan import BodyPlan, FinPlan, Hull, Sizes

_LARGEST = Sizes(length=2.0, width=1.0, thickness=0.5)


def _flipper(side: str, x: float) -> FinPlan:
    return FinPlan(
        f"{side}_pectoral",
        hinge=(x, 1.0, 0.0),
        axis=(1.0, 0.0, 0.0),
        direction=(0.0, -1.0, 0.0),
        drive="turns",
        speed=0.5,
        nominal=Sizes(length=1.6, width=0.4, thickness=0.1),
        largest=_LARGEST,
        word=f"{side} flipper",
    )


_TAIL = FinPlan(
    "caudal",
    hinge=(0.0, -2.0, 0.0),
    axis=(0.0, 0.0, 1.0),
    direction=(0.0, -1.0, 0.0),
    drive="sweeps",
    speed=1.0,
    sweep=math.radians(30.0),
    nominal=Sizes(length=1.4, width=0.6, thickness=0.4),
    largest=_LARGEST,
    word="tail",
)

AQUAFISH = BodyPlan(
    "aquafish", Hull(4.0, 0.5), (_flipper("left", -0.75), _flipper("right", 0.75), _TAIL)
)
