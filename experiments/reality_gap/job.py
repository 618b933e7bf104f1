"""One job of the reality-gap suite: a method models a damaged fish, and its gait swims."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache, lru_cache
from typing import Any

import numpy as np

from aquafish_gym import Damage, Morphology, held_out
from aquafish_gym.plans import AQUAFISH
from eea.core import JointConfig, PaperConfig, Result, streams
from eea.core.angles import Floats
from eea.core.config import Condition, Config
from eea.core.session import Session
from eea.fish import EngineTarget, RealityGap, fish_eea
from eea.fish.hypotheses import AS_COMMANDED, fault_hypotheses
from eea.infer.answer import Answer
from eea.study.presets import smoke
from experiments.reality_gap.worlds import WORLDS, gap_of, seized_of
from gait import Controller
from gait.search.evolve import EvolveConfig, evolve_gait
from gait.swims.poses import random_poses
from gait.swims.transfer import swims_on

METHODS: tuple[Condition, ...] = ("none", "in-band", "out-of-band", "joint")
ORACLE = "oracle"  # knows the true body; other distances are a share of its gait's
MASSES = (0.5, 0.8, 0.9)  # of the intervals whose coverage is counted


@dataclass(frozen=True)
class Settings:
    """The settings of all jobs of a suite."""

    eea: PaperConfig  #: Of the paper's methods; each has its own condition.
    joint: JointConfig
    gait: EvolveConfig  #: Of the gaits, except the seed.
    bodies: int  #: Of the posterior, that a gait is evolved on.
    poses: int  #: Random ones that a finished gait swims from.

    def to_dict(self) -> dict[str, Any]:
        """Return everything that decides a result, ready for JSON."""
        parts = {
            "eea": self.eea.to_dict(),
            "joint": self.joint.to_dict(),
            "gait": asdict(self.gait),
        }
        for part in parts.values():
            for name in ("condition", "seed", "threads"):  # each job's own
                part.pop(name, None)
        return {**parts, "bodies": self.bodies, "poses": self.poses}


@dataclass(frozen=True)
class GapJob:
    """One method in one world for one seed, complete enough for another process."""

    world: str  #: Of ``WORLDS``.
    method: str  #: Of ``METHODS``, or ``ORACLE``.
    seed: int  #: Of all random streams; the hidden state is the same for all methods and worlds.
    settings: Settings

    @property
    def name(self) -> str:
        """For people."""
        return f"{self.world}, {self.method}, seed {self.seed}"

    @property
    def file(self) -> str:
        """Its result's file, relative to the suite's folder."""
        return f"runs/{self.world}/{self.method}/{self.seed:03d}.json"

    @property
    def damage(self) -> Damage:
        """What is broken: the damages of the list "recovery" in turn."""
        damages = held_out("recovery")
        return Damage.parse(damages[self.seed % len(damages)])

    @property
    def body(self) -> Morphology:
        """The target's."""
        return self.damage.apply(Morphology.nominal())

    @property
    def gap(self) -> RealityGap:
        """How the target's world differs from the models'."""
        return gap_of(self.world, self.seed)

    @property
    def seized(self) -> Damage:
        """The target's seized servo, if any."""
        return seized_of(self.world, self.seed)

    def begin(self) -> Session[Any]:
        """Return the method before its first round."""
        settings = self.settings.eea
        engine = WORLDS[self.world].engine
        hidden = streams(self.seed)["target"]
        truth = self.body.to_array()
        target = EngineTarget(self.body, self.seized, hidden, settings.steps, engine, gap=self.gap)
        config: Config = self.settings.joint
        if self.method != "joint":
            config = settings.under(next(name for name in METHODS if name == self.method))
        return fish_eea(target, config, self.seed, truth, threads=1)


