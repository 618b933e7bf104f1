"""The command that fills a study's folder, and what it refuses."""

from __future__ import annotations

import json
import os
import re
from dataclasses import replace
from pathlib import Path

import pytest

from aquafish_gym.command_line import parse
from aquafish_gym.runs.folder import claim as claim_folder
from aquafish_gym.runs.folder import held
from aquafish_gym.runs.runner import SCHEMA as RESULT
from aquafish_gym.runs.stamps import versions
from aquafish_gym.runs.storage import read_document
from eea.__main__ import main
from eea.cli.study import StudyCommand
from eea.study.folder import read_description
from eea.study.presets import figure_config
from eea.study.replicate import replicate, source_stamp

SMALL = [
    *("--exploration.population", "4", "--exploration.generations", "2"),
    *("--estimation.population", "4", "--estimation.generations", "3"),
]
TINY = [
    "study",
    *("--conditions", "ideal", "none", "--steps", "16", "--replicates", "2", "--rounds", "3"),
    *SMALL,
    "--no-draw",
]
NAMES = [f"runs/{arm}/16/{seed}.json" for arm in ("ideal", "none") for seed in (0, 1)]


def files(folder):
    """Return name to content."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def copy(content, folder):
    for name, text in content.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(text)


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    """A finished study of one worker."""
    folder = tmp_path_factory.mktemp("tiny")
    assert main([*TINY, "--workers", "1", "--out", str(folder)]) == 0
    return folder


def test_a_study_is_a_file_a_replicate_whatever_the_workers(tiny, tmp_path, capsys):
    out = tmp_path / "new" / "study"
    assert main([*TINY, "--workers", "2", "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert files(out) == files(tiny)
    assert list(files(out)) == [*NAMES, "study.json"]
    lines = [line for line in said.splitlines() if "OBJ_FIT" in line]
    assert len(lines) == 4
    score = json.loads((out / NAMES[3]).read_text())["rounds"][-1]["objective_fitness"]
    line = next(line for line in lines if line.startswith("none, 16 steps, seed 1: "))
    assert f"OBJ_FIT {score:.3f} after 3 rounds, " in line
    assert "(4 of 4 replicates, 0 s to go)" in lines[-1]
    before = {path: path.stat().st_mtime_ns for path in out.rglob("*")}
    assert main([*TINY, "--out", str(out)]) == 0  # there is nothing left to do
    assert capsys.readouterr().out == "4 of 4 replicates are complete\n"
    assert {path: path.stat().st_mtime_ns for path in out.rglob("*")} == before


def test_study_json_says_what_is_run(tiny):
    document = read_description(tiny)
    spans = {"16": {"first": 0, "count": 2}}
    assert document["replicates"] == {"ideal": spans, "none": spans}
    assert document["rounds"] == 3
    assert document["versions"] == [versions()]
    assert list(document["arms"]) == ["ideal", "none"]
    assert document["arms"]["none"]["condition"] == "none"
    assert document["arms"]["none"]["estimation"]["population"] == 4
    assert not {"steps", "rounds", "time_limit"} & set(document["arms"]["none"])
    assert document["target_engine"] == "numba"
    assert document["source"] == [source_stamp()]


def test_a_study_can_be_extended_and_merged_and_keeps_what_it_has(tiny, tmp_path, capsys):
    first = ["--replicates", "1", "--conditions", "none", "--workers", "1"]
    assert main([*TINY, *first, "--out", str(tmp_path / "a")]) == 0
    begun = files(tmp_path / "a")
    assert list(begun) == ["runs/none/16/0.json", "study.json"]
    more = ["--first-seed", "1", "--replicates", "1", "--workers", "1"]
    assert main([*TINY, *more, "--out", str(tmp_path / "a")]) == 0
    assert files(tmp_path / "a")["runs/none/16/0.json"] == begun["runs/none/16/0.json"]
    spans = read_description(tmp_path / "a")["replicates"]
    assert spans == {
        "none": {"16": {"first": 0, "count": 2}},
        "ideal": {"16": {"first": 1, "count": 1}},
    }
    copy({name: files(tiny)[name] for name in (NAMES[0], "study.json")}, tmp_path / "b")
    capsys.readouterr()
    assert main(["merge", str(tmp_path / "a"), str(tmp_path / "b")]) == 0
    assert capsys.readouterr().out.startswith("1 replicates of ")
    runs = {n: content for n, content in files(tmp_path / "a").items() if n != "study.json"}
    assert runs == {n: content for n, content in files(tiny).items() if n != "study.json"}
    assert main(["merge", str(tmp_path / "a"), str(tmp_path)]) == 2
    assert "must hold a study" in capsys.readouterr().err


def test_a_damaged_replicate_is_named_and_made_anew(tiny, tmp_path, capsys):
    copy(files(tiny), tmp_path)
    path = tmp_path / NAMES[3]
    path.write_bytes(path.read_bytes().replace(b'"round": 2', b'"round": 7'))
    litter = path.with_name(".1.json.abcdefgh.part")  # of a kill
    litter.touch()
    assert main([*TINY, "--workers", "1", "--out", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert f"damaged: result: {path} is damaged: its content does not match its checksum;" in said
    assert "; none, 16 steps, seed 1 is made anew\n" in said
    assert files(tmp_path) == files(tiny)


def sometimes(job, say):
    """Make a replicate, unless it is one of them."""
    if job.place == ("none", 16, 1):
        raise ValueError("no such luck")
    return replicate(job, say)


def test_a_replicate_that_cannot_be_made_is_named_and_the_others_are_made(
    tiny, tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr("eea.cli.study.replicate", sometimes)
    assert main([*TINY, "--workers", "1", "--out", str(tmp_path)]) == 1
    said = capsys.readouterr().out
    assert "failed: none, 16 steps, seed 1: ValueError: no such luck (test_study_command" in said
    made = files(tiny)
    del made["runs/none/16/1.json"]
    assert files(tmp_path) == made


def test_of_two_commands_one_is_told_who_holds_the_folder(tmp_path, capsys):
    with held(tmp_path):
        since = json.loads((tmp_path / "lock").read_text())["since"]
        assert main([*TINY, "--out", str(tmp_path)]) == 2
        said = capsys.readouterr().err
        assert said == (
            f"eea: out: {tmp_path} is in use by another command, process {os.getpid()} "
            f"since {since}\n"
        )
        assert not (tmp_path / "study.json").exists()
    assert not list(tmp_path.iterdir())


def test_other_folders_are_refused(tmp_path, capsys):
    runs, case = tmp_path / "runs only", tmp_path / "case"
    copy({"runs/none/16/0.json": b"{}"}, runs)
    case.mkdir()
    claim_folder(case, "a case study", {})
    for folder, message in ((runs, "holds runs but no study.json"), (case, "holds a case study")):
        before = files(folder)
        assert main([*TINY, "--out", str(folder)]) == 2
        assert message in capsys.readouterr().err
        assert files(folder) == before


def test_a_damaged_study_json_is_refused_and_a_run_keeps_out_of_a_study(tmp_path, capsys):
    (tmp_path / "study.json").write_text('{"schema": "eea.study/1"}')
    assert main([*TINY, "--out", str(tmp_path)]) == 2
    assert "study.json has no checksum" in capsys.readouterr().err
    (tmp_path / "study.json").write_text("[" * 1_000_000)
    assert main([*TINY, "--out", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert "study.json" in said
    assert said.count("\n") == 1


def test_joint_inference_is_an_arm_like_the_others(tmp_path, monkeypatch):
    # Its pictures are made, and not written in full, which takes the longest.
    monkeypatch.setattr("eea.report.figures.save_figure", lambda _, path: path.write_bytes(b""))
    arguments = [
        *("study", "--conditions", "joint", "none", "--steps", "32", "--replicates", "1"),
        *("--rounds", "2", "--joint.bodies", "12", "--joint.poses", "12", "--joint.descents", "4"),
        *("--joint.polished", "1", "--joint.restarts", "0", "--joint.alternatives", "never"),
        *SMALL,
    ]
    assert main([*arguments, "--workers", "1", "--out", str(tmp_path)]) == 0
    joint, none = (
        read_document(tmp_path / f"runs/{arm}/32/0.json", RESULT) for arm in ("joint", "none")
    )
    assert [r["true_angles"] for r in joint["rounds"]] == [r["true_angles"] for r in none["rounds"]]
    assert set(joint) - set(none) == {"belief"}
    sure = joint["belief"]
    assert list(sure["coverage"]) == list(sure["width"]) == ["50%", "80%", "90%"]
    assert sure["coverage"]["50%"] <= sure["coverage"]["80%"] <= sure["coverage"]["90%"] <= 1.0
    assert sure["width"]["50%"] < sure["width"]["90%"]
    assert isinstance(sure["good"], bool)
    assert sure["verdict"]
    summary = (tmp_path / "summary.md").read_text()
    assert "| Joint |" in summary
    assert (tmp_path / "figures" / "conditions.png").exists()


REFUSED = [
    ([], "--figure or --conditions must say what to run"),
    (["--figure", "5", "--conditions", "none"], "--figure and --conditions exclude each other"),
    (["--figure", "5", "--steps", "100"], "steps must be a power of two; got 100"),
    (["--figure", "5", "--steps", "64", "64"], "steps must differ from each other"),
    (["--figure", "5", "--replicates", "0"], "replicates must be a whole number"),
    (["--figure", "5", "--replicates", "1000000000"], "replicates must be .* at most 10000; got"),
    (["--figure", "5", "--replicates", "1" + 400 * "0"], "replicates must be .* at most 10000"),
    (["--figure", "5", "--first-seed", "-1"], "first_seed must be a whole number"),
    (["--figure", "5", "--first-seed", "1" + 400 * "0"], "first_seed must be a whole number"),
    (["--figure", "5", "--rounds", "0"], "rounds must be a whole number"),
    (["--figure", "5", "--rounds", "1" + 400 * "0"], "rounds must be a whole number"),
    (["--figure", "5", "--workers", "0"], "workers must be a whole number"),
    (["--figure", "5", "--workers", "1000000000"], "workers must be .* at most 1024"),
    (["--figure", "5", "--in-band.k", "4"], "in_band.k has no say: no arm is of the condition"),
    (
        ["--figure", "5", "--joint.noise", "0.01"],
        "joint.noise has no say: no arm is of the condition",
    ),
    (
        ["--conditions", "joint", "--estimation.generations", "5"],
        "estimation.generations has no say: every arm is of the condition joint",
    ),
    (
        ["--conditions", "joint", "--genetic.elites", "2"],
        "genetic.elites has no say: every arm is of the condition joint",
    ),
    (
        ["--conditions", "joint", "--exploration.population", "5"],
        "exploration.population has no say: no arm chooses its commands by disagreement",
    ),
    (["--conditions", "in-band", "--in-band.k", "26"], "in_band.k must be at most estimation"),
    (["--figure", "5", "--genetic.mutations", "19"], "genetic.mutations must be at most"),
    (["--figure", "5", "--suffix", "/up"], "suffix must be at most 60 letters, digits"),
    (["--figure", "5", "--suffix", ",x"], "suffix must be at most 60 letters, digits"),
    (["--figure", "5", "--suffix", " with | pipe"], "got ' with | pipe'"),
    (["--figure", "5", "--suffix", "a" * 61], "suffix must be at most 60"),
    (["--figure", "5", "--suffix=-x"], "the first a letter or digit; got '-x'"),
    (["--figure", "5", "--target-damage", "left:length=2"], "damage part must be one of"),
    (["--figure", "5", "--target-morphology", "/nowhere"], "target_morphology must be a file"),
    (["--figure", "5", "--target-morphology", "/dev/zero"], "target_morphology must be a regular"),
    (["--figure", "5", "--current", "0", "0", "nan"], "current must be finite"),
    (["--figure", "5", "--substeps", "1000000000000"], "substeps must be a whole number"),
    (["--figure"], "--figure must be one or more of 5, 6, 7, 8, 9, 10, all; got none"),
    (["--preset", "smoke", "--figure"], "--figure must be one or more of"),
    (["--conditions"], "--conditions must be one or more of ideal, none, in-band, out-of-band"),
    (["--figure", "5", "--steps"], "--steps must be one or more whole numbers; got none"),
    (["--figure", "5", "--format"], "--format must be one or more of png, pdf, svg; got none"),
    (["--figure", "5", "--behavior.timestep", "0.02"], "behavior.timestep has no say: no arm"),
    (
        ["--figure", "5", "--behavior.timestep", "0.02", "--behavior.signal", "attitude"],
        "behavior.timestep has no say: no arm takes the mean or rms rate of the attitude",
    ),
]


@pytest.mark.parametrize(("arguments", "message"), REFUSED)
def test_bad_options_are_refused_in_a_sentence(tmp_path, capsys, arguments, message):
    out = tmp_path / "out"
    assert main(["study", *arguments, "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert re.search(message if ".*" in message else re.escape(message), said), said
    assert said.count("\n") == 1
    assert len(said) < 600
    assert not out.exists() or not list(out.iterdir())


MISTYPED = [
    (["--figure", "4"], "4"),
    (["--figure", "5", "--step", "64"], "--steps"),
    (["--figure", "5", "--time-limit", "9"], "--time-limit"),
    (["--conditions", "nine"], "nine"),
    (["--figure", "5", "--preset", "smok"], "smoke"),
    (["--figure", "5", "--genetic.crossover", "twopoint"], "two_point"),
    (["--figure", "5", "--rounds", "1.5"], "1.5"),
    (["--figure", "5", "--steps", "12O"], "12O"),
    (["--figure", "5", "--format", "gif"], "gif"),
    (["--figure", "5", "--behavior.clamp", "yes"], "yes"),
    (["--figure", "5", "--estimation.population", "1"], "estimation.population must be a whole"),
    (["--figure", "5", "--estimation.population", "1000000000000"], "estimation.population must"),
]


@pytest.mark.parametrize(("arguments", "named"), MISTYPED)
def test_mistyped_options_are_refused(tmp_path, capsys, arguments, named):
    out = tmp_path / "out"
    assert main(["study", *arguments, "--out", str(out)]) == 2
    assert named in capsys.readouterr().err
    assert not out.exists()


def asked(*arguments):
    """Return the study of a command line."""
    words = [*arguments, "--out", "x"]
    return replace(parse(StudyCommand, "study", words), words=tuple(words)).study()


def test_the_figures_arms_are_the_papers():
    study = asked("--figure", "all")
    names = ["ideal", "none", "in-band", "in-band-200", "out-of-band", "out-of-band-100"]
    assert list(study.arms) == names
    assert list(study.arms.values()) == [figure_config(f"fig{n}") for n in range(5, 11)]
    assert (study.steps, study.rounds) == ((128, 256, 512, 1024), 25)
    assert (study.first_seed, study.replicates) == (0, 25)
    assert (study.world.target_engine, study.world.damage.to_list()) == ("numba", [])
    assert list(asked("--figure", "10", "7").arms) == ["out-of-band-100", "in-band"]
    assert len(study.jobs()) == 6 * 4 * 25


def test_settings_of_the_command_line_go_over_those_of_each_arm():
    study = asked("--figure", "8", "9", "10", "--estimation.generations", "7", "--suffix", "7")
    assert list(study.arms) == ["in-band-200-7", "out-of-band-7", "out-of-band-100-7"]
    assert [c.estimation.population for c in study.arms.values()] == [200, 25, 100]
    assert [c.estimation.generations for c in study.arms.values()] == [7, 7, 7]
    assert study.arms["out-of-band-100-7"].out_of_band.sampled_models == 5
    # Also where what is given is the default of another arm.
    study = asked("--figure", "8", "9", "--estimation.population=25", "--accurate", "0.9")
    assert [c.estimation.population for c in study.arms.values()] == [25, 25]
    assert [c.accurate for c in study.arms.values()] == [0.9, 0.9]


def test_the_attitudes_rates_have_a_timestep():
    settings = {"timestep": 0.02, "signal": "attitude", "summary": "rms_rate"}
    words = [
        word for name, value in settings.items() for word in (f"--behavior.{name}", str(value))
    ]
    assert asked("--figure", "5", *words).arms["ideal"].behavior.timestep == 0.02


@pytest.mark.slow
def test_the_smoke_preset_makes_every_figure_and_gives_way_to_options(tmp_path, capsys):
    smaller = ["--replicates", "1", "--rounds", "2", "--estimation.generations", "4"]
    study = asked("--preset", "smoke", *smaller)
    assert len(study.arms) == 6
    assert (study.steps, study.replicates, study.rounds) == ((128,), 1, 2)
    assert {c.estimation.generations for c in study.arms.values()} == {4}
    assert len({c.estimation.population for c in study.arms.values()}) == 3
    assert list(asked("--preset", "smoke", "--figure", "7").arms) == ["in-band"]
    assert asked("--preset", "smoke", "--replicates", "25").replicates == 25
    study = StudyCommand(tmp_path, preset="smoke", replicates=7).study()
    assert (study.steps, study.replicates, study.rounds) == ((128,), 7, 3)
    arguments = ["study", "--preset", "smoke", *smaller, "--out", str(tmp_path)]
    assert main([*arguments, "--format", "svg"]) == 0
    assert capsys.readouterr().out.endswith(f"summary.md and figures are in {tmp_path}\n")
    made = files(tmp_path)
    assert {"results.csv", "summary.md", "summary.json"} <= set(made)
    assert {Path(name).suffix for name in made if name.startswith("figures/")} == {".svg"}
    for name in made:
        if not name.startswith(("runs/", "study.json")):
            (tmp_path / name).unlink()
    assert main(["plot", str(tmp_path), "--format", "svg"]) == 0
    assert files(tmp_path) == made


def test_plot_needs_a_study(tmp_path, capsys):
    assert main(["plot", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert "study" in said
    assert said.count("\n") == 1
    assert main(["plot"]) == 2
    assert "Required options" in capsys.readouterr().err


@pytest.mark.slow
def test_a_study_of_unequal_arms_is_complete(tmp_path):
    with_report = [word for word in TINY if word != "--no-draw"]
    more = ["--conditions", "ideal", "--steps", "16", "32", "--replicates", "2"]
    assert main([*with_report, *more, "--out", str(tmp_path)]) == 0
    more = ["--conditions", "none", "--steps", "32", "--replicates", "1"]
    assert main([*with_report, *more, "--out", str(tmp_path)]) == 0
    assert "not complete" not in (tmp_path / "summary.md").read_text()
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert (summary["finished"], summary["planned"]) == (5, 5)
