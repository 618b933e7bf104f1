"""Which arms a study's command line asks for, and their settings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Literal, get_args

from eea.core.checks import ConfigurationError
from eea.core.conditions import InBandConfig, OutOfBandConfig
from eea.core.config import Condition, Config, FitConfig, JointConfig, config_for
from eea.core.estimation import EstimationConfig
from eea.core.exploration import ExplorationConfig
from eea.core.genetic import GeneticConfig
from eea.study.presets import FIGURE_ARMS, FIGURES

Figure = Literal["5", "6", "7", "8", "9", "10", "all"]
_OF_A_CONDITION = {"in_band": "in-band", "out_of_band": "out-of-band", "joint": "joint"}


@dataclass(frozen=True)
class ArmSettings:
    """Settings of the algorithm for all arms; those at their default stay each arm's own.

    Attributes
    ----------
    accurate
        End a replicate once the best MOD_FIT reaches this; None for never.
    """

    accurate: float | None = None
    exploration: ExplorationConfig = field(default_factory=ExplorationConfig)
    estimation: EstimationConfig = field(default_factory=EstimationConfig)
    genetic: GeneticConfig = field(default_factory=GeneticConfig)
    in_band: InBandConfig = field(default_factory=InBandConfig)
    out_of_band: OutOfBandConfig = field(default_factory=OutOfBandConfig)
    joint: FitConfig = field(default_factory=FitConfig)

    def over(self, arms: Mapping[str, Config]) -> dict[str, Config]:
        """Return the arms with every setting that is not at its default.

        Raises
        ------
        ConfigurationError
            If a setting belongs to a condition that no arm has, or contradicts an arm's.
        """
        usual = ArmSettings()
        conditions = {config.condition for config in arms.values()}
        for part, condition in _OF_A_CONDITION.items():
            if getattr(self, part) != getattr(usual, part) and condition not in conditions:
                name = next(iter(_changes(getattr(self, part), getattr(usual, part))))
                raise ConfigurationError(
                    f"{part}.{name} is for the condition {condition}; no arm has it"
                )
        return {name: self._on(config, usual) for name, config in arms.items()}

    def _on(self, config: Config, usual: ArmSettings) -> Config:
        if isinstance(config, JointConfig):
            return replace(config, **_changes(self.joint, usual.joint))
        changed: dict[str, Any] = {}
        for name, value in _changes(self, usual).items():
            if name == "accurate":
                changed[name] = value
            elif name != "joint":
                given = _changes(value, getattr(usual, name))
                changed[name] = replace(getattr(config, name), **given)
        return replace(config, **changed)


def asked_arms(
    figure: Sequence[Figure] | None, conditions: Sequence[Condition] | None
) -> dict[str, Config]:
    """Return the arms of some of the paper's figures or of some conditions, by name.

    Raises
    ------
    ConfigurationError
        If neither or both are given, or none is named.
    """
    if (figure is None) == (conditions is None):
        raise ConfigurationError("either --figure or --conditions must be given")
    if figure is not None:
        refuse_empty("--figure", figure, "of " + ", ".join(get_args(Figure)))
        names = FIGURE_ARMS if "all" in figure else figure
        return {FIGURE_ARMS[name]: FIGURES[f"fig{name}"] for name in names}
    assert conditions is not None
    refuse_empty("--conditions", conditions, "of " + ", ".join(get_args(Condition)))
    return {condition: config_for(condition) for condition in conditions}


def refuse_empty(option: str, values: Sequence[object], wanted: str) -> None:
    """Raise a ConfigurationError for an option without values."""
    if not values:
        raise ConfigurationError(f"{option} must be one or more {wanted}; got none")


def _changes(settings: Any, usual: Any) -> dict[str, Any]:
    """Return the fields of a dataclass that differ from another's, by name."""
    names = (field.name for field in fields(settings))
    return {
        name: getattr(settings, name)
        for name in names
        if getattr(settings, name) != getattr(usual, name)
    }
