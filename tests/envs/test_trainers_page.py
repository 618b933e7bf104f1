"""The page of trainers has a short block for each, and the command fails where a block does."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tests.trainers import __main__ as command
from tests.trainers.page import PAGE, Trainer, form, read_trainers, score, shown_line

TRAINERS = read_trainers(PAGE.read_text(encoding="utf-8"))
SHOWN = shown_line(PAGE.read_text(encoding="utf-8"))


def test_each_trainer_has_a_block_of_at_most_15_lines() -> None:
    lengths = {name: len(one.code.splitlines()) for name, one in TRAINERS.items()}
    names = "stable-baselines3 cleanrl torchrl skrl tianshou rllib minari"
    assert list(lengths) == names.split()
    assert max(lengths.values()) <= 15
    assert all("print(evaluate(" in one.code for one in TRAINERS.values())


def test_a_score_is_found_by_its_form() -> None:
    assert form(SHOWN) == "# [#, #] in # episodes"
    assert score("50%\r100%\n-0.4 [-1.0, 1.4] in 10 episodes\nclosed\n", SHOWN) == (
        "-0.4 [-1.0, 1.4] in 10 episodes"
    )
    assert score("nan [nan, nan] in 10 episodes\n", SHOWN) is None


@pytest.mark.parametrize(
    ("code", "status"),
    [(f"print({SHOWN!r})", 0), ("print('trained')", 1), ("raise ValueError('no such env')", 1)],
)
def test_the_command_fails_where_a_block_does(
    code: str, status: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    block = Trainer("Mine", "-e .", "py", code)
    monkeypatch.setattr(command, "read_trainers", lambda _: {"mine": block})
    monkeypatch.setattr(command, "install", lambda *_: Path(sys.executable))
    assert command.main(["Mine"]) == status
    said = capsys.readouterr()
    assert (f"Mine: {SHOWN}" in said.out) == (status == 0)
    assert ("failed: mine" in said.err) == (status == 1)


def test_a_name_that_the_page_lacks_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main(["skrll"]) == 2
    assert "did you mean 'skrl'?" in capsys.readouterr().err
