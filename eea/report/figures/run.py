"""The picture of one run as a file."""

from __future__ import annotations

import os
from pathlib import Path

from eea.aquafish.run_figure import draw_fitness, fitness_figure
from eea.core.checks import choice
from eea.core.result import Result
from eea.report.figures.drawing import FORMATS, save_figure

__all__ = ["draw_fitness", "fitness_figure", "save_fitness_figure"]


def save_fitness_figure(result: Result, path: str | os.PathLike[str]) -> None:
    """Draw one run into a file whose suffix names the format: ``.png``, ``.pdf`` or ``.svg``.

    The file is replaced at once or not at all.

    Raises
    ------
    ConfigurationError
        If there is no such format, or no round to draw.
    """
    figure = fitness_figure(result)
    choice("the picture's suffix", Path(path).suffix, [f".{form}" for form in FORMATS])
    save_figure(figure, Path(path))
