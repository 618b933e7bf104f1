"""The command run: its files, its report, and what it refuses."""

from __future__ import annotations

import numpy as np

import eea.cli.run
from aquafish_gym.bodies import body_array, read_bodies
from aquafish_gym.morphology import Morphology
from aquafish_gym.runs.command_line import parse, read_morphology
from aquafish_gym.utils.storage import read_document
from eea.__main__ import REFUSED_ERRORS as ERRORS
from eea.__main__ import main
from eea.cli.run import Run
from eea.core.config import Config, JointConfig, PaperConfig, recovery_config
from eea.fish import load_posterior
from quick_run import QUICK

JOINT = [
    "run",
    *("--condition", "joint", "--steps", "64", "--rounds", "2", "--target-engine", "numba"),
    *("--joint.bodies", "24", "--joint.poses", "24", "--joint.descents", "6"),
    *("--joint.polished", "2", "--joint.restarts", "0", "--joint.alternatives", "never"),
    *("--damage", "left_pectoral:length=0.5"),
]


def rounds_in(folder):
    return read_document(folder / "result.json", "eea.result/1")["rounds"]


def config_of(*arguments: str) -> Config:
    return parse(Run, "run", [*arguments, "--out", "x"], ERRORS).config()


def test_conditions_have_their_recommended_settings():
    assert config_of() == JointConfig()
    assert config_of("--condition", "out-of-band") == PaperConfig()
    assert config_of("--condition", "in-band") == PaperConfig("in-band")
    assert config_of("--condition", "ideal") == PaperConfig("ideal")
    assert config_of("--condition", "recovery") == recovery_config()
    assert recovery_config().to_dict()["condition"] == "recovery"
    changed = config_of("--condition", "recovery", "--rounds", "4", "--out-of-band.period", "9")
    assert (changed.rounds, changed.out_of_band.period) == (4, 9)
    assert (changed.out_of_band.sampled_models, changed.out_of_band.revisit) == (5, 5)


def test_a_run_writes_its_rounds_its_result_and_its_figure(tmp_path, capsys):
    out = tmp_path / "new" / "run"
    assert main([*QUICK, "--out", str(out)]) == 0
    result = read_document(out / "result.json", "eea.result/1")
    assert [r["round"] for r in result["rounds"]] == [1, 2]
    assert result["stopped"] == "rounds"
    assert result["truth"][1] == 0.8
    names = {"settings.json", "result.json", "times.json", "morphology.json", "rounds.png"}
    assert {path.name for path in out.iterdir()} == names
    printed = capsys.readouterr().out
    assert "experiments  2/2  best MOD_FIT" in printed
    assert [row.split()[2] for row in printed.splitlines() if "left_pectoral.l" in row] == ["0.800"]
    body = Morphology.from_array(result["morphology"])
    assert read_morphology(out / "morphology.json", "body") == body
    assert read_morphology(out / "result.json", "body") == body


def test_equal_runs_have_equal_results_and_times_of_their_own(tmp_path):
    for name in ("a", "b"):
        assert main([*QUICK, "--out", str(tmp_path / name)]) == 0
    names = ("settings.json", "result.json", "morphology.json", "rounds.png")
    for name in names:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    assert "seconds" not in rounds_in(tmp_path / "a")[0]
    assert len(read_document(tmp_path / "a" / "times.json")["seconds"]) == 2


def test_joint_inference_writes_its_posterior(tmp_path, capsys):
    out = tmp_path / "run"
    assert main([*JOINT, "--out", str(out)]) == 0
    names = {"settings.json", "result.json", "times.json", "morphology.json", "rounds.png"}
    names |= {"posterior.npz", "posterior.png", "bodies.json"}
    assert {path.name for path in out.iterdir()} == names
    result = read_document(out / "result.json", "eea.result/1")
    belief = load_posterior(out / "posterior.npz")
    ends = result["belief"]["intervals"]["90%"]["left_pectoral.length"]
    assert belief.table(0.9)["left_pectoral.length"] == tuple(ends)
    bodies = body_array(read_bodies(out / "bodies.json"))
    assert np.array_equal(bodies, belief.sample(50, np.random.default_rng(0)))
    printed = capsys.readouterr().out
    for sentence in [*belief.findings, belief.verdict]:
        assert printed.count(f"\n{sentence}\n") == 1


def test_the_same_run_may_be_repeated_in_place_and_another_not(tmp_path, capsys):
    arguments = [*QUICK, "--out", str(tmp_path)]
    assert main(arguments) == 0
    first = (tmp_path / "result.json").read_bytes()
    assert main(arguments) == 0
    assert (tmp_path / "result.json").read_bytes() == first
    for other, difference in (
        (["--seed", "1"], "seed 0, not 1"),
        (["--exploration.population", "7"], "exploration.population 6, not 7"),
        (["--damage", "none"], "target_damage 'left_pectoral:length=0.5', not 'none'"),
    ):
        assert main([*arguments, *other]) == 2
        assert f"holds a run of the algorithm with {difference}" in capsys.readouterr().err
    assert (tmp_path / "result.json").read_bytes() == first


def test_an_interrupted_run_keeps_its_rounds_and_can_be_repeated(tmp_path, monkeypatch):
    arguments = [*QUICK, "--rounds", "3", "--out", str(tmp_path)]
    line = eea.cli.run._round_line

    def stop(record, result):
        if record.round == 2:
            raise KeyboardInterrupt
        return line(record, result)

    with monkeypatch.context() as patch:
        patch.setattr(eea.cli.run, "_round_line", stop)
        assert main(arguments) == 130
    result = read_document(tmp_path / "result.json")
    assert (result["stopped"], len(result["rounds"])) == ("interrupted", 2)
    body = read_morphology(tmp_path / "morphology.json", "body")
    assert body.to_array().tolist() == result["morphology"]
    assert (tmp_path / "rounds.png").exists()
    assert main(arguments) == 0
    assert rounds_in(tmp_path)[:2] == result["rounds"]
    assert read_document(tmp_path / "result.json")["stopped"] == "rounds"
