"""The commands study and plot: what they write, how they resume, and what they refuse."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pytest

from aquafish_gym.runs.command_line import parse
from aquafish_gym.runs.jobs import RESULT_SCHEMA
from aquafish_gym.runs.manifest import write_manifest
from aquafish_gym.utils.storage import read_document
from eea.__main__ import REFUSED_ERRORS as ERRORS
from eea.__main__ import main
from eea.cli.study import StudyCommand
from eea.study.arms import figure_config
from eea.study.replicate import replicate
from eea.study.study import read_description
from tests.in_process import jobs_in_process

SMALL = [
    *("--exploration.population", "4", "--exploration.generations", "2"),
    *("--estimation.population", "4", "--estimation.generations", "3"),
]
TINY = [
    "study",
    *("--conditions", "ideal", "none", "--steps", "16", "--replicates", "2", "--rounds", "3"),
    *SMALL,
]
NAMES = [f"runs/{arm}/16/{seed}.json" for arm in ("ideal", "none") for seed in (0, 1)]


def files(folder: Path) -> dict[str, bytes]:
    """Return a study's replicates and description, by name."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in [*sorted(folder.rglob("runs/**/*.json")), folder / "study.json"]
    }


def asked(*arguments: str):
    """Return the study of a command line."""
    return parse(StudyCommand, "study", [*arguments, "--out", "x"], ERRORS).study()


@pytest.fixture
def undrawn(monkeypatch):
    """Leave out the reports, which take the longest."""
    monkeypatch.setattr("eea.cli.study._report", lambda *_: None)


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    """A finished study, with its report."""
    folder = tmp_path_factory.mktemp("tiny")
    with jobs_in_process():
        assert main([*TINY, "--out", str(folder)]) == 0
    return folder


@pytest.mark.usefixtures("undrawn")
def test_results_do_not_depend_on_workers_and_a_finished_study_is_left_alone(tiny, tmp_path, capfd):
    out = tmp_path / "new" / "study"
    assert main([*TINY, "--workers", "2", "--out", str(out)]) == 0
    lines = capfd.readouterr().err.splitlines()
    assert files(out) == files(tiny)
    assert list(files(out)) == [*NAMES, "study.json"]
    score = json.loads((out / NAMES[3]).read_text())["rounds"][-1]["objective_fitness"]
    assert any(line.endswith(f"none, 16 steps, seed 1  OBJ_FIT {score:.3f}") for line in lines)
    assert lines[-1].startswith("4/4  ")
    before = {path: path.stat().st_mtime_ns for path in out.rglob("*")}
    assert main([*TINY, "--out", str(out)]) == 0
    assert capfd.readouterr().err == ""
    assert {path: path.stat().st_mtime_ns for path in out.rglob("*")} == before


def test_plot_writes_the_same_report_again(tiny):
    written = {
        path: path.read_bytes()
        for path in tiny.rglob("*")
        if path.is_file() and path.suffix in (".png", ".csv", ".md")
    }
    assert {path.name for path in written} >= {"results.csv", "summary.md", "fig5.png", "fig6.png"}
    for path in written:
        path.unlink()
    assert main(["plot", str(tiny)]) == 0
    assert {path: path.read_bytes() for path in written} == written


@pytest.mark.usefixtures("undrawn")
@jobs_in_process()
def test_a_study_is_extended_by_seeds_and_arms(tiny, tmp_path):
    first = ["--replicates", "1", "--conditions", "none", "--workers", "1"]
    assert main([*TINY, *first, "--out", str(tmp_path)]) == 0
    begun = files(tmp_path)
    assert list(begun) == ["runs/none/16/0.json", "study.json"]
    more = ["--seed", "1", "--replicates", "1", "--workers", "1"]
    assert main([*TINY, *more, "--out", str(tmp_path)]) == 0
    assert read_description(tmp_path)["replicates"] == {
        "none": {"16": {"first": 0, "count": 2}},
        "ideal": {"16": {"first": 1, "count": 1}},
    }
    assert files(tmp_path)["runs/none/16/0.json"] == begun["runs/none/16/0.json"]
    assert files(tmp_path)[NAMES[1]] == files(tiny)[NAMES[1]]


