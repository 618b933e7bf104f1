"""Command lines: errors in one line, exit codes, and files that are not worth opening."""

from __future__ import annotations

import ctypes
import os
import re
import signal
import subprocess
import sys
import threading
import time
import weakref
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import pytest
from rich.console import Console
from tyro.conf import arg

from aquafish_gym.runs.command_line import AnyDamage, run_command_line
from aquafish_gym.utils.validation import EngineUnavailableError, InvalidArgumentError, integer


@dataclass(frozen=True)
class Swim:
    """Swim somewhere.

    In a ring or in lines.
    """

    far: float = 1.0
    """How far."""
    style: Literal["crawl", "butterfly"] = "crawl"
    fish: int = 1
    damage: AnyDamage = "none"

    def __post_init__(self) -> None:
        integer("fish", self.fish, 1, 10**6)

    def execute(self) -> None:
        """Refuse negative distances; long ones are interrupted."""
        if self.far < 0:
            raise InvalidArgumentError("far must be 0 or more;\n got less")
        if self.far > 100:
            raise KeyboardInterrupt
        print(f"swam with {self.damage}")


@dataclass(frozen=True)
class Pool:
    """Length and water of a pool."""

    length: float = 25.0
    """How long, in m."""
    warm: bool = False
    """Whether it is warm."""


@dataclass(frozen=True)
class Race:
    """Race in a pool.

    The first wins.

    The others do not.
    """

    example: ClassVar[str] = "--length 50"
    main_options: ClassVar[tuple[str, ...]] = ("lanes", "pool", "length")

    lanes: int = 8
    """How many swim."""
    pool: Annotated[Pool, arg(name="")] = field(default_factory=Pool)
    spare: Pool = field(default_factory=Pool)

    def execute(self) -> None:
        """Swim."""


@dataclass(frozen=True)
class Talker:
    """Print much on both streams, then write a file."""

    file: Path

    def execute(self) -> None:
        """Print and write."""
        for stream in (sys.stdout, sys.stderr):
            print("words " * 10_000, file=stream, flush=True)
            Console(file=stream).print("words " * 10_000)
        self.file.write_text("done")


COMMANDS = {"swim": (Swim, "swim somewhere"), "again": (f"{__name__}:Swim", "swim again")}


def run(*words: str) -> int:
    return run_command_line("fish", Swim, words)


