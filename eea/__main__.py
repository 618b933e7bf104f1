"""The command line: ``python -m eea run --condition out-of-band --out DIR``."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from aquafish_gym.runs.command_line import BAD_INPUT, Commands, run_command_line
from eea.core.checks import ConfigurationError, TargetError

REFUSED_ERRORS = (*BAD_INPUT, ConfigurationError, TargetError)
COMMANDS: Commands = {
    "run": ("eea.cli.run:Run", "let a damaged robot infer its own body"),
    "infer": ("eea.cli.infer:Infer", "infer the body from a recorded swim, with its uncertainty"),
    "logs": ("eea.cli.logs:Logs", "show what is in a recorder's log, and how to read it"),
    "watch": ("eea.cli.watch:Watch", "detect a change of the body in a recorded swim"),
    "study": ("eea.cli.study:StudyCommand", "replicates for the paper's figures"),
    "plot": ("eea.cli.study:Plot", "write a study's tables and figures again"),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code, see ``run_command_line``."""
    return run_command_line("eea", COMMANDS, arguments, REFUSED_ERRORS)


if __name__ == "__main__":
    sys.exit(main())
