"""What is done before anything is timed: a robot for nothing, so that all is compiled."""

from __future__ import annotations

from tests.inference.cases import Case, measure


def rehearse(case: Case) -> None:
    """Infer a robot, and forget it."""
    measure(case)
