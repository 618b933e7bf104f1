"""Every public command and environment gives what it gave: see golden.py."""

from __future__ import annotations

from typing import Any

import pytest

from tests.golden import COMMANDS, ENVIRONMENTS, NAMES, digest, kept


def test_every_case_has_a_hash() -> None:
    assert set(kept()) == set(NAMES)


#: Cases of many seconds, whose parts other cases and tests have.
NIGHTLY = (
    "agent episode", "evolve station", "league row", "study", "TailFish-v0 pybullet",
)  # fmt: skip


def case(name: str) -> Any:
    """Return a case as a test's parameter, with its marks."""
    marks = [pytest.mark.pybullet] if "pybullet" in name else []
    marks += [pytest.mark.slow] if name in NIGHTLY else []
    return pytest.param(name, marks=marks)


@pytest.mark.quick
@pytest.mark.parametrize("name", [case(name) for name in ENVIRONMENTS])
def test_environment_is_unchanged(name: str) -> None:
    assert digest(name) == kept()[name], f"see python -m tests.golden --show '{name}'"


# The case study takes long and is run once: tests/aquafish/test_recovery.py compares its hash.
@pytest.mark.parametrize("name", [case(name) for name in COMMANDS if name != "recover"])
def test_command_is_unchanged(name: str) -> None:
    assert digest(name) == kept()[name], f"see python -m tests.golden --show '{name}'"
