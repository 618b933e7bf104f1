"""The Python on the pages and the commands of the answers run, and print what the pages show."""

from __future__ import annotations

import pathlib
import re
import runpy
import shlex
import sys
from collections.abc import Iterator

import gymnasium as gym
import numpy as np
import pytest

import aquafish_gym  # noqa: F401  # registered before the registry is copied
import eea
from aquafish_gym.damage import TIERS
from gait import EvolveConfig
from tests.pictures import pixels

ROOT = pathlib.Path(__file__).parents[2]
BLOCK = re.compile(
    r"^```python\n(?P<code>.*?)^```$(?:\n\n```text\n(?P<shown>.*?)^```$)?", re.MULTILINE | re.DOTALL
)
CONFIGS = ("FitConfig", "JointConfig", "PaperConfig")
#: Such as ``FitConfig(bodies=16, descents=8)``.
SETTINGS = re.compile(rf"\b(?:{'|'.join(CONFIGS)}|EvolveConfig)\((?:[^()`]|\([^()`]*\))*\)")
# The quick run searches less. It compares the output of a block that it changed without numbers.
SMALLER = {
    "EvolveConfig(seed=0": (
        "EvolveConfig(generations=1, random_candidates=6, restarts=1, poses=2, seed=0"
    ),
    "learn(600_000)": "learn(6_400)",
    "run(evaluate, 100)": "run(evaluate, 1)",
}
PAGES = {
    str(page.relative_to(ROOT)): BLOCK.findall(page.read_text(encoding="utf-8"))
    for page in sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])
    if "_build" not in page.parts
}
WITH_PYTHON = [page for page, blocks in PAGES.items() if blocks]
CHECKED_IN_FULL = ("README.md", "docs/tutorial.md")
# Nightly: their blocks take many seconds, or compile the kernels of other fish.
LONG = (
    "docs/environments/fish.md",
    "docs/howto/body.md",
    "docs/howto/export.md",
    "docs/howto/logs.md",
    "docs/howto/robot.md",
    "docs/howto/train.md",
    "docs/swimming_on.md",
)


def outputs(
    page: str, smaller: dict[str, str], capsys: pytest.CaptureFixture[str]
) -> Iterator[tuple[str, str]]:
    """Run the page's blocks one after another; yield what each shows and what it printed."""
    names = {"__name__": "__main__"}
    searched_less = False
    for code, shown in PAGES[page]:
        short = code
        for words, small in smaller.items():
            short = short.replace(words, small)
        searched_less |= short != code
        exec(compile(short, page, "exec"), names)
        printed = capsys.readouterr().out
        if shown and searched_less:
            shown, printed = (re.sub(r"[-+]?\d+(\.\d+)?", "#", text) for text in (shown, printed))
        if shown:
            yield shown, printed


@pytest.fixture(autouse=True)
def _as_a_reader(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Run in an empty folder where the pages' committed files are found; forget new tiers."""
    tiers = dict(TIERS)
    for folder in ("docs", "examples", "experiments"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(ROOT / "examples")
    monkeypatch.setattr("gymnasium.envs.registration.registry", dict(gym.registry))
    yield
    TIERS.clear()
    TIERS.update(tiers)


@pytest.mark.parametrize(
    "page",
    [pytest.param(page, marks=pytest.mark.slow if page in LONG else ()) for page in WITH_PYTHON],
)
def test_a_page_prints_what_it_shows(page: str, capsys: pytest.CaptureFixture[str]) -> None:
    for shown, printed in outputs(page, SMALLER, capsys):
        assert printed == shown


def test_settings_in_a_sentence_or_a_table_are_accepted() -> None:
    names = {"EvolveConfig": EvolveConfig, **{n: getattr(eea, n) for n in CONFIGS}}
    found = 0
    for page in PAGES:
        text = (ROOT / page).read_text(encoding="utf-8")
        for words in SETTINGS.findall(re.sub("^```.*?^```$", "", text, flags=re.M | re.S)):
            eval(words, dict(names))
            found += 1
    assert found > 0


@pytest.mark.slow
@pytest.mark.parametrize("page", CHECKED_IN_FULL)
def test_a_page_prints_what_it_shows_in_full(page: str, capsys: pytest.CaptureFixture[str]) -> None:
    for shown, printed in outputs(page, {}, capsys):
        assert printed == shown


def test_what_is_made_smaller_is_on_a_page() -> None:
    everything = "".join(code for blocks in PAGES.values() for code, _ in blocks)
    assert [words for words in SMALLER if words not in everything] == []


# Each answer's command prints what its page shows, and writes the picture beside it.

COMMAND = re.compile(r"^```sh\n(python examples/answers/[^\n]+)\n```$", re.MULTILINE)
SHOWN = re.compile(r"^```text\n(.*?)^```$", re.MULTILINE | re.DOTALL)
ANSWERS = {
    page.stem: page
    for page in sorted((ROOT / "docs" / "answers").glob("*.md"))
    if page.stem != "index"
}
SLOW = ("constants", "unmeasured")  # commands that take longer than some seconds
NEEDS = {"unmeasured": "mujoco"}  # an extra
#: How lines begin that are those of a program which may not be installed.
OTHERS = "mujoco.sysid:"


def lines_of(text: str) -> list[str]:
    """Return the lines of what is printed or shown, without those of other programs."""
    return [line for line in text.splitlines() if not line.startswith(OTHERS)]


def shown_by(name: str) -> list[str]:
    """Return the lines of the first output that a page shows, which is its command's."""
    return lines_of(SHOWN.findall(ANSWERS[name].read_text(encoding="utf-8"))[0])


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow) if n in SLOW else n for n in ANSWERS]
)
def test_the_command_of_a_page_prints_what_it_shows(
    name: str,
    tmp_path: pathlib.Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    if name in NEEDS:
        pytest.importorskip(NEEDS[name])
    line = COMMAND.findall(ANSWERS[name].read_text(encoding="utf-8"))[0]
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
        both = (pixels(path, (60, 40)) for path in (written, ANSWERS[name].with_suffix(".png")))
        others = np.abs(np.subtract(*both)).max(axis=-1) > 0.1  # such as the points of OTHERS
        assert others.mean() < 0.02


@pytest.mark.slow
def test_constants_are_followed_as_the_page_shows(capsys: pytest.CaptureFixture[str]) -> None:
    """Without the counts over many swims, which take long."""
    script = ROOT / "examples" / "answers" / "constants.py"
    runpy.run_path(str(script))["main"](statistics=False)
    printed = lines_of(capsys.readouterr().out)
    assert len(printed) > 8
    assert printed == shown_by("constants")[: len(printed)]
