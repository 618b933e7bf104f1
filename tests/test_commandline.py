"""One line for a mistake, whatever the terminal; honest exit codes."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path

import pytest

from aquafish_gym.commandline import read_morphology, run_command_line, single_command
from aquafish_gym.morphology import Morphology
from aquafish_gym.validation import InvalidArgumentError


@dataclass(frozen=True)
class Swim:
    """Swim somewhere."""

    far: float = 1.0
    """How far."""

    def execute(self) -> None:
        """Refuse negative distances, and be interrupted by long ones."""
        if self.far < 0:
            raise InvalidArgumentError("far must be 0 or more;\n got less")
        if self.far > 100:
            raise KeyboardInterrupt
        print("swam")


def run(*arguments: str) -> int:
    return run_command_line("fish", single_command(Swim), arguments)


def test_a_command_that_worked_is_0(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--far", "2") == 0
    assert run("--help") == 0
    assert "How far." in capsys.readouterr().out


def test_a_refusal_is_one_line_and_2(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--far", "-1") == 2
    assert capsys.readouterr().err == "fish: far must be 0 or more; got less\n"


def test_ctrl_c_is_130(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--far", "101") == 130
    assert capsys.readouterr().err == "fish: interrupted\n"


@pytest.mark.parametrize("encoding", ["utf-8", "ascii"])
@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--fra", "2"), "fish: Unrecognized options: --fra, 2; did you mean --far?\n"),
        (
            ("--far", "long"),
            "fish: Error parsing --far: could not convert string to float: 'long'\n",
        ),
    ],
)
def test_tyros_boxes_become_one_line_in_every_encoding(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    encoding: str,
    arguments: tuple[str, ...],
    said: str,
) -> None:
    # tyro frames its boxes if stdout can show the frames.
    monkeypatch.setattr("sys.stdout", io.TextIOWrapper(io.BytesIO(), encoding=encoding))
    assert run(*arguments) == 2
    assert capsys.readouterr().err == said


def test_a_morphology_comes_from_a_file_or_is_nominal(tmp_path: Path) -> None:
    body = Morphology.coerce({"caudal": (0.1, 0.2, 0.3)})
    path = tmp_path / "body.json"
    path.write_text(body.to_json())
    assert read_morphology(path, "body") == body
    assert read_morphology(None, "body") == Morphology.nominal()
    with pytest.raises(InvalidArgumentError, match="body must be a file that can be read"):
        read_morphology(tmp_path, "body")
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(InvalidArgumentError, match="body must be a JSON file"):
        read_morphology(path, "body")
