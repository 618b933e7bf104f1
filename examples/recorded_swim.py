"""Write examples/logs: two swims as a robot's logger would record them, and the body that swam.

    python examples/recorded_swim.py --out examples/logs
    aquafish infer --log examples/logs/swim.csv --truth examples/logs/body.json --out out/infer
    aquafish watch --log examples/logs/later.csv --posterior out/infer/posterior.npz

A fish whose left flipper broke in the middle performs three commands, each from rest, from hidden
fin angles: swim.csv. In later.csv it swims for 12 s, and after 6 s its right flipper breaks, too.
Its gyroscope, with noise of 0.01 rad/s, is sampled at 100 Hz.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from aquafish_gym import Damage, Morphology, simulate
from aquafish_gym.rollout import rollout
from aquafish_gym.runs.command_line import Out, run_command_line
from aquafish_gym.scenario import TIMESTEP, Scenario
from aquafish_gym.utils.storage import ensure_writable_directory, write_document
from eea import RecordedLog, SwimLog, write_log

COMMANDS = [(0.5, -0.5, 1.0), (-0.5, -0.5, 0.5), (0.5, 0.5, 1.0)]  # rev/s, rev/s, Hz
STEPS = 300  # of 0.01 s
DIGITS = 4  # of a gyroscope's reading in rad/s
LATER_SECONDS = 12.0
HELD = 150  # steps for which the later swim holds a command


@dataclass(frozen=True)
class RecordedSwim:
    """Write swim.csv, the body that swam as body.json, and a later swim, later.csv."""

    example: ClassVar[str] = "--damage caudal:length=0.5 --out out/logs"

    out: Out = Path("examples/logs")
    damage: str = "left_pectoral:length=0.5"
    """What broke before both swims."""
    later: str = "right_pectoral:length=0.5@6"
    """What breaks in the later swim."""
    noise: float = 0.01
    """Standard deviation of the gyroscope's noise, rad/s."""
    seed: int = 0
    """Seed of the fins' starting angles and the noise."""

    def execute(self) -> None:
        """Swim, and write."""
        later = Damage.parse(self.later)
        body = Damage.parse(self.damage).apply(Morphology.nominal())
        broken = later.edit(Scenario.create(body), HELD)
        folder = ensure_writable_directory(self.out)
        rng = np.random.default_rng(self.seed)
        angles = rng.uniform(-np.pi, np.pi, (len(COMMANDS), 3))
        swum = simulate(body, COMMANDS, angles, STEPS, dtype="float64", record="gyro")
        noise = rng.normal(0.0, self.noise, (len(COMMANDS), STEPS, 3))
        felt = np.round(np.asarray(swum.gyro) + noise, DIGITS)
        log = SwimLog.of_trials(COMMANDS, [RecordedLog(gyro) for gyro in felt])
        write_log(folder / "swim.csv", log)
        write_document(folder / "body.json", body.to_dict())
        write_log(folder / "later.csv", self._swim_later(broken, rng))
        print(f"written to {folder}: {len(log)} trials, {sum(log.seconds):g} s of swimming")

    def _swim_later(self, broken: Scenario, rng: np.random.Generator) -> SwimLog:
        """Return the log of a swim of random commands in which something breaks."""
        (path,) = rollout(
            [lambda *_: np.round(rng.uniform(-1.0, 1.0, 3), 2)],
            broken.draw_angles([rng]),
            engine="numba",
            seconds=LATER_SECONDS,
            interval=HELD,
        ).paths
        turned = np.vstack([np.zeros(3), path.gyro])
        felt = np.round(turned + rng.normal(0.0, self.noise, turned.shape), DIGITS)
        commands = np.vstack([path.commands, path.commands[-1]])
        time = np.arange(len(felt), dtype=np.float64) * TIMESTEP
        return SwimLog(time, felt.astype(np.float64), commands)


if __name__ == "__main__":
    sys.exit(run_command_line("recorded_swim", RecordedSwim))
