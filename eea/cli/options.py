"""Options that ``run`` and ``study`` share: settings of the algorithm."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

from eea.core.checks import ConfigurationError
from eea.core.conditions import InBandConfig, OutOfBandConfig
from eea.core.config import Config, FitConfig, JointConfig
from eea.core.estimation import EstimationConfig
from eea.core.exploration import ExplorationConfig
from eea.core.genetic import GeneticConfig

_OF_A_CONDITION = {"in_band": "in-band", "out_of_band": "out-of-band", "joint": "joint"}


@dataclass(frozen=True)
class AlgorithmOptions:
    """Settings of the algorithm; those at their default stay as each condition has them."""

    accurate: float | None = None  #: Stop once the best MOD_FIT reaches this; None for never.
    exploration: ExplorationConfig = field(default_factory=ExplorationConfig)
    estimation: EstimationConfig = field(default_factory=EstimationConfig)
    genetic: GeneticConfig = field(default_factory=GeneticConfig)
    in_band: InBandConfig = field(default_factory=InBandConfig)
    out_of_band: OutOfBandConfig = field(default_factory=OutOfBandConfig)
    joint: FitConfig = field(default_factory=FitConfig)

    def over(self, configs: Mapping[str, Config]) -> dict[str, Config]:
        """Return named configurations with every setting that is not at its default.

        Raises
        ------
        ConfigurationError
            If a setting belongs to a condition that none of them has, or contradicts another.
        """
        usual = AlgorithmOptions()
        conditions = {config.condition for config in configs.values()}
        for part, condition in _OF_A_CONDITION.items():
            changed = _changes(getattr(self, part), getattr(usual, part))
            if changed and condition not in conditions:
                name = f"{part}.{next(iter(changed))}"
                raise ConfigurationError(
                    f"{name} is for the condition {condition}; got {', '.join(sorted(conditions))}"
                )
        return {name: self._over(config, usual) for name, config in configs.items()}

    def _over(self, config: Config, usual: AlgorithmOptions) -> Config:
        if isinstance(config, JointConfig):
            return replace(config, **_changes(self.joint, usual.joint))
        changed = _changes(self, usual)
        changed.pop("joint", None)
        for part in changed.keys() - {"accurate"}:
            given = _changes(changed[part], getattr(usual, part))
            changed[part] = replace(getattr(config, part), **given)
        return replace(config, **changed)


def _changes(settings: Any, usual: Any) -> dict[str, Any]:
    """Return the fields of a dataclass that differ from another's, by name."""
    pairs = ((f.name, getattr(settings, f.name), getattr(usual, f.name)) for f in fields(settings))
    return {name: value for name, value, default in pairs if value != default}
