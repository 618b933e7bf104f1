"""Progress: a line in time where there is no terminal, whether or not a step has ended."""

from __future__ import annotations

import time

import pytest

from aquafish_gym.runs.progress import show_progress, track


def test_track_prints_a_line_for_each_tenth_and_yields_the_items(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert list(track((number**2 for number in range(20)), "squares", 20)) == [
        number**2 for number in range(20)
    ]
    lines = capsys.readouterr().err.splitlines()
    assert lines == [f"{done}/20  squares" for done in range(2, 21, 2)]


def test_a_long_step_is_not_silent(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("aquafish_gym.runs.progress.QUIET_SECONDS", 0.1)
    monkeypatch.setattr("aquafish_gym.runs.progress.BEAT_SECONDS", 0.02)
    with show_progress("robots", 100) as show:
        show(3, "a robot")
        time.sleep(0.5)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) >= 2
    assert set(lines) <= {"3/100  a robot, 0 s", "3/100  a robot, 1 s"}


def test_progress_is_a_bar_on_a_terminal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    assert list(track("abc", "letters", 3)) == list("abc")
    said = capsys.readouterr().err
    assert "3/3" in said
    assert "3/3  letters" not in said
