"""The replicates of a study: for each arm and length of trial, a span of seeds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

Plan = dict[str, dict[int, range]]  # arm, then steps, then seeds
RUNS = "runs"


class ReplicateKey(NamedTuple):
    """The key of a replicate: an arm, the steps of its trials and a seed."""

    arm: str
    steps: int
    seed: int

    @property
    def name(self) -> str:
        """Its name for people."""
        return f"{self.arm}, {self.steps} steps, seed {self.seed}"

    @property
    def file(self) -> str:
        """Its file, relative to the study's folder."""
        return f"{RUNS}/{self.arm}/{self.steps}/{self.seed}.json"


def replicate_keys(plan: Plan) -> list[ReplicateKey]:
    """Return every replicate of a plan, by arm, steps and seed."""
    return [
        ReplicateKey(arm, steps, seed)
        for arm, durations in plan.items()
        for steps, seeds in durations.items()
        for seed in seeds
    ]


def read_plan(document: Mapping[str, Any]) -> Plan:
    """Return the plan in a study.json, whose ``replicates`` are as of ``written_plan``."""
    return {
        arm: {
            int(steps): range(seeds["first"], seeds["first"] + seeds["count"])
            for steps, seeds in document["replicates"][arm].items()
        }
        for arm in document["arms"]
    }


def written_plan(plan: Plan) -> dict[str, Any]:
    """Return a plan as ``replicates`` of study.json."""
    return {
        arm: {
            str(steps): {"first": seeds.start, "count": len(seeds)}
            for steps, seeds in sorted(durations.items())
        }
        for arm, durations in plan.items()
    }


def joined(held: Plan, asked: Plan) -> Plan:
    """Return the union of two plans.

    Raises
    ------
    ValueError
        If seeds of an arm would be missing between those of the two; the message names them.
    """
    plan = {arm: dict(durations) for arm, durations in held.items()}
    for arm, durations in asked.items():
        own = plan.setdefault(arm, {})
        for steps, new in durations.items():
            old = own.get(steps, new)
            if max(old.start, new.start) > min(old.stop, new.stop):
                raise ValueError(
                    f"seeds {old.start} to {old.stop - 1}; {new.start} to {new.stop - 1} would "
                    f"leave a gap in those of {arm} at {steps} steps"
                )
            own[steps] = range(min(old.start, new.start), max(old.stop, new.stop))
    return plan
