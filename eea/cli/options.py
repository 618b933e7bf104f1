"""Options that ``run`` and ``study`` share: settings of the algorithm."""

from __future__ import annotations

from collections.abc import Container, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

from aquafish_gym.runs.command_line import option_name
from eea.core.checks import ConfigurationError
from eea.core.config import (
    CONDITIONS,
    OUT_OF_BAND,
    Config,
    EstimationConfig,
    ExplorationConfig,
    FitConfig,
    GeneticConfig,
    InBandConfig,
    JointConfig,
    OutOfBandConfig,
)

_PARTS: dict[str, tuple[str, ...]] = {
    "exploration": (*CONDITIONS, "recovery"),
    "estimation": (*CONDITIONS, "recovery"),
    "genetic": (*CONDITIONS, "recovery"),
    "in_band": ("in-band",),
    "out_of_band": OUT_OF_BAND,
    "joint": ("joint",),
}


@dataclass(frozen=True)
class AlgorithmOptions:
    """Settings of the algorithm; settings that are not given keep each condition's default."""

    exploration: ExplorationConfig = field(default_factory=ExplorationConfig)
    estimation: EstimationConfig = field(default_factory=EstimationConfig)
    genetic: GeneticConfig = field(default_factory=GeneticConfig)
    in_band: InBandConfig = field(default_factory=InBandConfig)
    out_of_band: OutOfBandConfig = field(default_factory=OutOfBandConfig)
    joint: FitConfig = field(default_factory=FitConfig)

    def over(self, configs: Mapping[str, Config], given: Container[str] = ()) -> dict[str, Config]:
        """Return named configurations with every setting that was given.

        A setting was given if it differs from its default, or if its option, such as
        "out-of-band.revisit", is in ``given``.

        Raises
        ------
        ConfigurationError
            If a setting belongs to a condition that none of them has, or contradicts another.
        """
        conditions = {config.condition for config in configs.values()}
        changes = {part: _changes(part, getattr(self, part), given) for part in _PARTS}
        for part, having in _PARTS.items():
            if changes[part] and conditions.isdisjoint(having):
                name = f"{part}.{next(iter(changes[part]))}"
                raise ConfigurationError(
                    f"{name} is for the condition {' or '.join(having)}; got "
                    f"{', '.join(sorted(conditions))}"
                )
        return {name: _over(config, changes) for name, config in configs.items()}


def _over(config: Config, changes: Mapping[str, Mapping[str, Any]]) -> Config:
    """Return a configuration with the changes of those parts that its condition has."""
    if isinstance(config, JointConfig):
        return replace(config, **changes["joint"])
    parts = [part for part, having in _PARTS.items() if config.condition in having]
    return replace(
        config, **{part: replace(getattr(config, part), **changes[part]) for part in parts}
    )


def _changes(part: str, settings: Any, given: Container[str]) -> dict[str, Any]:
    """Return the fields of a dataclass that are given or not at their default, by name."""
    values = {each.name: (getattr(settings, each.name), each.default) for each in fields(settings)}
    return {
        name: value
        for name, (value, default) in values.items()
        if value != default or option_name(f"{part}.{name}") in given
    }
