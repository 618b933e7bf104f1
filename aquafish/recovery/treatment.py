"""One treatment of one replicate: infer a body, evolve a gait for it, swim it on the robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal, NamedTuple

import numpy as np

from aquafish.recovery.swimming_on import ONSET_SECONDS, swim_on
from aquafish_gym import Damage, Morphology
from aquafish_gym.engines.api import TIMESTEP
from aquafish_gym.physics.arithmetic import TAU
from aquafish_gym.utils.array_types import Floats
from aquafish_gym.world_config import WorldConfig
from eea.core import JointConfig, PaperConfig, Result, streams
from eea.core.angles import wrap
from eea.core.config import Condition, Config
from eea.core.fitness import objective_fitness
from eea.fish import EngineTarget, RealityGap, fish_eea, fish_problem
from eea.fish.fins import fins_after
from eea.study.presets import smoke
from gait.controllers.controller import Controller
from gait.search.evolve import EvolveConfig, damaged_at_random, evolve_gait
from gait.swims.swim import Swim
from gait.swims.transfer import TransferConfig, transfer

EVOLVED_BODIES = 50  # from a posterior, or randomly damaged, that one gait is evolved for
OUTCOME_MASS = 0.9  # of the posterior intervals in an outcome
PATH_FIELDS = ("time", "position", "quaternion", "fin_angles")
PATH_DECIMALS = 6  # of a path's numbers, as many as a float32 holds


class TreatmentSpec(NamedTuple):
    """The body that a treatment evolves its gait for, and the search."""

    label: str  #: What people read, in tables, sentences, figures and progress.
    description: str
    search: Literal["neat", "best", "fins", "direct"]
    model: Condition | None = None  #: The method that infers the body.
    body: Literal["healthy", "any", "true"] = "true"  #: The body, if it is not inferred.
    oracle: str = "oracle"  #: The treatment with the true body and the same search and senses.
    online: bool = False  #: Whether the robot breaks, infers and changes its gait as it swims.


# The oracles know the damage, which no robot does: upper bounds for self-models.
TREATMENTS: dict[str, TreatmentSpec] = {
    "undamaged": TreatmentSpec(
        "the old gait", "the gait from before the damage", "best", body="healthy"
    ),
    "randomised": TreatmentSpec(
        "one gait for any damage",
        "a gait for the healthy body and many randomly damaged ones, without a self-model",
        "best",
        body="any",
    ),
    "direct": TreatmentSpec(
        "search on the robot", "CMA-ES on the damaged robot itself; every swim costs robot time",
        "direct",
    ),
    "none": TreatmentSpec(
        "plain EEA",
        "the model of plain EEA, which assumes that the fins start at zero, and NEAT",
        "neat",
        "none",
        oracle="oracle-neat",
    ),
    "out-of-band": TreatmentSpec(
        "the paper's method",
        "the model of Out-of-Band EEA, which infers the initial fin angles, "
        "and NEAT",
        "neat",
        "out-of-band",
        oracle="oracle-neat",
    ),
    "joint": TreatmentSpec(
        "joint inference",
        "the posterior of joint inference over body, fin angles and nuisances: its median body in "
        "OBJ_FIT and *own model*, and one gait for many bodies of the posterior",
        "best",
        "joint",
    ),
    "joint-fins": TreatmentSpec(
        "joint inference (fins known)",
        "the same, with a gait that observes the fin angles: the self-model gives their initial "
        "values, and the commands are integrated",
        "fins",
        "joint",
        oracle="oracle-fins",
    ),
    "swims-on": TreatmentSpec(
        "swims on",
        f"the robot breaks after {ONSET_SECONDS:g} s of swimming. It recognises what broke from "
        "its gyroscope and its actions, and changes its gait without stopping: first to one of a "
        "library, then to a refinement of it. The distance counts from the damage on, with the "
        "speed of that moment and with the time for thinking. OBJ_FIT is from the zero pose; *own "
        "model* is the last gait from the last state",
        "fins",
        oracle="oracle-fins",
        online=True,
    ),
    "oracle-neat": TreatmentSpec(
        "true body (NEAT)", "the true body, and NEAT", "neat", oracle="oracle-neat"
    ),
    "oracle": TreatmentSpec(
        "true body", "the true body, which no robot knows: the upper bound for a self-model", "best"
    ),
    "oracle-fins": TreatmentSpec(
        "true body (fins known)", "the true body, and the true fin angles", "fins",
        oracle="oracle-fins",
    ),
}  # fmt: skip
MODEL_CONDITIONS: dict[str, Condition] = {
    name: s.model for name, s in TREATMENTS.items() if s.model
}


@dataclass(frozen=True)
class Treatment:
    """One treatment of one replicate, complete enough to run on another computer."""

    treatment: str  # of TREATMENTS
    seed: int  # of all random streams, as in the parts' own configurations
    morphology: Morphology  # before the damage
    damage: Damage
    eea: Config
    gait: EvolveConfig
    transfer: TransferConfig
    gyro_noise: float = 0.0  # standard deviation, rad/s
    reactive: bool = False  # whether the water has added mass: of the robot and of all models

    @property
    def name(self) -> str:
        """For people."""
        return f"seed {self.seed}, {self.spec.label}"

    @property
    def folder(self) -> str:
        """The path of its files in the study's folder."""
        return f"seed-{self.seed:03d}/{self.treatment}"

    @property
    def file(self) -> str:
        """The path of its outcome in the study's folder."""
        return f"{self.folder}/outcome.json"

    @property
    def spec(self) -> TreatmentSpec:
        """Its row of the table."""
        return TREATMENTS[self.treatment]

    @property
    def target(self) -> Morphology:
        """The damaged body."""
        return self.damage.apply(self.morphology)


