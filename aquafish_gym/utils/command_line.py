"""What the packages' command lines share: the wording of options, honest exit codes, one line.

tyro reads the options and explains a mistyped one in its own box. Whatever is wrong with a value,
a file or the machine is said in one line.
"""

from __future__ import annotations

import contextlib
import inspect
import io
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, Protocol

import tyro
from tyro.conf import arg
from tyro.extras import SubcommandApp

from aquafish_gym.bodies import morphology_of
from aquafish_gym.morphology import Morphology
from aquafish_gym.runs.executors import interrupts
from aquafish_gym.runs.storage import read_document
from aquafish_gym.utils.validation import (
    EngineUnavailableError,
    InvalidArgumentError,
    MissingExtraError,
    one_of,
)

BAD_INPUT: tuple[type[Exception], ...] = (
    InvalidArgumentError,
    EngineUnavailableError,
    MissingExtraError,
)
FAILED, REFUSED, INTERRUPTED = 1, 2, 130
UNREAD = 141  # as of a program that SIGPIPE ends
RESUMES = "the same command resumes"  # what a command says that was interrupted

# The options that several commands have: one name, one meaning, one wording.
_DAMAGE = (
    'FIN:SIZE=FACTOR, FIN:missing or FIN:entangled=SHARE, joined by ";", or none. FIN is '
    "left_pectoral, right_pectoral or caudal; SIZE is length, width or thickness."
)
_ANY_DAMAGE = (
    f"{_DAMAGE} Or FIN:weak=GAIN, reversed, seized, seized=ANGLE, dead, of its servo; "
    "gyro:noise=SD; CHANNEL:bias=BY, stuck, dropped, CHANNEL being up_x to gyro_z. Each may end in "
    "@ONSET+DURATION, in s of every trial."
)
_BODY = (
    'an object from fin to [x, y, z], or one with a "morphology", as a result.json; '
    "without it, the nominal body."
)
Out = Annotated[Path, arg(metavar="DIR", help="Directory for the results; made if need be.")]
BodyFile = Annotated[Path | None, arg(metavar="FILE", help=f"JSON file of the body: {_BODY}")]
BodiesFile = Annotated[
    Path | None,
    arg(metavar="FILE", help=f"bodies.json of a sample of bodies, or JSON file of one: {_BODY}"),
]
BodyDamage = Annotated[str, arg(metavar="DAMAGE", help=f"What broke on the body: {_DAMAGE}")]
TargetMorphology = Annotated[
    Path | None, arg(metavar="FILE", help=f"JSON file of the target before its damage: {_BODY}")
]
TargetDamage = Annotated[str, arg(metavar="DAMAGE", help=f"What broke on the target: {_DAMAGE}")]
AnyDamage = Annotated[str, arg(metavar="DAMAGE", help=f"What broke on the target: {_ANY_DAMAGE}")]
EpisodeDamage = Annotated[
    str,
    arg(
        metavar="DAMAGE",
        help=f"What is broken while it learns: {_ANY_DAMAGE} Or random:mild, random:moderate, "
        "random:severe: something else in each episode.",
    ),
]
TargetEngine = Annotated[
    Literal["auto", "pybullet", "numba"],
    arg(help="Where the target swims; auto is PyBullet where it is installed, else numba."),
]
ModelEngine = Annotated[
    Literal["numba", "auto", "pybullet"], arg(help="Where the candidate models swim.")
]
Threads = Annotated[int | None, arg(help="Cores to use; None for all. No result depends on it.")]


class Command(Protocol):
    """A subcommand, its options as fields."""

    def execute(self) -> None:
        """Do it."""


class CommandLine(Protocol):
    """Whatever makes a command of words; tyro's ``SubcommandApp`` is one."""

    def cli(self, *, prog: str | None = None, args: Sequence[str] | None = None) -> Any:
        """Return the command, or leave with SystemExit."""


@dataclass(frozen=True)
class _CommandLine:
    cli: Callable[..., Any]


def single_command(command: type[Command]) -> CommandLine:
    """Return the command line of a program that does one thing."""
    # The short help has a line an option; --help-verbose explains each.
    return _CommandLine(partial(tyro.cli, command, compact_help=True))


