"""The command line as a user meets it."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from aquafish_gym.damage import Damage
from aquafish_gym.morphology import Morphology
from aquafish_gym.storage import write_json
from gait.__main__ import main
from gait.controller import Controller
from gait.evolve import read_history
from gait_fakes import contents, make_controller

QUICK = ["--generations", "3", "--population", "12", "--seconds", "1", "--seed", "1000"]


@pytest.fixture
def controller_file(tmp_path: Path) -> str:
    path = tmp_path / "controller.json"
    write_json(path, make_controller().to_dict())
    return str(path)


def test_evolve_writes_a_controller_for_the_body(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    body = tmp_path / "body.json"
    body.write_text(Morphology.nominal().to_json())
    out = tmp_path / "out"
    damage = "right_pectoral:missing"
    assert (
        main(["evolve", "--morphology", str(body), "--damage", damage, "--out", str(out), *QUICK])
        == 0
    )
    assert set(contents(out)) == {
        "controller.json",
        "history.csv",
        "history.png",
        "checkpoint.json",
    }
    evolved = Controller.load(out / "controller.json")
    assert evolved.morphology == Damage.parse(damage).apply(Morphology.nominal())
    assert len(read_history(out / "history.csv")) == 3
    assert "units in 1 s" in capsys.readouterr().out


def test_transfer_prints_and_writes_the_same_numbers(
    tmp_path: Path, controller_file: str, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    arguments = ["--target-damage", "left_pectoral:length=0.5", "--poses", "2", "--seconds", "1"]
    code = main(["transfer", "--controller", controller_file, "--out", str(out), *arguments])
    assert code == 0
    table = capsys.readouterr().out.splitlines()
    report = json.loads((out / "transfer.json").read_text())
    for line, name in zip(table[1:], ("native", "target"), strict=True):
        numbers = [report[name]["distance"], report[name]["random_distance"]]
        assert line.split() == [name, *(f"{n:.2f}" for n in numbers)]
    assert report["target_morphology"]["left_pectoral"] == [0.4, 0.8, 0.1]
    assert (out / "trajectories.png").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["evolve", "--out", "{file}"], "out must be a directory that can be written"),
        (["evolve", "--out", "{dir}", "--damage", "tail:length=0.5"], "damage fin must be one of"),
        (["evolve", "--out", "{dir}", "--damage", "caudal:lenth=1"], "did you mean 'length'"),
        (["evolve", "--out", "{dir}", "--morphology", "{dir}/no.json"], "No such file"),
        (["evolve", "--out", "{dir}", "--morphology", "{file}"], "morphology is not JSON"),
        (["evolve", "--out", "{dir}", "--generations", "0"], "generations must be"),
        (["evolve", "--out", "{dir}", "--generatons", "5"], "did you mean --generations"),
        (["evolve", "--out", "{dir}", "--seed", "x"], "--seed"),
        (["evolve"], "--out"),
        (["evolv"], "evolv"),
        ([], "evolve"),
        (["transfer", "--controller", "{dir}/no.json"], "controller: cannot read"),
        (["transfer", "--controller", "{file}"], "is not JSON"),
        (["transfer", "--controller", "{good}", "--target-engine", "bullet"], "'pybullet'"),
        (["transfer", "--controller", "{good}", "--target-damage", "caudal:lost"], "damage must"),
        (["transfer", "--controller", "{good}", "--out", "{file}"], "out must be a directory"),
        (["baseline", "--out", "{dir}", "--algorithm", "PPA"], "did you mean 'PPO'"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    tmp_path: Path,
    controller_file: str,
    arguments: list[str],
    message: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    file = tmp_path / "file"
    file.write_text("fish")
    words = [a.format(file=file, dir=tmp_path, good=controller_file) for a in arguments]
    assert main(words) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    assert said.err.startswith("gait: ")
    assert message in said.err
    assert "Traceback" not in said.err


def test_ctrl_c_leaves_readable_files_and_the_run_goes_on(tmp_path: Path) -> None:
    out = tmp_path / "out"
    settings = ["--generations", "400", "--population", "12", "--seconds", "0.5", "--seed", "1000"]
    command = [sys.executable, "-m", "gait", "evolve", "--out", str(out), *settings]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 120
    while not (out / "history.csv").exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "gait: interrupted" in said
    assert "Traceback" not in said
    done = len(read_history(out / "history.csv"))
    assert 0 < done < 400
    Controller.load(out / "controller.json")
    settings[1] = str(done + 2)
    assert main(["evolve", "--out", str(out), *settings]) == 0
    assert len(read_history(out / "history.csv")) == done + 2


def test_help_is_no_error(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    assert "evolve" in capsys.readouterr().out
