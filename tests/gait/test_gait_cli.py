"""The command line as a user meets it."""

from __future__ import annotations

import io
import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from rich.console import Console

from aquafish_gym.damage import Damage
from aquafish_gym.morphology import Morphology
from aquafish_gym.runs.storage import write_json
from gait.__main__ import _progress, _progress_line, main
from gait.controller import Controller
from gait.evolve import finished_generations
from gait.history import Generation, read_history
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
    said = capsys.readouterr()
    final = max(row.final for row in read_history(out / "history.csv"))
    closing = f"swims {final:.2f} units in 1 s on the mean over the zero pose and 32 random ones ("
    assert said.out.startswith(closing)
    assert [line.split()[0] for line in said.err.splitlines()] == ["3/3"]  # no terminal


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
        (["evolve", "--out", "{dir}", "--morphology", "{file}"], "file is not JSON"),
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
    assert "Traceback" not in said
    done = len(finished_generations(out))
    assert 0 < done < 400
    last = f"gait: interrupted; the same command goes on from generation {done}"
    assert said.splitlines()[-1] == last
    assert (out / "history.png").exists()
    assert len(read_history(out / "history.csv")) in (done - 1, done)
    Controller.load(out / "controller.json")
    settings[1] = str(done + 2)
    assert main(["evolve", "--out", str(out), *settings]) == 0
    assert len(read_history(out / "history.csv")) == done + 2


@pytest.mark.parametrize(
    "names", [("run.json",), ("rounds.jsonl",), ("config.json", "seed-000"), ("outcome.json",)]
)
def test_a_directory_with_other_results_is_refused(
    tmp_path: Path, names: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    for name in names:
        (tmp_path / name).touch()
    for command in ("evolve", "baseline"):
        assert main([command, "--out", str(tmp_path)]) == 2
        said = capsys.readouterr().err
        assert said.startswith("gait: out holds an estimation or a case study (")
        assert said.count("\n") == 1
    assert set(contents(tmp_path)) == set(names)


def test_progress_fits_80_columns() -> None:
    console = Console(file=io.StringIO(), width=80, force_terminal=True, color_system=None)
    progress = _progress()
    task = progress.add_task("evolving", total=1000, completed=999)
    row = Generation(998, -100.0, -100.0, 12, -100.0, 0.0, 12, 99)
    progress.update(task, description=_progress_line(row))
    console.print(progress.get_renderable())
    assert isinstance(console.file, io.StringIO)
    shown = console.file.getvalue()
    assert "nodes 12" in shown
    assert "999/1000" in shown
    assert "0:00:00" in shown or "-:--:--" in shown


@pytest.mark.parametrize("command", ["evolve", "transfer", "baseline"])
def test_every_option_has_a_help(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([command, "--help"]) == 0
    said = " ".join(capsys.readouterr().out.replace("│", " ").split())
    for empty in ("INT (default", "STR (default", "PATH (default", "``"):
        assert empty not in said
    assert "FIN:SIZE=FACTOR or FIN:missing" in said


def test_help_is_no_error(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    assert "evolve" in capsys.readouterr().out
