"""The commands on the pages exist, and so do their options."""

from __future__ import annotations

import pathlib
import re
import shlex

import pytest

from aquafish.cli import COMMANDS, main

ROOT = pathlib.Path(__file__).parents[2]
PAGES = sorted(
    page
    for page in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    if "_build" not in page.parts
)
BLOCK = re.compile(r"^```sh\n(.*?)^```$", re.MULTILINE | re.DOTALL)
# ``python -m eea recover`` is ``aquafish infer``; the other names are the same.
BEGINNINGS = {("aquafish",): {}, ("python", "-m", "eea"): {"recover": "infer"}}
BEGINNINGS[("python", "-m", "gait")] = {}


def written(text: str) -> list[tuple[str, list[str]]]:
    """Return the commands of a page's shell blocks: the name as aquafish has it, its options."""
    found = []
    for line in "".join(BLOCK.findall(text)).replace("\\\n", " ").splitlines():
        words = tuple(shlex.split(line, comments=True))
        for beginning, names in BEGINNINGS.items():
            if words[: len(beginning)] == beginning:
                name, *rest = words[len(beginning) :]
                options = [word for word in rest if word.startswith("--")]
                found.append((names.get(name, name), options))
    return found


WRITTEN = {page: written(page.read_text(encoding="utf-8")) for page in PAGES}


@pytest.fixture(scope="module")
def described() -> dict[str, str]:
    """What each command's ``--help`` says."""
    return {}


@pytest.mark.parametrize("page", [p for p in PAGES if WRITTEN[p]], ids=lambda p: p.stem)
def test_a_page_names_commands_and_options_that_exist(
    page: pathlib.Path, described: dict[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    for name, options in WRITTEN[page]:
        assert name in COMMANDS
        if name not in described:
            assert main([name, "--help"]) == 0
            described[name] = capsys.readouterr().out
        for option in options:
            assert re.search(rf"{option}\b", described[name]), f"{name} has no {option}"


def test_commands_are_found_on_the_pages() -> None:
    names = {name for commands in WRITTEN.values() for name, _ in commands}
    assert {"recover", "study", "evolve", "transfer", "infer", "merge", "plot"} <= names
