"""The command line: ``python -m experiments.league``."""

from __future__ import annotations

import sys

from aquafish_gym.runs.command_line import run_command_line
from experiments.league.command import League

if __name__ == "__main__":
    sys.exit(run_command_line("experiments.league", League))
