"""Compare known, assumed and inferred fin angles (Secs. 4.1 to 4.4), and joint inference.

    python examples/compare_conditions.py --replicates 5

Each condition models the same damaged robots with the same hidden fin angles.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from rich.console import Console
from rich.table import Table
from tyro.conf import arg

from aquafish_gym import Damage
from aquafish_gym.runs.command_line import BAD_INPUT, TargetEngine, run_command_line
from aquafish_gym.runs.progress import track
from aquafish_gym.utils.validation import integer
from eea import (
    CONDITIONS,
    ConfigurationError,
    MorphologyEstimate,
    config_for,
    estimate_morphology,
)


@dataclass(frozen=True)
class CompareConditions:
    """Compare the conditions on a damaged robot."""

    example: ClassVar[str] = "--damage caudal:length=0.5 --replicates 3"

    damage: str = "left_pectoral:length=0.5"
    """Damage of the robot."""
    steps: int = 256
    """Length of a trial in steps of 0.01 s, a power of two."""
    rounds: int = 10
    """Trials on the damaged robot, one a round."""
    seed: int = 0
    """Seed of the first replicate."""
    replicates: Annotated[int, arg(aliases=("--seeds",))] = 5
    """Replicates, with seeds from --seed upwards."""
    target_engine: TargetEngine = "auto"

    def execute(self) -> None:
        """Run and print one table."""
        integer("seed", self.seed, 0)
        integer("replicates", self.replicates, 1)
        damage = Damage.coerce(self.damage)
        configs = {
            name: config_for(name, steps=self.steps, rounds=self.rounds)
            for name in (*CONDITIONS, "recovery", "joint")
        }
        table = Table(title=f"OBJ_FIT after {self.rounds} trials of {self.steps * 0.01:g} s")
        for column in ("condition", "mean", "SD", "least", "random body", "mid-range body"):
            table.add_column(column, justify="left" if column == "condition" else "right")
        seeds = range(self.seed, self.seed + self.replicates)
        for name, config in configs.items():
            found: list[MorphologyEstimate] = [
                estimate_morphology(None, damage, config, seed, target_engine=self.target_engine)
                for seed in track(seeds, name, len(seeds))
            ]
            fits = np.array([estimate.objective_fitness for estimate in found])
            table.add_row(
                name,
                f"{fits.mean():.3f}",
                f"{fits.std(ddof=1):.3f}" if len(fits) > 1 else "",
                f"{fits.min():.3f}",
                f"{found[0].chance:.3f}",
                f"{found[0].mid_range:.3f}",
            )
        Console().print(table)


if __name__ == "__main__":
    sys.exit(
        run_command_line(
            "compare_conditions",
            CompareConditions,
            refused=(*BAD_INPUT, ConfigurationError),
        )
    )
