"""One robot inferred, and all that is asked of the result: a pure function of its description."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from eea import FitConfig, JointConfig, JointInference
from eea.core.session import streams
from eea.fish.hypotheses import AS_COMMANDED
from eea.fish.joint import fish_robot
from eea.fish.simulator import EngineSimulator, fish_problem
from eea.infer.answer import Answer
from eea.infer.branch import Branch
from eea.infer.descent import descend
from eea.infer.misfit import FINE, Misfit
from eea.infer.unknowns import Unknowns
from instruments.inference.calibration import ranks
from instruments.inference.logs import LOGS, measure_log
from instruments.inference.robots import Floats, Robot, draw_body, draw_world
from instruments.inference.settings import EVERY, Setting
from instruments.inference.strangers import KINDS, measure_stranger
from instruments.inference.swims import SWIMS, measure_swim

MASSES = (0.5, 0.8, 0.9)
INSIDE = ("plain", "other numbers", "prior")  # the model: worlds with a whole truth
DRAWS = 99  # that a truth is ranked among
# In -log posterior: by so much the truth's own valley must be better than what was found.
WORSE = 1.0
LEAST_SIGMA = 1e-5  # rad/s, at which that is judged without noise


@dataclass(frozen=True)
class Case:
    """One robot of a setting, of ``SWIMS`` or ``LOGS``; its number and the seed decide all."""

    setting: str
    number: int
    seed: int = 0

    @property
    def name(self) -> str:
        """For people."""
        return f"{self.setting}, robot {self.number}"

    @property
    def file(self) -> str:
        """Where its result is, within the folder."""
        return f"cases/{self.setting}/{self.number}.json"


def measure(case: Case) -> dict[str, Any]:
    """Return what was found of one robot, and how it compares with the truth."""
    rng = np.random.default_rng([case.seed, *case.setting.encode(), case.number])
    if case.setting in LOGS:
        return measure_log(case.number, rng)
    if case.setting in SWIMS:
        return measure_swim(case.setting, case.number, rng)
    if case.setting in KINDS:
        rng = np.random.default_rng([case.seed, *case.setting.encode(), case.number])
        return measure_stranger(case.setting, rng)
    which = list(EVERY).index(case.setting)
    rng = np.random.default_rng([case.seed, which, case.number])
    return examine(EVERY[case.setting], case.number, rng)


def examine(
    setting: Setting,
    number: int,
    rng: np.random.Generator,
    effort: FitConfig | None = None,
) -> dict[str, Any]:
    """Return what was found of a setting's robot, and how it compares with the truth."""
    body = draw_body(setting, number, rng)
    world, seed = draw_world(setting, rng), int(rng.integers(2**32))
    robot = Robot(setting, body, world, rng, streams(seed)["exploration"])
    config = JointConfig(**vars(effort or FitConfig()), steps=setting.steps, rounds=setting.trials)
    model = fish_robot(EngineSimulator(setting.steps, threads=1))
    if setting.world == "reactive":
        imagined = tuple(h for h in model.alternatives if "reactive water" not in h.fixed)
        model = replace(model, hypotheses=imagined)
    method = JointInference(robot, model, fish_problem(), config, seed, body)
    rounds = []
    began = time.process_time()
    for record in method:
        seconds = time.process_time() - began
        rounds.append({"fitness": record.objective_fitness, "seconds": seconds})
    belief = method.result.belief
    assert isinstance(belief, Answer)
    ends = np.array([belief.interval(mass) for mass in MASSES])
    return {
        "rounds": rounds,
        "trials": sum(record.trials for record in method.result.rounds),
        "truth": body.tolist(),
        "model": belief.model.tolist(),
        "low": ends[:, 0].tolist(),
        "high": ends[:, 1].tolist(),
        "ranks": ranks(belief.sample(DRAWS, rng), body, rng).tolist(),
        "sigma": belief.sigma,
        "good": belief.good,
        "p": belief.goodness.p,
        "findings": belief.findings,
        "hypotheses": {b.hypothesis.name: b.probability for b in belief.branches},
        **_all_unknowns(belief, robot, rng),
    }


def _all_unknowns(belief: Answer, robot: Robot, rng: np.random.Generator) -> dict[str, Any]:
    """Return what needs the whole truth, nuisances and angles included: where it has one."""
    plain = [b for b in belief.branches if b.hypothesis.name == AS_COMMANDED.name]
    if not plain or robot.setting.world not in INSIDE:
        return {"excess": None, "others": None}
    branch = plain[0]
    posterior, truth = branch.posterior, truth_of(branch.parameters, robot)
    n = branch.parameters.body
    circular = posterior.circular
    rank = ranks(posterior.sample(DRAWS, rng), truth, rng, circular)
    ends = np.array([posterior.interval(mass) for mass in MASSES])[:, :, n:]
    return {
        "excess": _excess(branch, belief.sigma, robot, truth),
        "others": {
            "names": list(posterior.names[n:]),
            "circular": circular[n:].tolist(),
            "truth": truth[n:].tolist(),
            "low": ends[:, 0].tolist(),
            "high": ends[:, 1].tolist(),
            "ranks": rank[n:].tolist(),
        },
    }


def truth_of(parameters: Unknowns, robot: Robot) -> Floats:
    """Return the truth as a vector (P,) of the unknowns."""
    model = parameters.robot
    values = dict(zip(model.sought, robot.body, strict=True)) | robot.world
    for trial, angles in enumerate(robot.angles, 1):
        values |= {f"{n}@{trial}": a for n, a in zip(model.angles, angles, strict=True)}
    low, high = parameters.natural(np.array([[0.0], [1.0]]))
    truth = np.array([values[name] for name in parameters.names])
    inside: Floats = (truth - low) / (high - low)
    return inside


def _excess(branch: Branch, sigma: float, robot: Robot, truth: Floats) -> float:
    """Return by how much what was found is worse, in -log posterior, than the truth's valley."""
    parameters, sigma = branch.parameters, max(sigma, LEAST_SIGMA)
    misfit = Misfit(parameters, robot.observed, FINE)
    reached = descend(misfit, truth[None], sigma, 60, 1e-6)
    best = branch.posterior.modes[0].theta
    found = 0.5 * misfit.squares(best[None])[0] / sigma**2 + parameters.prior_cost(best)
    return float(found - reached.cost[0])
