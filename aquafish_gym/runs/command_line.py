"""Commands from frozen dataclasses: options, errors in one line, exit codes.

tyro reads the options. A command has a method ``execute``. A program is one command or a table of
commands by name. Errors go to stderr in one line, with the nearest name for a mistyped one.
"""

from __future__ import annotations

import contextlib
import difflib
import inspect
import io
import os
import re
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from pkgutil import resolve_name
from typing import Annotated, Any, ClassVar, Literal, Protocol, get_args, get_origin, get_type_hints

from aquafish_gym.bodies import read_bodies
from aquafish_gym.damage.tiers import TIERS
from aquafish_gym.damage.words import (
    BODY_WORDS,
    LINK_WORDS,
    NOISE_WORDS,
    RANDOM,
    SENSOR_WORDS,
    SERVO_WORDS,
    forms_of,
)
from aquafish_gym.engines.packages import MAXIMUM_THREADS
from aquafish_gym.morphology import Morphology
from aquafish_gym.plans import AQUAFISH, PLANS, PlanLike
from aquafish_gym.runs.version import other_clone_here, version
from aquafish_gym.scenario import CHANNELS
from aquafish_gym.utils.interrupts import kept_interrupts
from aquafish_gym.utils.streams import keep_streams
from aquafish_gym.utils.validation import (
    EngineUnavailableError,
    InvalidArgumentError,
    MissingExtraError,
    install_advice,
    integer,
    one_of,
    printable,
)

try:
    import tyro
    from tyro.conf import FlagCreatePairsOff, arg

    from aquafish_gym.runs.command_help import (
        FULL_HELP,
        SHORT_HELP,
        asked_help,
        commands_help,
        option_names,
        print_help,
    )
except ModuleNotFoundError as error:
    raise MissingExtraError(
        f"commands need the extra cli ({error}): {install_advice('cli')}"
    ) from None

Errors = tuple[type[Exception], ...]
BAD_INPUT: Errors = (InvalidArgumentError, EngineUnavailableError, MissingExtraError)
FAILED = 1
REFUSED = 2
INTERRUPTED = 130
_LISTED_OPTIONS = 4  # in the message on an unknown one
RESUMES = "the same command resumes"  # in the message of an interrupted command

# Options that several commands have: one name, one meaning, one wording.
_FIN_DAMAGE = (
    f'FIN:{forms_of(BODY_WORDS)}, joined by ";", or none. FIN is {", ".join(AQUAFISH.names)}, or '
    "a fin of --plan."
)
_ANY_DAMAGE = (
    f"{_FIN_DAMAGE} Or FIN:{forms_of(SERVO_WORDS)}, of its servo; gyro:{forms_of(NOISE_WORDS)}; "
    f"CHANNEL:{forms_of(SENSOR_WORDS)}, CHANNEL being {CHANNELS[0]} to {CHANNELS[-1]}. FIN, gyro "
    f"and CHANNEL: {forms_of(LINK_WORDS)}. Each may end in @ONSET+DURATION, in s of every trial."
)
_TIERS = ", ".join(f"{RANDOM}:{tier}" for tier in TIERS)
_BODY = (
    'an object from fin to [x, y, z], or one with a "morphology", as a result.json; '
    "without it, the nominal body."
)
_FOLDER = "created if missing. One that holds results of other settings is refused."
Out = Annotated[Path, arg(metavar="DIR", help=f"Folder for the results, {_FOLDER}")]
OptionalOut = Annotated[
    Path | None,
    arg(metavar="DIR", help=f"Folder for the results, {_FOLDER} Without it they are only printed."),
]
BodyFile = Annotated[Path | None, arg(metavar="FILE", help=f"JSON file of the body: {_BODY}")]
BodiesFile = Annotated[
    Path | None,
    arg(metavar="FILE", help=f"bodies.json of a sample of bodies, or JSON file of one: {_BODY}"),
]
_BODY_DAMAGE = f"Damage of the body: {_FIN_DAMAGE} Faults of servos and sensors are refused."
BodyDamage = Annotated[str, arg(metavar="DAMAGE", help=_BODY_DAMAGE)]
FirstFinDamage = Annotated[
    str | None,
    arg(metavar="DAMAGE", help=f"{_BODY_DAMAGE} Without it, the first fin has half its length."),
]
TargetMorphology = Annotated[
    Path | None, arg(metavar="FILE", help=f"JSON file of the target before its damage: {_BODY}")
]
AnyDamage = Annotated[
    str,
    arg(
        aliases=("--target-damage",),
        metavar="DAMAGE",
        help=f"Damage of the target: {_ANY_DAMAGE}",
    ),
]
EpisodeDamage = Annotated[
    str,
    arg(
        metavar="DAMAGE",
        help=f"Damage of each episode: {_ANY_DAMAGE} Or {_TIERS}: a new draw in each episode.",
    ),
]
# An option's settings: tyro takes lists of damages.
FILMED_DAMAGE = arg(
    metavar="DAMAGE",
    help=f"Damage of each fish: {_ANY_DAMAGE} Or {_TIERS}.",
)
TargetEngine = Annotated[
    Literal["auto", "pybullet", "numba"],
    arg(help="Engine of the robot; auto is PyBullet where it is installed, else numba."),
]
Plan = Annotated[
    str,
    arg(
        metavar="PLAN",
        help=f"Body plan of the robot: {', '.join(PLANS)}, or a JSON file of one (BodyPlan).",
    ),
]
GaitLibrary = Annotated[
    Path | None,
    arg(
        metavar="FILE",
        help="A library of gaits for the plan; without it, the packaged one, or all servos at full "
        "speed.",
    ),
]
Reactive = Annotated[
    FlagCreatePairsOff[bool],
    arg(help="Water that also resists acceleration, as around TailFish-v0 (docs/physics.md)."),
]
Threads = Annotated[int | None, arg(help="Cores to use; None for all. No result depends on it.")]


