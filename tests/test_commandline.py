"""One line for a mistake; honest exit codes; files that are not worth opening."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import pytest

from aquafish_gym.morphology import DIMENSIONS, Morphology
from aquafish_gym.runs.storage import CannotWriteError
from aquafish_gym.utils.command_line import (
    read_morphology,
    run_command_line,
    single_command,
    subcommands,
)
from aquafish_gym.utils.validation import EngineUnavailableError, InvalidArgumentError, integer


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
    assert run("--help-verbose") == 0
    assert "How far." in capsys.readouterr().out


def test_a_refusal_is_one_line_and_2(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--far", "-1") == 2
    assert capsys.readouterr().err == "fish: far must be 0 or more; got less\n"


def test_ctrl_c_is_130(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--far", "101") == 130
    assert capsys.readouterr().err == "fish: interrupted\n"


def test_tyro_explains_a_mistyped_option_in_its_own_box(capsys: pytest.CaptureFixture[str]) -> None:
    for words, part in (("--fra 2", "--far FLOAT"), ("--far long", "Error parsing --far")):
        assert run(*words.split()) == 2
        said = capsys.readouterr()
        assert part in said.err
        assert said.out == ""


@pytest.mark.parametrize("words", [("--far", ""), ("--far=",), ("--far", "1", "")])
def test_an_empty_value_is_refused(
    words: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    """``--out ""`` would be the current directory."""
    assert run(*words) == 2
    assert capsys.readouterr().err.endswith(" must not be empty\n")


class Machine:
    """Programs whose machine fails in some way."""

    error: BaseException

    def execute(self) -> None:
        raise self.error


@pytest.mark.parametrize(
    ("error", "said", "code"),
    [
        (
            OSError(28, "No space left on device", "run.json"),
            "run.json: No space left on device",
            1,
        ),
        (CannotWriteError("cannot write a: No space left"), "cannot write a: No space left", 1),
        (OSError(24, "Too many open files"), "Too many open files", 1),
        (PermissionError(13, "Permission denied", "a"), "a: Permission denied", 1),
        (MemoryError(), "there is not enough memory", 1),
        (EngineUnavailableError("the engine needs\nwater"), "the engine needs water", 2),
        (KeyboardInterrupt("interrupted; half is left"), "interrupted; half is left", 130),
    ],
)
def test_whatever_fails_is_one_line(
    error: BaseException, said: str, code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    @dataclass(frozen=True)
    class Failing(Machine):
        """Fail."""

    Failing.error = error
    assert run_command_line("fish", single_command(Failing), ()) == code
    assert capsys.readouterr().err == f"fish: {said}\n"


def test_a_mistake_of_ours_is_not_hidden() -> None:
    @dataclass(frozen=True)
    class Failing(Machine):
        """Fail."""

    Failing.error = ZeroDivisionError("a bug")
    with pytest.raises(ZeroDivisionError):
        run_command_line("fish", single_command(Failing), ())


def test_termination_is_an_interruption(capsys: pytest.CaptureFixture[str]) -> None:
    @dataclass(frozen=True)
    class Long:
        """Take long."""

        def execute(self) -> None:
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(60)

    before = signal.getsignal(signal.SIGTERM)
    assert run_command_line("fish", single_command(Long), ()) == 130
    assert capsys.readouterr().err == "fish: interrupted\n"
    assert signal.getsignal(signal.SIGTERM) == before


@dataclass(frozen=True)
class School:
    """Swim together.

    In a ring or in lines.
    """

    many: int = 1
    """How many."""

    def __post_init__(self) -> None:
        integer("many", self.many, 1, 10**6)

    def execute(self) -> None:
        """Do nothing."""


SEVERAL = subcommands({"swim": Swim, "school": School})


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("shcool", "the command must be one of swim, school; got 'shcool'; did you mean 'school'?"),
        ("fly", "the command must be one of swim, school; got 'fly'"),
        (
            f"school --many {10**400}",
            f"many must be a whole number of at least 1 and at most 1000000; got 1{'0' * 76}...",
        ),
    ],
)
def test_a_wrong_command_or_value_is_one_line(
    words: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_command_line("fish", SEVERAL, words.split()) == 2
    assert capsys.readouterr().err == f"fish: {said}\n"


def test_the_command_asked_for_is_done(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command_line("fish", SEVERAL, ["swim", "--far", "2"]) == 0
    assert capsys.readouterr().out == "swam\n"


def test_no_command_at_all_lists_them(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command_line("fish", SEVERAL, []) == 2
    assert "{swim, school}" in capsys.readouterr().err


def test_help_is_short_and_a_longer_one_explains(capsys: pytest.CaptureFixture[str]) -> None:
    said = []
    for words in (["--help"], ["school", "--help"], ["school", "--help-verbose"]):
        assert run_command_line("fish", SEVERAL, words) == 0
        said.append(capsys.readouterr().out)
    assert "Swim together." in said[0]
    assert "In a ring" not in said[0]
    assert "How many." not in said[1]
    assert "--many INT" in said[1]
    assert "How many." in said[2]


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
    path.write_text(json.dumps(body.to_dict()))
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
    with pytest.raises(InvalidArgumentError, match=r"body: .*body\.json is not JSON"):
        read_morphology(path, "body")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", r"body: .*fish\.json is not JSON"),
        ("[1, 2]", r"body: .*fish\.json must hold a JSON object"),
        ("{}", r"body: .*fish\.json: it must hold an object with the keys left_pectoral"),
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


def test_a_file_that_would_take_the_memory_is_refused(tmp_path: Path) -> None:
    large = tmp_path / "large.json"
    with large.open("wb") as file:
        file.truncate(100 * 2**20)  # bytes of nothing, and no block of the disk
    deep = tmp_path / "deep.json"
    deep.write_text("[" * 10**6)
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    for path, message in (
        (Path("/dev/zero"), "body must be a regular file; /dev/zero is none"),
        (pipe, "body must be a regular file"),
        (large, "body must have at most .* bytes"),
        (deep, "nested too deep"),
    ):
        with pytest.raises(InvalidArgumentError, match=message) as caught:
            read_morphology(path, "body")
        assert len(str(caught.value)) < 500
