"""Arms of a study: several values of one option, methods of one's own, and what is refused."""

from __future__ import annotations

import csv
import json
import re
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest

from aquafish_gym import Morphology, held_out
from aquafish_gym.runs.command_line import parse
from eea.__main__ import REFUSED_ERRORS as ERRORS
from eea.__main__ import main
from eea.cli.study import StudyCommand
from eea.core.checks import ConfigurationError
from eea.core.config import InBandConfig, JointConfig, OutOfBandConfig, PaperConfig, recovery_config
from eea.fish import RealityGap
from eea.study.arms import ARMS, comparisons, study_arms, variants
from eea.study.method import MethodConfig
from eea.study.replicate import Replicate, StudyWorld, replicate
from eea.study.study import read_description
from tests.in_process import jobs_in_process

ROOT = Path(__file__).parents[2]
SMALL = ("--preset", "smoke", "--steps", "32", "--workers", "1")


def asked(*arguments: str):
    """Return the study of a command line."""
    return parse(StudyCommand, "study", [*arguments, "--out", "x"], ERRORS).study()


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
        (
            ("--out-of-band.sampled-models", "None", "5"),
            ["sampled-models-None", "sampled-models-5"],
        ),
        (("--genetic.coding", "gray", "binary"), ["coding-gray", "coding-binary"]),
        (("--estimation.population", "9", "10"), [f"estimation-population-{n}" for n in (9, 10)]),
        (("--genetic.crossover-rate", "0.5", "1"), ["crossover-rate-0.5", "crossover-rate-1"]),
        (("--rounds", "4", "2"), ["rounds-4", "rounds-2"]),
    ],
)
def test_an_arm_is_named_by_the_value_that_sets_it_apart(words, names):
    study = asked("--conditions", "out-of-band", *words)
    assert list(study.arms) == [f"out-of-band-{name}" for name in names]


def test_two_options_with_several_values_make_every_combination():
    words = ("--in-band.best", "3", "5", "--in-band.dynamic-split", "False", "True")
    study = asked("--conditions", "in-band", *words)
    assert len(study.arms) == 4
    both = study.arms["in-band-best-5-dynamic-split-True"].in_band
    assert both == InBandConfig(best=5, dynamic_split=True)


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


def test_one_value_keeps_the_arms_name_and_a_flag_without_a_word_is_true():
    study = asked("--conditions", "in-band", "--in-band.best", "5", "--in-band.dynamic-split")
    assert study.arms["in-band"].in_band == InBandConfig(best=5, dynamic_split=True)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--conditions", "none", "--in-band.best", "3", "5"), "in_band.best is for the condition"),
        (("--conditions", "in-band", "--in-band.best", "3", "3"), r"differ; got \(3, 3\)"),
        (("--conditions", "in-band", "--in-band.best"), r"differ; got \(\)"),
        (("--conditions", "in-band", "--in-band.best", "3", "99"), "at most estimation.population"),
        (("--conditions", "in-band", "--rounds"), "--rounds must have one value or more"),
        (("--figure", "5", "--conditions", "none"), "either --figure or --conditions"),
        (
            ("--conditions", "none", "--held-out", "--damage", "caudal:missing"),
            "damage must be none with held_out",
        ),
    ],
)
def test_values_that_make_no_arm_are_refused(words, message):
    with pytest.raises(ConfigurationError, match=message):
        asked(*words)


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


def test_every_smoke_arm_keeps_what_its_condition_reads():
    for arm in asked("--preset", "smoke").arms.values():
        assert (arm.out_of_band == OutOfBandConfig()) == (arm.condition != "out-of-band")


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
    while True:
        yield MIDDLE * np.nan

def short(target, rounds, seed, settings):
    while True:
        yield MIDDLE[:8]

def large(target, rounds, seed, settings):
    while True:
        yield MIDDLE * 1000

def nothing(target, rounds, seed, settings):
    pass

def joint(target, rounds, seed, settings):
    pass

def without_settings(target, rounds, seed):
    pass