class AssumedRobot(NamedTuple):
    """The body that a treatment assumes."""

    body: Morphology
    bodies: list[Morphology]  # that the gait is evolved for: the body alone, or a sample
    rounds: Sequence[dict[str, Any]] = ()  # of its inference
    posterior: dict[str, Any] = {}  # noqa: RUF012  # what an outcome holds of it, if there is one
    fins: dict[str, Any] = {}  # noqa: RUF012  # the assumed fin state, as options of the transfer


def treat(job: Treatment) -> dict[str, Any]:
    """Run one treatment and return its outcome, ready for JSON.

    A swim that diverged counts as 0 units; ``diverged`` is how many swims on the target did.

    Returns
    -------
    dict
        ``treatment``, ``seed``, ``damage``; the inferred ``morphology`` with its ``model_fitness``
        (MOD_FIT; None if it was not inferred) and ``objective_fitness`` (OBJ_FIT; None without a
        body of its own); the EEA's ``rounds``; with joint inference its 90% ``interval`` (None
        where no body explains the trials),
        ``findings``, ``verdict``, the ``bodies`` that the gait is for, and ``fins``, the estimated
        angles after the last trial with their errors, rad; the gait's ``generations``; the
        ``controller``; distances in units of 5 cm by body, from the zero pose and from each random
        pose; ``diverged``; ``swims``, body -> ``PATH_FIELDS`` of the swim from the zero pose. A
        robot that swims on has neither generations nor these.
    """
    if job.spec.online:
        body, gait, *far = swim_on(
            job.morphology, job.damage, job.transfer, job.gyro_noise, job.reactive
        )
        outcome = _outcome(job, AssumedRobot(body, []), gait, *far)
        return {**outcome, "generations": [], "swims": {}}
    model = _model(job)
    # A sample needs random poses; without any, the gait is for the one body.
    bodies = model.bodies if job.gait.poses else [model.body]
    water = WorldConfig(reactive=job.reactive)
    evolved = evolve_gait(bodies, job.gait, world=water)
    sensed = model.fins if "fins" in job.gait.senses else {}
    config = replace(job.transfer, **sensed)
    scored = transfer(evolved.controller, job.target, config, model.body, water, native_world=water)
    native, target = (
        np.array([one.distance, *one.random_distances]) for one in (scored.native, scored.target)
    )
    return {
        **_outcome(job, model, evolved.controller, native, target),
        "generations": [asdict(row) for row in evolved.history],
        "swims": {
            "native": _path_to_dict(scored.native.swim),
            "target": _path_to_dict(scored.target.swim),
        },
    }


def _outcome(
    job: Treatment, model: AssumedRobot, controller: Controller, native: Floats, target: Floats
) -> dict[str, Any]:
    """Return an outcome's common part; distances (1 + poses,) from the zero pose and others."""
    models = fish_problem(job.morphology.plan).models
    fitness = objective_fitness(model.body.to_array(), job.target.to_array(), models)
    return {
        "treatment": job.treatment,
        "seed": job.seed,
        "damage": str(job.damage),
        "morphology": model.body.to_dict(),
        "model_fitness": model.rounds[-1]["model_fitness"] if model.rounds else None,
        "objective_fitness": None if job.spec.body == "any" else float(fitness),
        **model.posterior,
        "native_distance": _finite(native)[0],
        "target_distance": _finite(target)[0],
        "native_random_distances": _finite(native)[1:],
        "target_random_distances": _finite(target)[1:],
        "diverged": int(np.count_nonzero(~np.isfinite(target))),
        "rounds": model.rounds,
        "controller": controller.to_dict(),
    }


