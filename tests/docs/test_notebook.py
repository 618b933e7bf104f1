"""The notebook runs from top to bottom, and ends with a film. It is kept without outputs."""

from __future__ import annotations

import json
import pathlib
import sys
from types import ModuleType

import pytest
from PIL import Image

ROOT = pathlib.Path(__file__).parents[2]
NOTEBOOK = ROOT / "docs" / "break_a_fin.ipynb"
CELLS = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
CODE = [cell for cell in CELLS if cell["cell_type"] == "code"]


@pytest.mark.slow
def test_the_notebook_infers_what_broke_and_films_it(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    # Jupyter brings IPython, which alone draws an image below a cell: here the file is enough.
    display = ModuleType("IPython.display")
    vars(display)["Image"] = pathlib.Path
    monkeypatch.setitem(sys.modules, "IPython", ModuleType("IPython"))
    monkeypatch.setitem(sys.modules, "IPython.display", display)
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {"__name__": "__main__"}
    for cell in CODE:
        exec(compile("".join(cell["source"]), NOTEBOOK.name, "exec"), names)
    swims = names["swims"]
    assert isinstance(swims, dict)
    old, new = (swim.distance for swim in swims.values())
    assert new > old + 1.0
    assert capsys.readouterr().out.count("trial ") == 3
    with Image.open("swim.gif") as film:
        assert film.n_frames > 10  # type: ignore[attr-defined]


def test_the_notebook_is_kept_without_outputs() -> None:
    assert [cell for cell in CODE if cell["outputs"] or cell["execution_count"]] == []
