"""One treatment of one replicate: get a model, evolve a gait on it, swim it on the target."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from aquafish import batch
from aquafish.batch import check_source, in_small
from aquafish_gym import Damage, Morphology
from aquafish_gym.engines.api import TIMESTEP
from aquafish_gym.physics.arithmetic import TAU
from aquafish_gym.runs.runner import Say
from eea.core import EEAConfig, streams
from eea.core.angles import wrap
from eea.core.config import Condition
from eea.core.fitness import objective_fitness
from eea.fish import EngineTarget, RealityGap, fish_eea, fish_models
from eea.fish.fins import fins_after
from gait.evolve import EvolveConfig, Generation, damaged_at_random, evolve_gait
from gait.rollout import Swim
from gait.transfer import TransferConfig, transfer


class Way(NamedTuple):
    """What a treatment takes for the robot's body, and how it comes to a gait."""

    shown: str  #: For people.
    says: str
    search: Literal["neat", "best", "fins", "direct"]
    model: Condition | None = None  #: What infers the body, if anything does.
    body: Literal["healthy", "any", "true"] = "true"  #: Where nothing does.
    oracle: str = "oracle"  #: Whose body is the true one, with the same search and senses.


# The oracles know the damage, which no robot does: each is the best that self-modelling can give
# to who searches and senses as it does.
WAYS: dict[str, Way] = {
    "undamaged": Way(
        "the old body", "the gait that it swam with before the damage", "best", body="healthy"
    ),
    "randomised": Way(
        "any damage",
        "a gait for the healthy body and many randomly damaged ones, by somebody who does not ask "
        "what happened",
        "best",
        body="any",
    ),
    "direct": Way(
        "direct search",
        "a search on the damaged robot itself, in which every swim takes the robot's time",
        "direct",
    ),
    "none": Way(
        "plain EEA's model",
        "plain EEA's model, which takes its fins to start at zero, and NEAT",
        "neat",
        "none",
        oracle="oracle-neat",
    ),
    "out-of-band": Way(
        "Out-of-Band's model",
        "the paper's way: Out-of-Band EEA's model, which infers where its fins started, and NEAT",
        "neat",
        "out-of-band",
        oracle="oracle-neat",
    ),
    "joint": Way(
        "joint inference",
        "what joint inference believes, which fits body, fins and nuisances together: its median "
        "body in OBJ_FIT and *own model*, and a gait for many bodies that the trials allow",
        "best",
        "joint",
    ),
    "joint-fins": Way(
        "joint, fins known",
        "the same, with a gait that knows where its fins are: the self-model tells where they "
        "stand, and the commands where they go",
        "fins",
        "joint",
        oracle="oracle-fins",
    ),
    "oracle-neat": Way(
        "the true body, NEAT", "the true body, and NEAT", "neat", oracle="oracle-neat"
    ),
    "oracle": Way("the true body", "the true body: the best that a self-model can give", "best"),
    "oracle-fins": Way(
        "the true body and fins",
        "the true body, and the true place of its fins",
        "fins",
        oracle="oracle-fins",
    ),
}
TREATMENTS = tuple(WAYS)
MODELLED: dict[str, Condition] = {name: way.model for name, way in WAYS.items() if way.model}
# Of what joint inference believes, for a gait that is to swim whichever of them is true; and of
# bodies that chance has damaged.
BODIES = 50
MASS = 0.9  # of the intervals that an outcome holds

