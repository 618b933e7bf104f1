from __future__ import annotations

import csv
import json

import numpy as np
import pytest

from eea.core.checks import ConfigurationError
from eea.core.fitness import chance_level, mid_range_level, quantisation_limit
from eea.report.analysis import (
    baseline_of,
    chance_errors,
    comparisons,
    read_study,
    report,
    results_table,
    summarize_study,
)
from study_folder import TRUTH, make_records, write_records, write_study


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = write_study(tmp_path_factory.mktemp("study") / "s", ("ideal", "out-of-band", "none"))
    report(folder)
    return folder


def values(findings, arm, steps, field="objective_fitness"):
    return {seed: records[-1][field] for seed, records in findings.replicates[arm][steps].items()}


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


def test_the_same_runs_give_the_same_bytes(folder, tmp_path):
    other = write_study(tmp_path / "s", ("ideal", "out-of-band", "none"))
    # Another order of arms, and files of the study's bookkeeping, change nothing.
    header = json.loads((other / "study.json").read_text())
    header["arms"] = dict(reversed(header["arms"].items()))
    (other / "study.json").write_text(json.dumps(header))
    (other / "runs/none/128/4.state").write_text("{}")
    (other / "runs/none/128/.4.jsonl.tmp").write_text("half")
    (other / "times.jsonl").write_text("any\n")
    written = report(other)
    assert len(written) == 12
    for path in written:
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
    record = findings.replicates["out-of-band"][256][3][3]
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
    records = findings.replicates["out-of-band"][128]
    rises = [r[3]["objective_fitness"] - r[1]["objective_fitness"] for r in records.values()]
    assert arm["durations"]["128"]["rise"]["mean"] == pytest.approx(np.mean(rises))
    assert summary["chance"] == chance_level(TRUTH, findings.layout)
    assert summary["mid_range"] == mid_range_level(TRUTH, findings.layout)
    assert summary["nearest"] == quantisation_limit(TRUTH, findings.layout)
    text = (folder / "summary.md").read_text()
    assert f"| Out-of-Band | **mean of 2 durations** | 5 | {fit['mean']:.3f} |" in text
    assert "(BCa with Student's quantiles; none for fewer than five)" in text
    angles = text.partition("## The inferred angles")[2]
    assert "| None (assumes zero) |" in angles
    assert "| Ideal |" not in angles


def test_the_summary_says_what_was_run(tmp_path):
    arms = ("ideal", "none", "in-band-200")
    folder = write_study(tmp_path / "s", arms, (128, 256, 512), seeds=1, rounds=2)
    report(folder)
    assert (folder / "summary.md").read_text().splitlines()[:3] == [
        "# Study",
        "",
        "The target's body is nominal and damaged (`left_pectoral:length=0.5`). Each replicate "
        "has 2 rounds; trials are of 128, 256 and 512 steps, and behaviours of an unknown signal. "
        "All settings are in `study.json`.",
    ]
    header = json.loads((folder / "study.json").read_text())
    for arm, signal in zip(arms, ("body_rates", "body_rates", "attitude"), strict=True):
        header["arms"][arm]["behavior"] = {"signal": signal}
    del header["replicates"]["in-band-200"]["256"]
    header["target_damage"] = []
    header["target_morphology"]["caudal"] = [0.4, 1.0, 0.5]
    header["source"] = ["0123abcd"]
    (folder / "study.json").write_text(json.dumps(header))
    report(folder)
    assert (folder / "summary.md").read_text().splitlines()[2] == (
        "The target's body is nominal but for caudal length 1 and caudal width 0.5 (in units of "
        "5 cm), and undamaged. Each replicate has 2 rounds; trials are of 128, 256 and 512 steps "
        "(In-Band, 200 models: 128 and 512 steps), and behaviours of the gyroscope "
        "(In-Band, 200 models: the attitude). All settings are in `study.json`; the code's stamp "
        "is `0123abcd`."
    )


