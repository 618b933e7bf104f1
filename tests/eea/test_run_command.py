"""The command run: its settings, its files, its figure, and what it refuses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import eea.cli.run
from aquafish_gym.bodies import body_array, read_bodies
from aquafish_gym.morphology import Morphology
from aquafish_gym.runs.command_line import parse, read_morphology
from aquafish_gym.utils.storage import read_document, write_document
from eea.__main__ import REFUSED_ERRORS as ERRORS
from eea.__main__ import main
from eea.cli.run import Run
from eea.cli.study import StudyCommand
from eea.core.config import (
    CONDITIONS,
    EstimationConfig,
    ExplorationConfig,
    GeneticConfig,
    InBandConfig,
    JointConfig,
    PaperConfig,
    config_for,
    recovery_config,
)
from eea.fish import load_posterior
from eea.fish.plots import fitness_figure
from fake_fish import STEPS, fake_eea

QUICK = [
    "run",
    *("--condition", "none", "--steps", "32", "--rounds", "2", "--target-engine", "numba"),
    *("--exploration.population", "6", "--exploration.generations", "3"),
    *("--estimation.population", "8", "--estimation.generations", "5"),
    *("--target-damage", "left_pectoral:length=0.5"),
]
JOINT = [
    "run",
    *("--condition", "joint", "--steps", "64", "--rounds", "2", "--target-engine", "numba"),
    *("--joint.bodies", "24", "--joint.poses", "24", "--joint.descents", "6"),
    *("--joint.polished", "2", "--joint.restarts", "0", "--joint.alternatives", "never"),
    *("--damage", "left_pectoral:length=0.5"),
]


def rounds_in(folder):
    return read_document(folder / "result.json", "eea.result/1")["rounds"]


def config_of(*arguments):
    return parse(Run, "run", [*arguments, "--out", "x"], ERRORS).config()


def test_conditions_have_their_recommended_settings():
    assert config_of() == config_for() == JointConfig()
    for name in CONDITIONS:
        assert config_of("--condition", name) == config_for(name) == PaperConfig(name)
    assert config_of("--condition", "recovery") == config_for("recovery") == recovery_config()
    assert recovery_config().to_dict()["condition"] == "recovery"
    changed = config_of("--condition", "recovery", "--rounds", "4", "--out-of-band.period", "9")
    assert (changed.rounds, changed.out_of_band.period) == (4, 9)
    assert (changed.out_of_band.sampled_models, changed.out_of_band.revisit) == (5, 5)


def test_a_run_writes_its_rounds_its_result_and_its_figure(tmp_path, capsys):
    out = tmp_path / "new" / "run"
    assert main([*QUICK, "--out", str(out)]) == 0
    result = read_document(out / "result.json", "eea.result/1")
    assert [r["round"] for r in result["rounds"]] == [1, 2]
    assert "seconds" not in result["rounds"][0]
    assert len(read_document(out / "times.json")["seconds"]) == 2
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


def test_the_same_run_may_be_repeated_in_place_and_another_not(tmp_path, capsys):
    arguments = [*QUICK, "--out", str(tmp_path)]

    def written():
        return {p.name: p.read_bytes() for p in tmp_path.iterdir() if p.name != "times.json"}

    assert main(arguments) == 0
    first = written()
    assert main(arguments) == 0
    assert written() == first
    for other, difference in (
        (["--seed", "1"], "seed 0, not 1"),
        (["--exploration.population", "7"], "exploration.population 6, not 7"),
        (["--damage", "none"], "target_damage 'left_pectoral:length=0.5', not 'none'"),
    ):
        assert main([*arguments, *other]) == 2
        assert f"holds a run of the algorithm with {difference}" in capsys.readouterr().err
    write_document(
        tmp_path / "settings.json", {"kind": "a gait run", "settings": {}, "code": []},
        "aquafish.folder/1",
    )  # fmt: skip
    before = written()
    assert main(arguments) == 2
    assert f"{tmp_path} holds a gait run\n" in capsys.readouterr().err
    assert written() == before


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


@pytest.mark.parametrize(
    ("words", "revisit", "models"),
    [
        ([], 5, 5),
        (["--out-of-band.revisit", "0"], 0, 5),
        (["--out_of_band.revisit=0"], 0, 5),
        (["--out-of-band.sampled-models", "None"], 5, None),
    ],
)
def test_a_value_equal_to_a_default_counts_as_given(words, revisit, models):
    found = config_of("--condition", "recovery", *words).out_of_band
    assert (found.revisit, found.sampled_models) == (revisit, models)


def test_the_papers_choices_are_options_of_run_and_study():
    words = [
        *("--out", "out", "--in-band.best", "5", "--in-band.confidence", "0.75"),
        *("--in-band.dynamic-split", "--in-band.extension", "0.2"),
        *("--genetic.coding", "binary", "--genetic.crossover", "two-point"),
        *("--genetic.crossover-rate", "0.5", "--genetic.mutations", "2.5", "--genetic.elites", "3"),
        *("--exploration.initial-angles", "random"),
    ]
    run = parse(Run, "run", [*words, "--condition", "in-band"]).config()
    study = parse(StudyCommand, "study", [*words, "--figure", "5", "7"]).study()
    in_band = InBandConfig(best=5, confidence=0.75, dynamic_split=True, extension=0.2)
    genetic = GeneticConfig("binary", "two-point", 0.5, 2.5, 3)
    for config in (run, study.arms["in-band"]):
        assert config.in_band == in_band
        assert (config.genetic, config.exploration.initial_angles) == (genetic, "random")
    assert study.arms["ideal"].genetic == genetic
    assert study.arms["ideal"].in_band == InBandConfig()  # it has no range


def test_a_preset_leaves_what_was_given_at_its_default():
    words = ["--out", "out", "--preset", "smoke", "--exploration.population", "25"]
    study = parse(StudyCommand, "study", words).study()
    assert {arm.exploration.population for arm in study.arms.values()} == {25}
    assert {arm.exploration.generations for arm in study.arms.values()} == {3}
    plain = parse(StudyCommand, "study", words[:4]).study()
    assert {arm.exploration.population for arm in plain.arms.values()} == {6}


def test_the_figure_shows_both_fitnesses_and_the_levels_beside_them():
    config = PaperConfig(
        "none", STEPS, 3, exploration=ExplorationConfig(4, 2), estimation=EstimationConfig(6, 3)
    )
    result = fake_eea(config).run()
    lines = {line.get_label(): line for line in fitness_figure(result).axes[0].lines}
    objective = next(line for label, line in lines.items() if label.startswith("OBJ_FIT"))
    model = next(line for label, line in lines.items() if label.startswith("MOD_FIT"))
    assert objective.get_ydata().tolist() == [r.objective_fitness for r in result.rounds]
    assert model.get_ydata().tolist() == [r.model_fitness for r in result.rounds]
    assert list(objective.get_xdata()) == [1, 2, 3]
    assert set(lines["random bodies"].get_ydata()) == {result.chance}
    assert set(lines["mid-range body"].get_ydata()) == {result.mid_range}
    assert set(lines["quantisation limit"].get_ydata()) == {result.nearest}
    # A fitness far below zero does not squash the rest.
    result.rounds[1] = replace(result.rounds[1], model_fitness=-3.25)
    assert fitness_figure(result).axes[0].get_ylim()[0] == 0
