"""One replicate of a study: a pure function of a small description."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

from aquafish_gym.damage import Damage
from aquafish_gym.damage.held_out import held_out, recovery_list
from aquafish_gym.morphology import Morphology
from aquafish_gym.scenario import check_row
from eea.core.checks import ConfigurationError
from eea.core.result import Result
from eea.core.session import Session, streams
from eea.fish import EngineTarget, RealityGap, fish_eea
from eea.study.method import ArmConfig, MethodConfig, MethodSettings, method_rounds
from eea.study.presets import smoke

RUNS_FOLDER = "runs"
NO_DAMAGE = Damage.parse("none")
MASSES = (0.5, 0.8, 0.9)  # probabilities of the intervals with measured coverage


class ReplicateKey(NamedTuple):
    """The key of a replicate: an arm, the steps of its trials and a seed."""

    arm: str
    steps: int
    seed: int

    @property
    def name(self) -> str:
        """The name in messages."""
        return f"{self.arm}, {self.steps} steps, seed {self.seed}"

    @property
    def file(self) -> str:
        """The file, relative to the study's folder."""
        return f"{RUNS_FOLDER}/{self.arm}/{self.steps}/{self.seed}.json"


@dataclass(frozen=True)
class StudyWorld:
    """The target of a study, and the water of target and models."""

    morphology: Morphology  #: The target's body before the damage.
    damage: Damage = NO_DAMAGE
    target_engine: str = "numba"
    #: Velocity of the water, units/s, for target and models.
    current: tuple[float, float, float] = (0.0, 0.0, 0.0)
    #: Differences of the target's world from the models' world.
    gap: RealityGap = field(default_factory=RealityGap)
    #: Whether the damage is, seed by seed, the next one of the list ``held_out_list``.
    held_out: bool = False
    reactive: bool = False  #: Whether the water of target and models also resists acceleration.

    def __post_init__(self) -> None:
        check_row("current", self.current)
        if self.held_out and self.damage:
            raise ConfigurationError(
                f"damage must be none with held_out, which has its own; got {self.damage}"
            )

        if self.held_out:
            _ = self.held_out_list  # raises for a plan without one

    @property
    def held_out_list(self) -> str:
        """The name of the list of held-out damages."""
        return recovery_list(self.morphology.plan)

    def damage_of(self, seed: int) -> Damage:
        """Return the damage of the target of a seed."""
        if not self.held_out:
            return self.damage
        damages = held_out(self.held_out_list)
        return Damage.parse(damages[seed % len(damages)])


@dataclass(frozen=True)
class Replicate:
    """One seed of one arm at one length of trial, with everything that another machine needs.

    ``config`` has the arm's settings with the steps and rounds.
    """

    arm: str
    config: ArmConfig
    seed: int
    world: StudyWorld

    @property
    def key(self) -> ReplicateKey:
        """The key in the study."""
        return ReplicateKey(self.arm, self.config.steps, self.seed)

    @property
    def name(self) -> str:
        return self.key.name

    @property
    def file(self) -> str:
        return self.key.file

    def target(self) -> EngineTarget:
        """Return the target before its first trial; raises as ``EngineTarget``."""
        world = self.world
        return EngineTarget(
            world.morphology, world.damage_of(self.seed), streams(self.seed)["target"],
            self.config.steps, world.target_engine, world.current, gap=world.gap,
            reactive=world.reactive,
        )  # fmt: skip

    def session(self) -> Session[Any]:
        """Return the session of a condition before its first round.

        Raises
        ------
        InvalidArgumentError, EngineUnavailableError, ConfigurationError
            If a setting is wrong or an engine is not installed.
        """
        assert not isinstance(self.config, MethodConfig)
        target = self.target()
        return fish_eea(
            target, self.config, self.seed, target.morphology, current=self.world.current,
            threads=1, reactive=self.world.reactive,
        )  # fmt: skip


def warm_up_replicates(jobs: Sequence[Replicate]) -> None:
    """Refuse wrong settings, and run small replicates so that the kernels are compiled.

    Raises as ``replicate``.
    """
    for job in {(job.arm, job.config.steps): job for job in jobs}.values():
        if isinstance(job.config, MethodConfig):
            job.target()
        else:
            job.session()
    # one replicate of each kind of condition, and of each method
    first = {_kind(job.config): job for job in reversed(jobs)}
    for job in first.values():
        replicate(replace(job, config=replace(smoke(job.config), rounds=2)))


def _kind(config: ArmConfig) -> str:
    if isinstance(config, MethodConfig):
        return config.function
    return "joint" if config.condition == "joint" else "paper"


def replicate(job: Replicate) -> dict[str, Any]:
    """Run a replicate to its end; return its key, why it stopped and a record for each round.

    The records have no times, so that equal jobs give equal results. The condition joint adds
    ``belief``: the ``coverage`` of its intervals (the share of true sizes inside, by mass), their
    mean ``width`` as a share of the ranges, whether the fit is ``good``, and its ``verdict``.
    Raises as ``Replicate.session`` and ``method_rounds``.
    """
    if isinstance(job.config, MethodConfig):
        world = job.world
        settings = MethodSettings(
            job.config.steps, world.current, world.morphology.plan, world.reactive
        )
        rounds = method_rounds(job.config, job.target(), job.seed, settings)
        return {**job.key._asdict(), "stopped": "rounds", "rounds": rounds}
    session = job.session()
    records = [record.to_dict() for record in session]
    for record in records:
        del record["seconds"]
    result = session.result
    document = {**job.key._asdict(), "stopped": result.stopped, "rounds": records}
    if result.belief is not None:
        document["belief"] = _coverage(result, result.belief)
    return document


def _coverage(result: Result, belief: Any) -> dict[str, Any]:
    """Return a posterior's coverage, width and verdict, ready for JSON."""
    assert result.truth is not None
    coverage = {}
    width = {}
    for mass in MASSES:
        low, high = belief.interval(mass)
        held = (low <= result.truth) & (result.truth <= high)
        coverage[f"{mass:.0%}"] = float(held.mean())
        width[f"{mass:.0%}"] = result.width(mass)
    return {"coverage": coverage, "width": width, "good": belief.good, "verdict": belief.verdict}
