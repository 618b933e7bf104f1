"""The report of a study: its table, its summary, its figures and the files that are refused."""

from __future__ import annotations

import csv
import json
import shutil

import numpy as np
import pytest
from matplotlib.text import Text

from aquafish_gym.plans import AQUAFISH
from aquafish_gym.utils.storage import DamagedFileError
from eea.core.checks import ConfigurationError
from eea.core.fitness import chance_level, mid_range_level, quantisation_limit
from eea.fish import fish_problem
from eea.study import figures
from eea.study.report import markdown, report
from eea.study.results import read_study, result_columns
from eea.study.summary import summarize_study
from study_folder import LEVELS, TRUTH, make_records, write_records, write_study


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = write_study(tmp_path_factory.mktemp("study") / "s", ("ideal", "out-of-band", "none"))
    report(folder)
    return folder


def one_replicate(folder):
    return write_study(folder, ("ideal",), (128,), seeds=1)


def values(results, arm, steps, column="obj_fit"):
    """Return seed to the last round's value of a column."""
    return results.replicates.loc[arm].loc[steps][column].to_dict()


def change(folder, **settings):
    """Change a study.json, which then has no checksum."""
    header = json.loads((folder / "study.json").read_text())
    header.pop("checksum", None)
    (folder / "study.json").write_text(json.dumps(header | settings))


def test_every_file_is_written(folder):
    names = {str(path.relative_to(folder)) for path in folder.rglob("*.*") if path.is_file()}
    figures = ("fig5", "fig6", "fig9", "conditions", "final", "dimensions", "angles")
    assert {name for name in names if not name.startswith("runs/")} == {
        "study.json", "results.csv", "summary.json", "summary.md",
        *(f"figures/{name}.png" for name in figures),
    }  # fmt: skip
    text = (folder / "summary.md").read_text()
    assert "nan" not in text.lower()
    assert "not complete" not in text
    assert all(f"](figures/{name}.png)" in text for name in figures)


def test_runs_and_their_table_alone_give_the_same_bytes(folder, tmp_path, monkeypatch):
    monkeypatch.setattr(
        "eea.study.report.save_study_figures", lambda *_: []
    )  # plot's test has them
    other = shutil.copytree(folder, tmp_path / "s")
    shutil.rmtree(other / "runs")
    arms = json.loads((other / "study.json").read_text())["arms"]
    change(other, arms=dict(reversed(arms.items())))
    report(other)
    before, after = ((one / "summary.md").read_text() for one in (folder, other))
    assert after.partition("## Figures")[0] == before.partition("## Figures")[0]
    assert (other / "results.csv").read_bytes() == (folder / "results.csv").read_bytes()


def test_an_arm_is_named_by_its_choices(folder, tmp_path):
    other = shutil.copytree(folder, tmp_path / "s")
    arms = json.loads((other / "study.json").read_text())["arms"]
    assert set(read_study(other).labels.values()) == {"Ideal", "Out-of-Band", "None"}
    arms["ideal"] |= {"genetic": {"elites": 3, "crossover": "two-point", "coding": "gray"}}
    arms["none"] |= {"exploration": {"population": 6, "initial_angles": "random"}}
    change(other, arms=arms)
    labels = read_study(other).labels
    assert labels["ideal"] == "Ideal, elites 3, crossover two-point"
    assert labels["none"] == "None, initial angles random"


