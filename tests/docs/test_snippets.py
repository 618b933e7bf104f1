"""The Python on the tutorial's and the how-tos' pages runs, with fewer rounds and generations."""

from __future__ import annotations

import pathlib
import re

import gymnasium as gym
import pytest

import aquafish_gym  # noqa: F401  # registered before the registry is copied

DOCS = pathlib.Path(__file__).parents[2] / "docs"
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)
# What makes a page quick: the page's words, and what they become here.
SMALLER = {
    'search="cma"': 'search="cma", generations=1, screened=6',
    "EEAConfig(rounds=3)": "EEAConfig(rounds=1)",
    "learn(4096)": "learn(2048)",
}
PAGES = {
    "tutorial.md": ["gait for the self-model", "(1, 256, 3)", "(0.4, 1.6, 0.1) -> (0.4, 0.8, 0.1)"],
    "environments/damage.md": ["[0 0]", "ImuLog(", "\n1 [1.6 "],
    "environments/scores.md": ["PPO, fins {'whole': '6", "\nmine {'whole': '1.3"],
    "howto/robot.md": ["MorphologyEstimate(out-of-band, 1 round", "\nlength: 0.6"],
    "howto/task.md": ["return -"],
    "howto/train.md": ["episodes", "mean return "],
    "howto/controller.md": ["Swim(distance 8.19 units in 20 s)", "random poses"],
    "howto/gait.md": ["Evolved(", "[", "units in 20 s"],
    "howto/sample.md": ["evolved for both: Controller(", "on the right one", "with a gait for it"],
    "howto/logs.md": ["OBJ_FIT 1.000", "left flipper: 0.800 long", "Out-of-Band Inference: 0."],
}


def snippets(page: str) -> str:
    blocks = BLOCK.findall((DOCS / page).read_text(encoding="utf-8"))
    assert blocks, f"{page} has no Python"
    return "\n".join(blocks)


@pytest.mark.parametrize(
    "page",
    [pytest.param(p, marks=pytest.mark.slow) if p == "tutorial.md" else p for p in PAGES],
)
def test_a_page_does_what_it_says(
    page: str,
    tmp_path: pathlib.Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(DOCS.parent if page == "environments/scores.md" else tmp_path)
    monkeypatch.syspath_prepend(DOCS.parent / "examples")
    monkeypatch.setattr("gymnasium.envs.registration.registry", dict(gym.registry))
    code = snippets(page)
    for words, small in SMALLER.items():
        code = code.replace(words, small)
    exec(compile(code, page, "exec"), {"__name__": "__main__"})
    said = capsys.readouterr().out
    for words in PAGES[page]:
        assert words in said


def test_every_page_with_python_is_run() -> None:
    pages = [DOCS / "tutorial.md", *(DOCS / "environments" / f for f in ("damage.md", "scores.md"))]
    pages += (DOCS / "howto").glob("*.md")
    with_python = {str(page.relative_to(DOCS)) for page in pages if BLOCK.search(page.read_text())}
    assert with_python == set(PAGES)


def test_what_is_made_smaller_is_on_a_page() -> None:
    everything = "".join(map(snippets, PAGES))
    assert [words for words in SMALLER if words not in everything] == []
