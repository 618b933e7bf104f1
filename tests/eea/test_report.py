from __future__ import annotations

import csv
import json
import shutil
import subprocess
import sys

import numpy as np
import pytest

from aquafish_gym.rendering.pictures import save_figure
from aquafish_gym.runs.storage import DamagedFileError
from aquafish_gym.utils.validation import UnknownNameError
from eea.core.checks import ConfigurationError
from eea.core.fitness import chance_level, mid_range_level, quantisation_limit
from eea.report import report
from eea.report.arms import comparisons
from eea.report.figures.rounds import rounds_figure
from eea.report.findings import COLUMNS, LAYOUT, read_study
from eea.report.summary import chance_errors, summarize_study
from eea.report.tables import markdown
from study_folder import TRUTH, make_records, write_records, write_study


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = write_study(tmp_path_factory.mktemp("study") / "s", ("ideal", "out-of-band", "none"))
    report(folder)
    return folder


@pytest.fixture
def undrawn(monkeypatch):
    """Have pictures take no time where they are only counted; test_figures.py draws them."""
    monkeypatch.setattr("eea.report.figures.save_figure", lambda _, path: path.write_bytes(b""))


def values(findings, arm, steps, column="obj_fit"):
    """Return seed to what the last round has in a column."""
    rows = findings.table[(findings.table.arm == arm) & (findings.table.steps == steps)]
    return {row["seed"]: row[column] for row in rows.to_dict("records")}  # later ones remain


def written(folder):
    """Return what a report writes but for its pictures, which take the longest."""
    summary = summarize_study(read_study(folder))
    return summary, markdown(summary, [])


def change(folder, **settings):
    """Write other words into a study.json, which then has no checksum."""
    header = json.loads((folder / "study.json").read_text())
    del header["checksum"]
    (folder / "study.json").write_text(json.dumps(header | settings))


def settings_of(folder):
    return json.loads((folder / "study.json").read_text())["arms"]


def test_everything_is_written(folder):
    names = {str(path.relative_to(folder)) for path in folder.rglob("*.*") if path.is_file()}
    figures = ("fig5", "fig6", "fig9", "conditions", "final", "paired", "dimensions", "spread")
    assert {name for name in names if not name.startswith("runs/")} == {
        "study.json",
        "results.csv",
        "summary.json",
        "summary.md",
        *(f"figures/{name}.png" for name in (*figures, "angles")),
    }
    text = (folder / "summary.md").read_text()
    assert "nan" not in text.replace("Out-of-Band", "").lower()
    assert "not complete" not in text
    for name in names:
        if name.endswith(".png"):
            assert f"]({name})" in text


def test_the_same_runs_or_their_table_alone_give_the_same_bytes(folder, tmp_path):
    other = write_study(tmp_path / "s", ("ideal", "out-of-band", "none"))
    # Another order of arms, and files of the study's bookkeeping, change nothing.
    change(other, arms=dict(reversed(settings_of(other).items())))
    (other / "runs/none/128/.4.json.part").write_text("half")
    (other / "anything.jsonl").write_text("any\n")
    (other / "results.csv").write_text(read_study(other).to_csv())
    assert (other / "results.csv").read_bytes() == (folder / "results.csv").read_bytes()
    assert written(other) == written(folder)
    # Nor does it change a picture whether the numbers come from runs or from the table alone.
    shutil.rmtree(other / "runs")
    made = report(other)
    assert len(made) == 12
    for path in made:
        assert path.read_bytes() == (folder / path.relative_to(other)).read_bytes(), path


