"""How far the engines agree: ``python -m tests.verification.engines_command``.

The same random bodies, commands and fin angles swim in each engine; a robot's difference is the
largest over its samples, and the table gives the median and the maximum over robots. The other
comparisons are those of ``python -m tests.verification``.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

from rich.console import Console

from aquafish_gym.engines.base import MAXIMUM_STEPS, TIMESTEP, check_engine
from aquafish_gym.utils.command_line import run_command_line, single_command
from aquafish_gym.utils.validation import integer


@dataclass(frozen=True)
class Agreement:
    """Print how far the engines differ on the same random trials.

    A robot's difference is the largest over its samples; the table gives the median and the
    maximum over robots, of the angles, the rates of turn and the position.
    """

    robots: int = 20
    """Trials of PyBullet against the compiled engine, numba."""
    lane_robots: int = 2000
    """Trials of the compiled engine in float32 against float64."""
    steps: int = 512
    """Samples of 0.01 s a trial."""
    seed: int = 0
    """The random bodies, commands and fin angles follow from it."""

    def execute(self) -> None:
        """Print one table."""
        from tests.verification.agreement import engines
        from tests.verification.tables import agreement_table

        few, many = integer("robots", self.robots, 1), integer("lane_robots", self.lane_robots, 1)
        steps = integer("steps", self.steps, 1, MAXIMUM_STEPS)
        seed = integer("seed", self.seed, 0)
        check_engine("pybullet")
        rows = engines(few, many, steps, seed)
        table = agreement_table({"seconds": steps * TIMESTEP, "rows": rows})
        Console(highlight=False).print(table.rich())


if __name__ == "__main__":
    sys.exit(run_command_line("tests.verification.engines_command", single_command(Agreement)))