"""


@pytest.fixture
def mine(tmp_path, monkeypatch):
    """A folder with a module of methods, in which the command is run."""
    (tmp_path / "methods_of_mine.py").write_text(METHODS)
    (tmp_path / "helper.py").write_text("import numpy as np\nMIDDLE = np.full(9, 0.5)\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    for name in ("methods_of_mine", "helper"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    yield tmp_path
    for name in ("methods_of_mine", "helper"):
        sys.modules.pop(name, None)


def run(folder, *words):
    return main(["study", *SMALL, *words, "--out", str(folder)])


@jobs_in_process()
def test_methods_of_ones_own_are_arms_with_tables_pairs_and_figures(mine):
    out = mine / "out"
    places = [f"methods_of_mine:{name}" for name in ("guess", "at_once", "without_trials")]
    words = ("--conditions", "none", "--replicates", "2", "--rounds", "2")
    assert run(out, *words, "--method", *places) == 0
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
    table = (out / "results.csv").read_bytes()
    assert main(["plot", str(out)]) == 0
    assert (out / "results.csv").read_bytes() == table
    angles = [
        [record["true_angles"] for record in json.loads(path.read_text())["rounds"]]
        for path in (out / "runs/none/32/1.json", out / "runs/guess/32/1.json")
    ]
    assert angles[0] == angles[1]  # paired: the target hides the same angles


@jobs_in_process()
def test_a_study_is_not_continued_with_another_code_of_a_method_or_its_helpers(mine, capsys):
    words = ("--replicates", "1", "--rounds", "1", "--method", "methods_of_mine:guess")
    assert run(mine / "out", *words) == 0
    before = read_description(mine / "out")["arms"]["guess"]
    assert before["function"] == "methods_of_mine:guess"
    hashes = [before["code"]]
    for path in (mine / "helper.py", mine / "methods_of_mine.py"):
        path.write_text(path.read_text() + "\n# changed\n")
        clear_hashes()
        assert run(mine / "out", *words) == 2
        assert "arms.guess.code" in capsys.readouterr().err
        hashes.append(MethodConfig.of("methods_of_mine:guess").code)
    assert all(one != other for one, other in pairwise(hashes))


def clear_hashes():
    from aquafish_gym.runs import code

    code._hash.cache_clear()


@pytest.mark.parametrize(
    ("place", "message"),
    [
        ("methods_of_mine", "method must be MODULE:FUNCTION; got 'methods_of_mine'"),
        ("methods_of_yours:guess", "there is no module 'methods_of_yours'"),
        ("methods_of_mine:gues", "did you mean 'guess'"),
        ("methods_of_mine:joint", "none of a condition; got methods_of_mine:joint"),
        ("methods_of_mine:greedy", "one command a round at most; it performed 1 and asked"),
        ("methods_of_mine:few", "must give a body in each of 2 rounds; got 1 bodies"),
        ("methods_of_mine:nan", "the body of round 1 of methods_of_mine:nan must be finite"),
        ("methods_of_mine:short", r"the body of round 1 of .*short must .*\(9,\)"),
        ("methods_of_mine:large", "must have left_pectoral.width of .* units; got 500"),
        ("methods_of_mine:without_settings", r"must take \(robot, rounds, seed, settings\); too m"),
        ("builtins:max", r"max must take \(robot, rounds, seed, settings\); no signature found"),
        ("methods_of_mine:nothing", "a body in each of 2 rounds; got NoneType"),
    ],
)
def test_a_wrong_method_is_refused_in_one_line_before_anything_is_written(
    mine, capsys, place, message
):
    assert run(mine / "out", "--method", place) == 2
    said = capsys.readouterr().err
    assert re.search(message, said), said
    assert not (mine / "out" / "study.json").exists()


@pytest.mark.usefixtures("mine")
def test_a_method_may_have_several_numbers_of_rounds():
    words = ("--conditions", "none", "--method", "methods_of_mine:at_once", "--rounds", "2", "4")
    assert compared(asked(*words)) == [
        ("None, rounds 4", "None, rounds 2"),
        ("At once, rounds 2", "None, rounds 2"),
        ("At once, rounds 4", "None, rounds 4"),
        ("At once, rounds 4", "At once, rounds 2"),
    ]


@pytest.mark.usefixtures("mine")
def test_two_methods_of_one_name_are_refused():
    with pytest.raises(ConfigurationError, match="functions of different names"):
        asked("--method", "methods_of_mine:guess", "methods_of_mine:guess")


@jobs_in_process()
def test_each_seed_has_the_next_held_out_damage(tmp_path):
    words = ("--conditions", "none", "--held-out", "--replicates", "3", "--rounds", "1")
    assert run(tmp_path / "out", *words) == 0
    text = (tmp_path / "out" / "summary.md").read_text()
    for damage in held_out("recovery")[:3]:
        assert f"`{damage}`" in text
    study = asked(*words, *SMALL)
    assert [str(job.target().damage) for job in study.jobs()] == held_out("recovery")[:3]


def test_variants_are_arms_of_the_python_interface_too():
    arms = variants({"joint": JointConfig()}, {"joint.noise": (0.01, None), "rounds": (2,)})
    assert list(arms) == ["joint-noise-0.01", "joint-noise-None"]
    assert {config.rounds for config in arms.values()} == {2}


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