def test_the_table_holds_every_round(folder):
    findings = read_study(folder)
    rows = list(csv.DictReader((folder / "results.csv").read_text().splitlines()))
    assert len(rows) == 3 * 2 * 5 * 4
    row = next(
        r
        for r in rows
        if (r["arm"], r["steps"], r["seed"], r["round"]) == ("out-of-band", "256", "3", "4")
    )
    document = json.loads((folder / "runs/out-of-band/256/3.json").read_text())
    record = document["rounds"][3]
    assert float(row["obj_fit"]) == pytest.approx(record["objective_fitness"], rel=1e-4)
    assert float(row["mod_fit"]) == pytest.approx(record["model_fitness"], rel=1e-4)
    assert float(row["act_fit"]) == pytest.approx(record["action_fitness"], rel=1e-4)
    assert int(row["trials"]) == record["trials"]
    assert float(row["angle_error.caudal"]) == pytest.approx(record["angle_error"][2], rel=1e-4)
    for kind in ("dimension_error", "spread"):
        found = float(row[f"{kind}.caudal.length"])
        assert found == pytest.approx(record[kind][7], rel=1e-4)
    assert {r["act_fit"] for r in rows if r["round"] == "1"} == {""}
    assert [r["arm"] for r in rows[::40]] == ["ideal", "none", "out-of-band"], "the paper's order"
    assert list(findings.table.columns) == list(rows[0]) == COLUMNS
    assert findings.to_csv() == (folder / "results.csv").read_text()


def test_the_summary_by_hand(folder):
    findings = read_study(folder)
    summary = json.loads((folder / "summary.json").read_text())
    short, long = (values(findings, "out-of-band", steps) for steps in (128, 256))
    arm = summary["arms"]["out-of-band"]
    fit = arm["durations"]["128"]["objective_fitness"]
    assert fit["mean"] == pytest.approx(np.mean(list(short.values())))
    assert fit["sd"] == pytest.approx(np.std(list(short.values()), ddof=1))
    assert fit["interval"][0] < fit["mean"] < fit["interval"][1]
    # Over durations a replicate counts once: the SD is of its means.
    both = [(short[seed] + long[seed]) / 2 for seed in range(5)]
    fit = arm["mean_of_durations"]["objective_fitness"]
    assert fit["replicates"] == 5
    assert fit["mean"] == pytest.approx(np.mean(both))
    assert fit["sd"] == pytest.approx(np.std(both, ddof=1))
    sds = [arm["durations"][steps]["objective_fitness"]["sd"] for steps in ("128", "256")]
    assert arm["mean_of_sds"] == pytest.approx(np.mean(sds))
    assert summary["rise_since_round"] == 2
    curves = findings.curves("out-of-band", "obj_fit", [128])
    rises = [curve[3] - curve[1] for curve in curves.to_numpy()]
    assert arm["durations"]["128"]["rise"]["mean"] == pytest.approx(np.mean(rises))
    assert summary["chance"] == chance_level(TRUTH, LAYOUT)
    assert summary["mid_range"] == mid_range_level(TRUTH, LAYOUT)
    assert summary["nearest"] == quantisation_limit(TRUTH, LAYOUT)
    text = (folder / "summary.md").read_text()
    assert f"| Out-of-Band | **mean of 2 durations** | 5 | {fit['mean']:.3f} |" in text
    assert "(BCa at Student's level; none for fewer than five)" in text
    angles = text.partition("## The inferred angles")[2]
    assert "| None (assumes zero) |" in angles
    assert "| Ideal |" not in angles


def test_arms_are_compared_within_the_seeds_that_both_finished(tmp_path):
    folder = write_study(tmp_path / "s", ("ideal", "out-of-band"), seeds=6)
    (folder / "runs/ideal/256/2.json").unlink()
    findings = read_study(folder)
    (found,) = summarize_study(findings)["paired"]
    assert "Not every condition has the same durations" not in written(folder)[1]
    assert (found["first"], found["second"]) == ("ideal", "out-of-band")
    assert [row["durations"] for row in found["rows"]] == [[128], [256], [128, 256]]
    assert [row["last_round"]["replicates"] for row in found["rows"]] == [6, 5, 5]
    ours, theirs = (
        {steps: values(findings, arm, steps) for steps in (128, 256)}
        for arm in ("ideal", "out-of-band")
    )
    gains = [
        np.mean([ours[steps][seed] - theirs[steps][seed] for steps in (128, 256)])
        for seed in (0, 1, 3, 4, 5)
    ]
    last = found["rows"][2]["last_round"]
    assert last["mean"] == pytest.approx(np.mean(gains))
    assert last["sd"] == pytest.approx(np.std(gains, ddof=1))
    assert last["wins"] == sum(gain > 0 for gain in gains)


