"""The command line ``python -m gait``; :data:`COMMANDS` lists its commands."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from aquafish_gym.runs.command_line import Commands, run_command_line

COMMANDS: Commands = {
    "evolve": ("gait.cli:Evolve", "evolve a gait for a body, or for a sample of bodies"),
    "transfer": ("gait.cli:TransferCommand", "swim a gait on another body"),
    "film": ("gait.film:Film", "film controllers as they swim, side by side"),
    "export": (
        "gait.controllers.export:Export",
        "write a controller, a policy or a model in C, for a board",
    ),
    "baseline": ("gait.cli:BaselineCommand", "learn a task with PPO of stable-baselines3"),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code, see ``run_command_line``."""
    return run_command_line("gait", COMMANDS, arguments)


if __name__ == "__main__":
    sys.exit(main())
