"""Names that users import are removed on purpose alone: ``public_names.json`` lists them.

Whoever takes one out of the list says so in the changelog, with the reason.
"""

from __future__ import annotations

import importlib
import json
from pathlib import Path

import pytest

from aquafish.cli import main

NAMES: dict[str, list[str]] = json.loads((Path(__file__).parent / "public_names.json").read_text())
COMMANDS = (
    "recover", "view", "page", "run", "infer", "logs", "watch", "study", "plot", "evolve",
    "transfer", "baseline", "film", "export",
)  # fmt: skip
SCRIPTS = ("damage_recovery.py", "recovery_league.py")


@pytest.mark.parametrize("module", NAMES)
def test_the_module_has_its_names(module: str) -> None:
    found = importlib.import_module(module)
    assert [name for name in NAMES[module] if not hasattr(found, name)] == []


@pytest.mark.parametrize(
    "module", [name for name in NAMES if "__all__" in vars(importlib.import_module(name))]
)
def test_a_new_public_name_is_listed(module: str) -> None:
    assert sorted(importlib.import_module(module).__all__) == NAMES[module]


def test_every_command_is_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    said = capsys.readouterr().out
    assert [name for name in COMMANDS if f" {name} " not in said] == []


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_script_that_users_call_is_there(name: str) -> None:
    assert (Path(__file__).parents[1] / "examples" / name).is_file()