def test_dimensions_are_held_against_guessing(folder):
    findings = read_study(folder)
    found = json.loads((folder / "summary.json").read_text())["dimensions"]
    chance = chance_errors(findings.truth)
    assert 1 - chance.mean() == pytest.approx(chance_level(TRUTH, LAYOUT))
    assert list(found["chance_error"].values()) == pytest.approx(chance)
    assert found["mid_range_error"]["right_pectoral.length"] == pytest.approx(0.3)
    # A nominal length of 0.8 of the range lies between 50 and 51 of its 63 steps.
    assert found["nearest_error"]["right_pectoral.length"] == pytest.approx(0.8 - 50 / 63)
    least = 1 - np.mean(list(found["nearest_error"].values()))
    assert least == pytest.approx(quantisation_limit(TRUTH, LAYOUT))
    assert (
        "| dimension | random | middle | quantisation limit |"
        in (folder / "summary.md").read_text()
    )
    row = f"| right pectoral length | {chance[4]:.3f} | 0.300 | 0.006 |"
    assert row in (folder / "summary.md").read_text()
    ideal, none = (found["arms"][arm]["dimensions"] for arm in ("ideal", "none"))
    name = "right_pectoral.length"
    errors = np.array(
        [
            list(values(findings, "ideal", steps, f"dimension_error.{name}").values())
            for steps in (128, 256)
        ]
    )
    assert errors.shape == (2, 5)
    assert ideal[name]["error"]["mean"] == pytest.approx(errors.mean())
    assert ideal[name]["error"]["sd"] == pytest.approx(errors.mean(axis=0).std(ddof=1))
    assert ideal[name]["mean_of_error_sds"] == pytest.approx(errors.std(axis=1, ddof=1).mean())
    assert ideal[name]["better_than_guessing"]
    assert not none["caudal.thickness"]["better_than_guessing"]


def test_an_arms_models_are_counted_in_its_settings(tmp_path):
    folder = write_study(tmp_path / "s", ("in-band-200", "ideal"), (128,), seeds=1, rounds=1)
    arms = settings_of(folder)
    arms["in-band-200"]["estimation"]["population"] = 7
    change(folder, arms=arms)
    text = written(folder)[1]
    assert "| In-Band, 7 models |" in text
    assert "200 models" not in text


def test_conditions_are_compared_in_the_papers_order_and_variants_with_what_they_vary():
    arms = ["ideal", "none", "in-band", "out-of-band", "out-of-band-100"]
    conditions = [
        ("ideal", "out-of-band"),
        ("out-of-band", "in-band"),
        ("in-band", "none"),
        ("out-of-band-100", "out-of-band"),
    ]
    assert comparisons(arms) == conditions
    variants = ["out-of-band-100-long", "ideal-long", "other"]
    assert comparisons([*arms, *variants]) == [
        *conditions,
        ("out-of-band-100-long", "out-of-band-100"),
        ("ideal-long", "ideal"),
    ]


def test_a_study_of_one_replicate_is_reported_without_intervals(tmp_path):
    folder = write_study(tmp_path / "s", ("none", "in-band"), (128,), seeds=1, rounds=1)
    report(folder)
    summary = json.loads((folder / "summary.json").read_text())
    fit = summary["arms"]["none"]["durations"]["128"]["objective_fitness"]
    assert (fit["replicates"], fit["sd"], fit["interval"]) == (1, None, None)
    text = (folder / "summary.md").read_text().partition("## Figures")[0]
    assert "[" not in text
    assert "In the rows of means" not in text
    between = text.partition("from replicate to replicate")[2]
    assert "| left pectoral width |  |  |" in between


