"""The command line as a user meets it."""

from __future__ import annotations

import io
import json
import resource
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console
from rich.progress import Progress, TaskID

from aquafish_gym.bodies import read_bodies, write_bodies
from aquafish_gym.damage import Damage
from aquafish_gym.morphology import Morphology
from aquafish_gym.runs.folder import claim, held
from aquafish_gym.runs.storage import CannotWriteError
from gait import evolve, learner
from gait.baselines import Leg
from gait.cli import _bar, _learned, _line, main
from gait.controller import Controller
from gait.records import Generation, finished_generations
from gait_fakes import contents, make_controller, read_history

PLAIN = ["--starts", "1", "--polish", "0"]  # NEAT alone
QUICK = [*PLAIN, "--generations", "3", "--population", "12", "--seconds", "1", "--seed", "1000"]


@pytest.fixture
def controller_file(tmp_path: Path) -> str:
    path = tmp_path / "controller.json"
    make_controller().save(path)
    return str(path)


def test_evolve_writes_a_controller_for_the_body(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    body = tmp_path / "body.json"
    body.write_text(json.dumps(Morphology.nominal().to_dict()))
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
        "settings.json",
    }
    evolved = Controller.load(out / "controller.json")
    assert evolved.morphology == Damage.parse(damage).apply(Morphology.nominal())
    assert len(read_history(out / "history.csv")) == 3
    said = capsys.readouterr()
    final = max(row.final for row in read_history(out / "history.csv"))
    closing = f"swims {final:.2f} units in 1 s on the mean over the zero pose and 32 random ones ("
    assert said.out.startswith(closing)
    assert [line.split()[0] for line in said.err.splitlines()] == [
        "1/3",
        "2/3",
        "3/3",
    ]  # no terminal


