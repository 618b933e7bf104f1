"""The commands study and plot: arms, what they write, how they resume, and what they refuse."""

from __future__ import annotations

import csv
import json
import re
import shutil
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from unittest import mock

import pytest

from aquafish_gym import Morphology, held_out
from aquafish_gym.runs import code
from aquafish_gym.runs.command_line import parse
from aquafish_gym.runs.jobs import RESULT_SCHEMA
from aquafish_gym.runs.manifest import write_manifest
from aquafish_gym.utils.storage import read_document
from eea.__main__ import REFUSED_ERRORS as ERRORS
from eea.__main__ import main
from eea.cli.study import StudyCommand
from eea.core.checks import ConfigurationError
from eea.core.config import InBandConfig, JointConfig, OutOfBandConfig, PaperConfig, recovery_config
from eea.fish import RealityGap
from eea.study.arms import ARMS, comparisons, figure_config, study_arms
from eea.study.method import MethodConfig
from eea.study.replicate import Replicate, StudyWorld, replicate
from eea.study.study import read_description
from tests.in_process import jobs_in_process

SMALL = [
    *("--exploration.population", "4", "--exploration.generations", "2"),
    *("--estimation.population", "4", "--estimation.generations", "3"),
]
SMOKE = ("--preset", "smoke", "--steps", "32", "--workers", "1")
TINY = [
    "study",
    *("--conditions", "ideal", "none", "--steps", "16", "--replicates", "2", "--rounds", "3"),
    *SMALL,
]
NAMES = [f"runs/{arm}/16/{seed}.json" for arm in ("ideal", "none") for seed in (0, 1)]


def files(folder):
    """Return a study's replicates and description, by name."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in [*sorted(folder.rglob("runs/**/*.json")), folder / "study.json"]
    }


def asked(*arguments):
    """Return the study of a command line."""
    return parse(StudyCommand, "study", [*arguments, "--out", "x"], ERRORS).study()


def undrawn_study(folder, *words):
    """Run a small study whose report has no figures."""
    with mock.patch("eea.study.report.save_study_figures", return_value=[]):
        return main(["study", *SMOKE, *words, "--out", str(folder)])


@pytest.fixture
def unreported(monkeypatch):
    """Leave out the reports, which take the longest."""
    monkeypatch.setattr("eea.cli.study._report", lambda *_: None)


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    """A finished study, with its report."""
    folder = tmp_path_factory.mktemp("tiny")
    with jobs_in_process():
        assert main([*TINY, "--out", str(folder)]) == 0
    return folder


@pytest.mark.slow
@pytest.mark.usefixtures("unreported")
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


@pytest.mark.usefixtures("unreported")
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


@pytest.mark.usefixtures("unreported")
def test_a_study_of_other_code_is_refused(tiny, tmp_path, capsys, monkeypatch):
    out = shutil.copytree(tiny, tmp_path / "study")
    before = files(out)
    monkeypatch.setattr("eea.study.study.code_hash", lambda _: "0123456789abcdef")
    assert main([*TINY, "--replicates", "3", "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert re.search("holds a study that other code made .*here 0123.*choose another folder", said)
    assert files(out) == before
    assert main(["plot", str(out)]) == 0


@pytest.mark.usefixtures("unreported")
@jobs_in_process()
def test_a_damaged_replicate_is_named_and_made_again(tiny, tmp_path, capsys):
    for name, content in files(tiny).items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(content)
    (tmp_path / NAMES[3]).write_bytes(b'{"half')
    assert main([*TINY, "--workers", "1", "--out", str(tmp_path)]) == 0
    assert "none, 16 steps, seed 1 runs again\n" in capsys.readouterr().err
    assert files(tmp_path) == files(tiny)


@pytest.mark.usefixtures("unreported")
@jobs_in_process()
def test_a_failed_replicate_is_named_and_the_others_are_made(tiny, tmp_path, capsys, monkeypatch):
    def sometimes(job):
        if job.key == ("none", 16, 1):
            raise ValueError("no such luck")
        return replicate(job)

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


@pytest.mark.usefixtures("unreported")
@jobs_in_process()
def test_joint_inference_is_an_arm_with_the_same_hidden_angles(tmp_path):
    arguments = [
        *("study", "--conditions", "joint", "none", "--steps", "32", "--replicates", "1"),
        *("--rounds", "1", "--joint.bodies", "12", "--joint.poses", "12", "--joint.descents", "4"),
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


@jobs_in_process()
def test_a_study_takes_a_gap_and_notes_it_only_if_there_is_one(tmp_path):
    words = ("--conditions", "none", "--replicates", "1")
    assert undrawn_study(tmp_path, *words, "--gap.lag", "0.05") == 0
    assert json.loads((tmp_path / "study.json").read_text())["gap"] == {"lag": 0.05}
    assert "differs from its models' in lag 0.05" in (tmp_path / "summary.md").read_text()
    assert undrawn_study(tmp_path, *words) == 2  # another world than the folder's
    assert "gap" not in asked("--figure", "5").to_dict()


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


ROOT = Path(__file__).parents[2]


def compared(study):
    """Return the labels of a study's pairs."""
    document = study.to_dict()
    plan = study_arms(document["arms"], document["rounds"])
    return [(plan[a].label, plan[b].label) for a, b in comparisons(list(plan.values()))]


