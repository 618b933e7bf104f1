"""Names that users import are removed on purpose alone: ``public_names.json`` lists them.

Whoever takes one out of the list says so in the changelog, with the reason.
"""

from __future__ import annotations

import importlib
import json
from pathlib import Path

import pytest

from aquafish.cli import main
from aquafish_gym.utils.validation import MissingExtraError

NAMES: dict[str, list[str]] = json.loads((Path(__file__).parent / "public_names.json").read_text())
COMMANDS = (
    "recover", "view", "page", "run", "infer", "logs", "watch", "study", "plot", "evolve",
    "transfer", "baseline", "film", "export",
)  # fmt: skip
SCRIPTS = ("damage_recovery.py", "recovery_league.py")


@pytest.mark.parametrize("module", NAMES)
def test_the_module_has_its_names(module: str) -> None:
    try:
        found = importlib.import_module(module)
    except MissingExtraError as error:
        pytest.skip(str(error))
    assert [name for name in NAMES[module] if not hasattr(found, name)] == []
    # And a new public name is listed.
    assert sorted(getattr(found, "__all__", NAMES[module])) == NAMES[module]


def test_every_command_is_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    said = capsys.readouterr().out
    assert [name for name in COMMANDS if f" {name} " not in said] == []


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_script_that_users_call_is_there(name: str) -> None:
    assert (Path(__file__).parents[1] / "examples" / name).is_file()
