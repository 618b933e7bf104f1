"""The one command: quick to help, and each of its commands is that of the package it is from."""

from __future__ import annotations

import subprocess
import sys
from pkgutil import resolve_name

import pytest

import eea.__main__
import eea.cli.run
import gait.cli
from aquafish.cli import COMMANDS, _Commands, main, usage


def test_help_lists_every_command_and_loads_nothing_heavy() -> None:
    code = (
        "import sys; from aquafish.cli import main; code = main(['--help']); "
        "heavy = {'numba', 'matplotlib', 'pybullet', 'scipy', 'pandas', 'neat'}; "
        "print(*sorted(heavy & set(sys.modules)), file=sys.stderr); sys.exit(code)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr.split() == []
    assert done.stdout == usage() + "\n"
    assert all(f"\n  {name} " in done.stdout for name in COMMANDS)
    assert max(map(len, done.stdout.splitlines())) <= 100


def test_its_commands_are_those_of_the_packages() -> None:
    ours = {name: resolve_name(where) for name, (where, _) in COMMANDS.items()}
    for case_study, room in (("recover", "recovery"), ("gap", "gap"), ("scores", "scores")):
        assert ours.pop(case_study).__module__ == f"aquafish.{room}.command"
    theirs: dict[str, object] = {**eea.__main__.COMMANDS, **gait.cli.COMMANDS}
    # As eea run, with the case study's settings: under aquafish, recover is all of that study.
    assert theirs.pop("recover") is eea.cli.run.Recover
    assert ours == theirs


def test_a_study_is_read_as_by_its_own_command() -> None:
    words = ["study", "--conditions", "none", "ideal", "--estimation.population", "6", "--out", "x"]
    ours, theirs = _Commands().cli(prog="", args=words), eea.__main__.Commands().cli(args=words)
    assert ours == theirs
    assert ours.study() == theirs.study()


@pytest.mark.parametrize(("wrong", "right"), [("evolv", "evolve"), ("recovr", "recover")])
def test_an_unknown_command_is_told_the_nearest(
    wrong: str, right: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([wrong]) == 2
    said = capsys.readouterr().err
    assert f"did you mean {right!r}?" in said
    assert len(said.splitlines()) == 1


def test_without_a_command_its_use_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 2
    assert capsys.readouterr().out.startswith("usage: aquafish COMMAND")


@pytest.mark.parametrize("name", COMMANDS)
def test_each_command_has_help(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([name, "--help"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("usage: ")
    assert f" {name} " in said.splitlines()[0]
