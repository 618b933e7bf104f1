"""What the packages' command lines share: one line for a mistake, and honest exit codes."""

from __future__ import annotations

import contextlib
import difflib
import io
import os
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

import tyro

from aquafish_gym.morphology import DIMENSIONS, FINS, Morphology
from aquafish_gym.utils.validation import EngineUnavailableError, InvalidArgumentError, parse_json

BAD_INPUT: tuple[type[Exception], ...] = (InvalidArgumentError, EngineUnavailableError)
REFUSED = 2
INTERRUPTED = 130
UNREAD = 141  # as of a program that SIGPIPE ends


class Command(Protocol):
    """A subcommand, its options as fields."""

    def execute(self) -> None:
        """Do it."""


def run_command_line(
    program: str,
    app: CommandLine,
    arguments: Sequence[str] | None = None,
    refused: tuple[type[Exception], ...] = BAD_INPUT,
) -> int:
    """Run one of an app's commands and return the exit code.

    Parameters
    ----------
    program
        The package's name, as in ``python -m gait``.
    app
        Its commands, each a :class:`Command`.
    arguments
        None takes the process's own.
    refused
        Errors that say what is wrong with the input.

    Returns
    -------
    int
        0; 2 after one line on stderr for a command or setting that is wrong; 130 after Ctrl-C; 141
        where nobody reads what is printed.
    """
    try:
        code = _run(program, app, arguments, refused)
        sys.stdout.flush()
    except BrokenPipeError:
        # The reader has left, as head does; nor can what is left be written at the exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return UNREAD
    return code


def _run(
    program: str,
    app: CommandLine,
    arguments: Sequence[str] | None,
    refused: tuple[type[Exception], ...],
) -> int:
    said = io.StringIO()
    try:
        # tyro explains a bad command line in a box on stderr; one line of it is enough.
        with contextlib.redirect_stderr(said):
            command: Command = app.cli(prog=f"python -m {program}", args=arguments)
    except SystemExit as stop:
        if not stop.code:
            return 0
        words = sys.argv[1:] if arguments is None else arguments
        return _refuse(program, _first_sentence(said.getvalue(), words))
    except refused as error:
        return _refuse(program, str(error))
    try:
        command.execute()
    except KeyboardInterrupt as stop:  # a command may say what is left to do
        print(f"{program}: {str(stop) or 'interrupted'}", file=sys.stderr)
        return INTERRUPTED
    except refused as error:
        return _refuse(program, str(error))
    return 0


class CommandLine(Protocol):
    """Whatever makes a command of a command line; tyro's ``SubcommandApp`` is one."""

    def cli(self, *, prog: str | None = None, args: Sequence[str] | None = None) -> Any:
        """Return the command, or leave with SystemExit."""


def single_command(command: type[Command]) -> CommandLine:
    """Return the command line of a program that does one thing."""

    class Single:
        def cli(self, *, prog: str | None = None, args: Sequence[str] | None = None) -> Any:
            return tyro.cli(command, prog=prog, args=args)

    return Single()


def read_morphology(path: Path | None, argument: str) -> Morphology:
    """Return the body in a JSON file, or the nominal body for None.

    The file holds what ``Morphology.to_json`` wrote, or an object whose ``morphology`` is that or
    nine numbers in the order of ``DIMENSIONS``, as results of estimations and studies do.

    Raises
    ------
    InvalidArgumentError
        If the file cannot be read or holds no morphology; the message names ``argument`` and the
        file.
    """
    if path is None:
        return Morphology.nominal()
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise InvalidArgumentError(
            f"{argument} must be a file that can be read; {path}: {error.strerror}"
        ) from None
    except UnicodeDecodeError:
        raise InvalidArgumentError(f"{argument} must be a JSON file; {path} is not text") from None
    document: Any = parse_json(f"{argument}: {path}", text)
    try:
        return _find_morphology(document)
    except InvalidArgumentError as error:
        raise InvalidArgumentError(f"{argument}: {path}: {error}") from None


def _find_morphology(document: Any) -> Morphology:
    if isinstance(document, dict) and "morphology" in document:
        body = document["morphology"]
        if body is None:
            raise InvalidArgumentError("its morphology is null, so it has no body yet")
        if isinstance(body, list):
            _check_dimensions(document)
            return Morphology.from_array(body)
        document = body
    if not isinstance(document, dict) or sorted(document) != sorted(FINS):
        raise InvalidArgumentError(
            f"it must hold an object with the keys {', '.join(FINS)}, "
            'or one with such an object or nine numbers under "morphology"'
        )
    return Morphology.coerce(document)


