"""Each answer's command prints what its page shows, and writes the picture beside it."""

from __future__ import annotations

import pathlib
import re
import runpy
import shlex
import sys

import numpy as np
import pytest

from tests.pictures import pixels

ROOT = pathlib.Path(__file__).parents[2]
COMMAND = re.compile(r"^```sh\n(python examples/answers/[^\n]+)\n```$", re.MULTILINE)
SHOWN = re.compile(r"^```text\n(.*?)^```$", re.MULTILINE | re.DOTALL)
PAGES = {
    page.stem: page
    for page in sorted((ROOT / "docs" / "answers").glob("*.md"))
    if page.stem != "index"
}
SLOW = ("constants",)  # commands that take longer than some seconds
NEEDS = {"unmeasured": "mujoco"}  # an extra
#: How lines begin that are those of a program which may not be installed.
OTHERS = "mujoco.sysid:"


def lines_of(text: str) -> list[str]:
    """Return the lines of what is printed or shown, without those of other programs."""
    return [line for line in text.splitlines() if not line.startswith(OTHERS)]


def shown_by(name: str) -> list[str]:
    """Return the lines of the first output that a page shows, which is its command's."""
    return lines_of(SHOWN.findall(PAGES[name].read_text(encoding="utf-8"))[0])


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow) if n in SLOW else n for n in PAGES]
)
def test_the_command_of_a_page_prints_what_it_shows(
    name: str,
    tmp_path: pathlib.Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    if name in NEEDS:
        pytest.importorskip(NEEDS[name])
    line = COMMAND.findall(PAGES[name].read_text(encoding="utf-8"))[0]
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    words = shlex.split(line, comments=True)[1:]
    monkeypatch.setattr(sys, "argv", words)
    code: object = None
    try:
        runpy.run_path(words[0], run_name="__main__")
    except SystemExit as ended:
        code = ended.code
    assert not code
    printed = lines_of(capsys.readouterr().out)
    assert len(printed) > 2
    assert printed == shown_by(name)
    for written in (tmp_path / "out").rglob("*.png"):
        both = (pixels(path, (60, 40)) for path in (written, PAGES[name].with_suffix(".png")))
        others = np.abs(np.subtract(*both)).max(axis=-1) > 0.1  # such as the points of OTHERS
        assert others.mean() < 0.02


def test_constants_are_followed_as_the_page_shows(capsys: pytest.CaptureFixture[str]) -> None:
    """Without the counts over many swims, which take long."""
    script = ROOT / "examples" / "answers" / "constants.py"
    runpy.run_path(str(script))["main"](statistics=False)
    printed = lines_of(capsys.readouterr().out)
    assert len(printed) > 8
    assert printed == shown_by("constants")[: len(printed)]
