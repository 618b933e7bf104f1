"""The figures of a study show its numbers, and no text is cut off or covered."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.text import Text

from eea.study import figures
from eea.study.results import read_study
from eea.study.summary import summarize_study
from study_folder import LEVELS, write_study


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study") / "s"
    results = read_study(write_study(folder, tuple(LEVELS), (128, 256, 512, 1024), 5, 6))
    return results, summarize_study(results)


def texts_drawn(figure, monkeypatch):
    """Return the texts that a figure shows, and their boxes."""
    boxes = []
    draw = Text.draw

    def note(self, renderer):
        draw(self, renderer)
        if self.get_visible() and self.get_text().strip():
            boxes.append((self.get_text(), self.get_window_extent(renderer)))

    with monkeypatch.context() as patch:
        patch.setattr(Text, "draw", note)
        figure.canvas.draw()
    return boxes


def test_no_text_is_cut_off_or_covers_another(study, monkeypatch):
    for name, figure in figures.study_figures(*study).items():
        boxes = texts_drawn(figure, monkeypatch)
        assert len(boxes) > 5
        width, height = figure.get_size_inches() * figure.dpi
        for i, (text, box) in enumerate(boxes):
            inside = box.x0 >= 0 and box.y0 >= 0 and box.x1 <= width and box.y1 <= height
            assert inside, f"{name}: {text!r} is cut off"
            for other, second in boxes[:i]:
                across = min(box.x1, second.x1) - max(box.x0, second.x0)
                along = min(box.y1, second.y1) - max(box.y0, second.y0)
                assert across < 1 or along < 1, f"{name}: {text!r} covers {other!r}"


def test_a_figure_of_the_paper_shows_mean_and_sd_against_round(study):
    results, summary = study
    axes, below = figures.rounds_figure(results, summary, "in-band").axes
    lines = {line.get_label(): line for line in axes.lines}
    for steps in (128, 256, 512, 1024):
        curves = results.curves("in-band", "obj_fit", [steps]).to_numpy()
        assert lines[f"{steps} steps"].get_ydata() == pytest.approx(curves.mean(axis=0))
    assert below.lines[-1].get_ydata() == pytest.approx(curves.std(axis=0, ddof=1))


def test_inferred_angles_are_in_degrees(study):
    results, _ = study
    axes = figures.angles_figure(results).axes[1]
    lines = {line.get_label(): line.get_ydata() for line in axes.lines}
    assert not any(label.startswith("Ideal") for label in lines)
    curves = results.curves("none", "angle_error.right_pectoral").to_numpy()
    assert lines["None (assumes zero) (n = 5)"] == pytest.approx(np.degrees(curves.mean(axis=0)))
