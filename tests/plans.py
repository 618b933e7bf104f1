"""Body plans for tests: those of the package, one of odd fins, and random ones."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import strategies as st

from aquafish_gym.plans import AQUAFISH, FOUR_FINS, TAIL_FISH, BodyPlan, FinPlan, Hull, Sizes
from aquafish_gym.utils.validation import InvalidArgumentError

_LARGEST = Sizes(2.0, 1.0, 0.5)


def _sweeping(name: str, hinge: object, axis: object, direction: object, sizes: Sizes) -> FinPlan:
    return FinPlan(
        name, hinge, axis, direction, "sweeps", 1.2, sizes, _LARGEST, sweep=0.5  # type: ignore[arg-type]
    )  # fmt: skip


#: Five fins: a skew one, a keel, one on the back, a flipper without a mirror, a tail.
ODD = BodyPlan(
    "odd",
    Hull(3.0, 0.6),
    (
        _sweeping("skew", (0.7, 0.3, 0.0), (0, 1, 1), (1, 0, 0), Sizes(1.0, 0.3, 0.1)),
        _sweeping("keel", (0, -0.5, -0.9), (1, 0, 0), (0, -1, -0.5), Sizes(1.0, 0.5, 0.1)),
        _sweeping("top", (0.3, 0.7, 0.6), (1, 0.2, 0), (0, 0, 1), Sizes(0.8, 0.5, 0.1)),
        FinPlan(
            "alone", (-0.8, 0.0, 0.3), (1.0, 0.0, 0.0), (0.0, -1.0, 0.0), "turns", 0.5,
            Sizes(1.0, 0.2, 0.1), _LARGEST,
        ),
        _sweeping("end", (0, -1.5, 0), (0, 0, 1), (0, -1, 0), Sizes(1.0, 0.5, 0.1)),
    ),
)  # fmt: skip
PLANS = (AQUAFISH, FOUR_FINS, TAIL_FISH, ODD)
EACH_PLAN = [pytest.param(plan, id=plan.name) for plan in PLANS]
#: For tests that compile kernels of the plan, which takes long: the others' are slow ones.
COMPILED_PLANS = [
    EACH_PLAN[0],
    *(pytest.param(plan, id=plan.name, marks=pytest.mark.slow) for plan in PLANS[1:]),
]


@st.composite
def plans(draw: st.DrawFn) -> BodyPlan:
    """Return a plan of one to six fins anywhere around a hull, that point away from it."""
    number = st.floats(-1.0, 1.0)
    hull = Hull(draw(st.floats(2.0, 6.0)), draw(st.floats(0.3, 0.9)))
    fins = []
    for i in range(draw(st.integers(1, 6))):
        around = draw(st.floats(0.0, 2 * math.pi))
        out = np.array([math.cos(around), 0.0, math.sin(around)])
        away = hull.radius * draw(st.sampled_from([1.0, 1.5, 2.0]))
        hinge = away * out + [0.0, draw(number) * (hull.length / 2 - hull.radius), 0.0]
        turns = draw(st.booleans())
        # A fin that turns does so in a plane beside the hull; one that sweeps points outward.
        aft = np.array([0.0, -1.0, 0.0])
        axis = out if turns else np.cross(out, aft) * draw(number) + aft * draw(number)
        if np.linalg.norm(axis) < 1e-3:
            axis = aft
        fins.append(
            FinPlan(
                f"fin_{i}", tuple(hinge.tolist()), tuple(axis.tolist()),
                tuple((aft if turns else out).tolist()), "turns" if turns else "sweeps",
                draw(st.floats(0.3, 2.0)),
                Sizes(draw(st.floats(0.2, 1.5)), draw(st.floats(0.05, 0.3)), 0.05), _LARGEST,
                sweep=0.0 if turns else draw(st.floats(0.1, 0.6)),
            )
        )  # fmt: skip
    try:
        return BodyPlan("random", hull, tuple(fins))
    except InvalidArgumentError:  # a wide fin close to the hull
        return BodyPlan("random", hull, tuple(replace(fin, nominal=_SMALL) for fin in fins))


_SMALL = Sizes(0.2, 0.0, 0.05)


def turned(plan: BodyPlan, angle: float) -> BodyPlan:
    """Return a plan with all fins turned about the hull's axis: the same fish lying on its side."""
    c, s = (round(x, 15) for x in (math.cos(angle), math.sin(angle)))  # a quarter turn is exact

    def turn(v: tuple[float, float, float]) -> tuple[float, float, float]:
        return (c * v[0] + s * v[2], v[1], c * v[2] - s * v[0])

    fins = (
        replace(fin, hinge=turn(fin.hinge), axis=turn(fin.axis), direction=turn(fin.direction))
        for fin in plan.fins
    )
    return BodyPlan(f"{plan.name}-turned", plan.hull, tuple(fins))
