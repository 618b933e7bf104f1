"""The command line: ``python -m experiments.scores``."""

from __future__ import annotations

import sys

from aquafish_gym.runs.command_line import run_command_line
from experiments.scores.command import Scores

if __name__ == "__main__":
    sys.exit(run_command_line("experiments.scores", Scores))
