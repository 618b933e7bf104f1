"""Measure how wrong the simulator is, and scale the intervals: makes ``eea/fish/discrepancy.json``.

    python -m instruments.inference.discrepancy --seed 1

First our simulator is compared with another statement of the same law (``foreign_law``) over random
trials. Then many random robots of our own simulator are inferred, at several noises; every other
one has nuisances drawn from their priors. They are sorted by the noise relative to the signal and
its length. For each group and dimension the factor on the half width is that of split-conformal
prediction for nested sets (Gupta et al., 2022), with which 90% of the intervals hold.
"""

from __future__ import annotations

import json
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from itertools import cycle
from multiprocessing import get_context
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from aquafish_gym.engines.api import TIMESTEP, simulate
from aquafish_gym.runs.command_line import run_command_line
from aquafish_gym.runs.progress import track
from aquafish_gym.utils.storage import write_document
from aquafish_gym.utils.validation import integer
from eea import FitConfig
from eea.core.session import streams
from eea.fish.joint import DISCREPANCY_SCHEMA, fish_robot
from eea.fish.simulator import EngineSimulator, fish_problem
from eea.fish.simulator_error import Discrepancy
from eea.infer.fit import fit
from eea.infer.goodness import autocorrelation
from eea.infer.session import fast_command
from instruments.inference.robots import SPANS, Floats, Robot, draw_body, draw_world
from instruments.inference.settings import Setting, World
from instruments.verification.foreign_law import simulate_law

STEPS, LAGS = 256, 100
MASS = 0.9
NOISES = (0.003, 0.01, 0.03, 0.1)  # rad/s
LENGTHS = (256, 512)  # steps of a trial
WORLDS: tuple[World, ...] = ("plain", "prior")  # of the robots, in turn
GROUPS = 5  # of robots, by noise
FACTORS = np.geomspace(0.15, 3.0, 40)  # on the half widths, that are tried


@dataclass(frozen=True)
class MeasureDiscrepancy:
    """Measure the discrepancy of the simulator and calibrate the intervals of joint inference."""

    out: Annotated[Path, tyro.conf.arg(metavar="FILE")] = Path("eea/fish/discrepancy.json")
    """The file to write."""
    trials: int = 100
    """Random trials that the simulators are compared on."""
    robots: int = 60
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
        jobs = [
            (self.seed, number, Setting("", 1, world=world, noise=noise, steps=steps))
            for noise in NOISES
            for steps in LENGTHS
            for number, world in zip(range(self.robots), cycle(WORLDS), strict=False)
        ]
        judge = partial(miss, share=share, seconds=seconds)
        with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:
            found = list(track(pool.map(judge, jobs), "robots", len(jobs)))
        good = sorted((one for one in found if one is not None), key=lambda one: one[0])
        groups = [
            good[i * len(good) // GROUPS : (i + 1) * len(good) // GROUPS] for i in range(GROUPS)
        ]
        factors = [conformal(np.array([misses for _, misses in group])) for group in groups]
        table = {
            "share": round(share, 4),
            "seconds": round(seconds, 2),
            "levels": [float(f"{np.median([level for level, _ in g]):.3g}") for g in groups],
            "factors": [np.round(row, 3).tolist() for row in factors],
        }
        write_document(self.out, table, DISCREPANCY_SCHEMA)
        print(f"{len(good)} of {len(found)} robots have a good fit")
        print(json.dumps(table, indent=1))


def miss(
    job: tuple[int, int, Setting], share: float, seconds: float
) -> tuple[float, Floats] | None:
    """Return a robot's noise level, and the least factors (9,) whose intervals hold its sizes.

    None if its fit is not good.
    """
    seed, number, setting = job
    joint = fish_robot(EngineSimulator(setting.steps, threads=1))
    assert isinstance(joint.discrepancy, Discrepancy)
    discrepancy = replace(
        joint.discrepancy, share=share, duration=seconds / TIMESTEP, calibration=None
    )
    joint = replace(joint, discrepancy=discrepancy)
    rng = np.random.default_rng([seed, 1 + round(1000 * setting.noise), setting.steps, number])
    body = draw_body(setting, number, rng)
    exploring = streams(number)["exploration"]
    robot = Robot(setting, body, draw_world(setting, rng), rng, exploring)
    for _ in range(setting.trials):
        performed = np.array(robot.commands).reshape(-1, 3)
        robot.perform(fast_command(fish_problem().actions, performed, exploring))
    effort = FitConfig(alternatives="never", restarts=0)
    belief = fit(robot.observed, joint, effort, rng)
    if not belief.good:
        return None
    doubted, held = belief.branches[0].doubted, []
    for factor in FACTORS:
        every = np.full(len(doubted.names), factor)
        modes = [mode.scaled(every) for mode in doubted.modes]
        low, high = (
            end[: len(body)] * SPANS for end in replace(doubted, modes=modes).interval(MASS)
        )
        held.append((low <= body) & (body <= high))
    # The least factor from which on every interval holds.
    holding = np.cumprod(held[::-1], axis=0).sum(axis=0)
    least = FACTORS[-np.maximum(holding, 1)]
    level = belief.sigma / float(np.sqrt((robot.observed.signal**2).sum()))
    return level, least


def measure(trials: int, rng: np.random.Generator) -> tuple[float, float]:
    """Return the rms of the discrepancy as a share of the signal's, and how long it lasts, s."""
    setting = Setting("", trials)
    bodies = np.array([draw_body(setting, i, rng) for i in range(trials)])
    nothing = np.empty((0, 3))
    commands = np.array([fast_command(fish_problem().actions, nothing, rng) for _ in bodies])
    angles = rng.uniform(-np.pi, np.pi, (trials, 3))
    log = simulate(bodies, commands, angles, STEPS, engine="numba", dtype="float64")
    ours = np.asarray(log.gyro, np.float64)
    each = zip(bodies, commands, angles, strict=True)
    apart = (
        np.array([simulate_law(*trial, STEPS) for trial in track(each, "trials", trials)]) - ours
    )
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
    sys.exit(run_command_line("instruments.inference.discrepancy", MeasureDiscrepancy))
