"""A robot's variable body: the sizes of its fins (Sec. 3.1 of the paper)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.plans import AQUAFISH, BodyPlan, PlanLike, check_plan, check_same_plan
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    UnknownNameError,
    brief,
    finite_array,
    one_of,
    parse_json,
)

Size = tuple[float, float, float]


@dataclass(frozen=True, repr=False)
class Morphology:
    """The sizes of a plan's fins in units of 5 cm; a size of 0 is legal.

    Each fin's, along x, y and z, is an attribute of its name; see ``FinPlan.order``. A size that is
    not finite or leaves its range in the plan's ``dimensions`` raises InvalidArgumentError.

    Examples
    --------
    >>> Morphology.nominal().caudal
    (0.4, 1.4, 0.6)
    """

    sizes: tuple[float, ...]
    """S of them, in the order of the plan's ``dimensions``."""
    plan: BodyPlan = AQUAFISH

    def __post_init__(self) -> None:
        object.__setattr__(self, "plan", check_plan(self.plan))
        count = len(self.plan.dimensions)
        array = finite_array("morphology", self.sizes, (count,), hint=other_plans(self.plan))
        for fin, sizes, most in zip(
            self.plan.names, array.reshape(-1, 3), self.plan.maxima.reshape(-1, 3), strict=True
        ):
            finite_array(f"morphology.{fin}", sizes, (3,), 0.0, most)
        object.__setattr__(self, "sizes", tuple(array.tolist()))

    def __getattr__(self, name: str) -> Size:
        if name.startswith("_") or name not in self.plan.names:
            raise AttributeError(f"{type(self).__name__!r} has no attribute {name!r}")
        first = 3 * self.plan.names.index(name)
        x, y, z = self.sizes[first : first + 3]
        return (x, y, z)

    def __repr__(self) -> str:
        sizes = ", ".join(f"{fin}={getattr(self, fin)}" for fin in self.plan.names)
        return f"{type(self).__name__}({sizes})"

    @classmethod
    def nominal(cls, plan: PlanLike = AQUAFISH) -> Self:
        """Return the whole fish of a plan."""
        return cls.from_array(check_plan(plan).nominal, plan)

    @classmethod
    def from_array(cls, sizes: ArrayLike, plan: PlanLike = AQUAFISH) -> Self:
        """Return the body of sizes (S,) in the order of the plan's ``dimensions``."""
        return cls(sizes, plan)  # type: ignore[arg-type]  # checked there

    @classmethod
    def coerce(cls, value: MorphologyLike, plan: PlanLike | None = None) -> Morphology:
        """Return the body of ``None`` (nominal), S numbers, or a mapping from fins to sizes.

        Without a ``plan`` a ``Morphology`` keeps its own, and anything else is of the paper's fish.
        """
        if plan is None:
            plan = value.plan if isinstance(value, Morphology) else AQUAFISH
        plan = check_plan(plan)
        if value is None:
            return cls.nominal(plan)
        if isinstance(value, Morphology):
            check_same_plan("morphology", value.plan, plan)
            return value
        if isinstance(value, Mapping):
            sizes = plan.nominal.reshape(-1, 3).copy()
            for fin, size in value.items():
                try:
                    one_of("morphology fin", fin, plan.names)
                except UnknownNameError as error:
                    raise UnknownNameError(f"{error}{other_plans(plan)}") from None
                sizes[plan.names.index(fin)] = finite_array(f"morphology.{fin}", size, (3,))
            return cls.from_array(sizes.ravel(), plan)
        return cls.from_array(value, plan)

    def to_array(self) -> NDArray[np.float64]:
        """Return the sizes (S,) in the order of the plan's ``dimensions``."""
        return np.array(self.sizes)

    def to_dict(self) -> dict[str, list[float]]:
        """Return fin -> [x, y, z], ready for JSON."""
        return {fin: list(getattr(self, fin)) for fin in self.plan.names}

    def to_json(self) -> str:
        """Return one line of JSON that ``from_json`` reads back exactly."""
        return json.dumps(self.to_dict(), allow_nan=False)

    @classmethod
    def from_json(cls, text: str, plan: PlanLike = AQUAFISH) -> Morphology:
        """Return the body of the JSON of ``to_json``; anything else is refused."""
        plan = check_plan(plan)
        sizes: Any = parse_json("morphology", text)
        if not isinstance(sizes, dict) or sorted(sizes) != sorted(plan.names):
            wanted = f"an object with the keys {', '.join(plan.names)}"
            raise InvalidArgumentError(
                f"a morphology's JSON must be {wanted}; got {brief(sizes)}{other_plans(plan)}"
            )
        return cls.coerce(sizes, plan)


# What ``Morphology.coerce`` takes.
MorphologyLike = Morphology | Mapping[str, ArrayLike] | ArrayLike | None


def other_plans(plan: BodyPlan) -> str:
    """Return what is said of a body that is none of a plan's."""
    return (
        f"; the plan is {plan.name}, and another fish has a BodyPlan of its own "
        "(docs/howto/body.md); any other robot can be inferred by eea.Robot (docs/howto/robot.md), "
        "and its environment be broken by aquafish_gym.FaultWrapper"
    )
