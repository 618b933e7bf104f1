"""One treatment of one replicate: get a model, evolve a gait on it, swim it on the target."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from aquafish import batch, gait_utility
from aquafish.batch import check_source, in_small
from aquafish.gait_utility import GaitUtility
from aquafish_gym import Damage, Morphology
from aquafish_gym.runs.runner import Say
from eea.aquafish import EngineTarget, fish_eea, fish_models
from eea.core import EEAConfig, streams
from eea.core.config import Condition
from eea.core.fitness import objective_fitness
from gait.evolve import EvolveConfig, Generation, evolve_gait
from gait.rollout import Swim
from gait.transfer import TransferConfig, transfer

# What each treatment takes for the robot's body. The oracle knows the damage, which no robot
# does: it is the best that self-modelling can give.
TREATMENTS = ("undamaged", "none", "out-of-band", "joint", "oracle")
MODELLED: dict[str, Condition] = {
    "none": "none",
    "out-of-band": "out-of-band",
    "joint": "joint",
}
# Of what joint inference believes, for a gait that is to swim whichever of them is true.
BODIES = 50
MASS = 0.9  # of the intervals that an outcome holds

PATH = ("time", "position", "quaternion", "fin_angles")
DECIMALS = 6  # of a path's numbers, as many as a float32 holds
MODEL_SHARE, GAIT_SHARE = 0.4, 0.5  # of a treatment's time, about; the swims take the rest


@dataclass(frozen=True)
class Treatment:
    """One treatment of one replicate, complete enough to be sent to another computer."""

    treatment: str  # of TREATMENTS
    seed: int  # of everything random, as in the parts' own configurations
    morphology: Morphology  # before the damage
    damage: Damage
    eea: EEAConfig
    gait: EvolveConfig
    transfer: TransferConfig
    source: str = ""  # the code that must do it (see source_stamp); "" for any

    @property
    def name(self) -> str:
        """For people."""
        return f"seed {self.seed}, {self.treatment}"

    @property
    def folder(self) -> str:
        """Where its files are, relative to the study's folder."""
        return f"seed-{self.seed:03d}/{self.treatment}"

    @property
    def file(self) -> str:
        """Its outcome's file, relative to the study's folder."""
        return f"{self.folder}/outcome.json"

    @property
    def target(self) -> Morphology:
        """The damaged body."""
        return self.damage.apply(self.morphology)


def treat(job: Treatment, say: Say) -> dict[str, Any]:
    """Do one treatment and return its outcome, ready for JSON.

    A robot that diverges has made no progress: its distance counts as 0, ``diverged`` tells how
    many of the swims on the target did, and its path stays where it was last seen.

    Returns
    -------
    dict
        ``treatment``, ``seed``; the believed ``morphology`` with its ``model_fitness`` (MOD_FIT;
        None if it was not inferred) and ``objective_fitness`` (OBJ_FIT); ``rounds``, the
        self-model's records; of joint inference its 90% ``interval``, ``findings``, ``verdict`` and
        the sample of ``bodies`` that the gait is for; ``generations``, the gait's; the
        ``controller``; distances in units of 5 cm by body, from the zero pose and from each random
        pose; ``diverged``; ``swims``, body -> ``PATH`` of the swim from the zero pose.

    Raises
    ------
    ConfigurationError
        If this machine has other code than ``job.source``.
    """
    check_source(job, source_stamp())
    model = _self_model(job, say)

    def tell(row: Generation) -> None:
        done, total = row.generation + 1, job.gait.plan.rows
        share = MODEL_SHARE + GAIT_SHARE * done / total
        say(f"gait: generation {done}/{total}, {row.best:.1f} units", share)

    # From the zero pose alone, no more than one body can swim.
    bodies = model.bodies if job.gait.poses else [model.body]
    evolved = evolve_gait(bodies, job.gait, on_generation=tell)
    say("swimming on the target", MODEL_SHARE + GAIT_SHARE)
    scored = transfer(evolved.controller, job.target, job.transfer, native=model.body)
    native, target = (
        np.array([one.distance, *one.random_distances]) for one in (scored.native, scored.target)
    )
    return {
        "treatment": job.treatment,
        "seed": job.seed,
        "morphology": model.body.to_dict(),
        "model_fitness": model.rounds[-1]["model_fitness"] if model.rounds else None,
        "objective_fitness": float(
            objective_fitness(model.body.to_array(), job.target.to_array(), fish_models())
        ),
        **model.sure,
        "native_distance": _progress(native)[0],
        "target_distance": _progress(target)[0],
        "native_random_distances": _progress(native)[1:],
        "target_random_distances": _progress(target)[1:],
        "diverged": int(np.count_nonzero(~np.isfinite(target))),
        "rounds": model.rounds,
        "generations": [asdict(row) for row in evolved.history],
        "controller": evolved.controller.to_dict(),
        "swims": {
            "native": _path_to_dict(scored.native.swim),
            "target": _path_to_dict(scored.target.swim),
        },
    }


