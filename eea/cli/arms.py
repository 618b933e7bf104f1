"""Which arms a command line asks for, and the settings that it gives them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Literal, get_args

import tyro

from eea.core.behavior import BehaviorConfig
from eea.core.checks import ConfigurationError
from eea.core.conditions import InBandConfig, OutOfBandConfig
from eea.core.config import Condition, EEAConfig, JointConfig
from eea.core.estimation import EstimationConfig
from eea.core.exploration import ExplorationConfig
from eea.core.genetic import GeneticConfig
from eea.study.presets import FIGURE_ARMS, FIGURES

_NONE = "no arm is of the condition"
_NO_BREEDING = "every arm is of the condition joint, which breeds nothing"
WHY_UNHEARD = {
    "in_band": f"{_NONE} in-band",
    "out_of_band": f"{_NONE} out-of-band",
    "joint": f"{_NONE} joint",
    "exploration": _NO_BREEDING,
    "estimation": _NO_BREEDING,
    "genetic": _NO_BREEDING,
}
Figure = Literal["5", "6", "7", "8", "9", "10", "all"]


@dataclass(frozen=True)
class ArmSettings:
    """The settings that an arm has besides its condition and the lengths of trials.

    Attributes
    ----------
    accurate
        End a replicate once the best MOD_FIT reaches this; None for never.
    """

    accurate: float | None = None
    exploration: ExplorationConfig = field(default_factory=ExplorationConfig)
    estimation: EstimationConfig = field(default_factory=EstimationConfig)
    genetic: GeneticConfig = field(default_factory=GeneticConfig)
    behavior: BehaviorConfig = field(default_factory=BehaviorConfig)
    in_band: InBandConfig = field(default_factory=InBandConfig)
    out_of_band: OutOfBandConfig = field(default_factory=OutOfBandConfig)
    joint: JointConfig = field(default_factory=JointConfig)

    @classmethod
    def of(cls, config: EEAConfig) -> ArmSettings:
        """Return a configuration's."""
        return cls(**{name: getattr(config, name) for name in cls.__dataclass_fields__})

    def on(self, config: EEAConfig) -> EEAConfig:
        """Return a configuration with these settings."""
        return replace(config, **{name: getattr(self, name) for name in self.__dataclass_fields__})


def asked_arms(
    figure: Sequence[Figure] | None, conditions: Sequence[Condition] | None
) -> dict[str, EEAConfig]:
    """Return the arms that one of the options asks for; else raise a ConfigurationError."""
    asked = {"--figure": figure, "--conditions": conditions}
    given = [name for name, what in asked.items() if what is not None]
    if len(given) > 1:
        raise ConfigurationError(
            f"{' and '.join(given)} exclude each other; run them one after the other, into "
            "one folder if you like"
        )
    if figure is not None:
        refuse_empty("--figure", figure, "of " + ", ".join(get_args(Figure)))
        names = FIGURE_ARMS if "all" in figure else figure
        return {FIGURE_ARMS[name]: FIGURES[f"fig{name}"] for name in names}
    if conditions is not None:
        refuse_empty("--conditions", conditions, "of " + ", ".join(get_args(Condition)))
        return {condition: EEAConfig(condition=condition) for condition in conditions}
    raise ConfigurationError(f"{' or '.join(asked)} must say what to run")


def refuse_empty(option: str, values: Sequence[object], wanted: str) -> None:
    """Refuse an option that says none of the values it is for, with a ConfigurationError."""
    if not values:
        raise ConfigurationError(f"{option} must be one or more {wanted}; got none")


def given_settings(base: EEAConfig, settings: ArmSettings, words: Sequence[str]) -> EEAConfig:
    """Return an arm's settings with those that a command line gives.

    ``settings`` is what it was read as, over the defaults. Its ``words`` are read again over the
    arm's own settings, for what they give may equal a default and not the arm's; without them,
    ``settings`` are all given if any is.
    """
    options = [word.partition("=")[0] for word in words if word.startswith("--")]
    given = any("." in option or option == "--accurate" for option in options)
    if settings == ArmSettings() and not given:
        return base
    if words:
        settings, _ = tyro.cli(
            ArmSettings, default=ArmSettings.of(base), args=words, return_unknown_args=True
        )
    return settings.on(base)


def refuse_what_has_no_say(arms: Mapping[str, EEAConfig], settings: ArmSettings) -> None:
    """Refuse a setting that no arm looks at, with a ConfigurationError that names it."""
    for part in ("in_band", "out_of_band", "joint", "exploration", "estimation", "genetic"):
        given, usual = asdict(getattr(settings, part)), asdict(getattr(ArmSettings(), part))
        for name in given:
            unheard = all(_unheard(part, config) for config in arms.values())
            if given[name] != usual[name] and unheard:
                raise ConfigurationError(f"{part}.{name} has no say: {WHY_UNHEARD[part]}")
    behaviors = [config.behavior for config in arms.values()]
    used = any(b.signal == "attitude" and b.summary != "dft" for b in behaviors)
    if settings.behavior.timestep != BehaviorConfig().timestep and not used:
        raise ConfigurationError(
            "behavior.timestep has no say: no arm takes the mean or rms rate of the attitude"
        )


def _unheard(part: str, config: EEAConfig) -> bool:
    """Return whether an arm looks at a setting under no circumstances."""
    if part in ("exploration", "estimation", "genetic"):
        return config.condition == "joint"
    return config.condition != part.replace("_", "-")
