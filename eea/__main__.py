"""The command line: ``python -m eea run --condition out-of-band --out DIR``."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from aquafish_gym.utils.command_line import BAD_INPUT, Command, run_command_line, subcommands
from eea.cli.infer import Infer
from eea.cli.run import Recover, Run
from eea.cli.study import Merge, Plot, StudyCommand
from eea.cli.watch import Watch
from eea.core.checks import ConfigurationError, TargetError

REFUSED = (*BAD_INPUT, ConfigurationError, TargetError)
COMMANDS: dict[str, type[Command]] = {
    "run": Run,
    "recover": Recover,
    "infer": Infer,
    "watch": Watch,
    "study": StudyCommand,
    "plot": Plot,
    "merge": Merge,
}


class Commands:
    """The subcommands by their names."""

    def cli(self, *, prog: str | None = None, args: Sequence[str] | None = None) -> Any:
        """Return the command that the arguments ask for."""
        command = subcommands(COMMANDS).cli(prog=prog, args=args)
        # A study reads its settings again over those of each of its arms.
        words = tuple(sys.argv[1:] if args is None else args)
        return replace(command, words=words) if isinstance(command, StudyCommand) else command


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code, see ``run_command_line``."""
    return run_command_line("eea", Commands(), arguments, REFUSED)


if __name__ == "__main__":
    sys.exit(main())