def test_arms_are_compared_within_the_seeds_that_both_finished(tmp_path):
    folder = write_study(tmp_path / "s", ("ideal", "out-of-band"), seeds=6)
    (folder / "runs/ideal/256/2.jsonl").unlink()
    findings = read_study(folder)
    (found,) = summarize_study(findings)["paired"]
    report(folder)
    assert "Not every condition has the same durations" not in (folder / "summary.md").read_text()
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
    chance = chance_errors(findings.truth, findings.layout)
    assert 1 - chance.mean() == pytest.approx(chance_level(TRUTH, findings.layout))
    assert list(found["chance_error"].values()) == pytest.approx(chance)
    assert found["mid_range_error"]["right_pectoral.length"] == pytest.approx(0.3)
    # A nominal length of 0.8 of the range lies between 50 and 51 of its 63 steps.
    assert found["nearest_error"]["right_pectoral.length"] == pytest.approx(0.8 - 50 / 63)
    least = 1 - np.mean(list(found["nearest_error"].values()))
    assert least == pytest.approx(quantisation_limit(TRUTH, findings.layout))
    row = f"| right pectoral length | {chance[4]:.3f} | 0.300 | 0.006 |"
    assert row in (folder / "summary.md").read_text()
    ideal, none = (found["arms"][arm]["dimensions"] for arm in ("ideal", "none"))
    name = "right_pectoral.length"
    errors = [
        np.mean([values(findings, "ideal", s, "dimension_error")[seed][4] for s in (128, 256)])
        for seed in range(5)
    ]
    assert ideal[name]["error"]["mean"] == pytest.approx(np.mean(errors))
    sizes = [
        np.std(
            [body[4] / 2.0 for body in values(findings, "ideal", s, "morphology").values()], ddof=1
        )
        for s in (128, 256)
    ]
    assert ideal[name]["between_replicates"] == pytest.approx(np.mean(sizes))
    assert ideal[name]["better_than_guessing"]
    assert not none["caudal.thickness"]["better_than_guessing"]


def test_ablations_are_held_against_the_baseline(tmp_path):
    arms = ("clamp", "baseline", "binary")
    folder = write_study(tmp_path / "s", arms, (256,))
    for seed in range(5):
        (folder / f"runs/clamp/256/{seed}.jsonl").write_bytes(
            (folder / f"runs/baseline/256/{seed}.jsonl").read_bytes()
        )
    report(folder)
    summary = json.loads((folder / "summary.json").read_text())
    effects = {effect["first"]: effect for effect in summary["effects"]}
    assert list(summary["arms"]) == ["baseline", "binary", "clamp"]
    assert set(effects) == {"binary", "clamp"}
    same = effects["clamp"]["rows"][0]["last_round"]
    assert (same["mean"], same["interval"], same["sign_test_p"]) == (0.0, [0.0, 0.0], 1.0)
    assert effects["clamp"]["trials_ratio"] == 1.0
    findings = read_study(folder)
    other, base = (values(findings, arm, 256) for arm in ("binary", "baseline"))
    gains = [other[seed] - base[seed] for seed in range(5)]
    assert effects["binary"]["rows"][0]["last_round"]["mean"] == pytest.approx(np.mean(gains))
    assert (folder / "figures/effects.png").exists()
    assert "## Effects against the baseline" in (folder / "summary.md").read_text()


def test_figures_and_ablations_share_a_report(tmp_path):
    folder = write_study(tmp_path / "s", ("ideal", "out-of-band"), (256,), rounds=2)
    report(folder)
    assert (folder / "figures/final.png").exists()
    (folder / "figures/mine.png").write_bytes(b"")
    (folder / "figures/rounds-gone.png").write_bytes(b"")
    arms = ("ideal", "out-of-band", "baseline-out-of-band", "clamp-out-of-band")
    both = write_study(tmp_path / "both", arms, (256,), rounds=2)
    (folder / "study.json").write_bytes((both / "study.json").read_bytes())
    for arm in arms[2:]:
        (both / "runs" / arm).rename(folder / "runs" / arm)
    written = report(folder)
    summary = (folder / "summary.md").read_text()
    columns = "random | middle | nearest genome | Out-of-Band (baseline) | Ideal | Out-of-Band |"
    assert f"| dimension | {columns}" in summary
    angles = summary.partition("## The inferred angles")[2].partition("## Figures")[0]
    assert "\n| Out-of-Band |" in angles
    assert "\n| Out-of-Band (baseline) |" in angles
    assert "clamp" not in angles
    made = {path.name for path in (folder / "figures").iterdir()}
    assert made == {path.name for path in written if path.suffix == ".png"} | {"mine.png"}
    assert {"fig5.png", "final.png", "final-out-of-band.png", "conditions.png"} <= made