def _model(job: Treatment) -> AssumedRobot:
    """Return the body that the treatment assumes, or infer it in trials on the robot."""
    if job.spec.model is None:
        body = job.target if job.spec.body == "true" else job.morphology
        others = (
            damaged_at_random(body, EVOLVED_BODIES - 1, job.seed) if job.spec.body == "any" else []
        )
        return AssumedRobot(body, [body, *others], [])
    config = job.eea
    if job.spec.model != "joint":
        assert isinstance(config, PaperConfig)
        config = config.under(job.spec.model)
    hidden, gap = streams(job.seed)["target"], RealityGap(gyro_noise=job.gyro_noise)
    engine = job.transfer.target_engine
    target = EngineTarget(
        job.morphology, job.damage, hidden, config.steps, engine, gap=gap, reactive=job.reactive
    )
    method = fish_eea(
        target, config, job.seed, target.morphology,
        threads=job.gait.threads, reactive=job.reactive,
    )  # fmt: skip
    rounds = [
        {name: value for name, value in record.to_dict().items() if name != "seconds"}
        for record in method
    ]
    result = method.result
    plan = job.morphology.plan
    body = Morphology.from_array(result.body, plan)
    if result.belief is None:
        return AssumedRobot(body, [body], rounds)
    bodies = [
        Morphology.from_array(sizes, plan) for sizes in result.sample(EVOLVED_BODIES, job.seed)
    ]
    posterior, fins = _posterior(result, body, target.start_angles, config.steps)
    posterior["bodies"] = [one.to_dict() for one in bodies]
    return AssumedRobot(body, bodies, rounds, posterior, fins)


def _posterior(
    result: Result, body: Morphology, start_angles: Floats, steps: int
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return what an outcome holds of joint inference, and the fin state for the transfer.

    Intervals hold the sizes of the ``body``; there are none where no body explains the trials.
    The true initial angles (F,) only serve to measure the error of the estimated ones.
    """
    assert result.belief is not None
    interval = None
    if result.belief.good:
        low, high = result.interval(OUTCOME_MASS)
        sizes = body.to_array()
        ends = {"low": np.minimum(low, sizes), "high": np.maximum(high, sizes)}
        bodies = {
            name: Morphology.from_array(end, body.plan).to_dict() for name, end in ends.items()
        }
        interval = {"mass": OUTCOME_MASS, **bodies}
    fins, turned = fins_after(result), np.array(result.rounds[-1].command) * steps * TIMESTEP
    error = wrap(fins.angles - start_angles - TAU * turned)
    posterior = {
        "interval": interval,
        "findings": result.belief.findings,
        "verdict": result.belief.verdict,
        "fins": {
            "angles": fins.angles.tolist(),
            "spread": fins.spread.tolist(),
            "error": error.tolist(),
            "servo_gain": fins.servo_gain.tolist(),
        },
    }
    return posterior, {"angle_error": tuple(error), "believed_gain": tuple(fins.servo_gain)}


def warm_up_treatments(jobs: Sequence[Treatment]) -> None:
    """Compile all that treatments need: run two very small ones."""
    job = jobs[0]
    small = replace(job, transfer=replace(job.transfer, poses=1, seconds=0.1))
    steps = job.eea.steps
    few: dict[str, Any] = {
        "plan": job.morphology.plan, "generations": 1, "population": 10, "poses": 1,
        "seconds": 0.1, "threads": 1,
    }  # fmt: skip
    neat = EvolveConfig(paper=True, **few)
    senses: Any = ("imu", "clock", "fins")
    fins = EvolveConfig(search="cma", restarts=1, random_candidates=10, senses=senses, **few)
    models: tuple[Config, ...] = (PaperConfig(steps=steps), JointConfig(steps=steps))
    for name, gait, model in zip(("out-of-band", "joint-fins"), (neat, fins), models, strict=True):
        treat(replace(small, treatment=name, gait=gait, eea=replace(smoke(model), rounds=2)))


def _finite(distances: Floats) -> list[float]:
    """Return distances (n,) as a list, with 0 where the robot diverged."""
    return [float(value) for value in np.where(np.isfinite(distances), distances, 0.0)]


def _path_to_dict(swim: Swim) -> dict[str, Any]:
    """Return a swim as lists; a sample that is not finite repeats the last finite one."""
    path = {}
    for name in PATH_FIELDS:
        samples = getattr(swim, name)
        good = np.isfinite(samples.reshape(len(samples), -1)).all(axis=1)
        last = np.maximum.accumulate(np.where(good, np.arange(len(samples)), 0))
        path[name] = samples[last].round(PATH_DECIMALS).tolist()
    return path


def path_from_dict(path: dict[str, Any]) -> Swim:
    """Return the swim in an outcome's ``swims``."""
    return Swim(*(np.asarray(path[name], dtype=np.float64) for name in PATH_FIELDS))
