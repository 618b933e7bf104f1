from __future__ import annotations

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.text import Text

from eea.report import figures
from eea.report.findings import read_study
from eea.report.summary import summarize_study
from study_folder import LEVELS, write_study


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study") / "s"
    findings = read_study(write_study(folder, tuple(LEVELS), (128, 256, 512, 1024), 5, 6))
    return findings, summarize_study(findings)


def texts_drawn(figure, monkeypatch):
    """Return the boxes of all the texts that a figure shows."""
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


DRAWN = {
    "rounds": lambda f, s: figures.rounds_figure(f, s, "none"),
    "conditions": figures.conditions_figure,
    "final": lambda f, s: figures.final_figure(f, s, f.arms),
    "paired": lambda _, s: figures.forest_figure(s["paired"], s["labels"], s["durations"]),
    "dimensions": figures.dimensions_figure,
    "spread": lambda _, s: figures.spread_figure(s),
    "angles": lambda f, _: figures.angles_figure(f),
}


@pytest.mark.parametrize("name", DRAWN)
def test_no_text_is_cut_off_or_covers_another(study, monkeypatch, name):
    check_texts(DRAWN[name](*study), monkeypatch)


def check_texts(figure, monkeypatch):
    boxes = texts_drawn(figure, monkeypatch)
    assert len(boxes) > 5
    width, height = figure.get_size_inches() * figure.dpi
    for i, (text, box) in enumerate(boxes):
        inside = box.x0 >= 0 and box.y0 >= 0 and box.x1 <= width and box.y1 <= height
        assert inside, f"{text!r} is cut off"
        for other, second in boxes[:i]:
            across = min(box.x1, second.x1) - max(box.x0, second.x0)
            along = min(box.y1, second.y1) - max(box.y0, second.y0)
            assert across < 1 or along < 1, f"{text!r} covers {other!r}"


def test_a_figure_of_the_paper_shows_mean_and_sd_against_round(study):
    findings, summary = study
    axes, below = figures.rounds_figure(findings, summary, "in-band").axes
    lines = {line.get_label(): line for line in axes.lines}
    for steps in (128, 256, 512, 1024):
        curves = findings.curves("in-band", "obj_fit", [steps]).to_numpy()
        assert lines[f"{steps} steps"].get_ydata() == pytest.approx(curves.mean(axis=0))
    levels = sorted({line.get_ydata()[0] for line in axes.lines if len(line.get_ydata()) == 2})
    assert levels == sorted(summary[level] for level in ("chance", "mid_range", "nearest"))
    assert below.lines[-1].get_ydata() == pytest.approx(curves.std(axis=0, ddof=1))
    corners = axes.collections[-1].get_paths()[0].vertices
    reach = corners[corners[:, 0] == 4, 1]
    middle, deviation = curves[:, 3].mean(), curves[:, 3].std(ddof=1)
    assert middle + deviation < 1
    assert (reach.min(), reach.max()) == pytest.approx((middle - deviation, middle + deviation))
    assert (
        len({to_hex(lines[f"{steps} steps"].get_color()) for steps in (128, 256, 512, 1024)}) == 4
    )


def test_every_replicate_is_a_point_beside_its_own_kind(study):
    findings, summary = study
    axes = figures.final_figure(findings, summary, findings.arms).axes[0]
    points = [c.get_offsets() for c in axes.collections if len(c.get_offsets()) == 5]
    assert len(points) == 6 * 4
    last = [curve[-1] for curve in findings.curves("ideal", "obj_fit", [128]).to_numpy()]
    assert sorted(points[0][:, 1]) == pytest.approx(sorted(last))
    for i, cloud in enumerate(points):
        assert np.all(np.abs(cloud[:, 0] - i // 4) < 0.5)


def test_each_dimension_has_its_own_panel_with_its_own_levels(study):
    findings, summary = study
    figure = figures.dimensions_figure(findings, summary)
    titles = [axes.get_title() for axes in figure.axes]
    assert titles[0] == "left pectoral width"
    axes = figure.axes[titles.index("caudal length")]
    lines = {line.get_label(): line.get_ydata() for line in axes.lines}
    curves = findings.curves("out-of-band", "dimension_error.caudal.length")
    assert lines["Out-of-Band"] == pytest.approx(curves.to_numpy().mean(axis=0))
    assert lines["random bodies"][0] == summary["dimensions"]["chance_error"]["caudal.length"]
    assert lines["quantisation limit"][0] == summary["dimensions"]["nearest_error"]["caudal.length"]


def test_angles_are_in_degrees_and_leave_out_what_is_known(study):
    findings, _ = study
    axes = figures.angles_figure(findings).axes[1]
    lines = {line.get_label(): line.get_ydata() for line in axes.lines}
    assert "Ideal" not in lines
    curves = findings.curves("none", "angle_error.right_pectoral").to_numpy()
    named = lines["None (assumes zero)"]
    assert named == pytest.approx(np.degrees(curves.mean(axis=0)))