def test_several_values_of_an_option_are_arms_of_the_conditions_that_read_it():
    study = asked("--conditions", "none", "in-band", "--in-band.best", "3", "5")
    assert list(study.arms) == ["none", "in-band-best-3", "in-band-best-5"]
    assert [study.arms[f"in-band-best-{n}"].in_band.best for n in (3, 5)] == [3, 5]
    assert compared(study) == [
        ("In-Band, best 3", "None"),
        ("In-Band, best 5", "None"),
        ("In-Band, best 5", "In-Band, best 3"),
    ]
    seeds = {name: spans["128"] for name, spans in study.to_dict()["replicates"].items()}
    assert len({json.dumps(span) for span in seeds.values()}) == 1  # the same seeds, so paired


@pytest.mark.parametrize(
    ("words", "names"),
    [
        ("--out-of-band.sampled-models None 5", ["sampled-models-None", "sampled-models-5"]),
        ("--genetic.coding gray binary", ["coding-gray", "coding-binary"]),
        ("--estimation.population 9 10", ["estimation-population-9", "estimation-population-10"]),
        ("--genetic.crossover-rate 0.5 1", ["crossover-rate-0.5", "crossover-rate-1"]),
        ("--rounds 4 2", ["rounds-4", "rounds-2"]),
    ],
)
def test_an_arm_is_named_by_the_value_that_sets_it_apart(words, names):
    study = asked("--conditions", "out-of-band", *words.split())
    assert list(study.arms) == [f"out-of-band-{name}" for name in names]


def test_two_options_with_several_values_make_every_combination():
    both = ("--conditions", "in-band", "--in-band.best", "5", "--in-band.dynamic-split")
    assert asked(*both).arms["in-band"].in_band == InBandConfig(best=5, dynamic_split=True)
    study = asked(*both[:4], "3", *both[4:], "False", "True")
    assert len(study.arms) == 4
    last = study.arms["in-band-best-3-dynamic-split-True"].in_band
    assert last == InBandConfig(best=3, dynamic_split=True)


def test_arms_that_vary_one_setting_alike_are_compared_at_equal_values():
    study = asked("--conditions", "out-of-band", "joint", "--rounds", "2", "4")
    assert compared(study) == [
        ("Out-of-Band, rounds 4", "Out-of-Band, rounds 2"),
        ("Joint, rounds 2", "Out-of-Band, rounds 2"),
        ("Joint, rounds 4", "Out-of-Band, rounds 4"),
        ("Joint, rounds 4", "Joint, rounds 2"),
    ]
    document = study.to_dict()
    assert document["rounds"] == 4
    assert [arm.get("rounds", 4) for arm in document["arms"].values()] == [2, 4, 2, 4]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--conditions in-band --in-band.best 3 3", r"differ; got \(3, 3\)"),
        ("--conditions in-band --in-band.best", r"differ; got \(\)"),
        ("--conditions in-band --rounds", "--rounds must have one value or more"),
        ("--figure 5 --conditions none", "either --figure or --conditions"),
        ("--conditions none --held-out --damage caudal:missing", "damage must be none with held"),
    ],
)
def test_values_that_make_no_arm_are_refused(words, said):
    with pytest.raises(ConfigurationError, match=said):
        asked(*words.split())


