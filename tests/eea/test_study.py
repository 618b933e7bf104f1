"""What a study is, what its folder says and may take in, and how it is shown."""

from __future__ import annotations

import io
import json
from dataclasses import replace

import pytest
from rich.console import Console

import eea.study.replicate
import eea.study.study
from aquafish_gym.damage import Damage
from aquafish_gym.morphology import Morphology
from aquafish_gym.runs.runner import SCHEMA as RESULT
from aquafish_gym.runs.runner import Event, read_result
from aquafish_gym.runs.stamps import versions
from aquafish_gym.runs.storage import DamagedFileError, write_document
from aquafish_gym.utils.validation import InvalidArgumentError
from eea.cli.board import Board, duration, shown
from eea.core.checks import ConfigurationError
from eea.core.config import EEAConfig
from eea.core.genetic import GeneticConfig
from eea.study.cost import cost
from eea.study.folder import claim, extended, merge, read_description
from eea.study.plan import places
from eea.study.replicate import World, source_stamp
from eea.study.study import Study

WORLD = World(Morphology.nominal(), Damage.parse("none"))
STUDY = Study({"none": EEAConfig(condition="none")}, (64, 128), 5, 2, 4, WORLD)


def changed(**settings):
    return replace(STUDY, **settings)


def files(folder):
    """Return name to content."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"arms": {}}, "the number of arms"),
        ({"steps": ()}, "the number of steps"),
        ({"arms": {"none": EEAConfig(time_limit=3.0)}}, "time_limit must be None in a study"),
        ({"arms": {"a|b": EEAConfig()}}, "an arm's name must be letters, digits"),
        ({"arms": {"a" * 121: EEAConfig()}}, "at most 120 characters"),
        ({"steps": (64, 65)}, "steps must be a power of two; got 65"),
        ({"replicates": 10**9}, "replicates must be a whole number .* at most 10000"),
        ({"first_seed": 2**63}, "first_seed must be a whole number"),
        ({"replicates": 10_000, "steps": tuple(2**k for k in range(1, 13))}, "at most 100000"),
    ],
)
def test_a_study_checks_itself(wrong, message):
    with pytest.raises(ConfigurationError, match=message):
        changed(**wrong)


def test_a_studys_jobs_are_its_plans_places():
    assert [job.place for job in STUDY.jobs()] == places(STUDY.plan)
    assert {job.config.rounds for job in STUDY.jobs()} == {5}
    assert {job.source for job in STUDY.jobs()} == {source_stamp()}


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
    assert extended(tmp_path, STUDY) == read_description(tmp_path)


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


def test_code_that_decides_results_is_stamped_and_no_other(tmp_path, monkeypatch):
    for name in ("core", "joint", "aquafish", "study"):
        (tmp_path / "eea" / name).mkdir(parents=True)
    source, other = tmp_path / "eea/core/algorithm.py", tmp_path / "eea/study/folder.py"
    (tmp_path / "eea/study/replicate.py").write_text("")
    source.write_text('"""A text."""\n\ndef f(x):\n    """Another."""\n    return x + 1\n')
    ours = source_stamp()  # it is remembered, and must not be of what follows
    monkeypatch.setattr(eea.study.replicate.eea, "__file__", str(tmp_path / "eea" / "__init__.py"))
    stamp_now = source_stamp.__wrapped__
    stamp = stamp_now()
    assert stamp != ours
    source.write_text("def f(x):  # short\n    return x + 1\n")
    other.write_text("ANY = 1\n")
    assert stamp_now() == stamp
    source.write_text("def f(x):\n    return x + 2\n")
    assert stamp_now() != stamp


def test_a_folder_without_a_study_or_with_a_damaged_one_is_named(tmp_path):
    with pytest.raises(ConfigurationError, match=r"must hold a study, .* it has no study\.json"):
        read_description(tmp_path)
    claim(tmp_path, extended(tmp_path, STUDY))
    whole = (tmp_path / "study.json").read_bytes()
    (tmp_path / "study.json").write_bytes(whole.replace(b'"rounds": 5', b'"rounds": 6'))
    for look in (read_description, lambda folder: extended(folder, STUDY)):
        with pytest.raises(DamagedFileError, match=r"study\.json is damaged: its content does not"):
            look(tmp_path)


@pytest.mark.parametrize("name", ["rounds", "arms", "replicates", "versions", "source"])
def test_a_description_that_does_not_say_all_is_damaged(tmp_path, name):
    document = {**STUDY.to_dict(), name: None}
    write_document(tmp_path / "study.json", document, "eea.study/1")
    with pytest.raises(DamagedFileError, match=rf"study\.json is damaged: .* say the {name}"):
        read_description(tmp_path)


def part(folder, study, value=0.5):
    """Write a study's folder with made-up results."""
    folder.mkdir()
    claim(folder, study.to_dict())
    for job in study.jobs():
        path = folder / job.file
        path.parent.mkdir(parents=True, exist_ok=True)
        document = {"job": job.file, "rounds": [{"objective_fitness": value}], "seed": job.seed}
        write_document(path, document, RESULT)
    return folder


