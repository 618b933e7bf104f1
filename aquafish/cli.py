"""The command ``aquafish``: the case study, and every command of ``eea`` and of ``gait``."""

from __future__ import annotations

import sys
from collections.abc import Sequence

# Name -> where its class is, loaded only when it is asked for, and what it does.
COMMANDS = {
    "recover": (
        "aquafish.recovery.command:Recover",
        "the case study: break a fish, let it model itself, evolve a gait, and score it",
    ),
    "run": ("eea.cli.run:Run", "let a damaged fish work out its own body, as the paper"),
    "infer": (
        "eea.cli.infer:Infer",
        "from a recorded swim, a file alone, to the body and how sure that is",
    ),
    "watch": (
        "eea.cli.watch:Watch",
        "is a recorded swim still that of the body that was inferred?",
    ),
    "study": ("eea.cli.study:StudyCommand", "replicates of the paper's figures"),
    "plot": ("eea.cli.study:Plot", "write a study's tables and figures again"),
    "evolve": ("gait.cli:Evolve", "evolve a gait for a body"),
    "transfer": ("gait.cli:TransferCommand", "swim a gait on another body"),
    "baseline": ("gait.cli:BaselineCommand", "train a learner of stable-baselines3"),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code, as ``run_command_line`` says."""
    try:  # imported here, so that Ctrl-C is answered from the start
        from aquafish_gym.command_line import BAD_INPUT, run_command_line
        from eea.core.checks import ConfigurationError, TargetError
    except KeyboardInterrupt:
        print("aquafish: interrupted", file=sys.stderr)
        return 130
    refused = (*BAD_INPUT, ConfigurationError, TargetError)
    return run_command_line("aquafish", COMMANDS, arguments, refused)