@pytest.mark.usefixtures("undrawn")
def test_a_study_of_other_code_is_refused(tiny, tmp_path, capsys, monkeypatch):
    out = shutil.copytree(tiny, tmp_path / "study")
    before = files(out)
    monkeypatch.setattr("eea.study.study.code_hash", lambda _: "0123456789abcdef")
    assert main([*TINY, "--replicates", "3", "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert re.search("holds a study that other code made .*here 0123.*choose another folder", said)
    assert files(out) == before
    assert main(["plot", str(out)]) == 0


@pytest.mark.usefixtures("undrawn")
@jobs_in_process()
def test_a_damaged_replicate_is_named_and_made_again(tiny, tmp_path, capsys):
    for name, content in files(tiny).items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(content)
    (tmp_path / NAMES[3]).write_bytes(b'{"half')
    assert main([*TINY, "--workers", "1", "--out", str(tmp_path)]) == 0
    assert "none, 16 steps, seed 1 runs again\n" in capsys.readouterr().err
    assert files(tmp_path) == files(tiny)


def sometimes(job):
    """Make a replicate, or fail for one of them."""
    if job.key == ("none", 16, 1):
        raise ValueError("no such luck")
    return replicate(job)


@pytest.mark.usefixtures("undrawn")
@jobs_in_process()
def test_a_failed_replicate_is_named_and_the_others_are_made(tiny, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("eea.cli.study.replicate", sometimes)
    assert main([*TINY, "--workers", "1", "--out", str(tmp_path)]) == 1
    assert "failed: none, 16 steps, seed 1: ValueError: no such luck" in capsys.readouterr().err
    assert files(tmp_path).keys() == files(tiny).keys() - {"runs/none/16/1.json"}


def test_folders_with_other_content_are_refused(tmp_path, capsys):
    write_manifest(tmp_path, "a case study", {})
    before = sorted(tmp_path.iterdir())
    assert main([*TINY, "--out", str(tmp_path)]) == 2
    assert "holds a case study" in capsys.readouterr().err
    assert sorted(tmp_path.iterdir()) == before
    (tmp_path / "orphans" / "runs").mkdir(parents=True)
    assert main([*TINY, "--out", str(tmp_path / "orphans")]) == 2
    assert "holds runs but no study.json" in capsys.readouterr().err


@pytest.mark.usefixtures("undrawn")
@jobs_in_process()
def test_joint_inference_is_an_arm_with_the_same_hidden_angles(tmp_path):
    arguments = [
        *("study", "--conditions", "joint", "none", "--steps", "32", "--replicates", "1"),
        *("--rounds", "2", "--joint.bodies", "12", "--joint.poses", "12", "--joint.descents", "4"),
        *("--joint.polished", "1", "--joint.restarts", "0", "--joint.alternatives", "never"),
        *SMALL,
    ]
    assert main([*arguments, "--workers", "1", "--out", str(tmp_path)]) == 0
    joint, none = (
        read_document(tmp_path / f"runs/{arm}/32/0.json", RESULT_SCHEMA)
        for arm in ("joint", "none")
    )
    assert [r["true_angles"] for r in joint["rounds"]] == [r["true_angles"] for r in none["rounds"]]
    sure = joint["belief"]
    assert sure["coverage"]["50%"] <= sure["coverage"]["80%"] <= sure["coverage"]["90%"] <= 1.0
    assert sure["width"]["50%"] < sure["width"]["90%"]


def test_figures_have_the_papers_settings():
    study = asked("--figure", "all")
    names = ["ideal", "none", "in-band", "in-band-200", "out-of-band", "out-of-band-100"]
    assert list(study.arms) == names
    assert list(study.arms.values()) == [figure_config(f"fig{n}") for n in range(5, 11)]
    assert (study.steps, study.rounds) == ((128, 256, 512, 1024), 25)
    assert (study.first_seed, study.replicates) == (0, 25)
    assert len(study.jobs()) == 6 * 4 * 25


def test_settings_apply_to_every_arm_and_leave_the_rest():
    study = asked(
        "--figure", "8", "10", "--estimation.generations", "7",
        "--target-damage", "caudal:missing", "--first-seed", "3",
    )  # fmt: skip
    assert [c.estimation.population for c in study.arms.values()] == [200, 100]
    assert [c.estimation.generations for c in study.arms.values()] == [7, 7]
    assert study.arms["out-of-band-100"].out_of_band.sampled_models == 5
    assert (str(study.world.damage), study.first_seed) == ("caudal:missing", 3)


def test_the_smoke_preset_is_small_and_gives_way_to_options():
    study = asked("--preset", "smoke", "--rounds", "2", "--estimation.generations", "4")
    assert len(study.arms) == 6
    assert (study.steps, study.replicates, study.rounds) == ((128,), 2, 2)
    assert {c.estimation.generations for c in study.arms.values()} == {4}
    assert list(asked("--preset", "smoke", "--figure", "7").arms) == ["in-band"]
