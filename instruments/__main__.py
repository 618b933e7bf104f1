"""The command line: ``python -m instruments``."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from aquafish_gym.runs.command_line import Commands, run_command_line

COMMANDS: Commands = {
    "mutants": (
        "instruments.mutants.command:Mutants",
        "change the source in one place at a time, and count the changes that the tests notice",
    ),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return the exit code."""
    return run_command_line("instruments", COMMANDS, arguments)


if __name__ == "__main__":
    sys.exit(main())
