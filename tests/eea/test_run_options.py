"""What the command run refuses, and what it says of its options."""

from __future__ import annotations

import pytest

from aquafish_gym.runs.storage import write_document
from eea.__main__ import main
from quick_run import QUICK


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--steps", "100"], "steps must be a power of two; got 100"),
        (["--condition", "joint", "--steps", "8"], "at least 16"),
        (["--condition", "joint", "--joint.nuisances", "curent"], "did you mean 'current'"),
        (["--exploration.population", "1"], "exploration.population must be a whole number of at"),
        (["--seed", "1" + 400 * "0"], "seed must be a whole number"),
        (["--out", ""], "--out must not be empty"),
        (["--target-damage", "left_pectoral:lenght=0.5"], "did you mean 'length'"),
        (["--target-morphology", "/nowhere.json"], "target_morphology must be a file"),
        (["--current", "0", "nan", "0"], "current must be finite"),
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
    assert not (tmp_path / "out" / "settings.json").exists()


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