def test_the_table_holds_every_round(folder):
    rows = list(csv.DictReader((folder / "results.csv").read_text().splitlines()))
    assert len(rows) == 3 * 2 * 5 * 4
    assert list(rows[0]) == result_columns(AQUAFISH)
    assert [r["arm"] for r in rows[::40]] == ["ideal", "none", "out-of-band"], "the paper's order"
    found = {(r["arm"], r["steps"], r["seed"], r["round"]): r for r in rows}
    row = found["out-of-band", "256", "3", "4"]
    record = json.loads((folder / "runs/out-of-band/256/3.json").read_text())["rounds"][3]
    expected = {
        "obj_fit": record["objective_fitness"],
        "mod_fit": record["model_fitness"],
        "act_fit": record["action_fitness"],
        "angle_error.caudal": record["angle_error"][2],
        "dimension_error.caudal.length": record["dimension_error"][7],
        "spread.caudal.length": record["spread"][7],
    }
    assert {name: float(row[name]) for name in expected} == pytest.approx(expected, rel=1e-4)
    assert {r["act_fit"] for r in rows if r["round"] == "1"} == {""}


def test_means_and_sds_are_over_replicates(folder):
    results = read_study(folder)
    summary = json.loads((folder / "summary.json").read_text())
    short, long = (values(results, "out-of-band", steps) for steps in (128, 256))
    rows = [row for row in summary["fitness"] if row["arm"] == "out-of-band"]
    assert [row["durations"] for row in rows] == [[128], [256], [128, 256]]
    fit = rows[0]["objective_fitness"]
    assert fit["mean"] == pytest.approx(np.mean(list(short.values())))
    assert fit["sd"] == pytest.approx(np.std(list(short.values()), ddof=1))
    assert fit["interval"][0] < fit["mean"] < fit["interval"][1]
    both = [(short[seed] + long[seed]) / 2 for seed in range(5)]
    fit = rows[2]["objective_fitness"]
    assert (fit["replicates"], fit["mean"]) == (5, pytest.approx(np.mean(both)))
    assert fit["sd"] == pytest.approx(np.std(both, ddof=1))
    curves = results.curves("out-of-band", "obj_fit", [128]).to_numpy()
    assert summary["rise_since_round"] == 2
    assert rows[0]["rise"]["mean"] == pytest.approx(np.mean(curves[:, 3] - curves[:, 1]))
    text = (folder / "summary.md").read_text()
    assert f"| Out-of-Band | **mean of 2 durations** | 5 | {fit['mean']:.3f} |" in text
    angles = text.partition("## The inferred angles")[2]
    assert "| None (assumes zero) |" in angles
    assert "| Ideal |" not in angles


def test_arms_are_compared_over_the_seeds_that_both_finished(tmp_path):
    folder = write_study(tmp_path / "s", ("ideal", "out-of-band"), seeds=6)
    (folder / "runs/ideal/256/2.json").unlink()
    results = read_study(folder)
    summary = summarize_study(results)
    assert [row["durations"] for row in summary["paired"]] == [[128], [256], [128, 256]]
    assert [row["last_round"]["replicates"] for row in summary["paired"]] == [6, 5, 5]
    ours, theirs = (values(results, arm, 256) for arm in ("ideal", "out-of-band"))
    gains = [ours[seed] - theirs[seed] for seed in ours]
    last = summary["paired"][1]["last_round"]
    assert last["mean"] == pytest.approx(np.mean(gains))
    assert last["wins"] == sum(gain > 0 for gain in gains)
    assert "23 of 24 replicates are finished" in markdown(results, summary, [])


def test_dimensions_are_compared_with_guessing(folder):
    summary = summarize_study(read_study(folder))
    assert summary["guesses"] == pytest.approx(
        {
            "random bodies": chance_level(TRUTH, fish_problem().models),
            "mid-range body": mid_range_level(TRUTH, fish_problem().models),
            "quantisation limit": quantisation_limit(TRUTH, fish_problem().models),
        }
    )
    # A nominal length of 0.8 of the range lies between 50 and 51 of its 63 steps.
    limit = summary["guess_errors"]["quantisation limit"]["right_pectoral.length"]
    assert limit == pytest.approx(0.8 - 50 / 63)
    ideal, none = (summary["dimension_error"][arm] for arm in ("ideal", "none"))
    assert ideal["right_pectoral.length"]["better_than_guessing"]
    assert not none["caudal.thickness"]["better_than_guessing"]