def test_trials_are_compared_where_both_arms_are_finished(tmp_path):
    folder = write_study(tmp_path / "s", ("baseline", "clamp"), (128, 256), seeds=2, rounds=2)
    for seed in (0, 1):  # as dear as they are, they are not the baseline's to be compared with
        path = folder / f"runs/clamp/256/{seed}.jsonl"
        records = make_records(np.random.default_rng(seed), 0.3, 0.1, 2)
        write_records(path, [{**record, "trials": 10**9} for record in records])
        (folder / f"runs/baseline/256/{seed}.jsonl").unlink()
    (folder / "runs/clamp/128/1.jsonl").unlink()
    findings = read_study(folder)
    (effect,) = summarize_study(findings)["effects"]
    ours, theirs = (
        sum(record["trials"] for record in findings.replicates[arm][128][0])
        for arm in ("clamp", "baseline")
    )
    assert effect["trials_ratio"] == pytest.approx(ours / theirs)


def test_an_arms_models_are_counted_in_its_settings(tmp_path):
    folder = write_study(tmp_path / "s", ("in-band-200", "ideal"), (128,), seeds=1, rounds=1)
    header = json.loads((folder / "study.json").read_text())
    header["arms"]["in-band-200"]["estimation"]["population"] = 7
    (folder / "study.json").write_text(json.dumps(header))
    report(folder)
    text = (folder / "summary.md").read_text()
    assert "| In-Band, 7 models |" in text
    assert "200 models" not in text


def test_each_condition_has_its_own_baseline(tmp_path):
    arms = ("baseline-ideal", "baseline-out-of-band", "baseline-out-of-band-100")
    assert baseline_of("k-5-out-of-band", arms) == "baseline-out-of-band"
    assert baseline_of("k-5-out-of-band-100", arms) == "baseline-out-of-band-100"
    assert baseline_of("k-5-in-band", arms) is None
    assert baseline_of("k-5-in-band", [*arms, "baseline"]) == "baseline"
    assert baseline_of("baseline-ideal", [*arms, "baseline"]) is None
    arms = ("clamp-ideal", "clamp-out-of-band", *arms[:2])
    folder = write_study(tmp_path / "s", arms, (256,), rounds=2)
    names = {path.name for path in report(folder)}
    assert {"effects-ideal.png", "effects-out-of-band.png", "final-ideal.png"} <= names
    effects = json.loads((folder / "summary.json").read_text())["effects"]
    assert [(effect["first"], effect["second"]) for effect in effects] == [
        ("clamp-ideal", "baseline-ideal"),
        ("clamp-out-of-band", "baseline-out-of-band"),
    ]
    assert "### From Out-of-Band (baseline)" in (folder / "summary.md").read_text()


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
    assert comparisons(["baseline", "baseline-ideal", "clamp", "clamp-on"]) == []


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
    whole = (runs / "3.jsonl").read_text()
    lines = whole.splitlines(keepends=True)
    (runs / "3.jsonl").write_text("".join(lines[:2]))
    (runs / "4.jsonl").write_text("".join(lines[:3]) + lines[3][:40])  # killed while it wrote
    (runs / "0.jsonl").write_text("")
    (runs / "1.jsonl").unlink()
    findings = read_study(other)
    assert list(findings.replicates["none"][128]) == [2]
    assert findings.unfinished == {"none": {128: 3}}
    report(other)
    summary = json.loads((other / "summary.json").read_text())
    text = (other / "summary.md").read_text()
    assert "Not every condition has the same durations" not in text
    (runs / "2.jsonl").unlink()
    report(other)
    assert "Not every condition has the same durations" in (other / "summary.md").read_text()
    assert "26 of 30 replicates are finished" in text
    assert "None at 128 steps: 3" in text
    assert summary["arms"]["none"]["mean_of_durations"]["objective_fitness"]["replicates"] == 1


