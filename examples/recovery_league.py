"""The recovery league: damage strikes a swimming robot, and the clock runs on.

    python examples/recovery_league.py --entrants self-model "PPO, fins" --episodes 10 --out DIR

It runs from any folder, with the packages of this clone: as its ``python -m experiments.league``.
``experiments.league.command`` says what the entrants do and what DIR holds.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

if __name__ == "__main__":
    paths = (str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH"))
    os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, paths))
    os.execv(sys.executable, [sys.executable, "-P", "-m", "experiments.league", *sys.argv[1:]])