def check_threads(threads: int | None) -> None:
    """Raise InvalidArgumentError unless ``threads`` can be a number of cores."""
    if threads is not None:
        integer("threads", threads, 1, MAXIMUM_THREADS)


class Command(Protocol):
    """A command, with its options as fields."""

    def execute(self) -> None:
        """Run it."""


class Given:
    """Base of commands that must know the given options, even at their default values."""

    #: Name of each given option, without dashes -> its first word, or "".
    given: ClassVar[Mapping[str, str]] = {}

    def refuse_given(self, names: Iterable[str], reason: str) -> None:
        """Raise InvalidArgumentError if an option was given that has no effect."""
        for name in names:
            if option_name(name) in self.given:
                raise InvalidArgumentError(f"--{option_name(name)} has no effect {reason}")


def option_name(field: str) -> str:
    """Return the option's name, without dashes, of a field such as "out_of_band.revisit"."""
    return field.replace("_", "-")


#: Name -> class and summary of a command; a class "module:Class" is loaded when it runs.
Commands = Mapping[str, tuple[type[Command] | str, str]]


def run_command_line(
    program: str,
    commands: type[Command] | Commands,
    arguments: Sequence[str] | None = None,
    refused: Errors = BAD_INPUT,
) -> int:
    """Run a command of a program, by default with the process's arguments; return the exit code.

    The code is 0; 1 if the machine fails, such as a full disk; 2 for a wrong command, option or
    setting (errors in ``refused``); 130 after Ctrl-C or SIGTERM. A reader that leaves the output
    does not change the code. Other errors are raised.
    """
    words = sys.argv[1:] if arguments is None else list(arguments)
    started = Path(sys.argv[0])
    prog = f"python {started}" if started.suffix == ".py" else program
    if started.name == "__main__.py" or "." in program:  # the module of python -m
        prog = f"python -m {program}"
    keep_streams()
    try:
        with _interrupts(), _flushed():
            if note := other_clone_here():
                print(printable(f"{program}: {note}"), file=sys.stderr)
            if words == ["--version"]:
                print(f"{program} {version()}")
            else:
                with end_at_signals(program):
                    command, prog, words = _chosen(prog, commands, words)
                _refuse_empty_values(words)
                parse(command, prog, words, refused).execute()
    except SystemExit as leaving:
        return leaving.code if isinstance(leaving.code, int) else int(leaving.code is not None)
    except KeyboardInterrupt as stop:  # the text may name the remaining work
        # CPython remembers one that passed exec() of a text, as where a class is made, until the
        # next exec(); python -m would then end with SIGINT instead of the code.
        exec("")
        return _fail(program, str(stop) or "interrupted", INTERRUPTED)
    except refused as error:
        return _fail(program, str(error), REFUSED)
    except OSError as error:
        place = f"{error.filename}: " if error.filename else ""
        return _fail(program, f"{place}{error.strerror or error}", FAILED)
    return 0