PATH = ("time", "position", "quaternion", "fin_angles")
DECIMALS = 6  # of a path's numbers, as many as a float32 holds
MODEL_SHARE, GAIT_SHARE = 0.3, 0.6  # of a treatment's time, about; the swims take the rest


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
    gyro_noise: float = 0.0  # of the robot's gyroscope, rad/s
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
        ``treatment``, ``seed``, ``damage``; the believed ``morphology`` with its ``model_fitness``
        (MOD_FIT; None if it was not inferred) and ``objective_fitness`` (OBJ_FIT; None of who asks
        for no body); ``rounds``, the self-model's records; of joint inference its 90%
        ``interval``, ``findings``, ``verdict``, the sample of ``bodies`` that the gait is for, and
        ``fins``, where it believes they stand after the last trial and how wrong that is, rad;
        ``generations``, the gait's; the ``controller``; distances in units of 5 cm by body, from
        the zero pose and from each random pose; ``diverged``; ``swims``, body -> ``PATH`` of the
        swim from the zero pose.

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
    scored = transfer(
        evolved.controller, job.target, replace(job.transfer, **model.fins_told), model.body
    )
    native, target = (
        np.array([one.distance, *one.random_distances]) for one in (scored.native, scored.target)
    )
    fitness = objective_fitness(model.body.to_array(), job.target.to_array(), fish_models())
    return {
        "treatment": job.treatment,
        "seed": job.seed,
        "damage": str(job.damage),
        "morphology": model.body.to_dict(),
        "model_fitness": model.rounds[-1]["model_fitness"] if model.rounds else None,
        "objective_fitness": None if WAYS[job.treatment].body == "any" else float(fitness),
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
    """Do treatments in small, so that whatever they need is compiled."""
    job = jobs[0]
    for name in ("out-of-band", "joint-fins"):
        few: dict[str, Any] = {"generations": 1, "population": 10, "poses": 1, "seconds": 0.1}
        gait = EvolveConfig(paper=True, threads=1, **few)
        if name == "joint-fins":
            few["senses"] = ("imu", "clock", "fins")
            gait = EvolveConfig(search="cma", restarts=1, random_candidates=10, threads=1, **few)
        small = replace(
            job,
            treatment=name,
            eea=in_small(job.eea),
            gait=gait,
            transfer=replace(job.transfer, poses=1, seconds=0.1),
        )
        treat(small, lambda _text, _share: None)


def source_stamp() -> str:
    """Return a hash of all code that the results come from."""
    return batch.source_stamp(Path(__file__))


class Model(NamedTuple):
    """What a treatment believes in."""

    body: Morphology
    bodies: list[Morphology]  # that the gait is evolved on: the body alone, or a posterior's sample
    rounds: list[dict[str, Any]]  # in which it was inferred
    sure: dict[str, Any]  # how sure it is, for the outcome; empty where nobody knows
    fins_told: dict[str, Any]  # what the gait is told of the target's fins; empty for the truth


def _self_model(job: Treatment, say: Say) -> Model:
    """Return what this treatment believes in."""
    way = WAYS[job.treatment]
    if way.model is None:
        body = job.target if way.body == "true" else job.morphology
        bodies = [body]
        if way.body == "any":
            bodies += damaged_at_random(body, BODIES - 1, job.seed)
        return Model(body, bodies, [], {}, {})
    config = replace(job.eea, condition=way.model)
    hidden = streams(job.seed)["target"]
    engine, gap = job.transfer.target_engine, RealityGap(gyro_noise=job.gyro_noise)
    target = EngineTarget(job.morphology, job.damage, hidden, config.steps, engine, gap=gap)
    algorithm = fish_eea(target, config, job.seed, target.morphology, threads=job.gait.threads)
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
        return Model(body, [body], rounds, {}, {})
    bodies = [Morphology.from_array(sizes) for sizes in result.sample(BODIES, job.seed)]
    low, high = (Morphology.from_array(end).to_dict() for end in result.interval(MASS))
    # The truth of the target's fins serves to know how wrong the self-model is, and nothing else.
    fins, turned = fins_after(result), np.array(rounds[-1]["command"]) * config.steps * TIMESTEP
    error = wrap(fins.angles - target.start_angles - TAU * turned)
    sure = {
        "interval": {"mass": MASS, "low": low, "high": high},
        "findings": result.belief.findings,
        "verdict": result.belief.verdict,
        "bodies": [one.to_dict() for one in bodies],
        "fins": {
            "angles": fins.angles.tolist(),
            "spread": fins.spread.tolist(),
            "error": error.tolist(),
            "servo_gain": fins.servo_gain.tolist(),
        },
    }
    told = {"angle_error": tuple(error), "believed_gain": tuple(fins.servo_gain)}
    return Model(body, bodies, rounds, sure, told)


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
