"""What a gait for a sample of bodies is worth, against a gait for the one body in its middle.

    python examples/compare_gaits.py --seeds 5

Two samples, as estimations may leave them: every size lies within a share of its range of that of
the robot whose left flipper broke; and it may have been the right one as well. Each gait then swims
on other bodies of that kind.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table

from aquafish_gym import Damage, Morphology
from aquafish_gym.morphology import MAXIMA
from aquafish_gym.utils.command_line import run_command_line, single_command
from aquafish_gym.utils.validation import finite_array, integer
from gait import EvolveConfig, distances, evolve_gait, random_poses

HELD_OUT, POSES = 200, 16
LEFT, RIGHT = (
    Damage.parse(f"{side}_pectoral:length=0.5").apply(Morphology.nominal()).to_array()
    for side in ("left", "right")
)


@dataclass(frozen=True)
class CompareGaits:
    """Compare gaits for one body with gaits for a sample of bodies."""

    spread: float = 0.1
    """How far a size may be from its middle, as a share of its range."""
    bodies: int = 50
    """How many the sample has."""
    generations: int = 560
    """Of each search, by CMA-ES."""
    population: int = 24
    """Controllers in a generation."""
    screened: int = 1200
    """Random controllers that each search begins with."""
    seeds: int = 5
    """Replicates, with seeds from 0 upwards; each has a sample of its own."""

    def execute(self) -> None:
        """Run and print a table for each sample."""
        finite_array("spread", self.spread, (), 0.0, 1.0)
        for name in ("bodies", "seeds"):
            integer(name, getattr(self, name), 2)
        config = EvolveConfig(
            search="cma",
            generations=self.generations,
            population=self.population,
            screened=self.screened,
        )
        evolve_gait(LEFT, replace(config, generations=1, screened=10, seconds=0.1))  # compiles
        for title, middles in (
            (f"every size within {self.spread:.0%} of its range", [LEFT]),
            ("and the flipper broke on the left or on the right", [LEFT, RIGHT]),
        ):
            Console().print(self._table(title, np.array(middles), config))

    def _sample(self, middles: NDArray[np.float64], count: int, seed: int) -> NDArray[np.float64]:
        """Return bodies (count, 9), around each of the middles (m, 9) in turn."""
        away = np.random.default_rng(seed).uniform(-self.spread, self.spread, (count, 9))
        return np.clip(np.resize(middles, (count, 9)) + away * MAXIMA, 0.0, MAXIMA)

    def _table(self, title: str, middles: NDArray[np.float64], config: EvolveConfig) -> Table:
        others, poses = self._sample(middles, HELD_OUT, 10**6), random_poses(POSES, 10**6)
        rows: dict[str, list[tuple[float, ...]]] = {}
        for seed in track(range(self.seeds), title, console=Console(stderr=True)):
            sample = self._sample(middles, self.bodies, seed)
            steady = replace(config, seed=seed, aggregate="quantile")
            for name, bodies, how in (
                ("one body, broken on the left", LEFT, replace(config, seed=seed)),
                ("the sample, mean", sample, replace(config, seed=seed)),
                (f"the sample, {steady.quantile:.0%} quantile", sample, steady),
            ):
                start = time.process_time()
                evolved = evolve_gait(bodies, how)
                spent = time.process_time() - start
                far = distances([evolved.controller], others, poses)[0]
                row = spent, far.mean(), np.quantile(far, 0.1), far.min()
                rows.setdefault(name, []).append(row)
        table = Table(title=f"{title}: units in 20 s, mean of {self.seeds} seeds (SD)")
        for column in ("gait for", "mean body", "10% of bodies below", "worst body", "CPU time"):
            table.add_column(column, justify="left" if column == "gait for" else "right")
        once = np.mean([row[0] for row in next(iter(rows.values()))])
        for name, found in rows.items():
            mean, deviation = np.mean(found, axis=0), np.std(found, axis=0, ddof=1)
            cells = (f"{m:.2f} ({s:.2f})" for m, s in zip(mean[1:], deviation[1:], strict=True))
            table.add_row(name, *cells, f"x {mean[0] / once:.2f}")
        return table


if __name__ == "__main__":
    sys.exit(run_command_line("compare_gaits", single_command(CompareGaits)))