def subcommands(commands: Mapping[str, type[Command]]) -> CommandLine:
    """Return the command line of a program that does several things, by name."""

    def cli(*, prog: str | None = None, args: Sequence[str] | None = None) -> Any:
        words = sys.argv[1:] if args is None else args
        if not words or words[0].startswith("-"):
            app = SubcommandApp()
            for name, command in commands.items():
                summary = (inspect.getdoc(command) or name).splitlines()[0]
                app.command(name=name, help=summary)(command)
            return app.cli(prog=prog, args=words)
        name = one_of("the command", words[0], commands)
        one = single_command(commands[name])
        return one.cli(prog=f"{prog or ''} {name}".strip(), args=words[1:])

    return _CommandLine(cli)


def run_command_line(
    program: str,
    app: CommandLine,
    arguments: Sequence[str] | None = None,
    refused: tuple[type[Exception], ...] = BAD_INPUT,
) -> int:
    """Run one of an app's commands and return the exit code.

    It is 0; 1 where the machine fails (a full disk, no more memory); 2 for a command or setting
    that is wrong, which errors in ``refused`` say; 130 after Ctrl-C or SIGTERM; 141 where nobody
    reads what is printed. Without ``arguments`` the process's own are taken.
    """
    words = sys.argv[1:] if arguments is None else list(arguments)
    prog = f"python -m {program}" if Path(sys.argv[0]).name == "__main__.py" else program
    try:
        with interrupts():
            _refuse_empty_values(words)
            _make(app, prog, words, refused).execute()
            sys.stdout.flush()
    except SystemExit as leaving:  # tyro has said why
        return leaving.code if isinstance(leaving.code, int) else int(leaving.code is not None)
    except KeyboardInterrupt as stop:  # a command may say what is left to do
        return _say(program, str(stop) or "interrupted", INTERRUPTED)
    except BrokenPipeError:
        # The reader has left, as head does; nor can what is left be written at the exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return UNREAD
    except refused as error:
        return _say(program, str(error), REFUSED)
    except OSError as error:
        place = f"{error.filename}: " if error.filename else ""
        return _say(program, f"{place}{error.strerror or error}", FAILED)
    except MemoryError:
        return _say(program, "there is not enough memory", FAILED)
    return 0


def _make(
    app: CommandLine, prog: str, words: Sequence[str], refused: tuple[type[Exception], ...]
) -> Command:
    """Return the command, or let tyro's box be seen, but for settings that we refuse ourselves."""
    box = io.StringIO()
    try:
        with contextlib.redirect_stderr(box):
            command: Command = app.cli(prog=prog, args=words)
    except SystemExit as leaving:
        cause: BaseException | None = leaving
        while cause is not None and not isinstance(cause, refused):
            cause = cause.__context__
        if cause is None:
            raise
        box.truncate(0)
        raise cause from None
    finally:
        sys.stderr.write(box.getvalue())
    return command


def _say(program: str, sentence: str, code: int) -> int:
    print(f"{program}: {' '.join(sentence.split())}", file=sys.stderr)
    return code


def _refuse_empty_values(words: Sequence[str]) -> None:
    """Refuse ``--out ""``: an empty path would be the current directory, which nobody means."""
    for before, word in pairwise(["", *words]):
        if not word or (word.startswith("--") and word.endswith("=")):
            name = (word or before).removesuffix("=") or "a word of the command"
            raise InvalidArgumentError(f"{name} must not be empty")


def read_morphology(path: Path | None, argument: str) -> Morphology:
    """Return the body in a JSON file, or the nominal body for None.

    The file holds what ``Morphology.to_dict`` gives, or an object whose ``morphology`` is that or
    nine numbers in the order of ``DIMENSIONS``, as results of estimations and studies do.

    Messages name the file and the argument.
    """
    if path is None:
        return Morphology.nominal()
    document = read_document(path, argument=argument, checksum="optional")
    try:
        return morphology_of(document)
    except InvalidArgumentError as error:
        raise InvalidArgumentError(f"{argument}: {path}: {error}") from None