@pytest.mark.parametrize("how", [[], ["--aggregate", "quantile", "--quantile", "0.1"]])
def test_evolve_takes_a_sample_of_bodies(
    tmp_path: Path, how: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    sample, out = tmp_path / "bodies.json", tmp_path / "out"
    broken = [Morphology.coerce({"caudal": (0.4, 1.4, z)}) for z in (0.3, 0.4, 0.6)]
    write_bodies(sample, broken)
    words = ["evolve", "--morphology", str(sample), "--damage", "left_pectoral:missing"]
    assert main([*words, "--out", str(out), *QUICK, *how]) == 0
    lost = [replace(body, left_pectoral=(0.0, 0.0, 0.0)) for body in broken]
    assert read_bodies(out / "bodies.json") == tuple(lost)
    evolved = Controller.load(out / "controller.json")
    assert evolved.morphology == lost[1]
    assert str(evolved.sample).startswith("3 bodies, ")
    final = max(row.final for row in read_history(out / "history.csv"))
    over = "or more in 90% of swims over" if how else "on the mean over"
    said = capsys.readouterr().out
    assert said.startswith(f"swims {final:.2f} units in 1 s {over} 3 bodies: ")
    assert main(["evolve", "--out", str(out), *QUICK, *how]) == 2
    assert "with morphology." in capsys.readouterr().err


def test_transfer_prints_and_writes_the_same_numbers(
    tmp_path: Path, controller_file: str, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    arguments = ["--target-damage", "left_pectoral:length=0.5", "--poses", "2", "--seconds", "1"]
    code = main(["transfer", "--controller", controller_file, "--out", str(out), *arguments])
    assert code == 0
    table = capsys.readouterr().out.splitlines()
    report = json.loads((out / "transfer.json").read_text())
    assert max(map(len, table)) <= 60
    assert table[0].split() == ["units", "of", "5", "cm", "native", "target"]
    for line, name in zip(table[1:], ("distance", "random_distance"), strict=True):
        numbers = [f"{report[body][name]:.2f}" for body in ("native", "target")]
        assert line.split()[-2:] == numbers
    assert [line.split()[0] for line in table[1:]] == ["zero", "2"]
    assert report["target_morphology"]["left_pectoral"] == [0.4, 0.8, 0.1]
    assert (out / "trajectories.png").exists()


def test_a_transfer_may_be_to_another_world(
    tmp_path: Path, controller_file: str, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["transfer", "--controller", controller_file, "--poses", "1", "--seconds", "1"]
    found = []
    for name, more in (("same", []), ("other", ["--target-world.servo-gain", "0", "1", "0.5"])):
        assert main([*arguments, "--out", str(tmp_path / name), *more]) == 0
        found.append(json.loads((tmp_path / name / "transfer.json").read_text()))
    capsys.readouterr()
    same, other = found
    assert same["target_world"]["servo_gain"] == [1.0, 1.0, 1.0]
    assert other["target_world"]["servo_gain"] == [0.0, 1.0, 0.5]
    assert other["native"] == same["native"]
    assert abs(other["target"]["distance"] - same["target"]["distance"]) > 1e-3


def test_evolve_is_for_the_world_that_was_asked_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    seized = ["--world.servo-gain", "0", "1", "1"]
    for name, more in (("whole", []), ("seized", seized)):
        assert main(["evolve", "--out", str(tmp_path / name), *QUICK, *more]) == 0
    assert read_history(tmp_path / "whole/history.csv") != read_history(
        tmp_path / "seized/history.csv"
    )
    assert main(["evolve", "--out", str(tmp_path / "late"), "--world.lag", "0.1", *QUICK]) == 2
    assert "world.lag must be 0" in capsys.readouterr().err
    assert not (tmp_path / "late").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["evolve", "--out", "{file}"], "out must be a directory that can be written"),
        (["evolve", "--out", "{dir}", "--damage", "tail:length=0.5"], "damage part must be one of"),
        (["evolve", "--out", "{dir}", "--damage", "caudal:lenth=1"], "did you mean 'length'"),
        (["evolve", "--out", "{dir}", "--morphology", "{dir}/no.json"], "No such file"),
        (["evolve", "--out", "{dir}", "--morphology", "{file}"], "file is not JSON"),
        (["evolve", "--out", "{dir}", "--generations", "0"], "generations must be"),
        (["evolve", "--out", ""], "--out must not be empty"),
        (["evolv"], "did you mean 'evolve'"),
        (["evolve", "--out", "{dir}", "--seed", "1" + 400 * "0"], "seed must be a whole number"),
        (["evolve", "--out", "{dir}", "--population", "1" + 12 * "0"], "population must be"),
        (["evolve", "--out", "{dir}", "--generations", "1" + 8 * "0"], "generations must be"),
        (["evolve", "--out", "{dir}", "--threads", "1" + 8 * "0"], "threads must be"),
        (["evolve", "--out", "{dir}", "--quantile", "0.1"], "quantile has a say only with"),
        (["evolve", "--out", "{dir}", "--aggregate", "quantile", "--poses", "0"], "poses must be"),
        (["evolve", "--out", "{dir}", "--world.drag", "1", "11"], "drag[1] must lie in [0, 10]"),
        (["transfer", "--controller", "{good}", "--target-world.lag", "2"], "lag must lie in"),
        (["evolve", "--out", "{dir}", "--morphology", "/dev/zero"], "must be a regular file"),
        (["transfer", "--controller", "{dir}/no.json"], "controller must be a file that can be"),
        (["transfer", "--controller", "/dev/zero"], "controller must be a regular file"),
        (["transfer", "--controller", "{good}", "--poses", "1" + 9 * "0"], "poses must be"),
        (["baseline", "--out", "{dir}", "--steps", "1" + 400 * "0"], "steps must be"),
        (["baseline", "--out", "{dir}", "--hidden", *["900"] * 30], "hidden must be at most 997"),
        (["baseline", "--out", "{dir}", "--interval", "7"], "the nearest is 5"),
        (["baseline", "--out", "{dir}", "--random-damages", "1000"], "damages must be a whole"),
        (
            ["baseline", "--out", "{dir}", "--random-damages", "256"],
            "morphologies must be 1 to 256",
        ),
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
    settings = [*PLAIN, "--generations", "400", "--population", "12", "--seconds", "0.5"]
    settings += ["--seed", "1000"]
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
    last = f"gait: interrupted; the same command resumes from generation {done}"
    assert said.splitlines()[-1] == last
    assert (out / "history.png").exists()
    assert len(read_history(out / "history.csv")) in (done - 1, done)
    Controller.load(out / "controller.json")
    settings[len(PLAIN) + 1] = str(done + 2)
    assert main(["evolve", "--out", str(out), *settings]) == 0
    assert len(read_history(out / "history.csv")) == done + 2


@pytest.mark.parametrize("command", ["evolve", "baseline"])
def test_a_directory_with_other_results_is_refused(
    tmp_path: Path, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    if command == "baseline":
        pytest.importorskip("stable_baselines3")
    with held(tmp_path):
        claim(tmp_path, "a study", {"seed": 1})
    before = contents(tmp_path)
    assert main([command, "--out", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert f"{tmp_path} holds a study" in said
    assert said.count("\n") == 1
    assert contents(tmp_path) == before


def test_a_directory_in_use_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with held(tmp_path):
        assert main(["evolve", "--out", str(tmp_path), *QUICK]) == 2
    assert f"{tmp_path} is in use by another command" in capsys.readouterr().err


@pytest.mark.slow
def test_of_two_commands_in_one_directory_the_second_is_refused(tmp_path: Path) -> None:
    """Both exited 0 once, and one was lost."""
    settings = [*PLAIN, "--generations", "400", "--population", "12", "--seconds", "0.5", "--seed"]
    commands = [
        [sys.executable, "-m", "gait", "evolve", "--out", str(tmp_path), *settings, seed]
        for seed in ("1", "2")
    ]
    processes = [subprocess.Popen(c, stderr=subprocess.PIPE, text=True) for c in commands]
    deadline = time.monotonic() + 120
    while all(p.poll() is None for p in processes) and time.monotonic() < deadline:
        time.sleep(0.02)
    loser, winner = sorted(processes, key=lambda p: p.poll() is None)
    while not (tmp_path / "checkpoint.json").exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    winner.send_signal(signal.SIGTERM)
    said = [process.communicate(timeout=60)[1] for process in (loser, winner)]
    assert (loser.returncode, winner.returncode) == (2, 130)
    assert f"{tmp_path} is in use by another command" in said[0]
    assert "the same command resumes from generation" in said[1]


LEARNING = ["--environments", "3", "--interval", "100", "--hidden", "4", "--senses", "imu", "fins"]


def test_what_was_learned_is_transferred_as_any_other(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("stable_baselines3")
    out = tmp_path / "out"
    damage = ["--damage", "left_pectoral:length=0.5", "--random-damages", "2"]
    words = ["baseline", "--out", str(out), "--steps", "180", *LEARNING, *damage]
    assert main(words) == 0
    assert set(contents(out)) == {
        "bodies.json",
        "checkpoint.npz",
        "controller.json",
        "curve.csv",
        "curve.png",
        "settings.json",
    }
    said = capsys.readouterr()
    rows = [line.split(",") for line in (out / "curve.csv").read_text().splitlines()]
    assert [row[0] for row in rows] == ["steps", "60", "120", "180"]
    best = max(float(row[2]) for row in rows[1:])
    assert said.out == (
        f"swims {best:.2f} units in 20 s on the mean over 3 bodies; "
        f"controller.json and curve.csv are in {out}\n"
    )
    lines = said.err.splitlines()  # no terminal
    assert (
        lines[-1] == f"180/180  training {float(rows[3][1]):6.2f}  score {float(rows[3][2]):6.2f}"
    )
    assert len(lines) == 10
    before = contents(out)
    assert main(words) == 0
    assert contents(out) == before
    bodies = read_bodies(out / "bodies.json")
    assert bodies[0] == Damage.parse(damage[1]).apply(Morphology.nominal())
    assert len(set(map(str, bodies))) == 3
    controller = Controller.load(out / "controller.json")
    assert (controller.interval, controller.senses.names[-1]) == (100, "caudal_cosine")
    arguments = ["--controller", str(out / "controller.json"), "--poses", "1", "--seconds", "1"]
    capsys.readouterr()
    assert main(["transfer", *arguments]) == 0
    assert "native" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("algorithm", "rest"),
    [("PPO", "the same command resumes"), ("SAC", "the same command starts again")],
)
def test_ctrl_c_while_learning_leaves_the_best_so_far(
    tmp_path: Path,
    algorithm: str,
    rest: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    pytest.importorskip("stable_baselines3")
    words = ["baseline", "--out", str(tmp_path), *LEARNING, "--algorithm", algorithm]
    update = Progress.update

    def stop(bar: Progress, task: TaskID, **changes: Any) -> None:
        if changes["completed"] == 123:
            raise KeyboardInterrupt
        update(bar, task, **changes)

    monkeypatch.setattr(Progress, "update", stop)
    assert main(words) == 130
    assert capsys.readouterr().err.splitlines()[-1] == f"gait: interrupted; {rest}"
    assert len((tmp_path / "curve.csv").read_text().splitlines()) == 3
    assert (tmp_path / "curve.png").exists()
    Controller.load(tmp_path / "controller.json")


def test_a_failed_baseline_leaves_no_directory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def absent(module: str) -> object:
        raise ModuleNotFoundError(f"No module named {module!r}")

    def stopped(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    out = tmp_path / "a" / "b"
    with monkeypatch.context() as patch:
        patch.setattr(learner, "import_module", absent)
        assert main(["baseline", "--out", str(out)]) == 2
    assert "[rl]" in capsys.readouterr().err
    pytest.importorskip("stable_baselines3")
    monkeypatch.setattr(Progress, "update", stopped)
    assert main(["baseline", "--out", str(out), *LEARNING]) == 130
    assert capsys.readouterr().err == "gait: interrupted; the same command starts again\n"
    assert not out.exists()


def test_ctrl_c_while_importing_is_one_line() -> None:
    """The import is held up, and interrupted there."""
    code = (
        "import os, runpy, signal, sys\n"
        "class Held:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        if name == 'numpy':\n"
        "            os.kill(os.getpid(), signal.SIGINT)\n"
        "sys.meta_path.insert(0, Held())\n"
        "runpy.run_module('gait', run_name='__main__', alter_sys=True)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (130, "gait: interrupted\n")


@pytest.mark.slow
def test_few_open_files_are_no_traceback(tmp_path: Path) -> None:
    """As under ``ulimit -n 20``, whatever it was enough for."""
    command = [sys.executable, "-m", "gait", "evolve", "--out", str(tmp_path / "out"), *QUICK]

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_NOFILE, (20, 20))

    done = subprocess.run(command, capture_output=True, text=True, preexec_fn=limit)
    assert done.returncode in (0, 1, 2)
    assert "Traceback" not in done.stderr


def test_a_full_disk_is_one_line_and_nothing_is_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    words = ["evolve", "--out", str(out), *QUICK]

    def full(path: Path, *_: object) -> None:
        raise CannotWriteError(f"cannot write {path}: No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(evolve, "write_history", full)
        assert main(words) == 1
    said = capsys.readouterr().err.splitlines()
    assert said == [f"gait: cannot write {out / 'history.csv'}: No space left on device"]
    assert main(words) == 0
    assert len(read_history(out / "history.csv")) == 3


@pytest.mark.parametrize(
    ("text", "done", "total"),
    [
        (_line(Generation(998, -100.0, -100.0, 12, -100.0, 0.0, 12, 99)), 999, 1000),
        (_learned(Leg(1_510_400, -10.0, -10.0)), 15_103_999, 15_104_000),
    ],
)
def test_progress_fits_80_columns(text: str, done: int, total: int) -> None:
    console = Console(file=io.StringIO(), width=80, force_terminal=True, color_system=None)
    progress = _bar()
    task = progress.add_task("evolving", total=total, completed=done)
    progress.update(task, description=text)
    console.print(progress.get_renderable())
    assert isinstance(console.file, io.StringIO)
    shown = console.file.getvalue()
    assert text in shown
    assert f"{done}/{total}" in shown
    assert "0:00:00" in shown or "-:--:--" in shown


@pytest.mark.parametrize("command", ["evolve", "transfer", "baseline"])
def test_every_option_has_a_help(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([command, "--help-verbose"]) == 0
    said = " ".join(capsys.readouterr().out.replace("│", " ").split())
    for empty in ("INT (default", "STR (default", "PATH (default", "``"):
        assert empty not in said
    assert "FIN:SIZE=FACTOR, FIN:missing or FIN:entangled=SHARE" in said


def test_help_is_no_error(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    assert "evolve" in capsys.readouterr().out


def test_a_task_is_evolved_and_learned_by_the_commands(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    few = ["--search", "cma", "--controller", "linear", "--starts", "1", "--screened", "2"]
    few += ["--generations", "1", "--population", "10", "--poses", "1", "--interval", "500"]
    assert main(["evolve", "--task", "station", *few, "--out", str(tmp_path / "gait")]) == 0
    assert Controller.load(tmp_path / "gait" / "controller.json").senses.goal
    pytest.importorskip("stable_baselines3")
    learn = ["--steps", "1", "--environments", "2", "--interval", "500", "--hidden", "4"]
    struck = ["--damage", "caudal:length=0.5; random:mild@2-8", "--out", str(tmp_path / "learned")]
    assert main(["baseline", "--task", "waypoint", *learn, *struck]) == 0
    assert "earns" in capsys.readouterr().out
    learned = Controller.load(tmp_path / "learned" / "controller.json")
    assert learned.morphology.caudal[1] == Morphology.nominal().caudal[1] / 2
    settings = json.loads((tmp_path / "learned" / "settings.json").read_text())
    assert "random:mild@2.0-8.0" in json.dumps(settings)
