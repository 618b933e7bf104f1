"""The command that fills a study's folder, and what it refuses."""

from __future__ import annotations

import io
import json
import os
import random
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

import eea.study.study
from aquafish_gym.damage import Damage
from aquafish_gym.morphology import Morphology
from aquafish_gym.runs import locks
from aquafish_gym.runs.storage import read_records
from aquafish_gym.runs.workers import Event
from aquafish_gym.utils.validation import InvalidArgumentError
from eea.__main__ import main
from eea.cli.board import Board, duration, shown
from eea.cli.study import StudyCommand
from eea.core.checks import ConfigurationError
from eea.core.config import EEAConfig
from eea.core.genetic import GeneticConfig
from eea.study.presets import figure_config
from eea.study.replicate import Progress, World, look
from eea.study.study import (
    Study,
    claim,
    cost,
    cost_left,
    extended,
    only_here,
    source_stamp,
    versions,
)

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


def files(folder):
    """Return name to content of all but the clock's file."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != "times.jsonl"
    }


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
    names = [f"runs/{arm}/16/{seed}.jsonl" for arm in ("ideal", "none") for seed in (0, 1)]
    assert list(files(out)) == [*names, "study.json"]
    lines = said.splitlines()
    assert len(lines) == 4
    score = read_records(out / names[3])[-1]["objective_fitness"]
    line = next(line for line in lines if line.startswith("none, 16 steps, seed 1: "))
    assert f"OBJ_FIT {score:.3f} after 3 rounds, " in line
    assert "(4 of 4 replicates, 0 s to go)" in lines[-1]
    times = read_records(out / "times.jsonl")
    assert sorted((t["arm"], t["seed"], t["round"]) for t in times) == [
        (arm, seed, number) for arm in ("ideal", "none") for seed in (0, 1) for number in (1, 2, 3)
    ]
    before = {path: path.stat().st_mtime_ns for path in out.rglob("*")}
    assert main([*TINY, "--out", str(out)]) == 0  # there is nothing left to do
    assert capsys.readouterr().out == "4 of 4 replicates are complete\n"
    assert {path: path.stat().st_mtime_ns for path in out.rglob("*")} == before


def test_study_json_says_what_is_run(tiny):
    document = json.loads((tiny / "study.json").read_text())
    assert document["schema"] == "eea.study/1"
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


def test_a_study_can_be_extended_and_keeps_what_it_has(tiny, tmp_path):
    main([*TINY, "--replicates", "1", "--conditions", "none", "--out", str(tmp_path)])
    first = files(tmp_path)
    more = ["--steps", "32", "16", "--first-seed", "1", "--replicates", "1"]
    assert main([*TINY, *more, "--out", str(tmp_path)]) == 0
    second = files(tmp_path)
    assert {name: second[name] for name in first if name != "study.json"} == {
        name: content for name, content in first.items() if name != "study.json"
    }
    assert main([*TINY, "--replicates", "2", "--out", str(tmp_path)]) == 0
    document = json.loads((tmp_path / "study.json").read_text())
    both, second = {"first": 0, "count": 2}, {"first": 1, "count": 1}
    spans = {"16": both, "32": second}
    assert document["replicates"] == {"none": spans, "ideal": spans}
    assert sorted(document["arms"]) == ["ideal", "none"]
    runs = {name: c for name, c in files(tmp_path).items() if "/16/" in name}
    assert runs == {name: c for name, c in files(tiny).items() if "/16/" in name}


def test_a_damaged_line_is_named_and_made_anew(tiny, tmp_path, capsys):
    for name, content in files(tiny).items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    log = tmp_path / "runs" / "none" / "16" / "1.jsonl"
    log.write_bytes(log.read_bytes().replace(b'"round": 2', b'"round": 7'))
    (tmp_path / "times.jsonl").write_text('{"checksum": torn')
    assert main([*TINY, "--out", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    damaged = f"damaged: {log}, line 2: the record does not match its checksum; none, 16 steps, "
    assert damaged + "seed 1 is made anew\n" in said
    assert files(tmp_path) == files(tiny)
    assert len(read_records(tmp_path / "times.jsonl")) == 3


def test_a_damaged_state_is_named(tiny, tmp_path, capsys):
    for name, content in files(tiny).items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    log = tmp_path / "runs" / "none" / "16" / "1.jsonl"
    log.write_bytes(b"".join(log.read_bytes().splitlines(keepends=True)[:2]))
    state = log.with_suffix(".state")
    state.write_bytes(b"damaged")
    assert main([*TINY, "--out", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    damaged = f"damaged: {state} does not match its checksum; none, 16 steps, seed 1 is made anew\n"
    assert damaged in said
    assert files(tmp_path) == files(tiny)


def test_a_replicate_that_cannot_be_made_is_named_and_the_others_are_made(tmp_path, capsys):
    (tmp_path / "runs" / "none").mkdir(parents=True)
    main([*TINY, "--conditions", "ideal", "--replicates", "1", "--out", str(tmp_path / "x")])
    (tmp_path / "study.json").write_bytes((tmp_path / "x" / "study.json").read_bytes())
    (tmp_path / "runs" / "none" / "16").write_text("in the way")
    capsys.readouterr()
    with pytest.raises(SystemExit) as stop:
        main([*TINY, "--replicates", "1", "--out", str(tmp_path)])
    assert stop.value.code == 1
    said = capsys.readouterr().out
    assert "failed: none, 16 steps, seed 0: " in said
    assert "Error: " in said
    assert look(_command("ideal").study().jobs(tmp_path)[0]).ended


def _command(condition):
    words = ("study", "--conditions", condition, "--steps", "16", "--rounds", "3", *SMALL)
    return StudyCommand(Path("x"), conditions=(condition,), steps=(16,), rounds=3, words=words)


# Long enough that no machine is through before the last kill.
ROUNDS = 60
LONG = [*TINY, "--conditions", "in-band", "out-of-band", "--rounds", str(ROUNDS), "--workers", "2"]


def start(arguments):
    return subprocess.Popen(
        [sys.executable, "-m", "eea", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def lines_in(folder):
    return sum(path.read_bytes().count(b"\n") for path in folder.glob("runs/*/*/*.jsonl"))


def wait_for_lines(folder, count, process):
    deadline = time.monotonic() + 120
    while lines_in(folder) < count and process.poll() is None:
        assert time.monotonic() < deadline
        time.sleep(0.005)


def children(process):
    return [
        int(entry.name)
        for entry in Path("/proc").iterdir()
        if entry.name.isdecimal()
        and _stat(entry)[1:2] == [str(process)]
        and b"spawn_main" in (entry / "cmdline").read_bytes()
    ]


def _stat(entry):
    try:
        return (entry / "stat").read_text().rpartition(")")[2].split()
    except OSError:
        return []


def test_sigkill_at_any_moment_changes_no_byte(tmp_path):
    assert main([*LONG, "--workers", "1", "--out", str(tmp_path / "undisturbed")]) == 0
    expected = files(tmp_path / "undisturbed")
    out = tmp_path / "killed"
    rng = random.Random(0)
    kills = 0
    for victim in ("command", "worker", "command", "command"):
        process = start([*LONG, "--out", str(out)])
        try:
            wait_for_lines(out, lines_in(out) + rng.randrange(1, 6), process)
            time.sleep(rng.uniform(0.0, 0.05))
            if victim == "worker":
                # Its replicate is taken up by another process, and the command goes on.
                for child in children(process.pid)[:1]:
                    os.kill(child, signal.SIGKILL)
                wait_for_lines(out, lines_in(out) + 3, process)
            kills += process.poll() is None
        finally:
            process.kill()
            process.communicate()
    assert kills >= 2
    assert lines_in(out) < 4 * ROUNDS, "the last kill came before the end"
    assert main([*LONG, "--out", str(out)]) == 0
    assert files(out) == expected


def test_ctrl_c_stops_at_once_and_says_how_to_go_on(tmp_path):
    out = tmp_path / "study"
    process = start([*LONG, "--rounds", "100000", "--out", str(out)])
    try:
        wait_for_lines(out, 3, process)
        workers = children(process.pid)
        assert len(workers) == 2
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=30)
    finally:
        process.kill()
    assert process.returncode == 130
    assert said.startswith("eea: stopped with 0 of 4 replicates, ")
    assert said.endswith(
        f" to go; every finished round is in {out}, and the same command goes on from there\n"
    )
    assert said.count("\n") == 1
    assert not [worker for worker in workers if Path(f"/proc/{worker}").exists()]
    assert not (out / "lock").exists()
    for log in out.glob("runs/*/*/*.jsonl"):
        assert read_records(log)


def test_of_two_commands_one_is_told_who_holds_the_folder(tmp_path, capsys):
    with only_here(tmp_path):
        held = json.loads((tmp_path / "lock").read_text())
        assert held["pid"] == os.getpid()
        assert main([*TINY, "--out", str(tmp_path)]) == 2
        said = capsys.readouterr().err
        assert said == (
            f"eea: out: {tmp_path} is in use by another command, process {os.getpid()} "
            f"since {held['since']}\n"
        )
        assert not (tmp_path / "study.json").exists()
    assert not list(tmp_path.iterdir())


def test_a_dead_commands_lock_is_taken_over(tmp_path):
    (tmp_path / "lock").write_text('{"pid": 1, "since": "long ago"}\n')
    with only_here(tmp_path):
        assert json.loads((tmp_path / "lock").read_text())["pid"] == os.getpid()


def test_a_lock_whose_file_was_just_removed_is_not_taken_for_one(tmp_path, monkeypatch):
    looks = []

    def is_at(handle, path):
        looks.append(path)
        if len(looks) == 1:  # the last holder removes it between the opening and the locking
            path.unlink()
        return original(handle, path)

    original = locks._is_at
    monkeypatch.setattr(locks, "_is_at", is_at)
    with only_here(tmp_path):
        assert len(looks) == 2
        with pytest.raises(InvalidArgumentError, match="in use"), only_here(tmp_path):
            pass


WORLD = World(Morphology.nominal(), Damage.parse("none"))
STUDY = Study({"none": EEAConfig(condition="none")}, (64, 128), 5, 2, 4, WORLD)


def changed(**settings):
    return replace(STUDY, **settings)


@pytest.mark.parametrize(
    ("other", "difference"),
    [
        (changed(rounds=6), "rounds 5, not 6"),
        (changed(world=replace(WORLD, substeps=2)), "substeps 1, not 2"),
        (changed(world=replace(WORLD, target_engine="pybullet")), "target_engine numba, not pyb"),
        (changed(world=replace(WORLD, target_orientation="heading")), "target_orientation upright"),
        (changed(world=replace(WORLD, dtype="float64")), "dtype float32, not float64"),
        (
            changed(world=replace(WORLD, damage=Damage.parse("left_pectoral:length=0.5"))),
            "target_damage none, not left_pectoral:length=0.5",
        ),
        (
            changed(arms={"ideal": EEAConfig(), "none": EEAConfig(condition="ideal")}),
            "arms.none.condition none, not ideal",
        ),
        (
            changed(arms={"none": EEAConfig(condition="none", genetic=GeneticConfig(elites=2))}),
            "arms.none.genetic.elites 1, not 2",
        ),
        (changed(first_seed=7), "seeds 2 to 5; 7 to 10 would leave a gap"),
        (changed(first_seed=0, replicates=1), "seeds 2 to 5; 0 to 0 would leave a gap"),
    ],
)
def test_another_study_in_the_folder_is_refused(tmp_path, other, difference):
    claim(tmp_path, extended(tmp_path, STUDY))
    before = files(tmp_path)
    with pytest.raises(InvalidArgumentError) as refusal:
        extended(tmp_path, other)
    assert difference in str(refusal.value)
    assert files(tmp_path) == before
    assert extended(tmp_path, STUDY) == json.loads(before["study.json"])


def span(first, count):
    return {"first": first, "count": count}


@pytest.mark.parametrize(
    ("other", "union"),
    [
        (
            changed(steps=(256, 64)),
            {"none": {"64": span(2, 4), "128": span(2, 4), "256": span(2, 4)}},
        ),
        (
            changed(first_seed=6, replicates=1, steps=(64,)),
            {"none": {"64": span(2, 5), "128": span(2, 4)}},
        ),
        (
            changed(first_seed=0, replicates=20),
            {"none": {"64": span(0, 20), "128": span(0, 20)}},
        ),
        (
            changed(first_seed=3, replicates=1),
            {"none": {"64": span(2, 4), "128": span(2, 4)}},
        ),
        (
            changed(arms={"more": EEAConfig()}, first_seed=0, replicates=1, steps=(32,)),
            {"none": {"64": span(2, 4), "128": span(2, 4)}, "more": {"32": span(0, 1)}},
        ),
    ],
)
def test_a_larger_study_is_the_union(tmp_path, other, union):
    claim(tmp_path, extended(tmp_path, STUDY))
    document = extended(tmp_path, other)
    assert document["replicates"] == union
    assert list(document["arms"]) == list(union)
    # The first studies had the same steps and seeds in all arms, and one set of versions.
    old = {**extended(tmp_path, STUDY), "steps": [64, 128], "seeds": span(2, 4)}
    old |= {"versions": old["versions"][0]}
    del old["replicates"]
    (tmp_path / "study.json").write_text(json.dumps(old))
    assert extended(tmp_path, other) == document


def test_a_study_of_unequal_arms_is_complete(tmp_path):
    with_report = [word for word in TINY if word != "--no-draw"]
    more = ["--conditions", "ideal", "--steps", "16", "32", "--replicates", "2"]
    assert main([*with_report, *more, "--out", str(tmp_path)]) == 0
    more = ["--conditions", "none", "--steps", "32", "--replicates", "1"]
    assert main([*with_report, *more, "--out", str(tmp_path)]) == 0
    assert "not complete" not in (tmp_path / "summary.md").read_text()
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert (summary["finished"], summary["planned"]) == (5, 5)


def test_results_of_other_code_are_not_gone_on_from_unasked(tmp_path, monkeypatch):
    claim(tmp_path, extended(tmp_path, STUDY))
    here = source_stamp()
    monkeypatch.setattr(eea.study.study, "source_stamp", lambda: "another")
    with pytest.raises(InvalidArgumentError, match=rf"other code \(source {here}, not another\)"):
        extended(tmp_path, STUDY)
    claim(tmp_path, extended(tmp_path, STUDY, other_code=True))
    assert extended(tmp_path, STUDY)["source"] == [here, "another"]


def test_nor_are_results_of_other_versions(tmp_path, monkeypatch):
    claim(tmp_path, extended(tmp_path, STUDY))
    before = versions()
    after = {**before, "numpy": "99.1"}
    monkeypatch.setattr(eea.study.study, "versions", lambda: after)
    message = rf"holds results of numpy {before['numpy']}, not 99\.1; .*--other-code"
    with pytest.raises(InvalidArgumentError, match=message):
        extended(tmp_path, STUDY)
    claim(tmp_path, extended(tmp_path, STUDY, other_code=True))
    assert extended(tmp_path, STUDY)["versions"] == [before, after]


def test_comments_are_no_other_code(tmp_path, monkeypatch):
    package = tmp_path / "eea"
    package.mkdir()
    (package / "__init__.py").write_text("")
    source = package / "algorithm.py"
    monkeypatch.setattr(eea.study.study.eea, "__file__", str(package / "__init__.py"))
    source.write_text('"""A text."""\n\ndef f(x):\n    """Another."""\n    return x + 1\n')
    stamp = source_stamp()
    source.write_text("def f(x):  # short\n    return x + 1\n")
    assert source_stamp() == stamp
    source.write_text("def f(x):\n    return x + 2\n")
    assert source_stamp() != stamp


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("run.json", "holds a run of the EEA (run.json)"),
        ("controller.json", "holds a gait run (controller.json)"),
        ("config.json", "holds a case study (config.json)"),
        ("runs/none/16/0.jsonl", "holds runs but no study.json"),
    ],
)
def test_other_folders_are_refused(tmp_path, capsys, name, message):
    (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / name).write_text("{}")
    assert main([*TINY, "--out", str(tmp_path)]) == 2
    assert message in capsys.readouterr().err
    assert list(files(tmp_path)) == [name]


def test_a_damaged_study_json_is_refused_and_a_run_keeps_out_of_a_study(tmp_path, capsys):
    (tmp_path / "study.json").write_text('{"schema": "eea.study/1"}')
    assert main([*TINY, "--out", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert "study.json is damaged" in said
    assert "restore it or choose another folder" in said
    assert main(["run", "--out", str(tmp_path)]) == 2
    assert "holds a study (study.json)" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "one of --figure, --conditions, --ablation must say what to run"),
        (["--figure", "5", "--conditions", "none"], "--figure and --conditions exclude each other"),
        (["--figure", "4"], "4"),
        (["--figure", "5", "--step", "64"], "did you mean --steps"),
        (["--figure", "5", "--steps", "100"], "steps must be a power of two; got 100"),
        (["--figure", "5", "--steps", "64", "64"], "steps must differ from each other"),
        (["--figure", "5", "--replicates", "0"], "replicates must be a whole number"),
        (["--figure", "5", "--first-seed", "-1"], "first_seed must be a whole number"),
        (["--figure", "5", "--rounds", "0"], "rounds must be a whole number"),
        (["--figure", "5", "--workers", "0"], "workers must be a whole number"),
        (["--figure", "5", "--time-limit", "9"], "--time-limit"),
        (["--conditions", "nine"], "nine"),
        (["--ablation", "everything"], "ablation must be one of"),
        (["--figure", "5", "--in-band.k", "4"], "in_band.k has no say: no arm is of the condition"),
        (["--conditions", "in-band", "--in-band.k", "26"], "in_band.k must be at most estimation"),
        (["--figure", "5", "--genetic.mutations", "19"], "genetic.mutations must be at most"),
        (["--figure", "5", "--suffix", "/up"], "suffix must be at most 60 letters, digits"),
        (["--figure", "5", "--suffix", ",x"], "suffix must be at most 60 letters, digits"),
        (["--figure", "5", "--suffix", " with | pipe"], "got ' with | pipe'"),
        (["--figure", "5", "--suffix", "a" * 61], "suffix must be at most 60"),
        (["--figure", "5", "--suffix=-x"], "the first a letter or digit; got '-x'"),
        (
            ["--figure", "5", "--estimation.population", "1"],
            "eea: estimation.population must be a whole number of at least 2; got 1",
        ),
        (["--figure", "5", "--target-damage", "left:length=2"], "damage fin must be one of"),
        (["--figure", "5", "--target-morphology", "/nowhere"], "target_morphology must be a file"),
        (["--figure", "5", "--current", "0", "0", "nan"], "current must be finite"),
        (["--figure", "5", "--preset", "smok"], "--preset must be smoke; got 'smok'; did you mean"),
        (["--figure", "5", "--genetic.crossover", "twopoint"], "did you mean 'two_point'?"),
        (["--conditions", "idea"], "did you mean 'ideal'?"),
        (["--figure", "5", "--target-orientation", "headng"], "did you mean 'heading'?"),
        (["--figure", "5", "--rounds", "1.5"], "--rounds must be a whole number; got '1.5'"),
        (["--figure", "5", "--steps", "12O"], "--steps must be whole numbers; got '12O'"),
        (
            ["--figure", "5", "--behavior.clamp", "yes"],
            "takes no value; got 'yes'; it is --behavior.clamp or --behavior.no-clamp",
        ),
        (["--figure"], "--figure must be one or more of 5, 6, 7, 8, 9, 10, all; got none"),
        (["--preset", "smoke", "--figure"], "--figure must be one or more of"),
        (["--conditions"], "--conditions must be one or more of ideal, none, in-band, out-of-band"),
        (["--figure", "5", "--steps"], "--steps must be one or more whole numbers; got none"),
        (["--figure", "5", "--behavior.timestep", "0.02"], "behavior.timestep has no say: no arm"),
        (
            ["--figure", "5", "--behavior.timestep", "0.02", "--behavior.signal", "attitude"],
            "behavior.timestep has no say: no arm takes the mean or rms rate of the attitude",
        ),
    ],
)
def test_bad_options_are_refused_in_a_sentence(tmp_path, capsys, arguments, message):
    out = tmp_path / "out"
    assert main(["study", *arguments, "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1
    assert not out.exists() or not list(out.iterdir())


def asked(*arguments):
    """Return the study of a command line."""
    from eea.__main__ import Commands

    return Commands().cli(args=["study", *arguments, "--out", "x"]).study()


def test_the_figures_arms_are_the_papers():
    study = asked("--figure", "all")
    names = ["ideal", "none", "in-band", "in-band-200", "out-of-band", "out-of-band-100"]
    assert list(study.arms) == names
    assert list(study.arms.values()) == [figure_config(f"fig{n}") for n in range(5, 11)]
    assert (study.steps, study.rounds) == ((128, 256, 512, 1024), 25)
    assert (study.first_seed, study.replicates) == (0, 25)
    assert (study.world.target_engine, study.world.damage.to_list()) == ("numba", [])
    assert list(asked("--figure", "10", "7").arms) == ["out-of-band-100", "in-band"]
    assert len(study.jobs(Path("x"))) == 6 * 4 * 25


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


def test_an_ablation_is_arms_of_256_steps():
    from eea.study.ablations import ABLATIONS, ablation_arms

    name = next(iter(ABLATIONS))
    study = asked("--ablation", name)
    assert study.steps == (256,)
    assert dict(study.arms) == ablation_arms([name])
    assert dict(asked("--ablation", "all").arms) == ablation_arms()


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
    assert main(arguments) == 0
    assert capsys.readouterr().out.endswith(f"summary.md and figures are in {tmp_path}\n")
    made = files(tmp_path)
    assert {"results.csv", "summary.md", "summary.json"} <= set(made)
    assert [name for name in made if name.startswith("figures/")]
    for name in made:
        if not name.startswith(("runs/", "study.json")):
            (tmp_path / name).unlink()
    assert main(["plot", str(tmp_path)]) == 0
    assert files(tmp_path) == made


def test_plot_needs_a_study(tmp_path, capsys):
    assert main(["plot", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert "study" in said
    assert said.count("\n") == 1
    assert main(["plot"]) == 2
    assert capsys.readouterr().err == "eea: FOLDER, the directory of a study, is required\n"


def board(workers=2):
    jobs = STUDY.jobs(Path("nowhere"))
    standings = {job: look(job) for job in jobs}
    return jobs, Board(standings, workers)


def test_the_time_to_go_follows_from_the_work_left_and_the_speed():
    jobs, progress = board()
    assert progress.counts() == "0 of 8 replicates"
    job = jobs[0]
    progress.take(Event("began", job))
    for number in range(1, 6):
        seconds = 1e-6 * cost(job, number)
        progress.take(Event("said", job, Progress(number, 0.5, seconds, seconds)))
    progress.take(Event("done", job))
    rest = sum(1e-6 * cost_left(other, 0) for other in jobs[1:])
    assert progress.to_go == pytest.approx(rest / 2)
    assert progress.counts() == f"1 of 8 replicates, {duration(rest / 2)} to go"
    alone = Board({job: look(job) for job in jobs[:2]}, 2)
    alone.take(Event("said", jobs[0], Progress(1, 0.5, 1.0, 1.0)))
    # Two workers do not share one replicate.
    assert alone.to_go == pytest.approx(cost_left(jobs[1], 0) / cost(jobs[0], 1))
    progress.take(Event("failed", jobs[1], "broken"))
    assert progress.to_go == pytest.approx((rest - 1e-6 * cost_left(jobs[1], 0)) / 2)


def test_the_table_shows_what_is_done_running_and_left():
    jobs, progress = board()
    progress.take(Event("began", jobs[0]))
    progress.take(Event("said", jobs[0], Progress(5, 0.8, 1.0, 1.0)))
    progress.take(Event("done", jobs[0]))
    progress.take(Event("began", jobs[1]))
    progress.take(Event("said", jobs[1], Progress(2, 0.1, 1.0, 1.0)))
    out = io.StringIO()
    console = Console(file=out, force_terminal=True, width=100, color_system=None)
    with shown(progress, console) as live:
        assert live is not None
        live.refresh()
    rows = [line.split() for line in out.getvalue().splitlines()]
    assert ["none", "64", "1", "2", "0.800", "3:", "2/5"] in rows
    assert ["none", "128", "0", "4"] in rows
    assert progress.counts() in out.getvalue()
    with shown(progress, Console(file=io.StringIO())) as live:
        assert live is None


def test_times_are_said_in_short():
    assert [duration(s) for s in (0.4, 89.0, 90.0, 5399.0, 5400.0)] == [
        "0 s",
        "89 s",
        "2 min",
        "90 min",
        "1.5 h",
    ]


def test_a_study_checks_itself():
    for wrong, message in (
        ({"arms": {}}, "the number of arms"),
        ({"steps": ()}, "the number of steps"),
        ({"arms": {"none": EEAConfig(time_limit=3.0)}}, "time_limit must be None in a study"),
        ({"arms": {"a|b": EEAConfig()}}, "an arm's name must be letters, digits"),
        ({"arms": {"a" * 121: EEAConfig()}}, "at most 120 characters"),
        ({"steps": (64, 65)}, "steps must be a power of two; got 65"),
    ):
        with pytest.raises(ConfigurationError, match=message):
            changed(**wrong)
