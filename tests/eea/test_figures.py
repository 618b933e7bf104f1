from __future__ import annotations

from dataclasses import replace

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


@pytest.fixture(scope="module")
def ablation(tmp_path_factory):
    condition = "out-of-band-100"
    arms = [
        f"{name}-{condition}" for name in ("baseline", *(f"rather-long-{i}" for i in range(12)))
    ]
    findings = read_study(write_study(tmp_path_factory.mktemp("a") / "s", arms, (256,), 6, 3))
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


@pytest.mark.parametrize("name", ["final", "paired"])
def test_nor_where_there_is_one_duration(tmp_path, monkeypatch, name):
    findings = read_study(write_study(tmp_path / "s", tuple(LEVELS), (256,), 2, 2))
    check_texts(DRAWN[name](findings, summarize_study(findings)), monkeypatch)


@pytest.mark.parametrize("name", ["spread", "conditions"])
def test_nor_where_there_are_three_arms(tmp_path, monkeypatch, name):
    findings = read_study(write_study(tmp_path / "s", tuple(LEVELS)[:3], (256,), 2, 2))
    check_texts(DRAWN[name](findings, summarize_study(findings)), monkeypatch)


def test_a_duration_has_its_colour_in_every_picture(tmp_path):
    folder = write_study(tmp_path / "s", ("ideal", "none"), (128, 256, 512), 2, 2)
    for seed in (0, 1):
        (folder / f"runs/ideal/512/{seed}.json").unlink()
    findings = read_study(folder)
    summary = summarize_study(findings)
    drawn = [
        figures.rounds_figure(findings, summary, "ideal"),
        figures.rounds_figure(findings, summary, "none"),
        figures.final_figure(findings, summary, ["ideal"]),
        figures.forest_figure(
            [{"first": "ideal", "second": "none", "rows": ROWS}],
            summary["labels"],
            findings.durations(),
        ),
    ]
    colours = {
        to_hex(line.get_color())
        for figure in drawn
        for line in figure.axes[0].lines
        if line.get_label() == "256 steps"
    }
    assert len(colours) == 1
    assert "each condition's durations" in (
        figures.conditions_figure(findings, summary).axes[0].get_title()
    )


ROWS = [
    {"durations": [steps], "last_round": {"mean": 0.1, "interval": None}} for steps in (128, 256)
]


@pytest.mark.parametrize("name", ["final", "effects"])
def test_nor_where_there_are_many_arms_with_long_names(ablation, monkeypatch, name):
    findings, summary = ablation
    if name == "final":
        arms = findings.arms
        check_texts(figures.final_figure(findings, summary, arms), monkeypatch)
    else:
        check_texts(
            figures.forest_figure(summary["effects"], summary["labels"], findings.durations()),
            monkeypatch,
        )


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


def with_last_rounds(findings, values):
    """Return a study of one arm and duration whose replicates have these OBJ_FIT throughout."""
    table = findings.table[(findings.table.arm == "ideal") & (findings.table.steps == 128)]
    fitness = table["seed"].map(dict(enumerate(values)))
    return replace(findings, table=table.assign(obj_fit=fitness))


def test_a_band_ends_where_no_fitness_can_be(study):
    skewed = with_last_rounds(study[0], [1.0, 1.0, 1.0, 1.0, 0.5])
    axes, _ = figures.rounds_figure(skewed, summarize_study(skewed), "ideal").axes
    corners = axes.collections[-1].get_paths()[0].vertices[:, 1]
    deviation = np.std([1.0, 1.0, 1.0, 1.0, 0.5], ddof=1)
    assert (corners.min(), corners.max()) == pytest.approx((0.9 - deviation, 1.0))


def test_the_highest_sd_has_room_and_none_at_all_a_scale(study):
    findings, summary = study
    below = figures.rounds_figure(findings, summary, "none").axes[1]
    highest = max(line.get_ydata().max() for line in below.lines)
    assert below.get_ylim() == pytest.approx((0.0, 1.15 * highest))
    same = with_last_rounds(findings, [0.8] * 5)
    assert figures.rounds_figure(same, summarize_study(same), "ideal").axes[1].get_ylim() == (
        (0.0, 0.1)
    )


CLOSE_LEVELS = [
    (0.75, 1.0, 0.984),  # a target in the middle of all ranges
    (0.5, 0.5, 1.0),  # one without fins
    (0.7, 0.71, 0.72),
    (0.99, 0.99, 0.99),
]


