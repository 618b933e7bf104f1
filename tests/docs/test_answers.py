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
#: How lines begin that are those of a program which may not be installed.
OTHERS = "mujoco.sysid:"


def is_of_others(line: str) -> bool:
    return line.startswith(OTHERS)


@pytest.mark.parametrize("name", ["unmeasured"])
def test_an_answer_prints_what_its_page_shows(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    if name in NEEDS:
        pytest.importorskip(NEEDS[name])
    page = (ROOT / "docs" / "answers" / f"{name}.md").read_text(encoding="utf-8")
    (script,) = COMMAND.findall(page)
    runpy.run_path(str(ROOT / "examples" / "answers" / f"{script}.py"))["main"]()
    printed = capsys.readouterr().out.splitlines()
    shown = "".join(SHOWN.findall(page)).splitlines()
    assert list(filterfalse(is_of_others, printed)) == list(filterfalse(is_of_others, shown))
