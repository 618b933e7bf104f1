"""Which replicates a study is to have: for each arm and length of trial, a span of seeds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

Plan = dict[str, dict[int, range]]  # arm, then steps, then seeds


def read_plan(document: Mapping[str, Any]) -> Plan:
    """Return the plan in a study.json.

    Each arm has its own steps, and each of these its own seeds, under ``replicates``. The first
    studies gave the same ``steps`` and ``seeds`` to all arms.

    Raises
    ------
    ValueError
        If it is not said, or not in this form; the message names what is wrong.
    """
    arms = document.get("arms")
    if not isinstance(arms, dict) or not all(isinstance(arm, dict) for arm in arms.values()):
        raise ValueError("arms")
    table = document.get("replicates")
    if table is None:
        steps, seeds = document.get("steps"), _span(document.get("seeds"), "seeds")
        if not isinstance(steps, list) or not all(type(number) is int for number in steps):
            raise ValueError("steps")
        return {arm: dict.fromkeys(steps, seeds) for arm in arms}
    if not isinstance(table, dict) or table.keys() != arms.keys():
        raise ValueError("replicates")
    plan: Plan = {}
    for arm, durations in table.items():
        if not isinstance(durations, dict) or not all(map(str.isdecimal, durations)):
            raise ValueError(f"replicates.{arm}")
        plan[arm] = {
            int(steps): _span(seeds, f"replicates.{arm}.{steps}")
            for steps, seeds in durations.items()
        }
    return plan


def _span(seeds: Any, name: str) -> range:
    if not isinstance(seeds, dict):
        raise ValueError(name)
    first, count = seeds.get("first"), seeds.get("count")
    if type(first) is not int or type(count) is not int or first < 0 or count < 1:
        raise ValueError(name)
    return range(first, first + count)


def written_plan(plan: Plan) -> dict[str, Any]:
    """Return a plan as study.json has it under ``replicates``."""
    return {
        arm: {
            str(steps): {"first": seeds.start, "count": len(seeds)}
            for steps, seeds in sorted(durations.items())
        }
        for arm, durations in plan.items()
    }


def joined(held: Plan, asked: Plan) -> Plan:
    """Return what is in either plan.

    Raises
    ------
    ValueError
        If seeds of an arm would be left out between those of the two; the message says which.
    """
    plan = {arm: dict(durations) for arm, durations in held.items()}
    for arm, durations in asked.items():
        own = plan.setdefault(arm, {})
        for steps, new in durations.items():
            old = own.get(steps, new)
            if max(old.start, new.start) > min(old.stop, new.stop):
                raise ValueError(
                    f"seeds {spoken_span(old)}; {spoken_span(new)} would leave a gap in those of "
                    f"{arm} at {steps} steps"
                )
            own[steps] = range(min(old.start, new.start), max(old.stop, new.stop))
    return plan


def spoken_span(seeds: range) -> str:
    """Return ``2 to 5``."""
    return f"{seeds.start} to {seeds.stop - 1}"