@contextlib.contextmanager
def _flushed() -> Iterator[None]:
    """Flush the output at the end, so that a full disk is an error of the command."""
    try:
        yield
    finally:
        sys.stdout.flush()


@contextlib.contextmanager
def _handled(numbers: Iterable[int], handler: Callable[[int, Any], None]) -> Iterator[None]:
    """Let a function handle signals that are not ignored; only in the main thread."""
    before = {}
    if threading.current_thread() is threading.main_thread():
        wanted = [number for number in numbers if signal.getsignal(number) is not signal.SIG_IGN]
        before = {number: signal.signal(number, handler) for number in wanted}
    try:
        yield
    finally:
        for number, each in before.items():
            signal.signal(number, each)


@contextlib.contextmanager
def end_at_signals(program: str) -> Iterator[None]:
    """Let Ctrl-C and SIGTERM end the process at once, while it imports and writes nothing.

    An exception within the import of a compiled package may become another error, or none.
    """

    def end(_number: int, _frame: Any) -> None:
        print(f"{program}: interrupted", file=sys.stderr, flush=True)
        os._exit(INTERRUPTED)

    with _handled((signal.SIGINT, signal.SIGTERM), end):
        yield


@contextlib.contextmanager
def _interrupts() -> Iterator[None]:
    """Let Ctrl-C and SIGTERM raise KeyboardInterrupt, even if a library raises another error.

    None is lost in a destructor or a callback; see ``kept_interrupts``.
    """
    came: list[int] = []

    def interrupt(number: int, _frame: Any) -> None:
        came.append(number)
        raise KeyboardInterrupt

    with _handled((signal.SIGINT, signal.SIGTERM), interrupt):
        try:
            with kept_interrupts():
                yield
        except Exception as error:
            if came:  # such as an error of a library that was interrupted while loading
                raise KeyboardInterrupt from error
            raise


def _chosen(
    prog: str, commands: type[Command] | Commands, words: list[str]
) -> tuple[type[Command], str, list[str]]:
    """Return the command's class, its full name, and the words of its options."""
    if not isinstance(commands, Mapping):
        return commands, prog, words
    if not words or words[0] in (*SHORT_HELP, *FULL_HELP):
        print(commands_help(prog, commands), file=sys.stdout if words else sys.stderr)
        raise SystemExit(0 if words else REFUSED)
    if words[0].startswith("-"):
        raise InvalidArgumentError(
            _unknown_option(words[0], (*FULL_HELP, *SHORT_HELP, "--version"))
        )
    name = one_of("the command", words[0], commands)
    place = commands[name][0]
    command = resolve_name(place) if isinstance(place, str) else place
    return command, f"{prog} {name}", words[1:]


def parse(
    command: type[Command],
    prog: str,
    words: Sequence[str],
    refused: Errors = BAD_INPUT,
) -> Command:
    """Return the command with the options of ``words``; --help and -H print and exit.

    Raises InvalidArgumentError for a wrong option, and the errors of the command's own checks.
    """
    if word := asked_help(words):
        print_help(command, prog, word in FULL_HELP)
        raise SystemExit(0)
    if "--" in words:  # tyro ignores it at the end, and reads no option after it
        raise InvalidArgumentError("unexpected argument '--'; leave it out")
    box = io.StringIO()
    try:
        with contextlib.redirect_stderr(box):
            made: Command = tyro.cli(command, prog=prog, args=words)
    except SystemExit as leaving:
        cause: BaseException | None = leaving
        while cause is not None and not isinstance(cause, refused):
            cause = cause.__context__
        if cause is not None:  # tyro puts our message into a box
            raise cause from None
        if leaving.code:
            raise InvalidArgumentError(_one_line(box.getvalue(), command, words)) from None
        raise
    if isinstance(made, Given):
        object.__setattr__(made, "given", _given(words))
    return made


def _given(words: Sequence[str]) -> dict[str, str]:
    """Return ``Given.given`` for the words of a command line."""
    found: dict[str, str] = {}
    for word, after in pairwise([*words, ""]):
        if word.startswith("--"):
            name, equals, value = word[2:].partition("=")
            found[option_name(name)] = value if equals or after.startswith("--") else after
    return found


