"""The commands ``evolve``, ``transfer`` and ``baseline``."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aquafish_gym.bodies import read_bodies, write_bodies
from aquafish_gym.damage import Damage
from aquafish_gym.morphology import Morphology
from aquafish_gym.physics import compiling
from gait.__main__ import main
from gait.cli import _result_text
from gait.controllers.controller import Controller
from gait.search.config import EvolveConfig
from gait.search.evolve import Evolved
from gait_fakes import contents, make_controller, read_history

QUICK = ["--paper", "--generations", "3", "--population", "12", "--seconds", "1", "--seed", "1000"]
LEARNING = ["--environments", "3", "--interval", "100", "--senses", "imu", "fins"]


@pytest.fixture
def controller_file(tmp_path: Path) -> str:
    path = tmp_path / "controller.json"
    make_controller().save(path)
    return str(path)


def test_evolve_writes_a_controller_for_the_body(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    body, out = tmp_path / "body.json", tmp_path / "out"
    body.write_text(json.dumps(Morphology.nominal().to_dict()))
    damage = "right_pectoral:missing"
    words = ["evolve", "--morphology", str(body), "--damage", damage, "--out", str(out), *QUICK]
    assert main(words) == 0
    files = {"controller.json", "history.csv", "history.png", "checkpoint.json", "settings.json"}
    assert set(contents(out)) == files
    evolved = Controller.load(out / "controller.json")
    assert evolved.morphology == Damage.parse(damage).apply(Morphology.nominal())
    said = capsys.readouterr()
    final = max(row.final for row in read_history(out / "history.csv"))
    assert said.out.startswith(f"swims {final:.2f} units in 1 s on the mean over the zero pose")
    lines = [line for line in said.err.splitlines() if line != compiling.NOTICE]
    assert [line.split()[0] for line in lines] == ["1/3", "2/3", "3/3"]


def test_evolve_takes_a_sample_of_bodies(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sample, out = tmp_path / "bodies.json", tmp_path / "out"
    broken = [Morphology.coerce({"caudal": (0.4, 1.4, z)}) for z in (0.3, 0.4, 0.6)]
    write_bodies(sample, broken)
    words = ["evolve", "--morphology", str(sample), "--damage", "left_pectoral:missing"]
    assert main([*words, "--out", str(out), *QUICK]) == 0
    lost = [
        Morphology.coerce(body.to_dict() | {"left_pectoral": (0.0, 0.0, 0.0)}) for body in broken
    ]
    assert read_bodies(out / "bodies.json") == tuple(lost)
    evolved = Controller.load(out / "controller.json")
    assert evolved.morphology == lost[1]
    assert "on the mean over 3 bodies: " in capsys.readouterr().out


@pytest.mark.parametrize(
    "option", [pytest.param("--damage", marks=pytest.mark.slow), "--target-damage"]
)
def test_transfer_prints_and_writes_the_same_numbers(
    tmp_path: Path, controller_file: str, option: str, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    words = ["transfer", "--controller", controller_file, "--out", str(out), "--poses", "2"]
    words += ["--seconds", "1", "--target-world.servo-gain", "1", "0.5", "1"]
    words += ["--native-world.reactive"]
    assert main([*words, option, "left_pectoral:length=0.5"]) == 0
    table = capsys.readouterr().out.splitlines()
    report = json.loads((out / "transfer.json").read_text())
    for line, name in zip(table[1:], ("distance", "random_distance"), strict=True):
        numbers = [f"{report[body][name]:.2f}" for body in ("native", "target")]
        assert line.split()[-2:] == numbers
    assert report["target_morphology"]["left_pectoral"] == [0.4, 0.8, 0.1]
    assert report["target_world"]["servo_gain"] == [1.0, 0.5, 1.0]
    assert report["native_world"]["reactive"] is True
    assert not report["target_world"]["reactive"]
    assert (out / "trajectories.png").exists()


def test_interrupted_evolve_keeps_its_files_and_resumes(tmp_path: Path) -> None:
    out = tmp_path / "out"
    settings = ["--paper", "--population", "12", "--seconds", "0.5", "--generations"]
    command = [sys.executable, "-m", "gait", "evolve", "--out", str(out), *settings, "400"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 120
    while not (out / "history.csv").exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130
    done = len(read_history(out / "history.csv"))
    assert 0 < done < 400
    last = f"gait: interrupted; the same command resumes from generation {done}"
    assert said.splitlines()[-1] == last
    assert (out / "history.png").exists()
    Controller.load(out / "controller.json")
    assert main(["evolve", "--out", str(out), *settings, str(done + 2)]) == 0
    assert len(read_history(out / "history.csv")) == done + 2


def test_baseline_learns_and_is_transferred(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("stable_baselines3")
    out = tmp_path / "out"
    sample = tmp_path / "bodies.json"
    write_bodies(sample, [Morphology.nominal(), Morphology.coerce({"caudal": (0.4, 1.4, 0.3)})])
    words = ["--morphology", str(sample), "--damage", "left_pectoral:length=0.5; random:mild@2-8"]
    assert main(["baseline", "--out", str(out), "--steps", "180", *LEARNING, *words]) == 0
    files = {"bodies.json", "controller.json", "curve.csv", "curve.png", "settings.json"}
    assert set(contents(out)) == files
    said = capsys.readouterr()
    rows = [line.split(",") for line in (out / "curve.csv").read_text().splitlines()]
    best = max(float(row[2]) for row in rows[1:])
    assert said.out.startswith(f"earns {best:.2f} in 20 s on the mean over 2 bodies; ")
    assert said.err.splitlines()[-1].startswith("3/3  training")
    bodies = read_bodies(out / "bodies.json")
    assert bodies[0] == Damage.parse("left_pectoral:length=0.5").apply(Morphology.nominal())
    arguments = ["--controller", str(out / "controller.json"), "--poses", "1", "--seconds", "1"]
    assert main(["transfer", *arguments]) == 0
    assert "native" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("task", "said"),
    [
        ("forward", "swims 2.50 units in 20 s on the mean over the zero pose and 32 random ones"),
        ("return", "earns 2.50 in 60 s on the mean over the zero pose and 32 random ones"),
    ],
)
def test_what_evolve_found_is_said_in_the_terms_of_its_task(task: Any, said: str) -> None:
    found = Evolved(make_controller(), 2.5, (), np.array([2.5]))
    assert _result_text(found, EvolveConfig(task=task)) == said
