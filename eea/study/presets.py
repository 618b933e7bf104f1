"""The settings behind each of the paper's figures."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

from eea.core.checks import choice
from eea.core.conditions import OutOfBandConfig
from eea.core.config import Config, JointConfig, PaperConfig
from eea.core.estimation import EstimationConfig

FIGURES: dict[str, PaperConfig] = {
    "fig5": PaperConfig(condition="ideal"),
    "fig6": PaperConfig(condition="none"),
    "fig7": PaperConfig(condition="in-band"),
    "fig8": PaperConfig(condition="in-band", estimation=EstimationConfig(population=200)),
    "fig9": PaperConfig(condition="out-of-band"),
    "fig10": PaperConfig(
        condition="out-of-band",
        estimation=EstimationConfig(population=100),
        out_of_band=OutOfBandConfig(inner_population=50, sampled_models=5),
    ),
}

# Figure number -> the arm that it shows.
FIGURE_ARMS: dict[str, str] = {
    "5": "ideal",
    "6": "none",
    "7": "in-band",
    "8": "in-band-200",
    "9": "out-of-band",
    "10": "out-of-band-100",
}


def figure_config(name: str, steps: int = 256, rounds: int = 25) -> PaperConfig:
    """Return the settings of ``FIGURES`` behind one of the paper's figures.

    The paper's figures have steps of 128 to 1024 and 25 rounds.

    Raises
    ------
    ConfigurationError
        If the name is unknown.
    """
    choice("figure", name, FIGURES)
    return replace(FIGURES[name], steps=steps, rounds=rounds)


C = TypeVar("C", bound=Config)


def smoke(config: C) -> C:
    """Return an arm's settings reduced so that all figures take seconds."""
    if isinstance(config, JointConfig):
        return replace(config, bodies=12, poses=12, descents=4, polished=1, restarts=0)
    return replace(
        config,
        exploration=replace(config.exploration, population=6, generations=3),
        estimation=replace(
            config.estimation,
            population=max(6, config.estimation.population // 10),
            generations=8,
        ),
        out_of_band=replace(config.out_of_band, period=3, inner_population=6, inner_generations=3),
    )
