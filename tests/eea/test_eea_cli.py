from __future__ import annotations

import itertools
import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

import eea.__main__
from aquafish_gym.morphology import Morphology
from aquafish_gym.runs.storage import append_record, read_records
from eea.__main__ import main
from eea.cli.folder import RunFolder

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
    for words in ("experiments  2/2", "best MOD_FIT", "OBJ_FIT 0.", "in units of 5 cm"):
        assert words in printed
    assert [row.split()[2] for row in printed.splitlines() if "left_pectoral.l" in row] == ["0.800"]
    level = f"a random body {result['chance']:.2f}, a mid-range body {result['mid_range']:.2f}"
    assert level in printed
    body = Morphology.from_array(result["morphology"])
    assert (out / "morphology.json").read_text() == body.to_json()
    assert f"python -m gait evolve --morphology {out / 'morphology.json'}" in printed


@pytest.mark.parametrize("command", ["run", "recover"])
def test_of_two_commands_in_a_folder_the_second_is_told_of_the_first(
    tmp_path, capsys, monkeypatch, command
):
    arguments = [command, *QUICK[1:], "--out", str(tmp_path)]
    add, codes = RunFolder.add, []

    def add_and_begin_another(folder, eea):
        add(folder, eea)
        codes.append(main(arguments))

    monkeypatch.setattr(RunFolder, "add", add_and_begin_another)
    assert main(arguments) == 0
    assert codes == [2, 2]
    said = capsys.readouterr().err
    assert said.count(f"{tmp_path} is in use by another command, process {os.getpid()}") == 2
    assert [r["round"] for r in read_records(tmp_path / "rounds.jsonl")] == [1, 2]
    assert not (tmp_path / "lock").exists()


def test_the_same_run_may_be_repeated_in_place_and_another_not(tmp_path, capsys):
    arguments = [*QUICK, "--out", str(tmp_path)]
    assert main(arguments) == 0
    first = json.loads((tmp_path / "result.json").read_text())
    assert main(arguments) == 0
    again = json.loads((tmp_path / "result.json").read_text())
    assert again["morphology"] == first["morphology"]
    assert len(read_records(tmp_path / "rounds.jsonl")) == 2
    said = capsys.readouterr().out
    assert said.count(f"replacing the earlier run in {tmp_path} (2 rounds)") == 1
    for other, difference in (
        (["--seed", "1"], "seed 0, not 1"),
        (["--rounds", "3"], "rounds 2, not 3"),
        (["--genetic.elites", "2"], "genetic.elites 1, not 2"),
        (["--target-damage", "none"], "target_damage left_pectoral:length=0.5, not none"),
    ):
        assert main([*arguments, *other]) == 2
        said = capsys.readouterr().err
        assert f"holds another run, with {difference}\n" in said
        assert said.count("\n") == 1
    (tmp_path / "run.json").write_text("nonsense")
    assert main(arguments) == 2
    assert "run.json is damaged" in capsys.readouterr().err
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


def test_a_missing_out_is_said_in_short(capsys):
    assert main(["run", "--seed", "1"]) == 2
    assert capsys.readouterr().err == "eea: --out is required\n"
    assert main(["recover", "--ouut", "x"]) == 2
    assert capsys.readouterr().err == "eea: --out is required; got --ouut\n"


def test_the_nearest_subcommand_is_offered(capsys):
    assert main(["rum"]) == 2
    said = capsys.readouterr().err
    assert said == (
        "eea: the command must be one of run, recover, study, plot; got 'rum'; "
        "did you mean 'run'?\n"
    )


def test_recover_is_run_with_the_case_studys_settings(tmp_path):
    out = tmp_path / "out"
    assert main(["recover", *QUICK[1:], "--condition", "out-of-band", "--out", str(out)]) == 0
    config = json.loads((out / "run.json").read_text())["config"]
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


class Stop:
    """Ctrl-C while a round's progress line is made."""

    def __init__(self, monkeypatch, after):
        self.line, self.after = eea.__main__._progress_line, after
        monkeypatch.setattr(eea.__main__, "_progress_line", self)

    def __call__(self, record, config):
        if record.round == self.after:
            raise KeyboardInterrupt
        return self.line(record, config)