def test_what_is_not_finished_is_left_out_and_counted(tmp_path):
    other = write_study(tmp_path / "s", ("ideal", "out-of-band", "none"))
    runs = other / "runs/none/128"
    for seed in (0, 1, 3, 4):
        (runs / f"{seed}.json").unlink()
    (runs / ".4.json.part").write_text('{"job": "runs/none/1')  # killed while it wrote
    assert list(read_study(other).replicates.loc["none"].loc[128].index) == [2]
    summary, text = written(other)
    assert summary["missing"] == {"none": {"128": 4}}
    assert "Not every condition has the same durations" not in text
    assert "26 of 30 replicates are finished.** Missing: None at 128 steps: 4." in text
    assert summary["arms"]["none"]["mean_of_durations"]["objective_fitness"]["replicates"] == 1
    (runs / "2.json").unlink()
    assert "Not every condition has the same durations" in written(other)[1]


def test_a_replicate_that_stopped_at_an_accurate_model_keeps_its_last_values(tmp_path):
    folder = write_study(tmp_path / "s", ("ideal",), (128,), seeds=2, rounds=4)
    records = make_records(np.random.default_rng(0), 0.3, 0.1, 4)[:2]
    for record, fitness in zip(records, (0.4, 0.6), strict=True):
        record["model_fitness"] = fitness
    write_records(folder, "ideal", 128, 0, records)
    arms = settings_of(folder)
    with pytest.raises(DamagedFileError, match=r"128/0\.json is damaged.* 1 to 4; it holds 2"):
        read_study(folder)
    change(folder, arms={"ideal": arms["ideal"] | {"accurate": 0.5}})
    findings = read_study(folder)
    assert list(findings.curves("ideal", "mod_fit").loc[0]) == [0.4, 0.6, 0.6, 0.6]
    assert values(findings, "ideal", 128, "mod_fit")[0] == 0.6
    assert len(findings.to_csv().splitlines()) == 1 + 2 + 4


@pytest.mark.parametrize("byte", [0, 40, 400, -3])
def test_a_changed_byte_is_found_and_its_file_named(tmp_path, byte):
    folder = write_study(tmp_path / "s", ("ideal",), (128,), seeds=2)
    path = folder / "runs/ideal/128/1.json"
    content = bytearray(path.read_bytes())
    content[byte] ^= 1
    path.write_bytes(content)
    with pytest.raises(DamagedFileError, match=r"128/1\.json.*delete this file"):
        report(folder)
    assert not (folder / "results.csv").exists()


def test_a_result_in_anothers_place_is_refused(tmp_path):
    folder = write_study(tmp_path / "s", ("ideal",), (128,), seeds=2)
    shutil.copy(folder / "runs/ideal/128/0.json", folder / "runs/ideal/128/1.json")
    with pytest.raises(DamagedFileError, match=r"128/1\.json"):
        report(folder)


def test_rounds_that_are_repeated_or_too_many_or_none_are_named(tmp_path):
    folder = write_study(tmp_path / "s", ("ideal",), (128,), seeds=1)
    records = make_records(np.random.default_rng(0), 0.3, 0.1, 5)
    bare = [{"round": 1}]
    short = [{**record, "spread": [0.1]} for record in records[:4]]
    for wrong in (records, [*records[:2], records[1], records[2]], bare, short, {}, [5]):
        write_records(folder, "ideal", 128, 0, wrong)
        with pytest.raises(
            (DamagedFileError, ConfigurationError), match=r"128/0\.json|no finished"
        ):
            read_study(folder)


@pytest.mark.parametrize(
    "damage",
    [
        lambda lines: lines[1:],  # no names
        lambda lines: [lines[0]],
        lambda _: [],
        lambda lines: [*lines[:3], lines[3].replace(",", ";")],
        lambda lines: [*lines[:3], lines[3].replace("0.", "x.")],
        lambda lines: [*lines, lines[1]],
        lambda lines: [*lines[:2], *lines[3:]],
        lambda lines: [line.replace("ideal", "other") for line in lines],
        lambda lines: [line.replace("ideal,128,0", "ideal,128,7") for line in lines],
        lambda _: ["\0\xff" * 100],
    ],
)
def test_a_damaged_table_is_refused_and_named(tmp_path, damage):
    folder = write_study(tmp_path / "s", ("ideal",), (128,), seeds=1)
    lines = read_study(folder).to_csv().splitlines(keepends=True)
    shutil.rmtree(folder / "runs")
    (folder / "results.csv").write_text("".join(damage(lines)))
    with pytest.raises(DamagedFileError, match=r"results\.csv is damaged"):
        report(folder)