def test_a_replicate_without_its_last_rounds_is_damaged(tmp_path):
    folder = write_study(tmp_path / "s", ("ideal",), (128,), seeds=2, rounds=4)
    records = make_records(np.random.default_rng(0), 0.3, 0.1, 4)[:2]
    for record, fitness in zip(records, (0.4, 0.6), strict=True):
        record["model_fitness"] = fitness
    write_records(folder, "ideal", 128, 0, records)
    assert list(read_study(folder).curves("ideal", "mod_fit").loc[0]) == [0.4, 0.6, 0.6, 0.6]


def test_a_study_of_one_replicate_has_no_intervals(tmp_path):
    folder = write_study(tmp_path / "s", ("none",), (128,), seeds=1, rounds=1)
    report(folder, ("svg",))
    fit = json.loads((folder / "summary.json").read_text())["fitness"][0]["objective_fitness"]
    assert (fit["replicates"], fit["sd"], fit["interval"]) == (1, None, None)
    assert "[" not in (folder / "summary.md").read_text().partition("## Figures")[0]
    assert {path.suffix for path in (folder / "figures").iterdir()} == {".svg"}


def test_a_damaged_table_is_refused(tmp_path):
    folder = one_replicate(tmp_path / "s")
    lines = read_study(folder).to_csv().splitlines(keepends=True)
    shutil.rmtree(folder / "runs")
    for wrong in (lines[1:], [], ["\0\xff" * 100]):  # the first without names
        (folder / "results.csv").write_text("".join(wrong))
        with pytest.raises(DamagedFileError, match="is damaged"):
            report(folder)


def test_a_folder_without_a_study_or_a_finished_replicate_is_refused(tmp_path):
    with pytest.raises(ConfigurationError, match=r"no study\.json"):
        report(tmp_path)
    folder = one_replicate(tmp_path / "s")
    shutil.rmtree(folder / "runs")
    with pytest.raises(ConfigurationError, match="no finished replicate"):
        report(folder)


def test_a_damaged_description_is_refused(tmp_path):
    folder = one_replicate(tmp_path / "s")
    whole = (folder / "study.json").read_text()
    for changed in (
        {"rounds": None},
        {"arms": []},
        {"arms": {"ideal": 5}},
        {"replicates": {}},
        {"replicates": {"ideal": {"128": {}}}},
        {"target_morphology": {"tail": [1, 2, 3]}},
        {"target_damage": ["left_fin:dead"]},
    ):
        (folder / "study.json").write_text(whole)
        change(folder, **changed)
        with pytest.raises(DamagedFileError, match=r"study\.json"):
            read_study(folder)


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    folder = tmp_path_factory.mktemp("drawn") / "s"
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


@pytest.mark.slow
def test_no_text_is_cut_off_or_covers_another(drawn, monkeypatch):
    for name, figure in figures.study_figures(*drawn).items():
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


def test_a_figure_of_the_paper_shows_mean_and_sd_against_round(drawn):
    results, summary = drawn
    axes, below = figures.rounds_figure(results, summary, "in-band").axes
    lines = {line.get_label(): line for line in axes.lines}
    for steps in (128, 256, 512, 1024):
        curves = results.curves("in-band", "obj_fit", [steps]).to_numpy()
        assert lines[f"{steps} steps"].get_ydata() == pytest.approx(curves.mean(axis=0))
    assert below.lines[-1].get_ydata() == pytest.approx(curves.std(axis=0, ddof=1))


def test_inferred_angles_are_in_degrees(drawn):
    results, _ = drawn
    axes = figures.angles_figure(results).axes[1]
    lines = {line.get_label(): line.get_ydata() for line in axes.lines}
    assert not any(label.startswith("Ideal") for label in lines)
    curves = results.curves("none", "angle_error.right_pectoral").to_numpy()
    assert lines["None (assumes zero) (n = 5)"] == pytest.approx(np.degrees(curves.mean(axis=0)))
