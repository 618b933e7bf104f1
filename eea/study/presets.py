"""The settings behind each of the paper's figures."""

from __future__ import annotations

from dataclasses import replace

from eea.core.checks import choice
from eea.core.conditions import InBandConfig, OutOfBandConfig
from eea.core.config import EEAConfig
from eea.core.estimation import EstimationConfig

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

# What the arms of a study are called, by the number of the figure that shows them.
FIGURE_ARMS: dict[str, str] = {
    "5": "ideal",
    "6": "none",
    "7": "in-band",
    "8": "in-band-200",
    "9": "out-of-band",
    "10": "out-of-band-100",
}


def figure_config(name: str, steps: int = 256, rounds: int = 25) -> EEAConfig:
    """Return the settings of ``FIGURES`` behind one of the paper's figures, or a variant.

    The paper's figures have steps of 128 to 1024 and 25 rounds.

    Raises
    ------
    ConfigurationError
        If the name is unknown.
    """
    choice("figure", name, FIGURES)
    return replace(FIGURES[name], steps=steps, rounds=rounds)


def smoke(config: EEAConfig) -> EEAConfig:
    """Return an arm's settings made so small that all figures take seconds."""
    return replace(
        config,
        exploration=replace(config.exploration, population=6, generations=3),
        estimation=replace(
            config.estimation,
            population=max(6, config.estimation.population // 10),
            generations=8,
        ),
        out_of_band=replace(config.out_of_band, period=3, inner_population=6, inner_generations=3),
        joint=replace(config.joint, bodies=12, poses=12, descents=4, polished=1, restarts=0),
    )
