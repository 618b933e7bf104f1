"""The arms of an ablation study: each answer of an open choice beside its condition's baseline."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

from eea.core.checks import choice
from eea.core.config import EEAConfig
from eea.study.ablations import ABLATIONS, BASELINES, STEPS, Settings
from eea.study.presets import figure_config


@dataclass(frozen=True)
class Arm:
    """One answer to a question under one condition.

    Attributes
    ----------
    condition
        A key of ``BASELINES``.
    config
        Every setting.
    """

    condition: str
    config: EEAConfig

    @property
    def baseline(self) -> str:
        """The arm to subtract, seed by seed."""
        return f"baseline-{self.condition}"


def baseline_config(condition: str, steps: int = STEPS, rounds: int = 25) -> EEAConfig:
    """Return the settings that a condition's arms differ from: the defaults.

    Raises
    ------
    ConfigurationError
        If the condition is not one of ``BASELINES``.
    """
    choice("condition", condition, BASELINES)
    return figure_config(BASELINES[condition], steps, rounds)


def with_settings(config: EEAConfig, settings: Settings) -> EEAConfig:
    """Return a configuration with some fields of its parts replaced."""
    parts = {part: replace(getattr(config, part), **dict(s)) for part, s in settings.items()}
    return replace(config, **parts)


def arms(
    names: Iterable[str] | None = None, steps: int = STEPS, rounds: int = 25
) -> dict[str, Arm]:
    """Return the arms of some ablations, by names as ``"difference-magnitude-ideal"``.

    Parameters
    ----------
    names
        Keys of ``ABLATIONS``; None for all.
    steps, rounds
        Of every arm.

    Raises
    ------
    ConfigurationError
        If a name is unknown.
    """
    found: dict[str, Arm] = {}
    for name in ABLATIONS if names is None else names:
        choice("ablation", name, ABLATIONS)
        for condition in ABLATIONS[name].conditions:
            baseline = baseline_config(condition, steps, rounds)
            for answer, settings in ABLATIONS[name].answers.items():
                config = with_settings(baseline, settings)
                if config != baseline:
                    found[f"{name}-{answer}-{condition}"] = Arm(condition, config)
    return found


def ablation_arms(
    names: Iterable[str] | None = None, steps: int = STEPS, rounds: int = 25
) -> dict[str, EEAConfig]:
    """Return the settings of every arm to run, the baselines first and once each.

    See ``arms`` for the parameters.
    """
    wanted = arms(names, steps, rounds)
    needed = {arm.condition for arm in wanted.values()}
    configs = {
        f"baseline-{condition}": baseline_config(condition, steps, rounds)
        for condition in BASELINES
        if condition in needed
    }
    return configs | {name: arm.config for name, arm in wanted.items()}
