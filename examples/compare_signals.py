"""What the EEA should listen to: the robot's attitude or its gyroscope (Eq. 2).

    python examples/compare_signals.py

Two robots do the same from the same fin angles, and their transforms are compared by Eq. 2. For
random pairs of bodies 1 - sim should neither vanish nor pass 1, where MAX would be too low. For the
nominal body and the nearest that a genome can spell it should be small, and no larger in long
trials: whatever fits better than the nearest is found instead of it.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from aquafish_gym import Morphology
from aquafish_gym.command_line import BAD_INPUT, run_command_line
from aquafish_gym.utils.validation import integer
from eea import ConfigurationError
from eea.core.behavior import BehaviorConfig, Signal, similarity, summarize
from eea.core.experiment import Trials
from eea.fish import EngineSimulator, fish_models
from tests.verification.trials import random_trials

SIGNALS: dict[str, Signal] = {
    "attitude, degrees": "attitude",
    "gyroscope, degrees/s": "body_rates",
}
DURATIONS = (128, 256, 512, 1024)


@dataclass(frozen=True)
class CompareSignals:
    """Compare the signals that a behaviour can be made of."""

    pairs: int = 1000
    """Pairs of random bodies, and trials of the nominal one."""
    seed: int = 0
    """Of the bodies, commands and fin angles."""

    def execute(self) -> None:
        """Simulate and print one table."""
        integer("pairs", self.pairs, 1)
        integer("seed", self.seed, 0)
        drawn = random_trials(self.pairs, self.seed)
        first = Trials(drawn.morphologies, drawn.commands, drawn.fin_angles)
        others = random_trials(self.pairs, self.seed + 1).morphologies
        nominal = Morphology.nominal().to_array()
        models = fish_models()
        nearest = models.decode(models.encode(nominal[None]))
        table = Table(title=f"1 - sim in {self.pairs} trials: median and 90th percentile")
        for column in ("signal", "steps", "random bodies", "nearest genome"):
            table.add_column(column, justify="left" if column == "signal" else "right")
        same = np.broadcast_to(nominal, others.shape)
        spelled = np.broadcast_to(nearest, others.shape)
        for name, signal in SIGNALS.items():
            config = BehaviorConfig(signal=signal)
            for steps in DURATIONS:
                at_random = self._apart(first, first.models, others, steps, config)
                least = self._apart(first, same, spelled, steps, config)
                table.add_row(name, f"{steps}", _quantiles(at_random), _quantiles(least))
        Console().print(table)

    def _apart(
        self,
        trials: Trials,
        some: NDArray[np.float64],
        others: NDArray[np.float64],
        steps: int,
        config: BehaviorConfig,
    ) -> NDArray[np.float64]:
        """Return 1 - sim (B,) of bodies (B, 9) in the same trials."""
        simulator = EngineSimulator(steps)
        one, other = (
            summarize(simulator.simulate(Trials(b, trials.commands, trials.angles)), config)
            for b in (some, others)
        )
        return 1.0 - similarity(one, other, config)


def _quantiles(values: NDArray[np.float64]) -> str:
    return "{:.3f}, {:.3f}".format(*np.quantile(values, [0.5, 0.9]))


if __name__ == "__main__":
    sys.exit(
        run_command_line(
            "compare_signals",
            CompareSignals,
            refused=(*BAD_INPUT, ConfigurationError),
        )
    )
