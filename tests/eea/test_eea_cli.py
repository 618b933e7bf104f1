from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

import eea.cli.run
from aquafish_gym.bodies import body_array, read_bodies
from aquafish_gym.command_line import read_morphology
from aquafish_gym.damage import Damage
from aquafish_gym.morphology import Morphology
from aquafish_gym.runs.storage import read_document
from eea.__main__ import main
from eea.cli.run import damage_words
from eea.core.config import PaperConfig
from eea.core.result import Result
from eea.fish import fish_models, load_posterior
from quick_run import QUICK

JOINT = [
    "run",
    *("--condition", "joint", "--steps", "64", "--rounds", "2", "--target-engine", "numba"),
    *("--joint.bodies", "24", "--joint.poses", "24", "--joint.descents", "6"),
    *("--joint.polished", "2", "--joint.restarts", "0", "--joint.alternatives", "never"),
    *("--target-damage", "left_pectoral:length=0.5"),
]


def rounds_in(folder):
    return read_document(folder / "result.json", "eea.result/1")["rounds"]


def without_clock(records):
    return [{**record, "seconds": None} for record in records]


def test_a_run_writes_its_rounds_its_result_and_its_picture(tmp_path, capsys):
    out = tmp_path / "new" / "run"
    assert main([*QUICK, "--out", str(out)]) == 0
    result = read_document(out / "result.json", "eea.result/1")
    run = read_document(out / "settings.json")["settings"]
    assert [r["round"] for r in result["rounds"]] == [1, 2]
    assert result["stopped"] == "rounds"
    assert result["truth"][1] == 0.8
    assert run["steps"] == result["config"]["steps"] == 32
    assert (run["target_damage"], run["target_engine"]) == ("left_pectoral:length=0.5", "numba")
    assert run["target_morphology"] == Morphology.nominal().to_dict()
    names = {"settings.json", "result.json", "morphology.json", "rounds.png"}
    assert {path.name for path in out.iterdir()} == names
    assert (out / "rounds.png").read_bytes().startswith(b"\x89PNG")
    printed = capsys.readouterr().out
    for words in ("experiments  2/2", "best MOD_FIT", "OBJ_FIT 0.", "in units of 5 cm"):
        assert words in printed
    assert [row.split()[2] for row in printed.splitlines() if "left_pectoral.l" in row] == ["0.800"]
    level = f"a random body {result['chance']:.2f}, a mid-range body {result['mid_range']:.2f}"
    assert level in printed
    body = Morphology.from_array(result["morphology"])
    assert read_morphology(out / "morphology.json", "body") == body
    assert read_morphology(out / "result.json", "body") == body
    found = f"left flipper: half its length, found {body.left_pectoral[1]:.2f} where it was 1.60"
    assert f"\n{found}\n" in printed
    assert f"python -m gait evolve --morphology {out / 'morphology.json'}" in printed


def test_a_run_of_joint_inference_says_how_sure_it_is(tmp_path, capsys):
    out = tmp_path / "run"
    assert main([*JOINT, "--out", str(out)]) == 0
    names = {"settings.json", "result.json", "morphology.json", "rounds.png"}
    names |= {"posterior.npz", "posterior.png", "bodies.json"}
    assert {path.name for path in out.iterdir()} == names
    assert (out / "posterior.png").read_bytes().startswith(b"\x89PNG")
    result = read_document(out / "result.json", "eea.result/1")
    ends = result["belief"]["intervals"]["90%"]["left_pectoral.length"]
    belief = load_posterior(out / "posterior.npz")
    low, high = belief.interval(0.9)
    assert belief.table(0.9)["left_pectoral.length"] == tuple(ends)
    bodies = body_array(read_bodies(out / "bodies.json"))
    assert np.array_equal(bodies, belief.sample(50, np.random.default_rng(0)))
    printed = capsys.readouterr().out
    assert "experiments  2/2  90% intervals " in printed
    assert "% of the ranges wide  OBJ_FIT 1.000" in printed
    row = f"{'left_pectoral.length':26s} {result['morphology'][1]:6.3f}"
    assert f"\n{row}  {low[1]:6.3f} to {high[1]:5.3f}   0.800\n" in printed
    truth = np.array(result["truth"])
    held = int(((low <= truth) & (truth <= high)).sum())
    assert f"\nthe 90% intervals hold {held} of the 9 true sizes\n" in printed
    nuisances = [line.split()[:2] for line in printed.splitlines() if line.startswith("servo gain")]
    assert len(nuisances) == 1
    for sentence in [*belief.findings, belief.verdict]:
        assert printed.count(f"\n{sentence}\n") == 1
    assert f"python -m gait evolve --morphology {out / 'bodies.json'}\n" in printed


