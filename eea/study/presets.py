"""Presets: settings of an arm, reduced."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, TypeVar

from eea.core.config import OUT_OF_BAND, JointConfig
from eea.study.method import ArmConfig, MethodConfig

C = TypeVar("C", bound=ArmConfig)


def smoke(config: C) -> C:
    """Return an arm's settings reduced so that all figures take seconds; methods have no sizes."""
    if isinstance(config, MethodConfig):
        return config
    if isinstance(config, JointConfig):
        return replace(config, bodies=12, poses=12, descents=4, polished=1, restarts=0)
    few: dict[str, Any] = {}
    if config.condition in OUT_OF_BAND:
        few = {"period": 3, "inner_population": 6, "inner_generations": 3}
    return replace(
        config,
        exploration=replace(config.exploration, population=6, generations=3),
        estimation=replace(
            config.estimation,
            population=max(6, config.estimation.population // 10),
            generations=8,
        ),
        out_of_band=replace(config.out_of_band, **few),
    )