def test_every_condition_of_run_is_one_of_study():
    names = ["ideal", "none", "in-band", "out-of-band", "recovery", "joint"]
    study = asked("--conditions", *names)
    assert list(study.arms) == names
    assert study.arms["recovery"] == recovery_config(rounds=25)
    assert study.arms["joint"] == JointConfig(rounds=25)
    assert set(names) <= set(ARMS)


def test_settings_that_a_condition_ignores_are_refused_or_left_out():
    searching = OutOfBandConfig(period=7)
    for condition in ("ideal", "none", "in-band"):
        with pytest.raises(ConfigurationError, match="out_of_band is for the condition out-of-b"):
            PaperConfig(condition, out_of_band=searching)
    config = PaperConfig(out_of_band=searching, rounds=3)
    assert config.under("recovery").out_of_band == searching
    assert config.under("none") == PaperConfig("none", rounds=3)
    assert PaperConfig("in-band", in_band=InBandConfig(5)).under("ideal") == PaperConfig("ideal")


METHODS = """
import numpy as np
from helper import MIDDLE

def guess(target, rounds, seed, settings):
    for _ in range(rounds):
        log = target.perform((0.4, -0.4, 0.8))
        assert log.shape == (settings.steps, 3)
        settings.simulate([MIDDLE] * 2, [(0.4, -0.4, 0.8)] * 2, np.zeros((2, 3)))
        yield MIDDLE

def at_once(target, rounds, seed, settings):
    for _ in range(rounds):
        target.perform((0.4, -0.4, 0.8))
    return [MIDDLE] * rounds

def without_trials(target, rounds, seed, settings):
    return np.full((rounds, 9), 0.5)

def greedy(target, rounds, seed, settings):
    for _ in range(rounds):
        target.perform((0.4, -0.4, 0.8))
        target.perform((0.4, -0.4, 0.8))
        yield MIDDLE

def few(target, rounds, seed, settings):
    yield MIDDLE

def nan(target, rounds, seed, settings):
    return [MIDDLE * np.nan] * rounds

def short(target, rounds, seed, settings):
    return [MIDDLE[:8]] * rounds

def large(target, rounds, seed, settings):
    return [MIDDLE * 1000] * rounds

def nothing(target, rounds, seed, settings):
    pass

joint = nothing

def without_settings(target, rounds, seed):
    pass
"""


