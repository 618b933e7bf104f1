"""The command line: ``python -m experiments.real``."""

from __future__ import annotations

import sys

from aquafish_gym.runs.command_line import BAD_INPUT, run_command_line
from eea.core.checks import ConfigurationError
from experiments.real.command import COMMANDS

if __name__ == "__main__":
    refused = (*BAD_INPUT, ConfigurationError)
    sys.exit(run_command_line("experiments.real", COMMANDS, refused=refused))
