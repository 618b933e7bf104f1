"""One line for a mistake, whatever the terminal; honest exit codes."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import pytest

from aquafish_gym.morphology import DIMENSIONS, Morphology
from aquafish_gym.utils.command_line import read_morphology, run_command_line, single_command
from aquafish_gym.utils.validation import InvalidArgumentError


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
            "fish: --far must be a number; got 'long'\n",
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


def test_a_switch_is_offered_without_its_comma(capsys: pytest.CaptureFixture[str]) -> None:
    @dataclass(frozen=True)
    class Hurry:
        """Hurry or not."""

        quick: bool = False

        def execute(self) -> None:
            """Do nothing."""

    assert run_command_line("fish", single_command(Hurry), ("--quik",)) == 2
    said = capsys.readouterr().err
    assert said == "fish: Unrecognized options: --quik; did you mean --quick?\n"


@dataclass(frozen=True)
class School:
    """Swim together."""

    many: int = 1
    order: Literal["two_lines", "ring"] = "ring"
    leader: Literal["first"] | None = None
    laps: tuple[int, ...] = ()
    start: tuple[float, float, float] = (0.0, 0.0, 0.0)
    pause: float | None = None
    quick: bool = False
    name: str = ""

    def execute(self) -> None:
        """Do nothing."""


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--order twolines", "--order must be one of two_lines, ring; got 'twolines'; did you "
         "mean 'two_lines'?"),
        ("--order x", "--order must be one of two_lines, ring; got 'x'"),
        ("--leader fist", "--leader must be first; got 'fist'; did you mean 'first'?"),
        ("--many 1.5", "--many must be a whole number; got '1.5'"),
        ("--laps 12O", "--laps must be whole numbers; got '12O'"),
        ("--laps 1 12O", "--laps must be whole numbers; got '1', '12O'"),
        ("--start 0 a 0", "--start must be 3 numbers; got '0', 'a', '0'"),
        ("--pause long", "--pause must be a number or None; got 'long'"),
        ("--quick yes", "--quick takes no value; got 'yes'; it is --quick or --no-quick"),
        ("--no-quick yes", "--no-quick takes no value; got 'yes'; it is --quick or --no-quick"),
        ("--name a b", "Unrecognized options: b"),
        ("--name yes --quick yes", "Unrecognized options: yes"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("encoding", ["utf-8", "ascii"])
def test_a_mistyped_value_is_told_what_it_must_be(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    encoding: str,
    words: str,
    said: str,
) -> None:
    monkeypatch.setattr("sys.stdout", io.TextIOWrapper(io.BytesIO(), encoding=encoding))
    assert run_command_line("fish", single_command(School), words.split()) == 2
    assert capsys.readouterr().err == f"fish: {said}\n"


def test_a_reader_that_leaves_is_no_error() -> None:
    code = (
        "import sys; sys.path.insert(0, sys.argv[1])\n"
        "from test_commandline import Swim\n"
        "from aquafish_gym.utils.command_line import run_command_line, single_command\n"
        "sys.exit(run_command_line('fish', single_command(Swim), sys.argv[2:]))\n"
    )
    for arguments in (["--help"], ["--far", "2"]):
        ours, theirs = os.pipe()
        os.close(ours)
        command = [sys.executable, "-c", code, str(Path(__file__).parent), *arguments]
        done = subprocess.run(command, stdout=theirs, stderr=subprocess.PIPE, text=True)
        os.close(theirs)
        assert (done.returncode, done.stderr) == (141, ""), arguments


def test_a_morphology_comes_from_a_file_or_is_nominal(tmp_path: Path) -> None:
    body = Morphology.coerce({"caudal": (0.1, 0.2, 0.3)})
    path = tmp_path / "body.json"
    path.write_text(body.to_json())
    assert read_morphology(path, "body") == body
    assert read_morphology(None, "body") == Morphology.nominal()
    with pytest.raises(InvalidArgumentError, match="body must be a file that can be read"):
        read_morphology(tmp_path, "body")
    for document in (
        {"morphology": body.to_dict(), "model_fitness": 0.1},
        {"morphology": body.to_array().tolist(), "rounds": []},
        {"morphology": body.to_array().tolist(), "dimensions": [d.name for d in DIMENSIONS]},
    ):
        path.write_text(json.dumps(document))
        assert read_morphology(path, "body") == body
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(InvalidArgumentError, match="body must be a JSON file"):
        read_morphology(path, "body")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", r"body: .*fish\.json is not JSON"),
        ("[1, 2]", r"body: .*fish\.json: it must hold an object with the keys left_pectoral"),
        ('{"caudal": [0.1, 0.2, 0.3]}', r"fish\.json: it must hold an object"),
        ('{"morphology": {"caudal": [0.1, 0.2, 0.3]}}', r"fish\.json: it must hold an object"),
        ('{"morphology": null}', r"fish\.json: its morphology is null"),
        ('{"morphology": [1, 2]}', r"fish\.json: morphology must have shape"),
        ('{"morphology": [9, 0, 0, 0, 0, 0, 0, 0, 0]}', r"fish\.json: morphology.*must lie in"),
        ('{"morphology": [0, 0], "dimensions": ["a", "b"]}', r"fish\.json: its dimensions must"),
    ],
)
def test_a_file_without_a_morphology_is_named(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "fish.json"
    path.write_text(text)
    with pytest.raises(InvalidArgumentError, match=message):
        read_morphology(path, "body")


def test_an_interrupted_command_may_say_more(capsys: pytest.CaptureFixture[str]) -> None:
    @dataclass(frozen=True)
    class Stopped:
        """Stop."""

        def execute(self) -> None:
            raise KeyboardInterrupt("interrupted; half is left")

    assert run_command_line("fish", single_command(Stopped), ()) == 130
    assert capsys.readouterr().err == "fish: interrupted; half is left\n"
