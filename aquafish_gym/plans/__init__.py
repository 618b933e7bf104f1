"""The fish that this package has: each is a :class:`BodyPlan`."""

from __future__ import annotations

from aquafish_gym.plans.aquafish import AQUAFISH
from aquafish_gym.plans.four_fins import FOUR_FINS
from aquafish_gym.plans.plan import (
    BodyPlan,
    Dimension,
    FinPlan,
    Hull,
    Sizes,
    check_plan,
    check_same_plan,
)
from aquafish_gym.plans.tail_fish import TAIL_FISH

__all__ = [
    "AQUAFISH",
    "FOUR_FINS",
    "PLANS",
    "TAIL_FISH",
    "BodyPlan",
    "Dimension",
    "FinPlan",
    "Hull",
    "Sizes",
    "check_plan",
    "check_same_plan",
]

#: The plans by name.
PLANS: dict[str, BodyPlan] = {plan.name: plan for plan in (AQUAFISH, FOUR_FINS, TAIL_FISH)}
