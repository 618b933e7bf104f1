"""The commands on the pages exist, and so do their options."""

from __future__ import annotations

import pathlib
import re
import shlex
from functools import partial
from itertools import pairwise

import pytest

import aquafish.cli
import eea.__main__
import gait.__main__
import instruments.__main__
from aquafish_gym.runs.command_line import run_command_line
from experiments.gaits.ceiling import Ceiling
from experiments.league.thresholds import Thresholds
from experiments.league.whole import WholeLeague
from experiments.reality_gap.command import Gap
from experiments.results import RESULTS
from experiments.scores.command import Scores

ROOT = pathlib.Path(__file__).parents[2]
PAGES = sorted(
    page
    for page in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    if "_build" not in page.parts
)
BLOCK = re.compile(r"^```sh\n(.*?)^```$", re.MULTILINE | re.DOTALL)
# Programs of one command, without a name.
FOLDERS = {"--out", "--data"}
EXPERIMENTS = {
    "python -m experiments.gaits": Ceiling,
    "python -m experiments.league.thresholds": Thresholds,
    "python -m experiments.league.whole": WholeLeague,
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


#: Programs of committed results, as pages show them.
MADE = re.compile(r"`((?:python -m (?:experiments|instruments)|aquafish recover --held-out)[^`]*)`")
#: What makes a part of a result, or other than a result.
OTHERS = {
    "aquafish recover --held-out --seed 2",
    "python -m experiments.NAME",
    "python -m experiments.league.whole --scheduler tcp://HOST:8786",
    "python -m experiments.league.whole --tables NAME",
    "python -m experiments.scores --tasks forward --entries 'PPO, fins' 'CMA-ES, fins'",
    "python -m instruments.benchmarks",
    "python -m instruments.inference",
    "python -m instruments.inference.discrepancy --seed 1",
    "python -m instruments.verification --only reactive",
    "python -m instruments.verification --only real_fish",
}


def made(text: str) -> set[str]:
    """Return the commands in a text that make results, without folders."""
    lines = "".join(BLOCK.findall(text)).replace("\\\n", " ").splitlines()
    lines += MADE.findall(" ".join(BLOCK.sub("", text).split()))
    found = (shlex.split(line, comments=True) for line in lines if MADE.match(f"`{line}`"))
    return {without_folders(words) for words in found}


def without_folders(words: list[str]) -> str:
    """Return a command line without --out, --data and their folders."""
    kept = [w for before, w in pairwise(["", *words]) if {before, w}.isdisjoint(FOLDERS)]
    return shlex.join(kept)


def test_a_page_makes_a_result_by_the_command_of_its_record() -> None:
    """That is the one of ``make results``, which docs/provenance.md has."""
    recorded = {without_folders(shlex.split(c)) for one in RESULTS.values() for c in one.commands}
    shown = set()
    for page in (*PAGES, ROOT / "paper" / "paper.md"):
        if page.name != "provenance.md":
            shown |= made(page.read_text(encoding="utf-8"))
    assert shown - recorded == OTHERS
