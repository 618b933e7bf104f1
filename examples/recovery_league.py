"""The recovery league: damage strikes a swimming robot, and the clock runs on.

    python examples/recovery_league.py --entrants self-model "PPO, fins" --episodes 10 --out DIR

It runs from any folder, with the packages of this clone. ``experiments.league.command`` says what
the entrants do and what DIR holds.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))  # the clone, for ``experiments``

from aquafish_gym.runs.command_line import run_command_line
from experiments.league.command import League

if __name__ == "__main__":
    sys.exit(run_command_line("recovery_league", League))
