"""Write examples/logs: a swim as a robot's logger would record it, and the body that swam.

    python examples/recorded_swim.py --out examples/logs
    aquafish infer --log examples/logs/swim.csv --truth examples/logs/body.json

A fish whose left flipper broke in the middle performs three commands, each from rest, from fin
hidden angles. Its gyroscope, with noise of 0.01 rad/s, is sampled at 100 Hz.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aquafish_gym import Damage, Morphology, simulate
from aquafish_gym.command_line import Out, run_command_line
from aquafish_gym.runs.storage import ensure_writable_directory, write_document
from eea import RecordedLog, SwimLog, write_log

COMMANDS = [(0.5, -0.5, 1.0), (-0.5, -0.5, 0.5), (0.5, 0.5, 1.0)]  # rev/s, rev/s, Hz
STEPS = 300  # of 0.01 s
DIGITS = 4  # of a gyroscope's reading in rad/s


@dataclass(frozen=True)
class RecordedSwim:
    """Write swim.csv, and the body that swam as body.json."""

    out: Out = Path("examples/logs")
    damage: str = "left_pectoral:length=0.5"
    """What broke."""
    noise: float = 0.01
    """Standard deviation of the gyroscope's noise, rad/s."""
    seed: int = 0
    """Of the fins' starting angles and the noise."""

    def execute(self) -> None:
        """Swim, and write."""
        folder = ensure_writable_directory(self.out)
        body = Damage.parse(self.damage).apply(Morphology.nominal())
        rng = np.random.default_rng(self.seed)
        angles = rng.uniform(-np.pi, np.pi, (len(COMMANDS), 3))
        swum = simulate(body, COMMANDS, angles, STEPS, dtype="float64", record="gyro")
        noise = rng.normal(0.0, self.noise, (len(COMMANDS), STEPS, 3))
        felt = np.round(np.asarray(swum.gyro) + noise, DIGITS)
        log = SwimLog.of_trials(COMMANDS, [RecordedLog(gyro) for gyro in felt])
        write_log(folder / "swim.csv", log)
        write_document(folder / "body.json", body.to_dict())
        print(f"written to {folder}: {len(log)} trials, {sum(log.seconds):g} s of swimming")


if __name__ == "__main__":
    sys.exit(run_command_line("recorded_swim", RecordedSwim))
