from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time

import pytest

from aquafish_gym.storage import read_records
from eea.__main__ import main

QUICK = [
    "run",
    *("--condition", "none", "--steps", "32", "--rounds", "2", "--target-engine", "numba"),
    *("--exploration.population", "6", "--exploration.generations", "3"),
    *("--estimation.population", "8", "--estimation.generations", "5"),
    *("--target-damage", "left_pectoral:length=0.5"),
]


def test_a_run_writes_its_rounds_its_result_and_its_picture(tmp_path, capsys):
    out = tmp_path / "new" / "run"
    assert main([*QUICK, "--out", str(out)]) == 0
    records = read_records(out / "rounds.jsonl")
    result = json.loads((out / "result.json").read_text())
    run = json.loads((out / "run.json").read_text())
    assert [r["round"] for r in records] == [1, 2]
    assert result["rounds"] == records
    assert result["stopped"] == "rounds"
    assert result["truth"][1] == 0.8
    assert run["config"]["steps"] == 32
    assert run["target_damage"] == [
        {"kind": "FinScaled", "fin": "left_pectoral", "size": "length", "factor": 0.5}
    ]
    assert (out / "rounds.png").read_bytes().startswith(b"\x89PNG")
    printed = capsys.readouterr().out
    for words in ("experiments  2/2", "best MOD_FIT", "OBJ_FIT 0.", "true 0.800"):
        assert words in printed


def test_the_same_run_may_be_repeated_in_place_and_another_not(tmp_path, capsys):
    arguments = [*QUICK, "--out", str(tmp_path)]
    assert main(arguments) == 0
    first = json.loads((tmp_path / "result.json").read_text())
    assert main(arguments) == 0
    again = json.loads((tmp_path / "result.json").read_text())
    assert again["morphology"] == first["morphology"]
    assert len(read_records(tmp_path / "rounds.jsonl")) == 2
    assert main([*arguments, "--seed", "1"]) == 2
    assert "holds another run" in capsys.readouterr().err
    (tmp_path / "run.json").write_text("nonsense")
    assert main(arguments) == 2
    assert json.loads((tmp_path / "result.json").read_text()) == again


def test_a_body_can_be_read_from_a_file(tmp_path):
    body = tmp_path / "body.json"
    sizes = {"left_pectoral": [0, 0, 0], "right_pectoral": [1, 2, 0.5], "caudal": [0.5, 2, 1]}
    body.write_text(json.dumps(sizes))
    out = tmp_path / "out"
    assert main([*QUICK, "--target-morphology", str(body), "--out", str(out)]) == 0
    truth = json.loads((out / "result.json").read_text())["truth"]
    assert truth == [0, 0, 0, 1, 2, 0.5, 0.5, 2, 1]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--steps", "100"], "steps must be a power of two; got 100"),
        (["--steps", "1099511627776"], "and at most 1048576; got 1099511627776"),
        (["--genetic.elites", "6"], "genetic.elites must be at most exploration.population - 1, 5"),
        (["--genetic.mutations", "19"], "genetic.mutations must be at most"),
        (["--step", "64"], "did you mean --steps"),
        (["--steps", "many"], "--steps"),
        (["--condition", "outofband"], "out-of-band"),
        (["--seed", "-1"], "seed must be a whole number"),
        (["--target-damage", "left_pectoral:lenght=0.5"], "did you mean 'length'"),
        (["--target-damage", "left_fin:length=0.5"], "damage fin must be one of"),
        (["--target-morphology", "/nowhere.json"], "target_morphology must be a file"),
        (["--target-engine", "bullet"], "--target-engine"),
        (["--current", "0", "nan", "0"], "current must be finite"),
        (["--threads", "0"], "threads must be"),
        (["--out-of-band.period", "0"], "out_of_band.period"),
        (["--behavior.maximum", "0"], "behavior.maximum"),
        (["--out", "/proc/nothing/here"], "out must be a directory that can be written"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(tmp_path, capsys, arguments, message):
    out = [] if "--out" in arguments else ["--out", str(tmp_path / "out")]
    assert main([*QUICK, *out, *arguments]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert message in said.err
    assert said.err.count("\n") == 1
    assert not (tmp_path / "out" / "run.json").exists()


@pytest.mark.parametrize("arguments", [[], ["rum"], ["run"], ["run", "--ouut", "x"]])
def test_an_incomplete_command_is_explained_in_one_line(capsys, arguments):
    assert main(arguments) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert len(said) > len("eea: \n")


def test_the_nearest_subcommand_is_offered(capsys):
    assert main(["rum"]) == 2
    said = capsys.readouterr().err
    assert said == (
        "eea: the command must be one of run, recover; got 'rum'; did you mean 'run'?\n"
    )


def test_recover_is_run_with_the_case_studys_settings(tmp_path):
    out = tmp_path / "out"
    assert main(["recover", *QUICK[1:], "--condition", "out-of-band", "--out", str(out)]) == 0
    config = json.loads((out / "run.json").read_text())["config"]
    assert config["genetic"]["crossover"] == "two_point"
    assert (config["out_of_band"]["sampled_models"], config["out_of_band"]["revisit"]) == (5, 5)
    assert (config["steps"], config["rounds"]) == (32, 2)


def test_a_run_without_a_round_says_so_and_leaves_a_result(tmp_path, capsys):
    assert main([*QUICK, "--time-limit", "0", "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert "no round was completed" in printed
    assert "stopped: time" in printed
    result = json.loads((tmp_path / "result.json").read_text())
    assert (result["stopped"], result["rounds"], result["morphology"]) == ("time", [], None)
    assert not (tmp_path / "rounds.png").exists()


@pytest.mark.parametrize("name", ["rounds.jsonl", "result.json", "rounds.png"])
def test_files_that_are_not_a_runs_are_left_alone(tmp_path, capsys, name):
    (tmp_path / name).write_text("mine")
    assert main([*QUICK, "--out", str(tmp_path)]) == 2
    assert f"holds {name} but no run.json" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text() == "mine"


def test_help_lists_the_options(capsys):
    assert main(["run", "--help"]) == 0
    printed = capsys.readouterr().out
    for option in ("--condition", "--steps", "--rounds", "--seed", "--target-damage", "--out"):
        assert option in printed


def test_ctrl_c_leaves_readable_output(tmp_path):
    out = tmp_path / "run"
    arguments = [*QUICK, "--rounds", "100000", "--out", str(out)]
    process = subprocess.Popen(
        [sys.executable, "-m", "eea", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "COLUMNS": "200"},
    )
    try:
        deadline = time.monotonic() + 60
        log = out / "rounds.jsonl"
        while time.monotonic() < deadline and not (log.exists() and log.stat().st_size > 2000):
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 130
    assert said == "eea: interrupted\n"
    records = read_records(out / "rounds.jsonl")
    result = json.loads((out / "result.json").read_text())
    assert result["stopped"] == "interrupted"
    assert len(records) >= 1
    # The signal may come between a round's end and its line in the log.
    assert abs(len(records) - len(result["rounds"])) <= 1
    assert all(a == b for a, b in zip(records, result["rounds"], strict=False))
    assert (out / "rounds.png").exists()
