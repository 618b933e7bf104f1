"""What ``--help`` and ``-H`` say of every command of the project."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import pytest

import aquafish.cli
import eea.__main__
import experiments.real.command
import gait.__main__
from aquafish_gym.runs.command_help import print_help
from aquafish_gym.runs.command_line import parse

ROOT = Path(__file__).parents[1]
MOST_OPTIONS = 12
COMMANDS: dict[str, str] = {
    "recover": aquafish.cli.CASE_STUDY[0],
    "view": aquafish.cli.VIEW[0],
    "page": aquafish.cli.PAGE[0],
    **{name: str(place) for name, (place, _) in eea.__main__.COMMANDS.items()},
    **{name: str(place) for name, (place, _) in gait.__main__.COMMANDS.items()},
    **{name: str(place) for name, (place, _) in experiments.real.command.COMMANDS.items()},
}
RUN = re.compile(r"run_command_line\(\s*\"([\w.]+)\",\s*(\w+)")
SCRIPTS = {
    found[1]: f"{'.'.join(path.relative_to(ROOT).with_suffix('').parts)}:{found[2]}"
    for folder in ("examples", "experiments")
    for path in sorted((ROOT / folder).rglob("*.py"))
    if (found := RUN.search(path.read_text(encoding="utf-8"))) and found[2] != "COMMANDS"
}


@pytest.fixture(params=[*COMMANDS, *SCRIPTS])
def command(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> type[Any]:
    """Return the class of a command."""
    monkeypatch.setenv("COLUMNS", "100")  # one column of options
    found: type[Any] = resolve_name({**COMMANDS, **SCRIPTS}[request.param])
    return found


def options(text: str) -> list[str]:
    """Return what the help says of each option, with its names."""
    lines = [line.strip("│╭╮╰╯─ ") for line in text.partition("usage:")[2].splitlines()]
    rows: list[str] = []
    for line in lines[1:]:
        if line.startswith("-") and not line.startswith("---"):
            rows.append(line)
        elif rows and line:
            rows[-1] += f" {line}"
    return rows


def test_all_commands_are_found() -> None:
    assert {"recover", "view", "run", "infer", "evolve", "film", "export"} <= set(COMMANDS)
    experiments = {
        "experiments.gaits", "experiments.gaits.library", "experiments.league",
        "experiments.league.archive", "experiments.league.policies", "experiments.reality_gap",
        "experiments.scores",
    }  # fmt: skip
    assert experiments <= set(SCRIPTS)


def test_help_has_an_example_that_parses(
    command: type[Any], capsys: pytest.CaptureFixture[str]
) -> None:
    print_help(command, "aquafish do")
    short = capsys.readouterr().out
    assert f"Example:\n  aquafish do {command.example}\n" in short
    made = parse(command, "aquafish do", shlex.split(command.example))
    assert isinstance(made, command)


def test_help_explains_few_options_and_all_of_them(
    command: type[Any], capsys: pytest.CaptureFixture[str]
) -> None:
    for full in (False, True):
        print_help(command, "aquafish do", full)
        rows = options(capsys.readouterr().out)
        assert len(rows) > 1
        if not full:
            assert len(rows) <= MOST_OPTIONS
        for row in rows[1:]:  # after --help
            assert re.search(r"[A-Z].*[a-z]{2}.*[.:]", row.partition("(default")[0]), row


def test_main_options_are_options(command: type[Any], capsys: pytest.CaptureFixture[str]) -> None:
    named = getattr(command, "main_options", ())
    print_help(command, "aquafish do")
    short = capsys.readouterr().out
    groups = {"config", "settings", "controllers"}  # without a name of their own, or a positional
    for name in named:
        option = {"columns": "map"}.get(name, name).replace("_", "-")
        assert name in groups or f"--{option}" in short, name
