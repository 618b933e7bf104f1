"""Measure how wrong the simulator is, and scale the intervals: makes ``eea/fish/discrepancy.json``.

    python -m tests.inference.discrepancy --seed 1

First our simulator is compared with another statement of the same law (``foreign_law``) over random
trials. Then many random robots are inferred. Those of our own simulator, at several noises, are
sorted by the noise relative to the signal; for each group and dimension the factor on the half
width is that of split-conformal prediction, with which 90% of the intervals hold. Without noise the
simulator's own errors are all there is: there the robots swim in the other simulator, and their
factors are the floor.
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from aquafish_gym.command_line import run_command_line
from aquafish_gym.engines.api import TIMESTEP, simulate
from aquafish_gym.runs.storage import write_bytes
from aquafish_gym.utils.validation import integer
from eea import FitConfig
from eea.core.session import streams
from eea.fish.joint import fish_joint
from eea.fish.simulator import EngineSimulator, fish_problem
from eea.joint.commands import fast_command
from eea.joint.goodness_of_fit import autocorrelation
from eea.joint.inference import fit
from eea.joint.problem import Calibration
from tests.inference.robots import SPANS, Floats, Robot, draw_body, draw_world
from tests.inference.settings import Setting
from tests.verification.foreign_law import simulate_law

STEPS, LAGS = 256, 100
MASS = 0.9
NOISES = (0.01, 0.03, 0.1)  # rad/s
GROUPS = 4  # of robots, by noise relative to the signal
LENGTHS = (256, 512)  # steps of a trial
NEUTRAL = Calibration((1.0,), ((1.0,) * len(SPANS),), (0.0,) * len(SPANS))


@dataclass(frozen=True)
class MeasureDiscrepancy:
    """Measure the discrepancy of the simulator and calibrate the intervals of joint inference."""

    out: Annotated[Path, tyro.conf.arg(metavar="FILE")] = Path("eea/fish/discrepancy.json")
    """The file to write."""
    trials: int = 100
    """Random trials that the simulators are compared on."""
    robots: int = 40
    """Random robots that are inferred at each noise and length of trial."""
    seed: int = 1
    """Seed of all that is random."""

    def execute(self) -> None:
        """Write the file and print it."""
        integer("trials", self.trials, 2)
        integer("robots", self.robots, 10)
        integer("seed", self.seed, 0)
        share, seconds = measure(self.trials, np.random.default_rng([self.seed, 0]))
        print(f"discrepancy {share:.4f} of the signal, for {seconds:.2f} s", flush=True)
        foreign = Setting("", self.robots, world="law", noise=0.0)
        floor = conformal(np.array([miss for _, miss in self._misses(foreign, share, seconds)]))
        noisy = [
            self._misses(Setting("", self.robots, noise=n, steps=steps), share, seconds, NEUTRAL)
            for n in NOISES
            for steps in LENGTHS
        ]
        ordered = sorted((miss for some in noisy for miss in some), key=lambda miss: miss[0])
        each = len(ordered) // GROUPS
        rows = [ordered[i * each : (i + 1) * each] for i in range(GROUPS)]
        levels = [float(np.median([level for level, _ in row])) for row in rows]
        factors = [conformal(np.array([miss for _, miss in row])) for row in rows]
        table = {
            "share": round(share, 4),
            "seconds": round(seconds, 2),
            "floor": np.round(floor, 3).tolist(),
            "levels": [round(level, 4) for level in levels],
            "factors": [np.round(row, 3).tolist() for row in factors],
        }
        text = json.dumps(table, indent=1)
        write_bytes(self.out, (text + "\n").encode())
        print(text)

    def _misses(
        self,
        setting: Setting,
        share: float,
        seconds: float,
        calibration: Calibration | None = None,
    ) -> list[tuple[float, Floats]]:
        """Return each robot's noise level, and how far each truth is in half widths (9,)."""
        joint = fish_joint(EngineSimulator(setting.steps, threads=1))
        assert joint.discrepancy is not None
        uncalibrated = replace(
            joint.discrepancy,
            share=share,
            duration=seconds / TIMESTEP,
            calibration=calibration,
        )
        joint = replace(joint, discrepancy=uncalibrated)
        effort = FitConfig(alternatives="never", restarts=0)
        found = []
        for number in range(setting.robots):
            stream = [self.seed, 1 + round(1000 * setting.noise), setting.steps, number]
            rng = np.random.default_rng(stream)
            body = draw_body(setting, number, rng)
            exploring = streams(number)["exploration"]
            # A user's water and servos may be nominal or not: every other robot's are drawn.
            drawn = replace(setting, world="prior") if calibration and number % 2 else setting
            robot = Robot(setting, body, draw_world(drawn, rng), rng, exploring)
            for _ in range(setting.trials):
                performed = np.array(robot.commands).reshape(-1, 3)
                robot.perform(fast_command(fish_problem().actions, performed, exploring))
            belief = fit(robot.observed, joint, effort, rng)
            low, high = belief.interval(MASS)
            middle = belief.branches[0].doubted.median()[: len(body)] * SPANS
            side = np.where(body > middle, high - middle, middle - low)
            signal = float(np.sqrt((robot.observed.signal**2).mean()))
            level = belief.sigma / max(np.sqrt(max(signal**2 - belief.sigma**2, 0.0)), 1e-9)
            found.append((level, np.abs(body - middle) / np.maximum(side, 1e-6 * SPANS)))
        return found


def measure(trials: int, rng: np.random.Generator) -> tuple[float, float]:
    """Return the rms of the discrepancy as a share of the signal's, and how long it lasts, s."""
    setting = Setting("", trials)
    bodies = np.array([draw_body(setting, i, rng) for i in range(trials)])
    nothing = np.empty((0, 3))
    commands = np.array([fast_command(fish_problem().actions, nothing, rng) for _ in bodies])
    angles = rng.uniform(-np.pi, np.pi, (trials, 3))
    ours = simulate(bodies, commands, angles, STEPS, engine="numba", dtype="float64").gyro
    each = zip(bodies, commands, angles, strict=True)
    apart = np.array([simulate_law(*trial, STEPS) for trial in each]) - ours
    kept = np.isfinite(apart).all(axis=(1, 2))
    shares = (apart[kept] ** 2).mean(axis=(1, 2)) / (ours[kept] ** 2).mean(axis=(1, 2))
    alike = autocorrelation(apart[kept], LAGS)[0]
    lasts = 1 + int(np.argmax(alike < np.exp(-1.0)))
    return float(np.sqrt(shares.mean())), TIMESTEP * lasts


def conformal(misses: Floats, mass: float = MASS) -> Floats:
    """Return the factors (n,) of split-conformal prediction from scores (R, n).

    Examples
    --------
    >>> conformal(np.arange(1.0, 10.0)[:, None])
    array([9.])
    """
    rank = min(int(np.ceil((len(misses) + 1) * mass)), len(misses))
    return np.asarray(np.sort(misses, axis=0)[rank - 1])


if __name__ == "__main__":
    sys.exit(run_command_line("tests.inference.discrepancy", MeasureDiscrepancy))