def _check_dimensions(document: dict[str, Any]) -> None:
    """Refuse numbers that say they are not the nine sizes in their order."""
    names = [dimension.name for dimension in DIMENSIONS]
    if document.get("dimensions", names) != names:
        raise InvalidArgumentError(f"its dimensions must be {', '.join(names)}")


def _refuse(program: str, reason: str) -> int:
    print(f"{program}: {' '.join(reason.split())}", file=sys.stderr)
    return REFUSED


def _first_sentence(box: str, arguments: Sequence[str]) -> str:
    """Return what a box of tyro's says first, and the nearest of what it offers.

    Its parts are divided by rules. Where the terminal has no UTF-8, there is no frame, and the
    title is a part of its own.
    """
    framed = box.startswith("╭")
    rows = [row.strip(" │") for row in box.splitlines() if not row.startswith(("╭", "╰"))]
    parts: list[list[str]] = [[]]
    for row in filter(None, rows):
        if set(row) <= set("─-"):
            parts.append([])
        else:
            parts[-1].append(row)
    sentence = " ".join(parts[0] if framed else parts[min(1, len(parts) - 1)])
    # tyro's own name for a group of settings, whose error names the setting itself.
    sentence = re.sub(r"^Error parsing \S*__tyro\S*: ", "", sentence)
    plain = _wrong_choice(sentence) or _no_number(sentence, rows) or _no_value(sentence, arguments)
    if plain:
        return plain
    said = [word.strip(",:") for word in sentence.split()]
    unknown = next((word for word in said if word.startswith("--")), "")
    offered = [
        row.split()[0].strip(",") for row in rows if row.startswith("--") and set(row) != {"-"}
    ]
    offered = [option for option in offered if option not in said]
    close = difflib.get_close_matches(unknown, offered, n=1, cutoff=0.6)
    return f"{sentence}; did you mean {close[0]}?" if close else sentence


def _wrong_choice(sentence: str) -> str | None:
    """Return what an option must be, if tyro's sentence lists its choices."""
    found = re.match(
        r"invalid choice '(.*)' for argument '(.*?)'\. Expected one of \((.*)\)", sentence
    )
    if found is None:
        return None
    got, option, listed = found.groups()
    # None is how an option is left out, and nobody says so.
    choices = [name for name in re.findall(r"'(.*?)'", listed) if name != "None"]
    close = difflib.get_close_matches(got, choices, n=1, cutoff=0.4)
    hint = f"; did you mean {close[0]!r}?" if close else ""
    one_of = "one of " if len(choices) > 1 else ""
    return f"{option} must be {one_of}{', '.join(choices)}; got {got!r}{hint}"


def _no_number(sentence: str, rows: Sequence[str]) -> str | None:
    """Return what an option must be, if tyro's help on it, among the rows, is of numbers."""
    found = re.match(r"Error parsing (--\S+): ", sentence)
    if found is None:
        return None
    option = found.group(1)
    form = next((row for row in rows if row.startswith(f"{option} ")), "")
    kinds = re.findall(r"\b(INT|FLOAT)\b", form)
    got = re.search(r"\[('.*?')\]", sentence) or re.search(r": ('.*')$", sentence)
    if not kinds or len(set(kinds)) > 1 or got is None:
        return None
    number = "whole number" if kinds[0] == "INT" else "number"
    if "..." in form:
        wanted = f"{number}s"
    elif len(kinds) > 1:
        wanted = f"{len(kinds)} {number}s"
    else:
        wanted = f"a {number}" + (" or None" if "{None}" in form else "")
    return f"{option} must be {wanted}; got {got.group(1)}"


def _no_value(sentence: str, arguments: Sequence[str]) -> str | None:
    """Return how to say a switch, if tyro cannot place the word right behind one."""
    found = re.match(r"Unrecognized options: ([^-,\s][^,\s]*)$", sentence)
    if found is None or list(arguments).count(found.group(1)) != 1:
        return None
    word = found.group(1)
    at = list(arguments).index(word)
    # An option that takes a value would have taken the word.
    option = arguments[at - 1] if at else ""
    if not option.startswith("--") or "=" in option:
        return None
    group, dot, name = option.removeprefix("--").rpartition(".")
    name = name.removeprefix("no-")
    return (
        f"{option} takes no value; got {word!r}; it is --{group}{dot}{name} "
        f"or --{group}{dot}no-{name}"
    )