def test_a_run_of_joint_inference_without_a_round_leaves_no_posterior(tmp_path, capsys):
    assert main([*JOINT, "--time-limit", "0", "--out", str(tmp_path)]) == 0
    assert "no round was completed" in capsys.readouterr().out
    assert {path.name for path in tmp_path.iterdir()} == {"settings.json", "result.json"}


@pytest.mark.parametrize("command", ["run", "recover"])
def test_of_two_commands_in_a_folder_the_second_is_told_of_the_first(
    tmp_path, capsys, monkeypatch, command
):
    arguments = [command, *QUICK[1:], "--out", str(tmp_path)]
    line, codes = eea.cli.run._progress_line, []

    def begin_another(record, config):
        codes.append(main(arguments))
        return line(record, config)

    monkeypatch.setattr(eea.cli.run, "_progress_line", begin_another)
    assert main(arguments) == 0
    assert codes == [2, 2]
    said = capsys.readouterr().err
    assert said.count(f"{tmp_path} is in use by another command, process {os.getpid()}") == 2
    assert [r["round"] for r in rounds_in(tmp_path)] == [1, 2]
    assert not (tmp_path / "lock").exists()


def test_the_same_run_may_be_repeated_in_place_and_another_not(tmp_path, capsys):
    arguments = [*QUICK, "--out", str(tmp_path)]
    assert main(arguments) == 0
    first = read_document(tmp_path / "result.json")
    assert main(arguments) == 0
    again = read_document(tmp_path / "result.json")
    assert without_clock(again["rounds"]) == without_clock(first["rounds"])
    said = capsys.readouterr().out
    assert said.count(f"replacing the earlier run in {tmp_path} (2 rounds)") == 1
    for other, difference in (
        (["--seed", "1"], "seed 0, not 1"),
        (["--rounds", "3"], "rounds 2, not 3"),
        (["--genetic.elites", "2"], "genetic.elites 1, not 2"),
        (["--target-damage", "none"], "target_damage 'left_pectoral:length=0.5', not 'none'"),
    ):
        assert main([*arguments, *other]) == 2
        said = capsys.readouterr().err
        assert f"holds a run of the algorithm with {difference}; " in said
        assert said.count("\n") == 1
    (tmp_path / "settings.json").write_text("nonsense")
    assert main(arguments) == 2
    assert "settings.json is not JSON" in capsys.readouterr().err
    assert read_document(tmp_path / "result.json") == again


def test_a_body_can_be_read_from_a_file(tmp_path):
    body = tmp_path / "body.json"
    sizes = {"left_pectoral": [0, 0, 0], "right_pectoral": [1, 2, 0.5], "caudal": [0.5, 2, 1]}
    body.write_text(json.dumps(sizes))
    out = tmp_path / "out"
    assert main([*QUICK, "--target-morphology", str(body), "--out", str(out)]) == 0
    truth = json.loads((out / "result.json").read_text())["truth"]
    assert truth == [0, 0, 0, 1, 2, 0.5, 0.5, 2, 1]


def test_recover_is_run_with_the_case_studys_settings(tmp_path):
    out = tmp_path / "out"
    assert main(["recover", *QUICK[1:], "--condition", "out-of-band", "--out", str(out)]) == 0
    config = read_document(out / "result.json")["config"]
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
        self.line, self.after = eea.cli.run._progress_line, after
        monkeypatch.setattr(eea.cli.run, "_progress_line", self)

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


