"""Each answer's command prints what its page shows, and writes the picture beside it."""

from __future__ import annotations

import pathlib
import re
import runpy
import shlex
import sys
from collections.abc import Callable
from importlib import import_module

import pytest
from llvmlite import binding
from PIL import Image

from aquafish_gym.runs.command_line import run_command_line

ROOT = pathlib.Path(__file__).parents[2]
COMMAND = re.compile(r"^```sh\n(python examples/answers/[^\n]+)\n```$", re.MULTILINE)
SHOWN = re.compile(r"^```text\n(.*?)^```$", re.MULTILINE | re.DOTALL)
PAGES = {
    page.stem: page
    for page in sorted((ROOT / "docs" / "answers").glob("*.md"))
    if page.stem != "index"
}
SLOW = ("constants", "same_bytes")  # commands that take longer than some seconds
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
    if name == "same_bytes" and not binding.get_host_cpu_features().get("avx2"):
        pytest.skip("this machine cannot run the instructions of the page's")
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
        with Image.open(written) as new, Image.open(PAGES[name].with_suffix(".png")) as committed:
            assert new.size == committed.size


def test_constants_are_followed_as_the_page_shows(capsys: pytest.CaptureFixture[str]) -> None:
    """Without the counts over many swims, which take long."""
    script = ROOT / "examples" / "answers" / "constants.py"
    runpy.run_path(str(script))["main"](statistics=False)
    printed = lines_of(capsys.readouterr().out)
    assert len(printed) > 8
    assert printed == shown_by("constants")[: len(printed)]


SCRIPT = ROOT / "examples" / "answers" / "same_bytes.py"
FUNCTIONS = """
import os
def steady():
    return {"a": [1, 2.5, "text", None], "b": b"bytes"}
def moody():
    return [1.0, 4.0 if os.environ.get("OMP_NUM_THREADS") == "2" else 5.0]
def growing():
    return [1.0] * int(os.environ.get("OMP_NUM_THREADS", 0))
def odd():
    return object()
"""


@pytest.fixture
def check(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., int]:
    """Return what calls the command with functions, with threads as the only settings."""
    (tmp_path / "strangers.py").write_text(FUNCTIONS)
    monkeypatch.chdir(tmp_path)
    few = {"threads": [{"OMP_NUM_THREADS": "2"}]}
    monkeypatch.syspath_prepend(SCRIPT.parent)
    script = import_module("same_bytes")
    monkeypatch.setattr(script, "emulations", lambda: few)

    def call(*names: str) -> int:
        functions = [f"strangers:{name}" for name in names]
        return int(run_command_line("same_bytes", script.SameBytes, functions))

    return call


def test_a_function_of_the_same_bytes_ends_with_0(
    check: Callable[..., int], capsys: pytest.CaptureFixture[str]
) -> None:
    assert check("steady") == 0
    assert capsys.readouterr().out.split() == ["threads", "strangers:steady", "same"]


def test_settings_that_change_bytes_are_named(
    check: Callable[..., int], capsys: pytest.CaptureFixture[str]
) -> None:
    assert check("steady", "moody", "growing") == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[-2:] == [
        "strangers:moody differs by 2e-01 with OMP_NUM_THREADS='2'",
        "strangers:growing differs by other numbers with OMP_NUM_THREADS='2'",
    ]


def test_a_function_that_cannot_be_compared_is_refused(
    check: Callable[..., int], capsys: pytest.CaptureFixture[str]
) -> None:
    assert check("odd") == 2
    assert "it returned object" in capsys.readouterr().err


def test_an_imported_file_makes_our_kernel_new_and_not_numbas() -> None:
    assert runpy.run_path(str(SCRIPT))["stale"]() == [(2.0, 2.0), (2.0, 3.0)]
