"""The settings behind each of the paper's figures."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

from eea.core.checks import choice
from eea.core.config import Config, EstimationConfig, JointConfig, OutOfBandConfig, PaperConfig

# The arms of Figs. 5 to 10, in this order.
ARMS: dict[str, PaperConfig] = {
    "ideal": PaperConfig(condition="ideal"),
    "none": PaperConfig(condition="none"),
    "in-band": PaperConfig(condition="in-band"),
    "in-band-200": PaperConfig(condition="in-band", estimation=EstimationConfig(population=200)),
    "out-of-band": PaperConfig(condition="out-of-band"),
    "out-of-band-100": PaperConfig(
        condition="out-of-band",
        estimation=EstimationConfig(population=100),
        out_of_band=OutOfBandConfig(inner_population=50, sampled_models=5),
    ),
}
FIGURE_ARMS = {str(number): arm for number, arm in enumerate(ARMS, 5)}
FIGURES = {f"fig{number}": config for number, config in enumerate(ARMS.values(), 5)}


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