def test_an_interrupted_run_is_repeated_and_replaced_by_the_same_rounds(tmp_path, monkeypatch):
    assert main([*QUICK, "--rounds", "3", "--out", str(tmp_path / "undisturbed")]) == 0
    expected = without_clock(rounds_in(tmp_path / "undisturbed"))
    tmp_path = tmp_path / "interrupted"
    arguments = [*QUICK, "--rounds", "3", "--out", str(tmp_path)]
    for after, kept in ((2, 2), (1, 2), (3, 3)):  # the second has less and replaces nothing
        with monkeypatch.context() as patch:
            Stop(patch, after)
            assert main(arguments) == 130
        result = read_document(tmp_path / "result.json")
        assert without_clock(result["rounds"]) == expected[:kept]
        assert result["stopped"] == "interrupted"
        body = read_morphology(tmp_path / "morphology.json", "body")
        assert body.to_array().tolist() == result["morphology"]
        assert (tmp_path / "rounds.png").exists()
    assert main(arguments) == 0
    assert without_clock(rounds_in(tmp_path)) == expected
    assert read_document(tmp_path / "result.json")["stopped"] == "rounds"
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]


def test_a_damaged_result_is_none_and_is_replaced(tmp_path, capsys):
    arguments = [*QUICK, "--out", str(tmp_path)]
    assert main(arguments) == 0
    path = tmp_path / "result.json"
    whole = path.read_bytes()
    path.write_bytes(whole.replace(b'"seed": 0', b'"seed": 1'))
    capsys.readouterr()
    assert main(arguments) == 0
    assert "replacing the earlier run" not in capsys.readouterr().out
    assert without_clock(rounds_in(tmp_path)) == without_clock(json.loads(whole)["rounds"])


def words_for(damage: str, found: list[float] | None = None) -> list[str]:
    what = Damage.parse(damage)
    broken = what.effect(Morphology.nominal()).body.to_array()
    result = Result(PaperConfig(), 0, fish_models(), broken)
    model = broken if found is None else found
    stub = type("Found", (Result,), {"model": np.asarray(model)})
    made = stub(PaperConfig(), 0, result.layout, result.truth)
    return damage_words(Morphology.nominal(), what, made)


def test_it_is_said_in_words_what_broke_and_what_was_found():
    assert words_for("none") == ["nothing was broken"]
    found = [0.4, 0.79, 0.1, 0.4, 1.6, 0.1, 0.4, 1.4, 0.6]
    assert words_for("left_pectoral:length=0.5", found) == [
        "left flipper: half its length, found 0.79 where it was 1.60"
    ]
    assert words_for("left_pectoral:length=0.25;caudal:width=0.9") == [
        "left flipper: a quarter of its length, found 0.40 where it was 1.60",
        "tail: 90% of its width, found 0.54 where it was 0.60",
    ]
    assert words_for("caudal:missing") == [
        f"tail: nothing of its {size}, found 0.00 where it was {was}"
        for size, was in (("thickness", "0.40"), ("length", "1.40"), ("width", "0.60"))
    ]
    assert words_for("caudal:width=0.9;caudal:dead@1;gyro_x:bias=0.1") == [
        "tail: 90% of its width, found 0.54 where it was 0.60",
        "servo of the tail: dead, from 1 s on; gyro_x: says 0.1 rad/s too much",
    ]
    assert words_for("caudal:missing@1+1")[-1] == "tail: missing, from 1 to 2 s"


def test_recover_breaks_what_the_case_study_breaks(tmp_path, capsys):
    arguments = [word for word in QUICK[1:] if "damage" not in word and "=0.5" not in word]
    assert main(["recover", *arguments, "--out", str(tmp_path)]) == 0
    assert "left flipper: half its length, found " in capsys.readouterr().out
    assert read_document(tmp_path / "result.json")["truth"][1] == 0.8


def test_ctrl_c_leaves_readable_output(tmp_path):
    out = tmp_path / "run"
    arguments = [*QUICK, "--rounds", "10000", "--out", str(out)]
    process = subprocess.Popen(
        [sys.executable, "-m", "eea", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "COLUMNS": "200"},
    )
    try:
        deadline = time.monotonic() + 60
        path = out / "result.json"
        while time.monotonic() < deadline and not (path.exists() and path.stat().st_size > 4000):
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 130
    assert said == "eea: interrupted\n"
    result = read_document(out / "result.json")
    assert result["stopped"] == "interrupted"
    assert [record["round"] for record in result["rounds"]] == [
        number + 1 for number in range(len(result["rounds"]))
    ]
    assert len(result["rounds"]) >= 1
    assert (out / "rounds.png").exists()
