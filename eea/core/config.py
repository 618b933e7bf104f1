"""The settings of a run: the paper's method, or joint inference."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, ClassVar, Literal, get_args

from eea.core.checks import (
    ConfigurationError,
    at_most,
    brief,
    check_fields,
    choice,
    flag,
    instance,
    real_field,
    whole_field,
)

Coding = Literal["gray", "binary"]
Crossover = Literal["uniform", "two-point"]
Condition = Literal["ideal", "none", "in-band", "out-of-band", "recovery", "joint"]
CONDITIONS: tuple[Condition, ...] = ("ideal", "none", "in-band", "out-of-band")  # the paper's
MAXIMUM_TRIAL_STEPS = 2**20  # samples; the paper's longest trial has 1024
MAXIMUM_ROUNDS = 10**4
# Parts of the settings -> the conditions that read them.
READERS: dict[str, tuple[Condition, ...]] = {
    "exploration": (*CONDITIONS, "recovery"),
    "estimation": (*CONDITIONS, "recovery"),
    "genetic": (*CONDITIONS, "recovery"),
    "in_band": ("in-band",),
    "out_of_band": ("out-of-band", "recovery"),
    "joint": ("joint",),
}
OUT_OF_BAND = READERS["out_of_band"]  # infer the angles between generations
FALSE_ALARM_RATE = 1e-3  # of a test whether residuals are noise
MAXIMUM_SIZE = 10**6  # limit of sizes in a search, to refuse typing errors at once


@dataclass(frozen=True)
class ExplorationConfig:
    """Settings of the exploration phase."""

    population: int = whole_field(25, 2, MAXIMUM_SIZE)  #: Size of the population of commands.
    generations: int = whole_field(25, 1, MAXIMUM_SIZE)  #: Generations a round.
    #: Initial joint angles of the models while commands are compared (Eq. 1): "zero", or "random",
    #: one random pose a round that all models share. The paper does not say.
    initial_angles: Literal["zero", "random"] = "zero"

    def __post_init__(self) -> None:
        check_fields(self, "exploration.")
        choice("exploration.initial_angles", self.initial_angles, ("zero", "random"))


@dataclass(frozen=True)
class EstimationConfig:
    """Settings of the estimation phase."""

    #: Size of the population of models; it survives from round to round.
    population: int = whole_field(25, 2, MAXIMUM_SIZE)
    generations: int = whole_field(100, 1, MAXIMUM_SIZE)  #: Generations a round.

    def __post_init__(self) -> None:
        check_fields(self, "estimation.")


@dataclass(frozen=True)
class GeneticConfig:
    """Settings of the genetic algorithms of commands, of models and of poses (Sec. 4).

    The paper states the crossover rate and the mutations, and neither coding, kind of crossover nor
    elites.

    Examples
    --------
    >>> GeneticConfig(elites=3).mutations
    1.0
    """

    #: Code of the genomes: in "gray" neighbouring values differ in one bit, in "binary" in several.
    coding: Coding = "gray"
    #: What two parents swap: "uniform" each bit with probability 1/2, "two-point" one stretch.
    crossover: Crossover = "uniform"
    #: Probability that two parents swap bits at all.
    crossover_rate: float = real_field(0.75, 0.0, 1.0)
    mutations: float = real_field(1.0, 0.0)  #: Mean number of flipped bits a genome.
    elites: int = whole_field(1, 0, MAXIMUM_SIZE)  #: Number of best genomes that survive unchanged.

    def __post_init__(self) -> None:
        choice("genetic.coding", self.coding, get_args(Coding))
        choice("genetic.crossover", self.crossover, get_args(Crossover))
        check_fields(self, "genetic.")


@dataclass(frozen=True)
class InBandConfig:
    """Settings of In-Band Inference (Sec. 3.3).

    Examples
    --------
    >>> InBandConfig(best=5).confidence
    0.5
    """

    #: Number of best models, the paper's K, whose initial angles make the range (Sec. 4.3).
    best: int = whole_field(3, 1, MAXIMUM_SIZE)
    #: Share of models that begin inside the newest experiment's range; the others begin at random
    #: angles.
    confidence: float = real_field(0.5, 0.0, 1.0)
    #: The share of models with random angles falls evenly to 0 in the first half of a round's
    #: generations.
    dynamic_split: bool = False
    #: Share of its width by which the range extends beyond the best angles at each end; the paper
    #: tried 0.2.
    extension: float = real_field(0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        check_fields(self, "in_band.")
        flag("in_band.dynamic_split", self.dynamic_split)


@dataclass(frozen=True)
class OutOfBandConfig:
    """Settings of Out-of-Band Inference."""

    #: Generations between inferences; the paper infers at 0, 35 and 70 of 100.
    period: int = whole_field(35, 1, MAXIMUM_SIZE)
    inner_population: int = whole_field(25, 2, MAXIMUM_SIZE)  #: Size of the population of poses.
    inner_generations: int = whole_field(25, 1, MAXIMUM_SIZE)  #: Generations of an inference.
    #: Number of models, drawn at random for each inference, that judge the poses; None for all.
    sampled_models: int | None = whole_field(None, 1, MAXIMUM_SIZE)
    #: Number of earlier experiments, drawn at random. Each inference also updates their angles,
    #: starting from the present pose. The paper locks these angles: 0.
    revisit: int = whole_field(0, 0, MAXIMUM_SIZE)

    def __post_init__(self) -> None:
        check_fields(self, "out_of_band.")


@dataclass(frozen=True)
class PaperConfig:
    """Settings of the Estimation-Exploration Algorithm; the defaults are the paper's.

    Raises
    ------
    ConfigurationError
        If a setting is out of range or contradicts another.

    Examples
    --------
    >>> PaperConfig(condition="ideal", rounds=5).steps
    256
    """

    #: What is known of the hidden angles: "ideal" knows them, "none" assumes zero, "in-band" and
    #: "out-of-band" infer them. "recovery" is "out-of-band" with the settings of
    #: :func:`recovery_config`, by their own name.
    condition: Condition = "out-of-band"
    #: Length of a trial in samples, a power of two.
    steps: int = whole_field(256, 2, MAXIMUM_TRIAL_STEPS)
    rounds: int = whole_field(25, 1, MAXIMUM_ROUNDS)  #: Number of rounds, each with one trial.
    exploration: ExplorationConfig = ExplorationConfig()
    estimation: EstimationConfig = EstimationConfig()
    genetic: GeneticConfig = GeneticConfig()
    in_band: InBandConfig = InBandConfig()
    out_of_band: OutOfBandConfig = OutOfBandConfig()

    def __post_init__(self) -> None:
        choice("condition", self.condition, READERS["estimation"])
        check_fields(self)
        if self.steps & (self.steps - 1):
            raise ConfigurationError(f"steps must be a power of two; got {self.steps}")
        models = self.estimation.population
        populations = {"exploration.population": self.exploration.population}
        populations["estimation.population"] = models
        for part, default in self._unread(self.condition).items():
            if getattr(self, part) != default:
                raise ConfigurationError(
                    f"{part} is for the condition {' or '.join(READERS[part])}; got "
                    f"{getattr(self, part)} with {self.condition}"
                )
        if self.condition == "in-band":
            at_most("in_band.best", self.in_band.best, "estimation.population", models)
        if self.condition in OUT_OF_BAND:
            judges = self.out_of_band.sampled_models or 0
            at_most("out_of_band.sampled_models", judges, "estimation.population", models)
            populations["out_of_band.inner_population"] = self.out_of_band.inner_population
        for name, population in populations.items():
            # With elites alone no generation would differ from the first.
            at_most("genetic.elites", self.genetic.elites, f"{name} - 1", population - 1)

    def under(self, condition: Condition) -> PaperConfig:
        """Return these settings under another condition, without those that it does not read.

        Examples
        --------
        >>> recovery_config().under("none").out_of_band == OutOfBandConfig()
        True
        """
        unread: dict[str, Any] = self._unread(condition)
        return replace(self, condition=condition, **unread)

    @staticmethod
    def _unread(condition: str) -> dict[str, InBandConfig | OutOfBandConfig]:
        """Return the parts that a condition does not read, at their defaults."""
        parts: dict[str, InBandConfig | OutOfBandConfig] = {
            "in_band": InBandConfig(),
            "out_of_band": OutOfBandConfig(),
        }
        return {name: part for name, part in parts.items() if condition not in READERS[name]}

    def to_dict(self) -> dict[str, Any]:
        """Return every setting, nested, ready for JSON."""
        return asdict(self)


@dataclass(frozen=True, kw_only=True)
class FitConfig:
    """Settings of one fit of joint inference, ``eea.infer.fit.fit``.

    Examples
    --------
    >>> FitConfig(nuisances=("current", "lag"), noise=0.01).alternatives
    'doubt'
    """

    #: Groups of nuisances to infer; None for all, the safest.
    nuisances: tuple[str, ...] | None = None
    #: Standard deviation of the gyroscope's noise, rad/s; None estimates it.
    noise: float | None = real_field(None, 1e-9)
    #: When to fit the alternative hypotheses, such as a seized servo: in "doubt" (the residuals do
    #: not look like noise, or a part seems to be absent), "always" or "never".
    alternatives: Literal["doubt", "always", "never"] = "doubt"
    bodies: int = whole_field(96, 2, 10**5)  #: Random bodies in the scan for starting points.
    #: Random poses for each body and trial in the scan.
    poses: int = whole_field(96, 1, 10**5)
    descents: int = whole_field(24, 1, 10**5)  #: Starting points of descents; at most ``bodies``.
    #: Descents that are completed in double precision; at most ``descents``.
    polished: int = whole_field(4, 1, 10**5)
    #: Maximum number of new scans where the residuals do not look like noise.
    restarts: int = whole_field(3, 0, 1000)
    #: Budget of simulated trials, after which the best so far is the answer; None for no end.
    evaluations: int | None = whole_field(None, 1, 10**12)
    #: Budget in s, likewise. Where it ends depends on the machine.
    seconds: float | None = real_field(None, 0.0)

    def __post_init__(self) -> None:
        if self.nuisances is not None:
            instance("nuisances", self.nuisances, tuple)
        choice("alternatives", self.alternatives, ("doubt", "always", "never"))
        check_fields(self)
        at_most("descents", self.descents, "bodies", self.bodies)
        at_most("polished", self.polished, "descents", self.descents)


@dataclass(frozen=True, kw_only=True)
class JointConfig(FitConfig):
    """Settings of a session of joint inference, and of its fits.

    Examples
    --------
    >>> JointConfig(rounds=2, noise=0.01).steps
    256
    """

    condition: ClassVar[Literal["joint"]] = "joint"

    steps: int = whole_field(256, 16, MAXIMUM_TRIAL_STEPS)  #: Length of a trial in samples.
    rounds: int = whole_field(3, 1, MAXIMUM_ROUNDS)  #: Number of rounds, each with one trial.
    #: Stop once the 90% interval of every dimension is at most this share of its range and the fit
    #: is good; None for never.
    max_interval_width: float | None = real_field(None, 0.0, 1.0)

    def to_dict(self) -> dict[str, Any]:
        """Return every setting, ready for JSON."""
        return {"condition": self.condition, **asdict(self)}


Config = PaperConfig | JointConfig


def checked_config(config: Config | None) -> Config:
    """Return ``config``, or default joint inference for None; raise for any other type."""
    if config is None:
        return JointConfig()
    if not isinstance(config, PaperConfig | JointConfig):
        raise ConfigurationError(
            f"config must be a PaperConfig or a JointConfig; got {brief(config)}"
        )
    return config


def recovery_config(steps: int = 256, rounds: int = 16) -> PaperConfig:
    """Return the EEA's best settings, those of the damage-recovery case study.

    They differ from the paper's Out-of-Band Inference in two settings. With ``revisit=5`` each
    inference also updates the angles of five earlier trials, which the paper locks. Five models
    judge the angles, as in Fig. 10; this halves the number of simulated trials.
    """
    searching = OutOfBandConfig(sampled_models=5, revisit=5)
    return PaperConfig(condition="recovery", steps=steps, rounds=rounds, out_of_band=searching)


RECOVERY = recovery_config()


def config_for(condition: str = "joint", **settings: Any) -> Config:
    """Return the settings of a condition by name, with some replaced.

    Parameters
    ----------
    condition
        "none", "ideal", "in-band" or "out-of-band" of the paper; "recovery", see
        :func:`recovery_config`; or "joint".
    **settings
        Fields of :class:`PaperConfig` or :class:`JointConfig`.

    Raises
    ------
    ConfigurationError
        If the condition is unknown or a setting is wrong.

    Examples
    --------
    >>> config_for("none", rounds=4).rounds, config_for("joint").rounds
    (4, 3)
    """
    choice("condition", condition, get_args(Condition))
    if condition == "joint":
        return JointConfig(**settings)
    if condition == "recovery":
        return replace(RECOVERY, **settings)
    return PaperConfig(condition=condition, **settings)  # type: ignore[arg-type]


def reads(condition: str, setting: str) -> bool:
    """Return whether a condition reads a setting by name, such as "in_band.best" or "rounds"."""
    part, dot, _ = setting.partition(".")
    return not dot or condition in READERS[part]


def check_read(settings: Iterable[str], conditions: Collection[str]) -> None:
    """Raise ConfigurationError for a setting, such as "in_band.best", that no condition reads."""
    for name in settings:
        if not any(reads(condition, name) for condition in conditions):
            raise ConfigurationError(
                f"{name} is for the condition {' or '.join(READERS[name.partition('.')[0]])}; got "
                f"{', '.join(sorted(conditions))}"
            )


def with_settings(config: Any, settings: Mapping[str, Any]) -> Any:
    """Return a configuration with settings by name that its condition reads.

    Examples
    --------
    >>> with_settings(PaperConfig("in-band"), {"in_band.best": 5, "rounds": 3}).in_band.best
    5
    """
    changes: dict[str, Any] = {}
    for name, value in settings.items():
        part, dot, own = name.partition(".")
        if not dot or part == "joint":
            changes[own or name] = value
        else:
            changes[part] = replace(changes.get(part, getattr(config, part)), **{own: value})
    return replace(config, **changes)
