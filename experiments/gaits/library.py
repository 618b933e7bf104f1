"""Make the library of gaits that the agent chooses from.

Two are for the whole robot, each other one for a robot that random damage broke. ``offline`` holds
for each gait the robot steps of 0.01 s that were simulated for it, and the CPU time in s.

    python -m experiments.gaits.library --out out/library.json
    python -m experiments.gaits.library --plan four-fins --out out/library.json

Some minutes on two cores. ``aquafish.online.gaits.PACKAGED`` names the packaged files.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from tyro.conf import arg

from aquafish.online.gaits import LIBRARY_SCHEMA
from aquafish_gym.damage import Damage
from aquafish_gym.damage.words import parts_of
from aquafish_gym.plans import AQUAFISH
from aquafish_gym.runs.command_line import Plan, run_command_line
from aquafish_gym.runs.progress import track
from aquafish_gym.scenario import TIMESTEP, Scenario
from aquafish_gym.utils.storage import read_document, write_document
from aquafish_gym.world_config import WorldConfig
from gait import Controller, EvolveConfig, evolve_gait
from gait.search.cma import CANDIDATE_POSES

SCORES = Path(__file__).parents[1] / "scores/results/runs/forward"
WHOLE = ("PPO--fins", "CMA-ES--fins")  # the paper's fish's, of the reference scores
SEARCH = EvolveConfig(
    search="cma", senses=("imu", "clock", "fins"), interval=20, restarts=3, generations=250
)


@dataclass(frozen=True)
class Library:
    """Evolve a gait for each of some robots that random damage broke, and write a library."""

    example: ClassVar[str] = "--gaits 4 --out out/library.json"

    out: Annotated[Path, arg(metavar="FILE")] = Path("out/library.json")
    """The library."""
    gaits: int = 24
    """Gaits for broken robots: four of five severely, the others moderately."""
    seed: int = 7
    """Seed of the damage."""
    plan: Plan = "aquafish"
    reactive: bool = False
    """Whether the water has added mass, too."""

    def execute(self) -> None:
        """Write the library; takes some seconds a gait."""
        whole = Scenario.create(plan=self.plan, reactive=self.reactive)
        robots = broken_robots(whole, self.gaits, self.seed)
        found: list[Controller] = []
        steps: list[int] = []
        seconds: list[float] = []
        if whole.plan == AQUAFISH and not self.reactive:
            scored = [read_document(SCORES / name / "100.json") for name in WHOLE]
            found = [Controller.from_dict(one["controller"]) for one in scored]
            # A curve's last row counts PPO's actions, or CMA-ES's generations.
            steps = [scored[0]["curve"][-1][0] * SEARCH.interval, swum(scored[1]["curve"][-1][0])]
            times = [read_document(SCORES / name / "100.times.json") for name in WHOLE]
            seconds = [one["seconds"] for one in times]
        else:
            robots = [whole, whole, *robots]
        for k, robot in enumerate(track(robots, "gaits", len(robots))):
            world = WorldConfig.of(robot)
            config = replace(SEARCH, seed=k, plan=self.plan)
            began = time.process_time()
            found.append(evolve_gait(robot.body[0], config, world=world).controller)
            seconds.append(time.process_time() - began)
            steps.append(swum(SEARCH.choices.rows))
        document = {
            "offline": {"steps": steps, "seconds": [round(one, 2) for one in seconds]},
            "gaits": [_short(one.to_dict()) for one in found],
        }
        write_document(self.out, document, LIBRARY_SCHEMA, indent=None)
        print(f"{len(found)} gaits: {self.out}")


def swum(generations: int) -> int:
    """Return the robot steps of 0.01 s in a search; those of finalists, some 5%, do not count."""
    choices = SEARCH.choices
    swims = choices.random_candidates * (1 + CANDIDATE_POSES)
    swims += (generations - 1) * choices.population * (1 + SEARCH.poses)
    return swims * round(SEARCH.seconds / TIMESTEP)


def broken_robots(whole: Scenario, count: int, seed: int) -> list[Scenario]:
    """Return robots whose body or servos random damage broke."""
    rng = np.random.default_rng(seed)
    found: list[Scenario] = []
    while len(found) < count:
        tier = rng.choice(["severe", "moderate"], p=[0.8, 0.2])
        robot = Damage.parse(f"random:{tier}").sample(rng, parts_of(whole.plan)).edit(whole)
        if (robot.body != whole.body).any() or (robot.servo_gain != 1.0).any():
            found.append(robot)
    return found


def _short(value: Any) -> Any:
    """Return a JSON value with numbers of four digits."""
    if isinstance(value, dict):
        return {name: _short(each) for name, each in value.items()}
    if isinstance(value, list):
        return [_short(each) for each in value]
    return float(f"{value:.4g}") if isinstance(value, float) else value


if __name__ == "__main__":
    sys.exit(run_command_line("experiments.gaits.library", Library))
