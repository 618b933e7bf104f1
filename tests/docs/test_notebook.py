"""The notebook runs, prints what it shows, and ends with the film that it shows."""

from __future__ import annotations

import base64
import contextlib
import io
import json
import pathlib
import sys
from types import ModuleType
from typing import Any

import pytest
from PIL import Image

ROOT = pathlib.Path(__file__).parents[2]
NOTEBOOK = ROOT / "docs" / "break_a_fin.ipynb"
CELLS = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
CODE = [cell for cell in CELLS if cell["cell_type"] == "code"]


def shown(cell: dict[str, Any]) -> str:
    """Return what a cell's outputs print."""
    streams = (out for out in cell["outputs"] if out["output_type"] == "stream")
    return "".join("".join(out["text"]) for out in streams)


def frames(film: pathlib.Path | io.BytesIO) -> tuple[int, tuple[int, int]]:
    with Image.open(film) as image:
        return image.n_frames, image.size  # type: ignore[attr-defined]


@pytest.mark.slow
def test_the_notebook_prints_and_films_what_it_shows(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Jupyter brings IPython, which alone draws an image below a cell: here the file is enough.
    display = ModuleType("IPython.display")
    vars(display)["Image"] = pathlib.Path
    monkeypatch.setitem(sys.modules, "IPython", ModuleType("IPython"))
    monkeypatch.setitem(sys.modules, "IPython.display", display)
    monkeypatch.chdir(tmp_path)
    names = {"__name__": "__main__"}
    for cell in CODE:
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            exec(compile("".join(cell["source"]), NOTEBOOK.name, "exec"), names)
        assert printed.getvalue() == shown(cell)
    (film,) = (out["data"]["image/gif"] for out in CODE[-1]["outputs"])
    assert frames(tmp_path / "swim.gif") == frames(io.BytesIO(base64.b64decode(film)))


def test_the_notebook_is_small_and_ran_from_top_to_bottom() -> None:
    text = NOTEBOOK.read_text(encoding="utf-8")
    assert len(text) < 500_000
    assert [cell["execution_count"] for cell in CODE] == list(range(1, len(CODE) + 1))
    assert all(cell["outputs"] for cell in CODE)
    for place in ("/home/", "/root/", "/tmp/", "/Users/", str(ROOT), "stderr"):
        assert place not in text
