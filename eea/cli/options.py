"""Options that ``run`` and ``study`` share: settings of the algorithm."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

from eea.core.checks import ConfigurationError
from eea.core.config import (
    Config,
    EstimationConfig,
    ExplorationConfig,
    FitConfig,
    JointConfig,
    OutOfBandConfig,
)

_OF_A_CONDITION = {"out_of_band": "out-of-band", "joint": "joint"}


@dataclass(frozen=True)
class AlgorithmOptions:
    """Settings of the algorithm; those at their default stay as each condition has them."""

    exploration: ExplorationConfig = field(default_factory=ExplorationConfig)
    estimation: EstimationConfig = field(default_factory=EstimationConfig)
    out_of_band: OutOfBandConfig = field(default_factory=OutOfBandConfig)
    joint: FitConfig = field(default_factory=FitConfig)

    def over(self, configs: Mapping[str, Config]) -> dict[str, Config]:
        """Return named configurations with every setting that is not at its default.

        Raises
        ------
        ConfigurationError
            If a setting belongs to a condition that none of them has, or contradicts another.
        """
        conditions = {config.condition for config in configs.values()}
        for part, condition in _OF_A_CONDITION.items():
            changed = _changes(getattr(self, part))
            if changed and condition not in conditions:
                name = f"{part}.{next(iter(changed))}"
                raise ConfigurationError(
                    f"{name} is for the condition {condition}; got {', '.join(sorted(conditions))}"
                )
        return {name: self._over(config) for name, config in configs.items()}

    def _over(self, config: Config) -> Config:
        if isinstance(config, JointConfig):
            return replace(config, **_changes(self.joint))
        return replace(
            config,
            exploration=replace(config.exploration, **_changes(self.exploration)),
            estimation=replace(config.estimation, **_changes(self.estimation)),
            out_of_band=replace(config.out_of_band, **_changes(self.out_of_band)),
        )


def _changes(settings: Any) -> dict[str, Any]:
    """Return the fields of a dataclass that are not at their default, by name."""
    values = {each.name: (getattr(settings, each.name), each.default) for each in fields(settings)}
    return {name: value for name, (value, default) in values.items() if value != default}