@pytest.fixture
def mine(tmp_path, monkeypatch):
    """A folder with a module of methods, in which the command is study_in."""
    (tmp_path / "methods_of_mine.py").write_text(METHODS)
    (tmp_path / "helper.py").write_text("import numpy as np\nMIDDLE = np.full(9, 0.5)\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    for name in ("methods_of_mine", "helper"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    yield tmp_path
    for name in ("methods_of_mine", "helper"):
        sys.modules.pop(name, None)


@jobs_in_process()
def test_methods_of_ones_own_are_arms_with_tables_pairs_and_figures(mine):
    out = mine / "out"
    places = [f"methods_of_mine:{name}" for name in ("guess", "at_once", "without_trials")]
    words = ("--conditions", "none", "--replicates", "2", "--rounds", "2", "--method", *places)
    assert main(["study", *SMOKE, *words, "--out", str(out)]) == 0
    rows = list(csv.DictReader((out / "results.csv").read_text().splitlines()))
    assert {row["arm"] for row in rows} == {"none", "guess", "at-once", "without-trials"}
    own = [row for row in rows if row["arm"] == "guess"]
    assert [row["trials"] for row in own] == ["2"] * 4
    assert {row["mod_fit"] + row["angle_error.caudal"] for row in own} == {""}
    scores = {row["obj_fit"] for row in rows if row["arm"] != "none"}
    assert len(scores) == 1  # one body
    text = (out / "summary.md").read_text()
    assert all(f"| {name} less None |" in text for name in ("Guess", "At once", "Without trials"))
    assert "| At once less Guess |" in text
    assert "nan" not in text.lower()
    assert (out / "figures" / "rounds-guess.png").exists()
    angles = text.split("## The inferred angles")[1].split("## Figures")[0]
    assert "None (assumes zero)" in angles
    assert "Guess" not in angles
    angles = [
        [record["true_angles"] for record in json.loads(path.read_text())["rounds"]]
        for path in (out / "runs/none/32/1.json", out / "runs/guess/32/1.json")
    ]
    assert angles[0] == angles[1]  # paired: the target hides the same angles


@jobs_in_process()
def test_a_study_is_not_continued_with_another_code_of_a_method_or_its_helpers(mine, capsys):
    words = ("--replicates", "1", "--rounds", "1", "--method", "methods_of_mine:guess")
    assert undrawn_study(mine / "out", *words) == 0
    before = read_description(mine / "out")["arms"]["guess"]
    assert before["function"] == "methods_of_mine:guess"
    hashes = [before["code"]]
    for path in (mine / "helper.py", mine / "methods_of_mine.py"):
        path.write_text(path.read_text() + "\n# changed\n")
        code._hash.cache_clear()
        assert undrawn_study(mine / "out", *words) == 2
        assert "arms.guess.code" in capsys.readouterr().err
        hashes.append(MethodConfig.of("methods_of_mine:guess").code)
    assert all(one != other for one, other in pairwise(hashes))


@pytest.mark.parametrize(
    ("places", "said"),
    [
        ("methods_of_mine", "method must be MODULE:FUNCTION"),
        ("methods_of_yours:guess", "no module 'methods_of_yours'"),
        ("methods_of_mine:gues", "did you mean 'guess'"),
        ("methods_of_mine:joint", "none of a condition"),
        ("methods_of_mine:greedy", "it performed 1 and asked"),
        ("methods_of_mine:few", "each of 2 rounds; got 1"),
        ("methods_of_mine:nan", "body of round 1 .*:nan must be finite"),
        ("methods_of_mine:short", r"body of round 1 .*:short must .*\(9,\)"),
        ("methods_of_mine:large", "left_pectoral.width .* got 500"),
        ("methods_of_mine:without_settings", r"\(robot, rounds, seed, settings\); too m"),
        ("builtins:max", "no signature found"),
        ("methods_of_mine:nothing", "each of 2 rounds; got NoneType"),
        ("methods_of_mine:guess methods_of_mine:guess", "functions of different names"),
    ],
)
def test_a_wrong_method_is_refused_before_anything_is_written(mine, capsys, places, said):
    assert undrawn_study(mine / "out", "--method", *places.split()) == 2
    assert re.search(said, capsys.readouterr().err)
    assert not (mine / "out" / "study.json").exists()


@jobs_in_process()
def test_each_seed_has_the_next_held_out_damage(tmp_path):
    words = ("--conditions", "none", "--held-out", "--replicates", "3", "--rounds", "1")
    assert undrawn_study(tmp_path / "out", *words) == 0
    text = (tmp_path / "out" / "summary.md").read_text()
    study = asked(*words, *SMOKE)
    assert [str(job.target().damage) for job in study.jobs()] == held_out("recovery")[:3]
    assert all(f"`{damage}`" in text for damage in held_out("recovery")[:3])


def test_the_example_gives_the_numbers_of_its_page():
    """The page's table is of ten seeds; one of them is made again."""
    committed = ROOT / "docs" / "results" / "method" / "results.csv"
    rows = [
        row
        for row in csv.DictReader(committed.read_text().splitlines())
        if (row["arm"], row["seed"]) == ("random-search", "3")
    ]
    config = MethodConfig.of("examples.random_search:random_search")
    world = StudyWorld(Morphology.nominal(), gap=RealityGap(gyro_noise=0.01), held_out=True)
    job = Replicate("random-search", replace(config, steps=128, rounds=5), 3, world)
    scores = [f"{record['objective_fitness']:.5g}" for record in replicate(job)["rounds"]]
    assert scores == [row["obj_fit"] for row in rows]
    assert {row["trials"] for row in rows} == {"2000"}


def test_every_command_and_option_that_the_map_of_the_paper_names_is_one_of_this_version():
    text = (ROOT / "docs" / "paper_map.md").read_text()
    commands = re.findall(r"^aquafish study (.*)$", text, re.MULTILINE)
    words = re.findall(r"`(--(?:in-band|genetic|exploration|out-of-band)\.[^`]*)`", text)
    assert len(words) >= 12
    assert commands
    for command in commands:
        asked(*command.split())
    plain = asked("--figure", "7", "9")
    for word in words:
        assert asked("--figure", "7", "9", *word.split()).arms != plain.arms, word
