"""The Estimation-Exploration Algorithm for robots that do not know where their fins are.

The algorithm, ``eea.core``, knows no robot: it asks a ``Target`` and a ``Simulator``, and needs
numpy only. ``eea.aquafish`` binds it to the fish of ``aquafish_gym``, ``eea.study`` repeats it in
numbers; both are loaded when first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from eea import aquafish, core
from eea.core import *  # noqa: F403

if TYPE_CHECKING:
    from eea.aquafish import *  # noqa: F403
    from eea.study.presets import FIGURES, figure_config

__all__ = ["FIGURES", "figure_config"]
__all__ += core.__all__
__all__ += aquafish.__all__


def __getattr__(name: str) -> Any:
    if name in ("FIGURES", "figure_config"):
        return getattr(import_module("eea.study.presets"), name)
    if name in aquafish.__all__:
        return getattr(aquafish, name)
    raise AttributeError(f"module 'eea' has no attribute {name!r}")