def test_a_repetition_that_is_broken_off_early_loses_no_round(tmp_path, capsys, monkeypatch):
    arguments = [*QUICK, "--out", str(tmp_path)]
    assert main(arguments) == 0
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    with monkeypatch.context() as patch:
        Stop(patch, after=1)
        assert main(arguments) == 130
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
    said = capsys.readouterr().out
    assert "after 1 round; " in said
    assert "still holds the earlier run (2 rounds)" in said


def without_clock(records):
    return [{**record, "seconds": None} for record in records]


def test_an_interrupted_run_is_gone_on_with(tmp_path, monkeypatch, capsys):
    assert main([*QUICK, "--rounds", "3", "--out", str(tmp_path / "undisturbed")]) == 0
    expected = read_records(tmp_path / "undisturbed" / "rounds.jsonl")
    tmp_path = tmp_path / "interrupted"
    arguments = [*QUICK, "--rounds", "3", "--out", str(tmp_path)]
    for after in (1, 2):
        with monkeypatch.context() as patch:
            Stop(patch, after)
            assert main(arguments) == 130
        result = json.loads((tmp_path / "result.json").read_text())
        assert len(result["rounds"]) == after
        assert read_records(tmp_path / "rounds.jsonl") == result["rounds"]
        body = Morphology.from_json((tmp_path / "morphology.json").read_text())
        assert body.to_array().tolist() == result["morphology"]
    # As if it had been killed between a round's line and its state.
    append_record(tmp_path / "rounds.jsonl", {"round": 3})
    capsys.readouterr()
    assert main(arguments) == 0
    said = capsys.readouterr().out
    assert said.startswith(f"going on with the earlier run in {tmp_path} (2 rounds)\n")
    assert "experiments  2/3" not in said
    result = json.loads((tmp_path / "result.json").read_text())
    assert without_clock(result["rounds"]) == without_clock(expected)
    assert np.all(np.diff([record["seconds"] for record in result["rounds"]]) > 0.0)
    assert not (tmp_path / "rounds.state").exists()
    assert result["stopped"] == "rounds"
    assert read_records(tmp_path / "rounds.jsonl") == result["rounds"]
    assert len(result["rounds"]) == 3
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]


@pytest.mark.parametrize(
    ("names", "kind"),
    [
        (["checkpoint.json"], "a gait run"),
        (["controller.json"], "a gait run"),
        (["config.json", "seed-000"], "a case study"),
    ],
)
def test_the_folders_of_other_programs_are_refused(tmp_path, capsys, names, kind):
    for name in names:
        (tmp_path / name).write_text("{}")
    assert main([*QUICK, "--out", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert f"holds {kind} ({names[0]})" in said
    assert said.count("\n") == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names)


@pytest.mark.parametrize("name", ["rounds.jsonl", "result.json", "rounds.png", "morphology.json"])
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


@pytest.mark.parametrize("command", ["run", "recover"])
def test_help_is_text_and_says_what_each_option_is(capsys, monkeypatch, command):
    monkeypatch.setenv("COLUMNS", "120")
    assert main([command, "--help"]) == 0
    printed = capsys.readouterr().out
    rows = [row.strip(" │") for row in printed.splitlines()]
    for row, after in itertools.pairwise(rows):
        if row.startswith("--") and not row.startswith("---"):
            assert after[:1].isupper(), row  # a sentence, and not the default alone
    assert "``" not in printed
    assert 'FIN:SIZE=FACTOR or FIN:missing, joined by ";"' in printed
    assert ("Unlike run" in printed) == (command == "recover")


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


@pytest.mark.parametrize("spoilt", ["rounds.state", "rounds.jsonl"])
def test_a_broken_off_run_whose_files_disagree_begins_anew(tmp_path, monkeypatch, capsys, spoilt):
    arguments = [*QUICK, "--rounds", "3", "--out", str(tmp_path)]
    with monkeypatch.context() as patch:
        Stop(patch, after=2)
        assert main(arguments) == 130
    path = tmp_path / spoilt
    path.write_bytes(path.read_bytes().replace(b"0.", b"1.", 1))
    assert main(arguments) == 0
    said = capsys.readouterr().out
    assert "replacing the earlier run" in said
    assert said.count("experiments  1/3") == 2
    assert len(read_records(tmp_path / "rounds.jsonl")) == 3
    assert not (tmp_path / "rounds.state").exists()
