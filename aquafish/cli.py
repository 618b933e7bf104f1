"""The command ``aquafish``: the case study, and every command of ``eea`` and of ``gait``."""

from __future__ import annotations

import sys
from collections.abc import Sequence

# Name -> where its class is, loaded only when it is run; and a summary.
COMMANDS = {
    "recover": ("aquafish.recovery.command:Recover", "the case study: damage, self-model, gait"),
    "run": ("eea.cli.run:Run", "let a damaged robot infer its own body"),
    "infer": ("eea.cli.infer:Infer", "infer the body from a recorded swim, with its uncertainty"),
    "watch": ("eea.cli.watch:Watch", "detect a change of the body in a recorded swim"),
    "evolve": ("gait.cli:Evolve", "evolve a gait for a body, or for a sample of bodies"),
    "transfer": ("gait.cli:TransferCommand", "swim a gait on another body"),
    "baseline": ("gait.cli:BaselineCommand", "learn a task with PPO of stable-baselines3"),
    "study": ("eea.cli.study:StudyCommand", "replicates for the paper's figures"),
    "plot": ("eea.cli.study:Plot", "write a study's tables and figures again"),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit code; see ``run_command_line``."""
    try:  # imported here, so that Ctrl-C is answered from the start
        from aquafish_gym.command_line import BAD_INPUT, run_command_line
        from eea.core.checks import ConfigurationError, TargetError
    except KeyboardInterrupt:
        print("aquafish: interrupted", file=sys.stderr)
        return 130
    refused = (*BAD_INPUT, ConfigurationError, TargetError)
    return run_command_line("aquafish", COMMANDS, arguments, refused)
