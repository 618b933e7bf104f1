"""The help of commands: ``--help`` for beginners, ``-H`` with every option.

A command may have two class attributes. ``example`` is a line of options for ``--help``.
``main_options`` names the fields that ``--help`` explains; without it, ``--help`` explains all. If
a field groups options without a prefix, such as ``config``, the list names the field and its main
options.
"""

from __future__ import annotations

import contextlib
import io
import re
import shutil
import textwrap
from collections.abc import Container, Iterable, Mapping
from dataclasses import is_dataclass, replace
from inspect import getdoc
from typing import Any

import tyro
from tyro.constructors import ConstructorRegistry, StructConstructorSpec, StructTypeInfo

SHORT_HELP = ("-h", "--help")
FULL_HELP = ("-H", "--help-verbose")
LONGEST_LINE = 100  # characters


def print_help(command: type[Any], prog: str, full: bool = False) -> None:
    """Print the help of a command, for its main options or for all."""
    main: tuple[str, ...] | None = getattr(command, "main_options", None)
    paragraphs = (getdoc(command) or "").partition("\nAttributes\n---")[0].strip().split("\n\n")
    if not full:  # the summary and the paragraph after it
        width = min(shutil.get_terminal_size().columns, LONGEST_LINE)
        paragraphs = [textwrap.fill(" ".join(" ".join(paragraphs[:2]).split()), width)]
    if example := getattr(command, "example", ""):
        paragraphs.append(f"Example:\n  {prog} {example}")
    if not full and main is not None:
        paragraphs.append(f"These options matter most; {prog} -H explains all.")
    print("\n\n".join(paragraphs), end="\n\n")
    _print_options(command, prog, None if full else main)


def option_names(command: type[Any]) -> list[str]:
    """Return the names of all options of a command."""
    text = io.StringIO()
    with contextlib.redirect_stdout(text):
        _print_options(command, "", None)
    return re.findall(r"--[a-z][\w.-]*", text.getvalue())


def commands_help(prog: str, commands: Mapping[str, tuple[Any, str]]) -> str:
    """Return a line for each command of a table."""
    width = max(map(len, commands))
    first = (
        f"usage: {prog} COMMAND [OPTIONS]\n"
        "COMMAND --help explains the options that matter and has an example, -H explains all\n"
    )
    return "\n".join([first, *(f"  {n:{width}}  {text}" for n, (_, text) in commands.items())])


def asked_help(words: Iterable[str]) -> str | None:
    """Return the first word that requests help, or None."""
    return next((word for word in words if word in (*SHORT_HELP, *FULL_HELP)), None)


def _print_options(command: type[Any], prog: str, fields: Container[str] | None) -> None:
    """Print a command's usage and its options: some fields, or all."""
    rules = contextlib.nullcontext() if fields is None else _only(fields)
    with rules, contextlib.suppress(SystemExit):
        tyro.cli(command, prog=prog, description="", args=["--help"])


def _only(fields: Container[str]) -> ConstructorRegistry:
    """Return rules that show tyro only some fields of dataclasses."""
    registry = ConstructorRegistry()
    asked: list[object] = []

    @registry.struct_rule
    def some(info: StructTypeInfo) -> StructConstructorSpec | None:
        if info in asked or not is_dataclass(info.type):
            return None
        asked.append(info)  # tyro's own rule applies
        spec = ConstructorRegistry.get_struct_spec(info)
        asked.pop()
        if not isinstance(spec, StructConstructorSpec):
            return None
        return replace(spec, fields=tuple(one for one in spec.fields if one.name in fields))

    return registry
