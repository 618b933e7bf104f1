"""Figures without pyplot, and their files: the same picture gives the same bytes."""

from __future__ import annotations

import io
import os
from pathlib import Path

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from aquafish_gym.utils.storage import write_bytes
from aquafish_gym.utils.validation import one_of

# Files without versions and dates are equal for equal pictures.
_UNSAID: dict[str, dict[str, None]] = {
    "png": {"Software": None},
    "pdf": {"Creator": None, "Producer": None, "CreationDate": None},
    "svg": {"Creator": None, "Date": None},
}
FORMATS = tuple(_UNSAID)


def new_figure(width: float, height: float, dpi: int = 200) -> Figure:
    """Return an empty figure of a size in inches, without pyplot and its global state."""
    figure = Figure(figsize=(width, height), layout="constrained", dpi=dpi)
    FigureCanvasAgg(figure)
    return figure


def save_figure(figure: Figure, path: str | os.PathLike[str]) -> None:
    """Write a picture, whole or not at all, in the format of its suffix, one of ``FORMATS``."""
    form = one_of("the picture's suffix", Path(path).suffix.lower(), [f".{f}" for f in FORMATS])[1:]
    write_bytes(path, encode_figure(figure, form))


def encode_figure(figure: Figure, form: str) -> bytes:
    """Return a picture as bytes in one of ``FORMATS``."""
    content = io.BytesIO()
    # A fixed salt makes names within an SVG reproducible; journals ask for TrueType.
    with mpl.rc_context({"svg.hashsalt": "aquafish", "pdf.fonttype": 42}):
        figure.savefig(content, format=form, metadata=_UNSAID[form])
    return _of_few_colours(content) if form == "png" else content.getvalue()


def _of_few_colours(png: io.BytesIO) -> bytes:
    """Return a PNG in 256 colours: a third of the bytes, and to the eye the same."""
    content = io.BytesIO()
    with Image.open(png) as picture:
        picture.convert("RGB").quantize(256, dither=Image.Dither.NONE).save(
            content, format="png", optimize=True, dpi=picture.info["dpi"]
        )
    return content.getvalue()