def test_two_folders_of_one_study_merge(tmp_path):
    whole = part(tmp_path / "whole", changed(first_seed=0, replicates=6))
    here = part(tmp_path / "here", changed(first_seed=0, replicates=3))
    there = part(tmp_path / "there", changed(first_seed=2))
    before = files(there)
    assert merge(here, there) == 6
    assert files(here) == files(whole)
    assert files(there) == before
    assert merge(here, there) == 0
    assert read_description(here)["replicates"]["none"]["64"] == span(0, 6)


def test_what_is_of_another_study_does_not_merge(tmp_path):
    here = part(tmp_path / "here", STUDY)
    before = files(here)
    gap = part(tmp_path / "gap", changed(first_seed=9))
    other = part(tmp_path / "other", changed(rounds=6, first_seed=6))
    contrary = part(tmp_path / "contrary", STUDY, value=0.75)
    damaged = part(tmp_path / "damaged", changed(first_seed=6))
    spoilt = damaged / "runs" / "none" / "64" / "7.json"
    spoilt.write_bytes(spoilt.read_bytes().replace(b"0.5", b"0.6"))
    for folder, message in (
        (gap, "would leave a gap"),
        (other, "rounds 5, not 6"),
        (contrary, "hold different results of none, 64 steps, seed 2"),
        (damaged, r"7\.json is damaged"),
    ):
        with pytest.raises(InvalidArgumentError, match=message):
            merge(here, folder)
        assert files(here) == before


def result(score=0.5):
    return {"rounds": [{"objective_fitness": score}] * 5}


def board(clock=lambda: 0.0):
    jobs = STUDY.jobs()
    return jobs, Board(jobs, {}, clock)


def test_the_time_to_go_follows_from_the_work_left_and_the_speed():
    now = [100.0]
    jobs, progress = board(lambda: now[0])
    progress.start()
    assert progress.counts() == "0 of 8 replicates"
    short, long = cost(jobs[0].config), cost(jobs[-1].config)
    assert long == 2 * short  # twice the steps
    progress.take(Event("began", jobs[0]))
    now[0] += 10.0
    progress.take(Event("said", jobs[0], "3/5", 0.5))
    rest = 10.0 * (3.5 * short + 4 * long) / (0.5 * short)
    assert progress.to_go == pytest.approx(rest)
    now[0] += 10.0
    progress.take(Event("done", jobs[0], share=1.0, document=result()))
    rest = 20.0 * (3 * short + 4 * long) / short
    assert progress.to_go == pytest.approx(rest)
    assert progress.counts() == f"1 of 8 replicates, {duration(rest)} to go"
    line = "none, 64 steps, seed 2: OBJ_FIT 0.500 after 5 rounds, 20.0 s (1 of 8 replicates, "
    assert progress.line(jobs[0], result()).startswith(line)
    progress.take(Event("failed", jobs[1], "broken"))
    assert progress.to_go == pytest.approx(20.0 * (2 * short + 4 * long) / short)
    for job in jobs[2:]:
        progress.take(Event("done", job, share=1.0, document=result(None)))
    assert progress.to_go == 0.0
    assert "OBJ_FIT unknown after 5 rounds (7 of 8" in progress.line(jobs[2], result(None))


def test_the_table_shows_what_is_done_running_and_left():
    jobs, progress = board()
    out = io.StringIO()
    console = Console(file=out, force_terminal=True, width=100, color_system=None)
    with shown(progress, console) as note:
        note(Event("began", jobs[0]))
        note(Event("done", jobs[0], share=1.0, document=result(0.8)))
        note(Event("began", jobs[1]))
        note(Event("said", jobs[1], "2/5", 0.4))
        note(Event("retried", jobs[1], "its process was killed by SIGKILL"))
        note(Event("began", jobs[1]))
        note(Event("said", jobs[1], "1/5", 0.2))
    rows = [line.split() for line in out.getvalue().splitlines()]
    assert ["none", "64", "1", "2", "0.800", "3:", "1/5"] in rows
    assert ["none", "128", "0", "4"] in rows
    assert progress.counts() in out.getvalue()
    assert f"{jobs[1].name}: its process was killed by SIGKILL; it is begun" in out.getvalue()


def test_elsewhere_a_finished_replicate_is_a_line():
    jobs, progress = board()
    out = io.StringIO()
    with shown(progress, Console(file=out, width=200)) as note:
        note(Event("began", jobs[0]))
        note(Event("said", jobs[0], "2/5", 0.4))
        note(Event("done", jobs[0], share=1.0, document=result(0.8)))
    assert out.getvalue().splitlines() == [progress.line(jobs[0], result(0.8))]


def test_times_are_said_in_short():
    assert [duration(s) for s in (0.4, 89.0, 90.0, 5399.0, 5400.0)] == [
        "0 s",
        "89 s",
        "2 min",
        "90 min",
        "1.5 h",
    ]


def test_a_result_in_anothers_place_is_named(tmp_path):
    folder = part(tmp_path / "study", STUDY)
    first, second, *_ = STUDY.jobs()
    (folder / second.file).write_bytes((folder / first.file).read_bytes())
    assert json.loads((folder / first.file).read_text())["seed"] == 2
    with pytest.raises(DamagedFileError, match="holds the result of another job than none, 64"):
        read_result(folder, second)