def test_a_folder_without_a_study_or_a_finished_replicate_is_refused(tmp_path):
    with pytest.raises(ConfigurationError, match=r"must hold a study.*it has no study\.json"):
        report(tmp_path)
    folder = write_study(tmp_path / "s", ("ideal",), (128,), seeds=1)
    (folder / "runs/ideal/128/0.json").unlink()
    with pytest.raises(ConfigurationError, match="no finished replicate yet"):
        report(folder)
    shutil.rmtree(folder / "runs")
    with pytest.raises(ConfigurationError, match="no finished replicate yet"):
        report(folder)


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"schema": "eea.run/1"}, "must be of schema"),
        ({"rounds": None}, "does not state the rounds"),
        ({"arms": []}, "does not state the arms"),
        ({"rounds": 0}, "does not state the rounds"),
        ({"arms": {"ideal": 5}}, "does not state the arms"),
        ({"replicates": {}}, "does not state the replicates"),
        ({"replicates": {"ideal": {}}}, "does not state the replicates.ideal"),
        ({"replicates": {"ideal": {"128": {}}}}, "does not state the replicates.ideal.128"),
        ({"replicates": None}, "does not state the replicates"),
        ({"target_morphology": {"tail": [1, 2, 3]}}, "does not say what the target is"),
        ({"target_damage": "none"}, "does not say what the target is"),
    ],
)
def test_a_damaged_study_is_refused(tmp_path, changed, says):
    folder = write_study(tmp_path / "s", ("ideal",), (128,), seeds=1)
    change(folder, **changed)
    with pytest.raises(DamagedFileError, match=says):
        read_study(folder)


def test_a_study_that_is_not_json_is_refused(tmp_path):
    folder = write_study(tmp_path / "s", ("ideal",), (128,), seeds=1)
    (folder / "study.json").write_text('{"schema": "eea.st')
    with pytest.raises(DamagedFileError, match=r"study\.json"):
        read_study(folder)


def test_pictures_come_in_the_formats_asked_for_and_with_the_same_bytes(tmp_path, request):
    folder = write_study(tmp_path / "s", ("ideal",), (128,), seeds=1, rounds=1)
    pictures = {path.name: path.read_bytes() for path in report(folder, ("svg", "pdf"))[3:]}
    assert {name.partition(".")[2] for name in pictures} == {"svg", "pdf"}
    assert pictures["fig5.pdf"].startswith(b"%PDF")
    assert b"Date" not in pictures["fig5.pdf"]
    assert b"<svg" in pictures["fig5.svg"]
    assert "](figures/fig5.svg)" in (folder / "summary.md").read_text()
    again = rounds_figure(findings := read_study(folder), summarize_study(findings), "ideal")
    for name in ("fig5.svg", "fig5.pdf"):
        save_figure(again, tmp_path / name)
        assert (tmp_path / name).read_bytes() == pictures[name]
    request.getfixturevalue("undrawn")
    report(folder)
    assert {path.suffix for path in (folder / "figures").iterdir()} == {".png"}
    with pytest.raises(UnknownNameError, match="format must be one of png, pdf, svg; got 'pgn'"):
        report(folder, ("pgn",))


def test_what_the_report_needs_is_loaded_when_it_is_used():
    code = (
        "import sys, eea.report\n"
        "assert not {'matplotlib', 'pandas', 'scipy'} & set(sys.modules)\n"
        "from eea.report.statistics import interval\n"
        "assert not {'matplotlib', 'pandas'} & set(sys.modules)\n"
        "from eea.report.findings import read_study\n"
        "assert 'matplotlib' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