@pytest.mark.parametrize(
    ("name", "levels"),
    [
        *(("conditions", levels) for levels in CLOSE_LEVELS),
        *((name, CLOSE_LEVELS[2]) for name in ("rounds", "final")),
    ],
)
def test_nor_where_levels_are_close(study, monkeypatch, name, levels):
    findings, summary = study
    close = summary | dict(zip(("chance", "mid_range", "nearest"), levels, strict=True))
    check_texts(DRAWN[name](findings, close), monkeypatch)


@pytest.mark.parametrize("levels", CLOSE_LEVELS)
def test_nor_where_they_are_close_beside_long_names(ablation, monkeypatch, levels):
    findings, summary = ablation
    close = summary | dict(zip(("chance", "mid_range", "nearest"), levels, strict=True))
    arms = findings.arms
    check_texts(figures.final_figure(findings, close, arms), monkeypatch)


def test_names_of_levels_stand_beside_them_in_their_order(study):
    findings, summary = study

    def places(**levels):
        axes = figures.conditions_figure(findings, summary | levels).axes[0]
        bottom, top = axes.get_ylim()
        found = {text.get_text(): text.xy[1] * (top - bottom) + bottom for text in axes.texts}
        return [
            found[name] for name in ("random\nbodies", "mid-range\nbody", "quantisation\nlimit")
        ]

    assert places(chance=0.65, mid_range=0.8, nearest=0.95) == pytest.approx([0.65, 0.8, 0.95])
    low, high, _ = places(chance=0.7, mid_range=0.71, nearest=0.95)
    assert low < 0.7 < 0.71 < high
    assert (low + high) / 2 == pytest.approx(0.705), "both give way"
    _, middle, nearest = places(chance=0.75, mid_range=1.0, nearest=0.984)
    assert nearest < middle < 1


def test_one_scale_for_all_conditions(study):
    findings, summary = study
    limits = {
        figures.rounds_figure(findings, summary, arm).axes[0].get_ylim()
        for arm in ("ideal", "none")
    }
    assert len(limits) == 1


def test_every_replicate_is_a_point_beside_its_own_kind(study):
    findings, summary = study
    axes = figures.final_figure(findings, summary, findings.arms).axes[0]
    points = [c.get_offsets() for c in axes.collections if len(c.get_offsets()) == 5]
    assert len(points) == 6 * 4
    last = [curve[-1] for curve in findings.curves("ideal", "obj_fit", [128]).to_numpy()]
    assert sorted(points[0][:, 1]) == pytest.approx(sorted(last))
    for i, cloud in enumerate(points):
        assert np.all(np.abs(cloud[:, 0] - i // 4) < 0.5)


def test_differences_are_filled_where_they_exclude_zero():
    def row(mean, interval):
        return {"durations": [256], "last_round": {"mean": mean, "interval": interval}}

    figure = figures.forest_figure(
        [
            {"first": "a", "second": "baseline", "rows": [row(0.02, [-0.01, 0.05])]},
            {"first": "b", "second": "baseline", "rows": [row(0.10, [0.05, 0.15])]},
            {"first": "c", "second": "baseline", "rows": [row(-0.10, None)]},
            {"first": "d", "second": "baseline", "rows": []},
        ],
        {name: name for name in ("a", "b", "c", "d", "baseline")},
        [256],
    )
    axes = figure.axes[0]
    marks = [line for line in axes.lines if line.get_marker() in "ox" and len(line.get_xdata())]
    assert [mark.get_xdata()[0] for mark in marks] == [0.10, 0.02, -0.10], "by size"
    hollow = [to_hex(mark.get_markerfacecolor()) == "#ffffff" for mark in marks[:2]]
    assert hollow == [False, True]
    assert [mark.get_marker() for mark in marks] == ["o", "o", "x"]
    assert "no interval" in axes.get_xlabel()
    assert [text.get_text() for text in axes.get_yticklabels()] == ["b", "a", "c"]


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


def test_intervals_are_named_only_where_they_are_shown(tmp_path):
    findings = read_study(write_study(tmp_path / "s", ("none", "in-band"), (256,), 2, 2))
    summary = summarize_study(findings)
    assert figures.conditions_figure(findings, summary).axes[0].get_title() == (
        "mean over replicates"
    )
    label = (
        figures.forest_figure(summary["paired"], summary["labels"], findings.durations())
        .axes[0]
        .get_xlabel()
    )
    assert "95%" not in label
    assert "crosses: under 5 replicates, no interval" in label


def test_points_at_the_edge_are_whole(study):
    axes = figures.spread_figure(study[1]).axes[0]
    points = [line for line in axes.lines if len(line.get_xdata()) == 1]
    assert len(points) == 9
    assert not any(point.get_clip_on() for point in points)