def run_job(job: GapJob) -> dict[str, Any]:
    """Run one job and return its outcome, ready for JSON. A diverged swim counts as 0 units.

    Returns
    -------
    dict
        ``world``, ``method``, ``seed``, ``damage``, ``gap`` in words, the ``truth``'s nine sizes,
        and ``gaits``: the distances in units of 5 cm that a gait swims in the target's world from
        random poses, by what it was evolved on, the method's ``body`` or a
        ``sample`` of the posterior. Of a method but the oracle also ``morphology``; by round
        ``objective_fitness``, ``model_fitness``, simulated ``trials``, and the CPU's ``seconds``
        since the beginning. Of joint inference also
        ``belief``: which dimensions its intervals of each of ``MASSES`` hold, whether the fit is
        ``good``, the ``hypotheses``' probabilities, and those of their names that are ``true``.
    """
    truth = job.body.to_array()
    outcome: dict[str, Any] = {
        "world": job.world,
        "method": job.method,
        "seed": job.seed,
        "damage": str(job.damage),
        "gap": str(job.gap),
        "truth": truth.tolist(),
    }
    bodies: dict[str, Floats] = {"body": truth[None]}
    if job.method != ORACLE:
        warm_up((job,))
        result, seconds = _model(job)
        bodies["body"] = result.body[None]
        outcome |= {
            "morphology": result.model.tolist(),
            "objective_fitness": [record.objective_fitness for record in result.rounds],
            "model_fitness": [record.model_fitness for record in result.rounds],
            "trials": [record.trials for record in result.rounds],
            "seconds": seconds,
        }
        if isinstance(result.belief, Answer):
            bodies["sample"] = result.sample(job.settings.bodies, job.seed)
            outcome["belief"] = _judge(job, result.belief)
    config = replace(job.settings.gait, seed=job.seed, threads=1)
    outcome["gaits"] = {
        name: _swim(job, _evolved(tuple(map(tuple, those.tolist())), config))
        for name, those in bodies.items()
    }
    return outcome


def _model(job: GapJob) -> tuple[Result, list[float]]:
    """Return a method's result, and the CPU seconds at the end of each round."""
    began = time.process_time()
    seconds = []
    method = job.begin()
    for _ in method:
        seconds.append(time.process_time() - began)
    return method.result, seconds


def _judge(job: GapJob, belief: Answer) -> dict[str, Any]:
    """Return how belief and truth compare."""
    truth = job.body.to_array()
    covered = {}
    for mass in MASSES:
        low, high = belief.interval(mass)
        covered[f"{mass:.0%}"] = ((low <= truth) & (truth <= high)).tolist()
    return {
        "covered": covered,
        "good": belief.good,
        "hypotheses": {b.hypothesis.name: b.probability for b in belief.branches},
        "true": _true_hypotheses(job),
    }


def _true_hypotheses(job: GapJob) -> list[str]:
    """Return the names of the hypotheses that hold of a target; more than one may."""
    sizes = dict(
        zip((d.name for d in AQUAFISH.dimensions), job.body.to_array().tolist(), strict=True)
    )
    missing = [f"{fin}.length" for fin in AQUAFISH.names if not any(getattr(job.body, fin))]
    true = [
        hypothesis.name
        for hypothesis in fault_hypotheses(AQUAFISH)
        if any(hypothesis.fixed.get(name) == sizes[name] for name in missing)
        or any(fault.part in hypothesis.moves for fault in job.seized.faults)
        or (job.gap.reactive and "reactive water" in hypothesis.fixed)
    ]
    return true or [AS_COMMANDED.name]


@lru_cache(maxsize=2)
def _evolved(bodies: tuple[tuple[float, ...], ...], config: EvolveConfig) -> Controller:
    """Return a gait for bodies, of which a process that has just evolved it remembers it."""
    return evolve_gait(np.array(bodies), config).controller


def _swim(job: GapJob, controller: Controller) -> list[float]:
    """Return how far a gait swims in the target's world from each random pose, units of 5 cm."""
    engine = WORLDS[job.world].engine
    settings = job.settings
    poses = random_poses(settings.poses, job.seed)
    for fault in job.seized.faults:
        poses[:, AQUAFISH.names.index(fault.part)] = fault.number
    scored = swims_on(controller, job.body, poses, engine, settings.gait.seconds, job.gap)
    distances = scored.random_distances
    return [float(far) for far in np.where(np.isfinite(distances), distances, 0.0)]


def warm_up(jobs: Sequence[GapJob]) -> None:
    """Compile and load all that jobs need, each kind once."""
    for job in jobs:
        if job.method == ORACLE:
            continue
        engine = WORLDS[job.world].engine
        like = next(name for name, world in WORLDS.items() if world.engine == engine)
        _warm_up(job.world, "none", job.settings)  # its target and its gaits' swims
        _warm_up(like, job.method, job.settings)


@cache
def _warm_up(world: str, method: str, settings: Settings) -> None:
    brief = replace(settings.gait, generations=1, population=10, poses=1, seconds=0.1)
    quick = replace(
        settings,
        eea=replace(smoke(settings.eea), rounds=2),
        joint=replace(smoke(settings.joint), rounds=2),
        gait=brief,
        poses=1,
    )
    small = GapJob(world, method, 0, quick)
    result, _ = _model(small)
    _swim(small, evolve_gait(result.body, replace(brief, threads=1)).controller)
