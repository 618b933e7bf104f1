"""All settings of a run in one place, and those of each of the paper's figures."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal

from eea.behavior import BehaviorConfig
from eea.checks import ConfigurationError, choice, real, whole
from eea.estimation import EstimationConfig
from eea.exploration import ExplorationConfig
from eea.genetic import GeneticConfig
from eea.inference import InBandConfig, OutOfBandConfig

Condition = Literal["ideal", "none", "in-band", "out-of-band"]
CONDITIONS: tuple[Condition, ...] = ("ideal", "none", "in-band", "out-of-band")


@dataclass(frozen=True)
class EEAConfig:
    """The settings of one run; the defaults are the paper's where it gives them.

    Attributes
    ----------
    condition
        What is known of the fins' angles: ``"ideal"`` all, ``"none"`` nothing, ``"in-band"`` and
        ``"out-of-band"`` what the two methods infer.
    steps
        Length of a trial in steps of 0.01 s; a power of two.
    rounds
        Rounds at most, which is also the number of commands the target performs.
    accurate
        Stop once the best MOD_FIT reaches this; ``None`` for never.
    time_limit
        Begin no round after so many seconds; ``None`` for no limit.
    exploration, estimation, genetic, behavior, in_band, out_of_band
        Settings of the parts.

    Raises
    ------
    ConfigurationError
        If a setting is out of range or unknown; the nearest valid name is offered.
    """

    condition: Condition = "out-of-band"
    steps: int = 256
    rounds: int = 25
    accurate: float | None = None
    time_limit: float | None = None
    exploration: ExplorationConfig = field(default_factory=ExplorationConfig)
    estimation: EstimationConfig = field(default_factory=EstimationConfig)
    genetic: GeneticConfig = field(default_factory=GeneticConfig)
    behavior: BehaviorConfig = field(default_factory=BehaviorConfig)
    in_band: InBandConfig = field(default_factory=InBandConfig)
    out_of_band: OutOfBandConfig = field(default_factory=OutOfBandConfig)

    def __post_init__(self) -> None:
        choice("condition", self.condition, CONDITIONS)
        whole("steps", self.steps, 2)
        if self.steps & (self.steps - 1):
            raise ConfigurationError(f"steps must be a power of two; got {self.steps}")
        whole("rounds", self.rounds, 1)
        if self.accurate is not None:
            real("accurate", self.accurate, float("-inf"), 1.0)
        if self.time_limit is not None:
            real("time_limit", self.time_limit, 0.0)
        if self.in_band.k > self.estimation.population:
            raise ConfigurationError(
                f"in_band.k must be at most estimation.population, {self.estimation.population}; "
                f"got {self.in_band.k}"
            )

    def to_dict(self) -> dict[str, Any]:
        """Return every setting, nested, ready for JSON."""
        return asdict(self)


FIGURES: dict[str, EEAConfig] = {
    "fig5": EEAConfig(condition="ideal"),
    "fig6": EEAConfig(condition="none"),
    "fig7": EEAConfig(condition="in-band"),
    "in-band-split": EEAConfig(condition="in-band", in_band=InBandConfig(dynamic_split=True)),
    "in-band-extended": EEAConfig(condition="in-band", in_band=InBandConfig(extension=0.2)),
    "fig8": EEAConfig(condition="in-band", estimation=EstimationConfig(population=200)),
    "fig9": EEAConfig(condition="out-of-band"),
    "fig10": EEAConfig(
        condition="out-of-band",
        estimation=EstimationConfig(population=100),
        out_of_band=OutOfBandConfig(inner_population=50, sampled_models=5),
    ),
}


def figure_config(name: str, steps: int = 256, rounds: int = 25) -> EEAConfig:
    """Return the settings behind one of the paper's figures, or a variant of Sec. 4.3.

    Parameters
    ----------
    name
        A key of ``FIGURES``: ``"fig5"`` to ``"fig10"``, ``"in-band-split"``,
        ``"in-band-extended"``.
    steps, rounds
        The paper's figures have steps of 128 to 1024 and 25 rounds.

    Raises
    ------
    ConfigurationError
        If the name is unknown.
    """
    choice("figure", name, FIGURES)
    return replace(FIGURES[name], steps=steps, rounds=rounds)
