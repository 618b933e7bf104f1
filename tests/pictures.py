"""What tests ask of pictures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image


def pixels(path: Path, size: tuple[int, int] | None = None) -> NDArray[np.float64]:
    """Return the colours of a picture from 0 to 1, shrunk to (width, height) if that is given."""
    with Image.open(path) as picture:
        colours = picture.convert("RGB")
        return np.asarray(colours if size is None else colours.resize(size)) / 255


def is_drawn(path: Path) -> bool:
    """Return whether at least one pixel in a hundred differs from the background."""
    colours = pixels(path)
    return bool((colours != colours[0, 0]).any(axis=-1).mean() > 0.01)
