"""The one command: it has the commands of every package, and prints its help quickly."""

from __future__ import annotations

import subprocess
import sys

import pytest

import eea.__main__
import gait.__main__
from aquafish.cli import main

COMMANDS = ("recover", "view", "page", *eea.__main__.COMMANDS, *gait.__main__.COMMANDS)


def test_help_lists_every_command_and_loads_nothing_heavy() -> None:
    code = (
        "import sys; from aquafish.cli import main; code = main(['--help']); "
        "heavy = {'numba', 'matplotlib', 'pybullet', 'scipy', 'pandas', 'neat'}; "
        "print(*sorted(heavy & set(sys.modules)), file=sys.stderr); sys.exit(code)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr.split() == []
    assert all(f"\n  {name} " in done.stdout for name in COMMANDS)
    assert max(map(len, done.stdout.splitlines())) <= 100


@pytest.mark.parametrize("name", COMMANDS)
def test_each_command_has_help(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([name, "--help"]) == 0
    said = capsys.readouterr().out
    (usage,) = (line for line in said.splitlines() if line.startswith("usage: "))
    assert f" {name} " in usage
