"""How far the engines agree: ``python -m aquafish_gym.agreement``.

The same random bodies, commands and fin angles swim in each engine; a robot's difference is the
largest over its samples, and the table gives the median and the maximum over robots.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np
from rich.console import Console
from rich.table import Table

from aquafish_gym.commandline import run_command_line, single_command
from aquafish_gym.engines.base import MAXIMUM_STEPS, check_engine, simulate
from aquafish_gym.imu import ImuLog
from aquafish_gym.morphology import MAXIMA
from aquafish_gym.validation import integer


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
        few, many = integer("robots", self.robots, 1), integer("lane_robots", self.lane_robots, 1)
        integer("steps", self.steps, 1, MAXIMUM_STEPS)
        check_engine("pybullet")
        rng = np.random.default_rng(integer("seed", self.seed, 0))
        count = max(few, many)
        bodies = rng.uniform(0, 1, (count, 9)) * MAXIMA
        commands = rng.uniform([-0.5, -0.5, 0.0], [0.5, 0.5, 1.0], (count, 3))
        angles = rng.uniform(-np.pi, np.pi, (count, 3))

        def log(engine: str, dtype: str, robots: int) -> ImuLog:
            trials = (bodies[:robots], commands[:robots], angles[:robots])
            return simulate(*trials, steps=self.steps, engine=engine, dtype=dtype, record="pose")

        table = Table(title=f"differences over {self.steps * 0.01:g} s")
        for column in ("engines", "robots", "what", "median", "maximum"):
            table.add_column(column, justify="left" if column in ("engines", "what") else "right")
        for name, first, second, robots in (
            ("PyBullet, numba float64", ("pybullet", "float64"), ("numba", "float64"), few),
            ("numba float32, float64", ("numba", "float32"), ("numba", "float64"), many),
        ):
            one, other = log(*first, robots), log(*second, robots)
            for field, unit in (("rpy", "rad"), ("gyro", "rad/s"), ("position", "units")):
                worst = abs(getattr(one, field) - getattr(other, field)).max(axis=(1, 2))
                table.add_row(
                    name, str(robots), f"{field} ({unit})",
                    f"{np.median(worst):.1e}", f"{worst.max():.1e}",
                )  # fmt: skip
        Console().print(table)


if __name__ == "__main__":
    sys.exit(run_command_line("aquafish_gym.agreement", single_command(Agreement)))
