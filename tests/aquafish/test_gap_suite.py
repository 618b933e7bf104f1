"""The reality-gap suite: its worlds, what it counts and draws, and the command, small."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aquafish.cli import main
from aquafish.gap.command import Gap
from aquafish.gap.figures import PAPERS_SECONDS, draw_all, progress_figure
from aquafish.gap.job import METHODS, ORACLE, GapJob, _true_hypotheses, bridge
from aquafish.gap.report import build_report, results, to_markdown
from aquafish.gap.worlds import DAMAGES, WORLDS, damage_of, draw, gap_of
from aquafish_gym import Damage, Morphology
from aquafish_gym.runs.storage import read_document
from eea import JointConfig

SETTINGS = Gap()._settings()
WORDS = {"left_pectoral": "left flipper", "right_pectoral": "right flipper", "caudal": "tail"}
SMALL = ("--preset", "smoke", "--workers", "1")


def test_no_damage_was_developed_on_and_each_breaks_something():
    bodies = {tuple(Damage.parse(text).apply(Morphology.nominal()).to_array()) for text in DAMAGES}
    assert len(bodies) == len(DAMAGES) >= 10
    developed = Damage.parse("left_pectoral:length=0.5").apply(Morphology.nominal())
    assert tuple(developed.to_array()) not in bodies
    assert tuple(Morphology.nominal().to_array()) not in bodies
    assert damage_of(len(DAMAGES) + 1) == damage_of(1)


def test_what_is_drawn_spans_what_the_worlds_say():
    drawn = [draw(seed) for seed in range(400)]
    drag = np.array([one.drag for one in drawn])
    gain = np.array([one.servo_gain for one in drawn])
    speed = np.linalg.norm([one.current for one in drawn], axis=1)
    bias = np.array([one.gyro_bias for one in drawn])
    for values, low, high in (
        (drag, 0.8, 1.2), (gain, 0.9, 1.1), (speed, 0.0, 0.2), (bias, -0.05, 0.05)
    ):  # fmt: skip
        assert low <= values.min() < low + 0.05 * (high - low)
        assert high - 0.05 * (high - low) < values.max() <= high
    assert {one.seized for one in drawn} == {"left_pectoral", "right_pectoral", "caudal"}
    assert draw(3) == draw(3)


def test_each_world_differs_from_the_models_in_what_it_says_alone():
    differs = {world: set(gap_of(world, 5).changes) for world in WORLDS}
    assert differs.pop("plain") == set()
    assert all("gyro_noise" in names for names in differs.values())
    usual = {world: names - {"gyro_noise"} for world, names in differs.items()}
    told = {
        "drag": {"drag"}, "reactive": {"reactive"}, "servo": {"servo_gain"},
        "current": {"current"}, "bias": {"gyro_bias"}, "lag": {"lag"}, "substeps-8": {"substeps"},
        "seized": {"seized", "seized_angle"},
        "everything": {"drag", "servo_gain", "current", "gyro_bias"},
    }  # fmt: skip
    assert usual == {world: told.get(world, set()) for world in usual}
    assert gap_of("noise-0.001", 0).gyro_noise == 0.001
    assert gap_of("noise-0.1", 0).gyro_noise == 0.1
    assert WORLDS["pybullet"].engine == "pybullet"


def test_all_methods_and_worlds_meet_the_same_hidden_angles():
    command, hidden = np.array([0.4, -0.3, 0.8]), []
    for world, method in (("plain", "none"), ("plain", "joint"), ("everything", "joint")):
        target = GapJob(world, method, 4, SETTINGS).begin()._target
        for _ in range(2):
            target.perform(command)
        hidden.append(target.start_angles.tolist())
    assert hidden[0] == hidden[1] == hidden[2]


def outcome(world, method, seed, fitness=(0.8, 0.9), gaits=None, **more):
    found = {
        "world": world, "method": method, "seed": seed, "damage": "caudal:missing",
        "gap": "nothing", "gaits": gaits or {"body": [4.0, 6.0]},
    }  # fmt: skip
    if method != ORACLE:
        found |= {
            "objective_fitness": list(fitness), "model_fitness": [0.5, 0.6],
            "trials": [100, 200], "cpu_seconds": [1.0, 4.0],
        }  # fmt: skip
    return found | more


def believed(covered, probable, true):
    return {
        "covered": {level: [True] * covered + [False] * (9 - covered)
                    for level in ("50%", "80%", "90%")},
        "good": True,
        "hypotheses": {probable: 0.9, "another": 0.1},
        "true": [true],
    }  # fmt: skip


OUTCOMES = [
    *(outcome("plain", ORACLE, s, gaits={"body": [8.0, 12.0 + s]}) for s in range(6)),
    *(outcome("plain", "none", s, (0.7, 0.6 + 0.01 * s)) for s in range(6)),
    *(
        outcome(
            "plain", "joint", s, (0.98, 0.99), {"body": [9.0], "sample": [10.0]},
            belief=believed(9 - s % 2, "seized", "seized" if s else "free"),
        )
        for s in range(6)
    ),
    *(outcome("reactive", ORACLE, s, gaits={"body": [-2.0 + 5.0 * (s == 3)]}) for s in range(6)),
    *(outcome("reactive", "none", s, gaits={"body": [-1.0]}) for s in range(6)),
]  # fmt: skip


def test_the_report_counts():
    report = build_report(results(OUTCOMES), {}, [])
    rows = {(row["world"], row["method"]): row for row in report["summary"]}
    assert list(report["worlds"]) == ["plain", "reactive"]
    assert report["seeds"] == list(range(6))
    none, joint, oracle = (rows["plain", name] for name in ("none", "joint", ORACLE))
    assert none["obj_fit"]["mean"] == pytest.approx(0.625)
    low, high = none["obj_fit"]["interval"]
    assert 0.6 <= low < 0.625 < high <= 0.65
    assert none["trials"]["mean"] == 300
    assert none["cpu_seconds"]["mean"] == 4.0
    assert oracle["distance"]["mean"] == pytest.approx(11.25)
    assert none["share"]["mean"] == pytest.approx(5.0 / 11.25)
    assert joint["share_sample"]["mean"] == pytest.approx(10.0 / 11.25)
    assert joint["covered"]["90%"]["mean"] == pytest.approx((9 + 8) / 18)
    assert joint["right"]["mean"] == pytest.approx(5 / 6)
    assert joint["hypotheses"] == {"seized": 6}
    assert "covered" not in none
    assert "obj_fit" not in oracle


def test_nothing_is_a_share_of_an_oracle_that_does_not_swim():
    report = build_report(results(OUTCOMES), {}, [])
    row = next(r for r in report["summary"] if (r["world"], r["method"]) == ("reactive", "none"))
    assert "share" not in row
    assert row["distance"] == {"mean": -1.0, "interval": [-1.0, -1.0]}
    text = to_markdown(report, SETTINGS, ["share.png"])
    assert "| none | 6 | 0.900 |  | -1.0 |  |  |  | 4 |" in text
    assert "![share](share.png)" in text
    few = [one for one in OUTCOMES if one["seed"] == 0 and one["world"] == "plain"]
    alone = build_report(results(few), {}, [])["summary"]
    assert alone[0]["share"] == {"mean": pytest.approx(0.5), "interval": None}


def test_pictures_show_what_was_counted(tmp_path: Path):
    table = results(OUTCOMES)
    names = draw_all(tmp_path, table, build_report(table, {}, []), ("png",))
    assert names == ["progress.png", "obj_fit.png", "share.png", "coverage.png"]
    assert all((tmp_path / name).stat().st_size > 5000 for name in names)
    left, right = progress_figure(table).axes
    curves = {tuple(line.get_xdata()) for line in left.lines}
    assert (1, 2) in curves
    assert any(np.allclose(line.get_xdata(), [1.0, 4.0]) for line in right.lines)
    stars = [line.get_xdata() for line in right.lines if line.get_marker() == "*"]
    assert stars == [[PAPERS_SECONDS]]


def gap(out: Path, *arguments: str) -> int:
    return main(["gap", "--out", str(out), *SMALL, *arguments])


WORLD = ("--worlds", "seized", "--methods", "none", "ga")


@pytest.fixture(scope="module")
def suite(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("deap", reason="DEAP comes with the extras named compare and test")
    out = tmp_path_factory.mktemp("gap") / "suite"
    assert gap(out, *WORLD) == 0
    return out


def measured(out: Path) -> dict[str, object]:
    """Return file -> outcome, but for the CPU times, which no two runs share."""
    found = {}
    for path in sorted(out.glob("runs/*/*/*.json")):
        found[str(path.relative_to(out))] = read_document(path)
        found[str(path.relative_to(out))].pop("cpu_seconds", None)
    return found


def test_the_command_leaves_a_report(suite: Path):
    report = read_document(suite / "report.json", "aquafish.gap/1")
    assert [row["method"] for row in report["summary"]] == ["none", "ga", ORACLE]
    assert [row["replicates"] for row in report["summary"]] == [2, 2, 2]
    assert report["settings"]["budget"] == 400
    assert report["code"][0]["numpy"]
    text = (suite / "report.md").read_text()
    assert "## seized: one servo is stuck" in text
    assert len((suite / "results.csv").read_text().splitlines()) == 7
    assert (suite / "obj_fit.png").exists()
    ga = read_document(suite / "runs/seized/ga/001.json")
    assert len(ga["objective_fitness"]) == 2
    assert ga["gap"].startswith("gyro_noise 0.01, seized ")
    assert all(400 <= tried / r < 1000 for r, tried in enumerate(ga["trials"], 1))


def test_joint_inference_is_judged_and_has_two_gaits():
    settings = Gap(preset="smoke")._settings()
    little = JointConfig(bodies=48, poses=48, descents=12, polished=2, restarts=0)
    settings = replace(settings, eea=replace(settings.eea, joint=little))
    job = GapJob("noise-0.01", "joint", 1, settings)
    found = bridge(job, lambda _text, _share: None)
    assert set(found["gaits"]) == {"body", "sample"}
    assert [len(those) for those in found["belief"]["covered"].values()] == [9, 9, 9]
    assert set(found["belief"]["hypotheses"]) >= set(found["belief"]["true"])
    assert found["objective_fitness"][-1] > 0.8
    assert found["cpu_seconds"] == sorted(found["cpu_seconds"])


@pytest.mark.parametrize(
    ("world", "seed", "true"),
    [
        ("drag", 0, ["every servo does as it is told"]),
        ("drag", 2, ["the left flipper is missing"]),
        ("reactive", 0, ["the water also resists acceleration"]),
        ("seized", 0, [f"the servo of the {WORDS[draw(0).seized]} is seized"]),
        ("seized", 2, ["the left flipper is missing",
                       f"the servo of the {WORDS[draw(2).seized]} is seized"]),
    ],
)  # fmt: skip
def test_what_is_true_of_a_target_is_named_as_joint_inference_does(world, seed, true):
    assert _true_hypotheses(GapJob(world, "joint", seed, SETTINGS)) == true


def test_what_is_lost_is_done_again_to_the_same_numbers(suite: Path, tmp_path: Path, capsys):
    out = Path(shutil.copytree(suite, tmp_path / "again"))
    (out / "runs/seized/ga/001.json").unlink()
    spoilt = out / "runs/seized/oracle/000.json"
    spoilt.write_text(spoilt.read_text().replace('"seized"', '"Seized"', 1))
    before = (out / "runs/seized/none/000.json").stat().st_mtime_ns
    assert gap(out, *WORLD) == 0
    assert f"damaged: {spoilt}; seized, oracle, seed 0 is done anew" in capsys.readouterr().err
    assert measured(out) == measured(suite)
    assert (out / "runs/seized/none/000.json").stat().st_mtime_ns == before


def test_other_settings_are_refused(suite: Path, capsys):
    assert gap(suite, *WORLD, "--rounds", "3") == 2
    assert "holds a reality-gap suite with eea.rounds 2, not 3" in capsys.readouterr().err


@pytest.mark.slow
def test_an_interrupted_suite_says_so_and_goes_on(suite: Path, tmp_path: Path):
    out = tmp_path / "out"
    process = subprocess.Popen(
        [sys.executable, "-m", "aquafish", "gap", "--out", str(out), *SMALL, *WORLD],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    while not list(out.glob("runs/*/*/*.json")) and process.poll() is None:
        time.sleep(0.05)
    os.kill(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130
    assert said.splitlines()[-1].endswith("the same command resumes")
    assert "Traceback" not in said
    assert gap(out, *WORLD) == 0
    assert measured(out) == measured(suite)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--worlds", "reactve"), "did you mean 'reactive'"),
        (("--methods", "cma"), "did you mean 'cma-es'"),
        (("--seeds", "0"), "seeds must be"),
        (("--budget", "0"), "budget must be"),
        (("--gait-poses", "0"), "gait_poses must be"),
        (("--steps", "100"), "steps must be a power of two"),
    ],
)
def test_a_mistake_is_refused_before_anything_is_written(words, said, tmp_path: Path, capsys):
    assert main(["gap", "--out", str(tmp_path / "out"), *words]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_method_whose_package_is_missing_says_what_to_install(monkeypatch):
    monkeypatch.setattr("aquafish.gap.command.find_spec", lambda _: None)
    with pytest.raises(ImportError, match="pip install") as caught:
        Gap(methods=("cma-es",), worlds=("plain",)).jobs()
    assert "cma" in str(caught.value)
    assert len(Gap(methods=("joint",), worlds=("plain",), seeds=3).jobs()) == 6


def test_the_whole_suite_is_every_method_in_every_world():
    pytest.importorskip("cma")
    jobs = Gap(worlds=tuple(world for world in WORLDS if world != "pybullet")).jobs()
    assert len(jobs) == len({job.file for job in jobs}) == 14 * (len(METHODS) + 1) * 25
    assert json.loads(json.dumps(jobs[0].settings.to_dict()))["budget"] > 0