def test_a_replicate_that_stopped_at_an_accurate_model_keeps_its_last_values(tmp_path):
    folder = write_study(tmp_path / "s", ("ideal",), (128,), seeds=2, rounds=4)
    header = json.loads((folder / "study.json").read_text())
    header["arms"]["ideal"]["accurate"] = 0.5
    (folder / "study.json").write_text(json.dumps(header))
    records = make_records(np.random.default_rng(0), 0.3, 0.1, 4)[:2]
    for record, fitness in zip(records, (0.4, 0.6), strict=True):
        record["model_fitness"] = fitness
    write_records(folder / "runs/ideal/128/0.jsonl", records)
    write_records(folder / "runs/ideal/128/1.jsonl", records[:1])
    findings = read_study(folder)
    assert findings.unfinished == {"ideal": {128: 1}}
    assert findings.curves("ideal", 128, "model_fitness")[0].tolist() == [0.4, 0.6, 0.6, 0.6]
    assert len(results_table(findings).splitlines()) == 1 + 2


def break_line(path, line):
    lines = path.read_text().splitlines(keepends=True)
    lines[line - 1] = lines[line - 1].replace('"trials": 4', '"trials": 5')
    path.write_text("".join(lines))


@pytest.mark.parametrize("line", [1, 3, 4])
def test_a_damaged_line_is_named(tmp_path, line):
    folder = write_study(tmp_path / "s", ("ideal",), (128,), seeds=2)
    break_line(folder / "runs/ideal/128/1.jsonl", line)
    with pytest.raises(ConfigurationError, match=rf"128/1\.jsonl, line {line}: .*checksum.*delete"):
        report(folder)
    assert not (folder / "results.csv").exists()


def test_rounds_that_are_repeated_or_too_many_are_named(tmp_path):
    folder = write_study(tmp_path / "s", ("ideal",), (128,), seeds=1)
    path = folder / "runs/ideal/128/0.jsonl"
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join([*lines[:2], lines[1], *lines[2:]]))
    with pytest.raises(ConfigurationError, match=r"line 3: it must be round 3 of 4; it is round 2"):
        read_study(folder)
    write_records(path, make_records(np.random.default_rng(0), 0.3, 0.1, 5))
    with pytest.raises(ConfigurationError, match=r"line 5: it must be round 5 of 4"):
        read_study(folder)


def test_a_folder_without_a_study_or_a_finished_replicate_is_refused(tmp_path):
    with pytest.raises(ConfigurationError, match=r"must hold a study.*it has no study\.json"):
        report(tmp_path)
    folder = write_study(tmp_path / "s", ("ideal",), (128,), seeds=1)
    path = folder / "runs/ideal/128/0.jsonl"
    write_records(path, make_records(np.random.default_rng(0), 0.3, 0.1, 3))
    with pytest.raises(ConfigurationError, match=r"no finished replicate yet \(1 begun\)"):
        report(folder)
    path.unlink()
    with pytest.raises(ConfigurationError, match=r"no finished replicate yet \(0 begun\)"):
        report(folder)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"schema": "eea.run/1"}, "must be of schema eea.study.study/1; it is of eea.run/1"),
        ({"rounds": None}, "is damaged"),
        ({"arms": []}, "is damaged"),
        ({"rounds": 0}, "does not say the rounds"),
        ({"arms": {"ideal": 5}}, "does not say the arms"),
        ({"arms": {"ideal": {"accurate": "x"}}}, "does not say the arms.ideal.accurate"),
        ({"replicates": {}}, "does not say the replicates"),
        ({"replicates": {"ideal": {}}}, "does not say the replicates.ideal"),
        ({"replicates": {"ideal": {"128": {}}}}, "does not say the replicates.ideal.128"),
        ({"replicates": None, "steps": [128], "seeds": {}}, "does not say the seeds"),
        ({"replicates": None, "seeds": {"first": 0, "count": 1}}, "does not say the steps"),
        ({"target_morphology": {"tail": [1, 2, 3]}}, "does not say what the target is"),
        ({"target_damage": "none"}, "does not say what the target is"),
    ],
)
def test_a_damaged_study_is_refused(tmp_path, change, says):
    folder = write_study(tmp_path / "s", ("ideal",), (128,), seeds=1)
    header = json.loads((folder / "study.json").read_text())
    (folder / "study.json").write_text(json.dumps(header | change))
    with pytest.raises(ConfigurationError, match=says):
        read_study(folder)


def test_a_study_that_is_not_json_is_refused(tmp_path):
    folder = write_study(tmp_path / "s", ("ideal",), (128,), seeds=1)
    (folder / "study.json").write_text('{"schema": "eea.st')
    with pytest.raises(ConfigurationError, match=r"study\.json is damaged"):
        read_study(folder)
