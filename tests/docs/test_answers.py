"""The commands of the answers print what their pages show."""

from __future__ import annotations

import pathlib
import re
import runpy
from itertools import filterfalse

import pytest

ROOT = pathlib.Path(__file__).parents[2]
COMMAND = re.compile(r"^python examples/answers/(\w+)\.py", re.MULTILINE)
SHOWN = re.compile(r"^```text\n(.*?)^```$", re.MULTILINE | re.DOTALL)
NEEDS = {"unmeasured": "mujoco"}  # an extra
#: What makes an answer shorter: it then prints only the first lines of what its page shows.
SHORTER = {"constants": {"statistics": False}}
#: How lines begin that are those of a program which may not be installed.
OTHERS = "mujoco.sysid:"


def is_of_others(line: str) -> bool:
    return line.startswith(OTHERS)


def printed_and_shown(
    name: str, options: dict[str, bool], capsys: pytest.CaptureFixture[str]
) -> tuple[list[str], list[str]]:
    """Return the lines that an answer's command prints, and those that its page shows."""
    if name in NEEDS:
        pytest.importorskip(NEEDS[name])
    page = (ROOT / "docs" / "answers" / f"{name}.md").read_text(encoding="utf-8")
    (script,) = COMMAND.findall(page)
    runpy.run_path(str(ROOT / "examples" / "answers" / f"{script}.py"))["main"](**options)
    printed = capsys.readouterr().out.splitlines()
    shown = "".join(SHOWN.findall(page)).splitlines()
    return list(filterfalse(is_of_others, printed)), list(filterfalse(is_of_others, shown))


@pytest.mark.parametrize("name", ["browser", "constants", "unmeasured"])
def test_an_answer_prints_what_its_page_shows(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    printed, shown = printed_and_shown(name, SHORTER.get(name, {}), capsys)
    assert len(printed) > 2
    assert printed == (shown[: len(printed)] if name in SHORTER else shown)


@pytest.mark.slow
@pytest.mark.parametrize("name", SHORTER)
def test_an_answer_prints_what_its_page_shows_in_full(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    printed, shown = printed_and_shown(name, {}, capsys)
    assert printed == shown
