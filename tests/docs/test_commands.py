"""The commands on the pages exist, and so do their options."""

from __future__ import annotations

import pathlib
import re
import shlex
from functools import partial

import pytest

import aquafish.cli
import eea.__main__
import gait.__main__
import instruments.__main__
from aquafish_gym.runs.command_line import run_command_line
from experiments.gaits.ceiling import Ceiling
from experiments.league.command import League
from experiments.league.thresholds import Thresholds
from experiments.reality_gap.command import Gap
from experiments.scores.command import Scores

ROOT = pathlib.Path(__file__).parents[2]
PAGES = sorted(
    page
    for page in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    if "_build" not in page.parts
)
BLOCK = re.compile(r"^```sh\n(.*?)^```$", re.MULTILINE | re.DOTALL)
# Programs of one command, without a name.
EXPERIMENTS = {
    "python examples/recovery_league.py": League,
    "python -m experiments.gaits": Ceiling,
    "python -m experiments.league.thresholds": Thresholds,
    "python -m experiments.reality_gap": Gap,
    "python -m experiments.scores": Scores,
}
PROGRAMS = {
    "aquafish": (
        aquafish.cli.main,
        {"recover", "view", "page", *eea.__main__.COMMANDS, *gait.__main__.COMMANDS},
    ),
    "python -m eea": (eea.__main__.main, eea.__main__.COMMANDS),
    "python -m gait": (gait.__main__.main, gait.__main__.COMMANDS),
    "python -m instruments": (instruments.__main__.main, instruments.__main__.COMMANDS),
    **{
        program: (partial(run_command_line, program, command), {""})
        for program, command in EXPERIMENTS.items()
    },
}


def written(text: str) -> list[tuple[str, str, list[str]]]:
    """Return the commands of a page's shell blocks: the program, the command, its options."""
    found = []
    for line in "".join(BLOCK.findall(text)).replace("\\\n", " ").splitlines():
        words = shlex.split(line, comments=True)
        for program in PROGRAMS:
            beginning = program.split()
            if words[: len(beginning)] == beginning:
                rest = words[len(beginning) :]
                name = "" if program in EXPERIMENTS else rest.pop(0)
                options = [word for word in rest if word.startswith("--")]
                found.append((program, name, options))
    return found


WRITTEN = {page: written(page.read_text(encoding="utf-8")) for page in PAGES}


@pytest.fixture(scope="module")
def described() -> dict[tuple[str, str], str]:
    """What each command's ``-H`` says."""
    return {}


@pytest.mark.parametrize("page", [p for p in PAGES if WRITTEN[p]], ids=lambda p: p.stem)
def test_a_page_names_commands_and_options_that_exist(
    page: pathlib.Path,
    described: dict[tuple[str, str], str],
    capsys: pytest.CaptureFixture[str],
) -> None:
    for program, name, options in WRITTEN[page]:
        main, commands = PROGRAMS[program]
        assert name in commands
        if (program, name) not in described:
            assert main([*filter(None, [name]), "-H"]) == 0
            described[program, name] = capsys.readouterr().out
        for option in options:
            said = described[program, name]
            assert re.search(rf"{option}\b", said), f"{program} {name} has no {option}"


def test_commands_are_found_on_the_pages() -> None:
    commands = [command for found in WRITTEN.values() for command in found]
    names = {name for _, name, _ in commands}
    assert {"recover", "study", "evolve", "transfer", "infer"} <= names
    assert set(EXPERIMENTS) <= {program for program, _, _ in commands}
