"""Pictures are small files that look as matplotlib drew them."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from aquafish_gym.rendering.pictures import encode_figure, new_figure

DOCS = Path(__file__).parents[1] / "docs"


def test_a_png_of_few_colours_is_small_and_looks_the_same() -> None:
    figure = new_figure(6.0, 3.0)
    left, right = figure.subplots(1, 2)
    left.imshow(np.linspace(0, 1, 400).reshape(20, 20), cmap="viridis")
    for k in range(10):
        right.plot(np.sin(np.linspace(0, 6, 200) + k), linewidth=0.5)
    right.fill_between(range(200), -0.5, 0.5, alpha=0.2)
    figure.draw_without_rendering()  # lays it out, as every drawing does again a little
    drawn = io.BytesIO()
    figure.savefig(drawn, format="png")
    encoded = encode_figure(figure, "png")
    assert len(encoded) < len(drawn.getvalue()) / 2

    with Image.open(drawn) as before, Image.open(io.BytesIO(encoded)) as after:
        assert after.info["dpi"] == pytest.approx((200, 200), abs=0.1)
        off = np.abs(
            np.asarray(before.convert("RGB")) / 255 - np.asarray(after.convert("RGB")) / 255
        )
    assert off.mean() < 0.004
    assert np.quantile(off, 0.99) < 0.08


def test_committed_pictures_are_at_most_150_kb() -> None:
    """They are in every clone. Sphinx copies them to _build."""
    pictures = [one for one in DOCS.rglob("*.png") if "_build" not in one.parts]
    assert len(pictures) > 30
    assert [one for one in pictures if one.stat().st_size > 150_000] == []
