"""The fish that this package has: each is a :class:`BodyPlan`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from aquafish_gym.plans.aquafish import AQUAFISH
from aquafish_gym.plans.four_fins import FOUR_FINS
from aquafish_gym.plans.plan import (
    BodyPlan,
    Dimension,
    FinPlan,
    Hull,
    Sizes,
    check_same_plan,
)
from aquafish_gym.plans.tail_fish import TAIL_FISH
from aquafish_gym.utils.storage import read_document
from aquafish_gym.utils.validation import InvalidArgumentError, brief, one_of

__all__ = [
    "AQUAFISH",
    "FOUR_FINS",
    "KNOWN_FINS",
    "PLANS",
    "TAIL_FISH",
    "BodyPlan",
    "Dimension",
    "FinPlan",
    "Hull",
    "PlanLike",
    "Sizes",
    "check_plan",
    "check_same_plan",
    "plan_document",
    "plan_of",
]

#: The plans by name.
PLANS: dict[str, BodyPlan] = {plan.name: plan for plan in (AQUAFISH, FOUR_FINS, TAIL_FISH)}

#: The fins that damage can name, and what people call them: of ``PLANS``, and of every plan that
#: :func:`check_plan` has let in.
KNOWN_FINS: dict[str, str] = {
    name: word for plan in PLANS.values() for name, word in plan.words.items()
}

PlanLike = BodyPlan | str | Mapping[str, Any]


def check_plan(plan: object) -> BodyPlan:
    """Return a plan, given one, the name of one of ``PLANS``, a JSON file, or what is in it.

    From then on, damage can name its fins.

    Raises
    ------
    InvalidArgumentError
        If it is none of them.

    Examples
    --------
    >>> check_plan("four-fins").names
    ('fore_left', 'fore_right', 'hind_left', 'hind_right')
    """
    match plan:
        case BodyPlan():
            found = plan
        case Mapping():
            found = BodyPlan.from_dict(plan)
        case str() if plan.endswith(".json"):
            found = BodyPlan.from_dict(read_document(plan, argument="plan"))
        case str():
            found = PLANS[one_of("plan", plan, (*PLANS, "FILE.json"))]
        case _:
            raise InvalidArgumentError(
                "plan must be a BodyPlan, a name of PLANS or the path of a JSON file, as text; "
                f"got {brief(plan)}"
            )
    if not found.words.keys() <= KNOWN_FINS.keys():
        KNOWN_FINS.update(found.words | KNOWN_FINS)
    # A packaged plan that came from another process is that object again: kernels are looked up by
    # their plan, and two objects are compared whole each time.
    return next((one for one in PLANS.values() if one == found), found)


def plan_of(*values: object, default: BodyPlan = AQUAFISH) -> BodyPlan:
    """Return the body plan of the first value, or entry of a list, that has one.

    Examples
    --------
    >>> from aquafish_gym import Morphology
    >>> plan_of(None, [Morphology.nominal("tail-fish")])
    BodyPlan('tail-fish': tail, left_fin, right_fin)
    """
    for value in values:
        for each in value if isinstance(value, list | tuple) else (value,):
            if isinstance(plan := getattr(each, "plan", None), BodyPlan):
                return plan
    return default


def plan_document(plan: BodyPlan) -> str | dict[str, Any]:
    """Return what a file says of a plan, ready for JSON: its name where it is one of ``PLANS``."""
    return plan.name if PLANS.get(plan.name) == plan else plan.to_dict()