def _one_line(box: str, command: type[Command], words: Sequence[str]) -> str:
    """Return the message in tyro's box as one line, with the nearest option or choice."""
    options = option_names(command)
    lacking = [
        name
        for field in inspect.signature(command).parameters.values()
        if field.default is field.empty
        and (name := f"--{option_name(field.name)}") in options
        and not any(word.partition("=")[0] == name for word in words)
    ]
    rows = [row.strip("│╭╮╰╯ ") for row in box.splitlines()[1:]]  # without the title
    text = " ".join(filter(None, rows))
    message = next(filter(None, re.split(r" *[─-]{9,} *", text)), text)
    if found := re.search(r"Unrecognized options: (\S+?)(,|\s|$)", text):
        if not found[1].startswith("-"):
            hint = f"; did you mean {lacking[0]} {found[1]}?" if lacking else ""
            return f"unexpected argument {found[1]!r}{hint}"
        return _unknown_option(found[1], options)
    if found := re.match(r"Error parsing (\S+): .*?(int|float)\b.*: '(.*)'", message):
        kind = "a whole number" if found[2] == "int" else "a number"
        return f"{found[1]} must be {kind}; got {found[3]!r}"
    if found := re.match(r"Error parsing (\S+): .*valid parse for arguments: \[(.*)\]", message):
        return f"{found[1]} must have values as in its help; got {found[2]}"
    if found := re.match(
        r"invalid choice '(.*)' for argument '(.*)'. Expected .*? \((.*)\)", message
    ):
        one_of(found[2], found[1], _in_order(re.findall(r"'(.*?)'", found[3]), command))
    if found := re.match(r"Missing value for argument '(\S+)'", message):
        return f"{found[1]} must have a value; got none"
    if message.startswith("Missing from ") and lacking:
        return f"{' and '.join(lacking)} must be given: see --help"
    return message


def _unknown_option(word: str, options: Iterable[str]) -> str:
    """Return the sentence on an option that does not exist: the nearest one, or all of a few."""
    known = [one for one in dict.fromkeys(options) if one not in (*SHORT_HELP, *FULL_HELP)]
    nearest = difflib.get_close_matches(word, [*known, *SHORT_HELP, *FULL_HELP], n=1)
    if nearest:
        return f"unknown option {word}; did you mean {nearest[0]}?"
    if len(known) <= _LISTED_OPTIONS:
        return f"unknown option {word}; must be {' or '.join([*known, SHORT_HELP[-1]])}"
    return f"unknown option {word}: see --help"


def _in_order(choices: Sequence[str], command: type[Command]) -> list[str]:
    """Return an option's choices as its type lists them, without None.

    tyro has those of an option that may be None in another order in each process.
    """
    if "None" not in choices:
        return list(choices)
    known = {one for one in choices if one != "None"}
    for hint in get_type_hints(command).values():
        for listed in _literals(hint):
            if known == set(listed):
                return listed
    return sorted(known)


def _literals(hint: Any) -> Iterator[list[str]]:
    """Yield the words of each Literal in a type."""
    if get_origin(hint) is Literal:
        yield list(map(str, get_args(hint)))
    else:
        for part in get_args(hint):
            yield from _literals(part)


def _fail(program: str, sentence: str, code: int) -> int:
    print(printable(f"{program}: {' '.join(sentence.split())}"), file=sys.stderr)
    return code


def _refuse_empty_values(words: Sequence[str]) -> None:
    """Refuse ``--out ""``: an empty path would be the current directory."""
    for before, word in pairwise(["", *words]):
        if not word or (word.startswith("--") and word.endswith("=")):
            name = (word or before).removesuffix("=") or "a word of the command"
            raise InvalidArgumentError(f"{name} must not be empty")


def read_morphology(path: Path | None, argument: str, plan: PlanLike | None = None) -> Morphology:
    """Return the body in a file, or a plan's nominal body for None; see ``read_bodies``."""
    if path is None:
        return Morphology.coerce(None, plan)
    bodies = read_bodies(path, argument, plan)
    if len(bodies) > 1:
        raise InvalidArgumentError(f"{argument}: {path} holds {len(bodies)} bodies; one is wanted")
    return bodies[0]
