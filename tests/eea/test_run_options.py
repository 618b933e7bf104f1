"""What the command run refuses, and what it says of its options."""

from __future__ import annotations

import pytest

from aquafish_gym.runs.command_line import parse
from aquafish_gym.utils.storage import write_document
from eea.__main__ import main
from eea.cli.run import Run
from eea.cli.study import StudyCommand
from eea.core.config import GeneticConfig, InBandConfig
from quick_run import QUICK


@pytest.mark.parametrize(
    ("words", "changes"),
    [
        ([], {"revisit": 5, "sampled_models": 5}),
        (["--out-of-band.revisit", "0"], {"revisit": 0, "sampled_models": 5}),
        (["--out_of_band.revisit=0"], {"revisit": 0, "sampled_models": 5}),
        (["--out-of-band.sampled-models", "None"], {"revisit": 5, "sampled_models": None}),
        (["--out-of-band.revisit", "3"], {"revisit": 3, "sampled_models": 5}),
    ],
)
def test_a_value_equal_to_a_default_counts_as_given(words, changes):
    command = parse(Run, "run", ["--out", "out", "--condition", "recovery", *words])
    config = command.config()
    assert {name: getattr(config.out_of_band, name) for name in changes} == changes


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


def test_the_folder_of_another_program_is_refused(tmp_path, capsys):
    write_document(
        tmp_path / "settings.json",
        {"kind": "a gait run", "settings": {}, "code": []},
        "aquafish.folder/1",
    )
    assert main([*QUICK, "--out", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert f"{tmp_path} holds a gait run\n" in said
    assert said.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["settings.json"]