def test_success_is_0_and_help_explains(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--far", "2") == 0
    assert capsys.readouterr().out == "swam with none\n"
    for word in ("-h", "--help", "-H", "--help-verbose"):
        assert run(word) == 0
        assert re.search(r"--far FLOAT +How far\.", capsys.readouterr().out)


def test_help_explains_the_options_that_matter_and_has_an_example(
    capsys: pytest.CaptureFixture[str],
) -> None:
    run_command_line("fish", Race, ["--help"])
    short = capsys.readouterr().out
    assert "Race in a pool. The first wins.\n" in short
    assert " --length 50\n" in short
    assert "-H explains all" in short
    assert set(re.findall(r"^\W*(--\w+)", short, re.MULTILINE)) == {"--lanes", "--length"}
    run_command_line("fish", Race, ["-H"])
    full = capsys.readouterr().out
    assert "The others do not." in full
    assert " --length 50\n" in full
    assert {"--warm", "--spare.length", "--lanes"} <= set(re.findall(r"--[\w.]+", full))


@pytest.mark.parametrize("file", ["fish/__main__.py", "fish/swim.py"])
def test_help_of_a_module_calls_it_by_its_name(
    file: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", [f"/clone/{file}"])
    run_command_line("fish.swim", Race, ["--help"])
    assert "  python -m fish.swim --length 50\n" in capsys.readouterr().out


def test_a_file_without_its_option_is_answered_with_the_option(
    capsys: pytest.CaptureFixture[str],
) -> None:
    from eea.cli.infer import Infer

    for words in (["swim.csv"], ["swim.csv", "--out", "x"]):
        assert run_command_line("fish", Infer, words) == 2
        said = capsys.readouterr().err
        assert said == "fish: unexpected argument 'swim.csv'; did you mean --log swim.csv?\n"
    assert run_command_line("fish", Infer, ["--log", "swim.csv", "other.csv"]) == 2
    assert capsys.readouterr().err == "fish: unexpected argument 'other.csv'\n"
    assert run_command_line("fish", Infer, []) == 2
    assert capsys.readouterr().err == "fish: --log must be given: see --help\n"


def test_version_names_the_program(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--version") == 0
    name, version = capsys.readouterr().out.split()
    assert name == "fish"
    assert version[0].isdigit()


def test_damage_has_one_name_and_keeps_the_old_one(capsys: pytest.CaptureFixture[str]) -> None:
    for option in ("--damage", "--target-damage"):
        assert run(option, "caudal:missing") == 0
        assert capsys.readouterr().out == "swam with caudal:missing\n"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--far -1", "far must be 0 or more; got less"),
        ("--fra 2", "unknown option --fra; did you mean --far?"),
        (
            "--style craul",
            "--style must be one of crawl, butterfly; got 'craul'; did you mean 'crawl'?",
        ),
        ("--far long", "--far must be a number; got 'long'"),
        ("--fish few", "--fish must be a whole number; got 'few'"),
        ("--far", "--far must have a value; got none"),
        ("far", "unexpected argument 'far'"),
        ("-- --far 2", "unexpected argument '--'; leave it out"),
        ("--far 2 --", "unexpected argument '--'; leave it out"),
        ("--fish 0", "fish must be a whole number of at least 1 and at most 1000000; got 0"),
        ("--far=", "--far must not be empty"),
    ],
)
def test_a_wrong_option_is_one_line_and_2(
    words: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(*words.split()) == 2
    assert capsys.readouterr() == ("", f"fish: {said}\n")


def test_a_table_of_commands_runs_the_one_named(capsys: pytest.CaptureFixture[str]) -> None:
    for name in COMMANDS:
        assert run_command_line("fish", COMMANDS, [name]) == 0
        assert capsys.readouterr().out == "swam with none\n"
    assert run_command_line("fish", COMMANDS, ["--help"]) == 0
    assert "  again  swim again" in capsys.readouterr().out
    assert run_command_line("fish", COMMANDS, []) == 2
    assert "  again  swim again" in capsys.readouterr().err
    assert run_command_line("fish", COMMANDS, ["swmi"]) == 2
    assert capsys.readouterr().err == (
        "fish: the command must be one of swim, again; got 'swmi'; did you mean 'swim'?\n"
    )


def run_with(
    monkeypatch: pytest.MonkeyPatch, execute: Callable[[Any], object], seconds: float = 30.0
) -> int:
    """Run a command that does something of the test's own, and check that it does not hang."""
    monkeypatch.setattr(Swim, "execute", execute)
    begun = time.monotonic()
    code = run()
    assert time.monotonic() - begun < seconds
    return code


@pytest.mark.parametrize(
    ("error", "said", "code"),
    [
        (
            OSError(28, "No space left on device", "run.json"),
            "run.json: No space left on device",
            1,
        ),
        (EngineUnavailableError("the engine needs\nwater"), "the engine needs water", 2),
        (KeyboardInterrupt(), "interrupted", 130),
        (KeyboardInterrupt("interrupted; half is left"), "interrupted; half is left", 130),
    ],
)
def test_failures_are_one_line_and_a_bug_is_not_hidden(
    error: BaseException,
    said: str,
    code: int,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def fail(_: object) -> None:
        raise error

    assert run_with(monkeypatch, fail) == code
    assert capsys.readouterr().err == f"fish: {said}\n"
    with pytest.raises(ZeroDivisionError):
        run_with(monkeypatch, lambda _: 1 // 0)


@pytest.mark.parametrize(
    ("stream", "buffering", "said"),
    [
        ("stdout", "", (["--help"], 0)),
        pytest.param("stderr", "1", (["--fiel", "x"], 2), marks=pytest.mark.slow),
    ],
)
def test_a_reader_that_leaves_is_no_error(
    stream: str, buffering: str, said: tuple[list[str], int], tmp_path: Path
) -> None:
    code = (
        "import sys; sys.path.insert(0, sys.argv[1])\n"
        "from test_commandline import Talker\n"
        "from aquafish_gym.runs.command_line import run_command_line\n"
        "sys.exit(run_command_line('fish', Talker, sys.argv[2:]))\n"
    )
    done = tmp_path / "done"
    for words, number in said, (["--file", str(done)], 0):
        ours, theirs = os.pipe()
        os.close(ours)
        command = [sys.executable, "-c", code, str(Path(__file__).parent), *words]
        streams: dict[str, Any] = dict.fromkeys(("stdout", "stderr"), subprocess.PIPE)
        environment = {**os.environ, "PYTHONUNBUFFERED": buffering}
        process = subprocess.run(command, **{**streams, stream: theirs}, env=environment)
        os.close(theirs)
        assert process.returncode == number, (words, process)
        assert b"Traceback" not in (process.stderr or b"")
    assert done.exists()


def test_no_message_or_page_installs_a_package_that_is_not_published() -> None:
    root = Path(__file__).parents[1]
    folders = ("aquafish", "aquafish_gym", "eea", "gait", "examples", "experiments", "docs")
    texts = [root / "README.md"]
    for folder in folders:
        texts += [p for suffix in ("py", "md") for p in (root / folder).rglob(f"*.{suffix}")]
    wrong = re.compile(r"install\b[^\n]*aquafish[-_]gym\b(?!\[)")
    found = {str(path.relative_to(root)): path.read_text(encoding="utf-8") for path in texts}
    # A message names an extra of the package that is installed, which pip does not look for.
    names = [name for name, text in found.items() if wrong.search(text)]
    # The first release will be: these two pages say so beside the command.
    assert [name for name in names if "once 0.1.0 is published" not in found[name]] == []
    assert set(names) <= {"README.md", "docs/tutorial.md"}


def start(words: str, **options: Any) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "aquafish", *words.split()],
        stderr=subprocess.PIPE, text=True, cwd=Path(__file__).parents[1], **options,
    )  # fmt: skip


@pytest.mark.parametrize("words", ["--version", "run --help", "export nowhere.json --c a.c"])
def test_a_closed_output_is_no_error(words: str) -> None:
    process = start(words, preexec_fn=lambda: os.close(1))
    _, said = process.communicate()
    assert "Traceback" not in said
    assert process.returncode == (2 if "export" in words else 0)


@pytest.mark.parametrize(
    "delay", [0.3, *(pytest.param(one, marks=pytest.mark.slow) for one in (0.05, 0.6, 1.0, 1.5))]
)
def test_termination_at_the_start_leaves_no_traceback(delay: float) -> None:
    process = start("infer --log examples/logs/swim.csv", stdout=subprocess.DEVNULL)
    time.sleep(delay)
    process.send_signal(signal.SIGTERM)
    _, said = process.communicate(timeout=30)
    assert process.returncode in (130, -signal.SIGTERM)  # the latter before our code runs
    assert "Traceback" not in said
    assert said.endswith("aquafish: interrupted\n") == (process.returncode == 130)


INTERRUPTED_IN_A_TEXT = """
import sys
from dataclasses import dataclass
from aquafish_gym.runs.command_line import run_command_line
@dataclass
class Swim:
    def execute(self):
        exec("raise KeyboardInterrupt")
sys.exit(run_command_line("fish", Swim, ()))
"""


def test_an_interrupt_within_a_text_ends_with_the_code_of_others(tmp_path: Path) -> None:
    (tmp_path / "swims.py").write_text(INTERRUPTED_IN_A_TEXT)
    root = str(Path(__file__).parents[1])
    found = subprocess.run(
        [sys.executable, "-m", "swims"], cwd=tmp_path, env={**os.environ, "PYTHONPATH": root},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (found.returncode, found.stderr) == (130, "fish: interrupted\n")


def test_the_command_line_runs_in_a_thread(capsys: pytest.CaptureFixture[str]) -> None:
    codes: list[int] = []
    thread = threading.Thread(target=lambda: codes.append(run("--far", "2")))
    thread.start()
    thread.join()
    assert codes == [0]
    assert capsys.readouterr() == ("swam with none\n", "")


# A termination that comes while a command runs, and where Python raises nothing.


def terminate(*_: object) -> None:
    """Terminate this process, within a call from which Python raises nothing."""
    signal.raise_signal(signal.SIGTERM)


class Fin:
    """A fin, which may be lost."""


class LostFin(Fin):
    """A fin whose loss terminates the process."""

    __del__ = terminate


def lose_a_watched_fin() -> None:
    fin = Fin()
    watch = weakref.ref(fin, terminate)
    del fin
    assert watch() is None


def lose_a_fin_and_sleep(_: object) -> None:
    LostFin()
    time.sleep(60)


def sleep_and_load(_: object) -> None:
    """Be terminated in a library that swallows what comes."""
    try:
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(60)
    except KeyboardInterrupt:
        raise ImportError("cannot load") from None


#: Python prints what a callback raises, and goes on: imports and LLVM make callbacks.
TERMINATED: dict[str, Callable[[Any], object]] = {
    "in a sleep": lambda _: (os.kill(os.getpid(), signal.SIGTERM), time.sleep(60)),
    "in a library": sleep_and_load,
    "in a destructor": lambda _: LostFin(),
    "in a destructor, before a sleep": lose_a_fin_and_sleep,
    "in a weak reference": lambda _: lose_a_watched_fin(),
    "in a C callback": lambda _: ctypes.CFUNCTYPE(None)(terminate)(),
}


@pytest.mark.parametrize("usual", [signal.default_int_handler, signal.SIG_IGN])
@pytest.mark.parametrize("where", TERMINATED)
def test_no_termination_is_lost(
    where: str,
    usual: Any,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Also where Ctrl-C is ignored, as in a background job of a shell script."""
    hook = sys.unraisablehook
    others = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    signal.signal(signal.SIGINT, usual)
    try:
        assert run_with(monkeypatch, TERMINATED[where]) == 130
        assert signal.getsignal(signal.SIGINT) is usual
        assert signal.getsignal(signal.SIGTERM) == others[signal.SIGTERM]
    finally:
        signal.signal(signal.SIGINT, others[signal.SIGINT])
    assert capsys.readouterr() == ("", "fish: interrupted\n")
    assert sys.unraisablehook is hook


def test_a_signal_just_before_a_sleep_ends_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Such a signal is known to Python, but does not wake the main thread."""
    send, sent = signal.pthread_kill, []

    def miss_once(thread: int, number: int) -> None:
        sent.append(number)
        send(threading.get_ident() if len(sent) == 1 else thread, number)

    monkeypatch.setattr(signal, "pthread_kill", miss_once)
    assert run_with(monkeypatch, lose_a_fin_and_sleep) == 130
    assert len(sent) == 2
    assert capsys.readouterr() == ("", "fish: interrupted\n")


def test_a_handler_that_is_set_meanwhile_is_kept_and_is_sent_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    came: list[int] = []

    def execute(_: object) -> None:
        LostFin()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda number, _frame: came.append(number))
        time.sleep(0.2)

    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    assert run_with(monkeypatch, execute) == 130
    assert came == []
    assert {number: signal.getsignal(number) for number in before} == before


def test_other_errors_of_a_callback_are_printed(monkeypatch: pytest.MonkeyPatch) -> None:
    printed: list[Any] = []
    monkeypatch.setattr(sys, "unraisablehook", lambda found: printed.append(found.exc_type))
    assert run_with(monkeypatch, lambda _: ctypes.CFUNCTYPE(None)(lambda: 1 / 0)()) == 0
    assert printed == [ZeroDivisionError]


def test_a_word_that_is_not_utf_8_is_printed_with_escapes() -> None:
    command = [sys.executable, "-m", "aquafish", "film", b"\xff.json", "--label", b"\xfe"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=Path(__file__).parents[1])  # type: ignore[call-overload]
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.count("\n") == 1
    assert "\\udcff.json: No such file" in done.stderr
