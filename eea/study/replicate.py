"""One replicate of a study: a pure function of a small description that any process can have."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import aquafish_gym
import eea
from aquafish_gym.damage import Damage
from aquafish_gym.morphology import Morphology
from aquafish_gym.runs.stamps import code_stamp
from eea.core.checks import ConfigurationError
from eea.core.config import EEAConfig
from eea.core.result import Belief, Result
from eea.core.session import Session, streams
from eea.fish import EngineTarget, Orientation, RealityGap, fish_eea
from eea.study.plan import Place
from eea.study.presets import smoke

# What decides a result. A study's settings are written down themselves, and the folder, the
# commands and the reports only carry results.
_ROBOT = ("command.py", "damage", "envs/course.py", "imu.py", "morphology.py", "physics", "engines")
MASSES = (0.5, 0.8, 0.9)  # of the intervals that are held against the truth
_ALGORITHM = ("core", "joint", "fish", "study/replicate.py")


@cache
def source_stamp() -> str:
    """Return a hash of the code that decides the results; comments and docstrings have no say."""
    packages = ((aquafish_gym, _ROBOT), (eea, _ALGORITHM))
    paths = [
        Path(str(package.__file__)).parent / name for package, names in packages for name in names
    ]
    return code_stamp(
        file for path in paths for file in (sorted(path.rglob("*.py")) if path.is_dir() else [path])
    )


@dataclass(frozen=True)
class World:
    """Where a study's fish swims, and where its models do.

    Attributes
    ----------
    morphology, damage
        The target's body before the damage, and what broke.
    target_engine, target_orientation
        Where the target swims, and how it lies at the start; see ``EngineTarget``.
    engine, dtype
        Where the models swim.
    current
        Velocity of the water, units/s.
    substeps
        Physics steps in each 0.01 s.
    gap
        How the target's world differs from the models'.
    """

    morphology: Morphology
    damage: Damage
    target_engine: str = "numba"
    target_orientation: Orientation = "upright"
    engine: str = "numba"
    dtype: str = "float32"
    current: tuple[float, float, float] = (0.0, 0.0, 0.0)
    substeps: int = 1
    gap: RealityGap = field(default_factory=RealityGap)


@dataclass(frozen=True)
class Replicate:
    """One seed of one arm at one length of trial; enough to be sent to another machine.

    Attributes
    ----------
    arm, config
        The arm's name and its settings, with the steps and rounds.
    seed
        Of everything random.
    source
        The ``source_stamp`` of the code that is to run it, which a machine of a cluster may not
        have; empty for any.
    """

    arm: str
    config: EEAConfig
    seed: int
    world: World
    source: str = ""

    @property
    def place(self) -> Place:
        """Where it is in the study."""
        return Place(self.arm, self.config.steps, self.seed)

    @property
    def name(self) -> str:
        """For people."""
        return self.place.name

    @property
    def file(self) -> str:
        """Its file relative to the study's folder."""
        return self.place.file

    def begin(self) -> Session:
        """Return the algorithm before its first round.

        Raises
        ------
        InvalidArgumentError, EngineUnavailableError, ConfigurationError
            If a setting is wrong or an engine is not to be had.
        """
        world = self.world
        target = EngineTarget(
            world.morphology,
            world.damage,
            streams(self.seed)["target"],
            self.config.steps,
            world.target_engine,
            world.current,
            world.substeps,
            world.target_orientation,
            world.gap,
        )
        return fish_eea(
            target,
            self.config,
            self.seed,
            target.morphology,
            engine=world.engine,
            dtype=world.dtype,
            current=world.current,
            substeps=world.substeps,
            threads=1,
        )


def rehearse(jobs: Sequence[Replicate]) -> None:
    """Begin each job, and run one like the first in small, so that the engine is compiled.

    Raises as ``Replicate.begin``.
    """
    for job in jobs:
        job.begin()
    config = jobs[0].config
    small = EEAConfig(condition="ideal", steps=config.steps, rounds=2, behavior=config.behavior)
    ours = [small] * any(job.config.condition != "joint" for job in jobs)
    ours += [job.config for job in jobs if job.config.condition == "joint"][:1]
    for config in ours:
        few = replace(smoke(config), rounds=2)
        replicate(replace(jobs[0], config=few), lambda _text, _share: None)


def replicate(job: Replicate, say: Callable[[str, float], None]) -> dict[str, Any]:
    """Run a replicate to its end; return what it was, why it ended, and a record a round.

    Nothing but the job has a say in what comes out: the records are without their clock. ``say``
    is told the round, and the share of all rounds that is done. Of the condition joint comes out
    as well, as ``belief``, how sure it was: ``coverage``, the share of the true sizes that its
    intervals hold, by their mass, ``width``, their mean width as a share of the ranges, and
    ``good`` and ``verdict``, whether it explains all that was felt.

    Raises
    ------
    ConfigurationError
        If this machine has other code than ``job.source``, and as ``Replicate.begin``.
    InvalidArgumentError, EngineUnavailableError
        As ``Replicate.begin``.
    """
    if job.source and job.source != source_stamp():
        raise ConfigurationError(
            f"this worker has other code (source {source_stamp()}, not {job.source}); install the "
            "same version on every machine"
        )
    algorithm, rounds = job.begin(), job.config.rounds
    for record in algorithm:
        say(f"{record.round}/{rounds}", record.round / rounds)
    result = algorithm.result
    timeless = [record.to_dict() for record in result.rounds]
    for line in timeless:
        del line["seconds"]
    sure = {} if result.belief is None else {"belief": _sureness(result, result.belief)}
    return {**job.place._asdict(), "stopped": result.stopped, "rounds": timeless, **sure}


def _sureness(result: Result, belief: Belief) -> dict[str, Any]:
    """Return what a posterior comes to beside the truth, ready for JSON."""
    assert result.truth is not None
    coverage, width = {}, {}
    for mass in MASSES:
        low, high = belief.interval(mass)
        held = (low <= result.truth) & (result.truth <= high)
        coverage[f"{mass:.0%}"] = float(held.mean())
        width[f"{mass:.0%}"] = result.width(mass)
    return {"coverage": coverage, "width": width, "good": belief.good, "verdict": belief.verdict}