def rehearse(jobs: Sequence[Treatment]) -> None:
    """Do a treatment in small, so that whatever they need is compiled."""
    job = jobs[0]
    brief = replace(job.gait, generations=1, population=10, poses=1, seconds=0.1)
    swims = replace(job.transfer, poses=1, seconds=0.1)
    for name in ("out-of-band", "joint"):
        small = replace(job, treatment=name, eea=in_small(job.eea), gait=brief, transfer=swims)
        treat(small, lambda _text, _share: None)


def source_stamp() -> str:
    """Return a hash of all code that the results come from."""
    return batch.source_stamp(Path(__file__), Path(gait_utility.__file__))


class Model(NamedTuple):
    """What a treatment believes in."""

    body: Morphology
    bodies: list[Morphology]  # that the gait is evolved on: the body alone, or a posterior's sample
    rounds: list[dict[str, Any]]  # in which it was inferred
    sure: dict[str, Any]  # how sure it is, for the outcome; empty where nobody knows


def _self_model(job: Treatment, say: Say) -> Model:
    """Return what this treatment believes in."""
    if job.treatment not in MODELLED:
        body = job.morphology if job.treatment == "undamaged" else job.target
        return Model(body, [body], [], {})
    config = replace(job.eea, condition=MODELLED[job.treatment])
    hidden = streams(job.seed)["target"]
    engine = job.transfer.target_engine
    target = EngineTarget(job.morphology, job.damage, hidden, config.steps, engine)
    utility = GaitUtility.quicker(job.gait) if config.asks_gaits else None
    algorithm = fish_eea(
        target, config, job.seed, target.morphology, utility, threads=job.gait.threads
    )
    rounds = []
    say("self-model: the first trial", 0.0)
    for record in algorithm:
        say(
            f"self-model: round {record.round}/{config.rounds}, "
            f"MOD_FIT {record.model_fitness:.3f}, OBJ_FIT {record.objective_fitness:.3f}",
            MODEL_SHARE * record.round / config.rounds,
        )
        rounds.append(record.to_dict())
        del rounds[-1]["seconds"]  # which no two runs share
    result = algorithm.result
    body = Morphology.from_array(result.model)
    if result.belief is None:
        return Model(body, [body], rounds, {})
    bodies = [Morphology.from_array(sizes) for sizes in result.sample(BODIES, job.seed)]
    low, high = (Morphology.from_array(end).to_dict() for end in result.interval(MASS))
    sure = {
        "interval": {"mass": MASS, "low": low, "high": high},
        "findings": result.belief.findings,
        "verdict": result.belief.verdict,
        "bodies": [one.to_dict() for one in bodies],
    }
    return Model(body, bodies, rounds, sure)


def _progress(distances: NDArray[np.float64]) -> list[float]:
    """Return distances (n,) as a list, with 0 where the robot diverged."""
    return [float(value) for value in np.where(np.isfinite(distances), distances, 0.0)]


def _path_to_dict(swim: Swim) -> dict[str, Any]:
    """Return a swim as lists; a sample that is not finite repeats the last that was."""
    path = {}
    for name in PATH:
        samples = getattr(swim, name)
        good = np.isfinite(samples.reshape(len(samples), -1)).all(axis=1)
        last = np.maximum.accumulate(np.where(good, np.arange(len(samples)), 0))
        path[name] = samples[last].round(DECIMALS).tolist()
    return path


def path_from_dict(path: dict[str, Any]) -> Swim:
    """Return the swim that an outcome's ``swims`` hold."""
    return Swim(*(np.asarray(path[name], dtype=np.float64) for name in PATH))
