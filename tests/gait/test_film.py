"""The command ``film`` swims what it is given; stages follow the damage."""

from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image

from aquafish_gym.damage import Damage
from aquafish_gym.morphology import Morphology
from gait.__main__ import main
from gait.film import stages
from gait_fakes import make_controller

NOMINAL = Morphology.nominal()
SMALL = ("--seconds", "1", "--width", "160", "--height", "96", "--fps", "10", "--engine", "numba")


@pytest.fixture
def controller_file(tmp_path: Path) -> Path:
    """Return the file of a small network."""
    path = tmp_path / "controller.json"
    make_controller().save(path)
    return path


def test_stages_follow_sizes_and_servos() -> None:
    damage = Damage.parse("caudal:missing@4; left_pectoral:weak=0.5@6+2; gyro:noise=0.1")
    found = stages(NOMINAL, damage)
    assert [stage.begin for stage in found] == pytest.approx([0.0, 4.0, 6.0, 8.0])
    tail, both = ("caudal",), ("left_pectoral", "caudal")
    assert [stage.broken for stage in found] == [(), tail, both, tail]
    assert found[0].morphology == NOMINAL
    assert found[-1].morphology.caudal == (0.0, 0.0, 0.0)


def test_one_controller_swims_with_several_damages(
    controller_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "films" / "a.webp"
    damages = ("none", "caudal:missing@0.5", "gyro:noise=0.1")
    assert (
        main(["film", str(controller_file), "--out", str(out), "--damage", *damages, *SMALL]) == 0
    )
    with Image.open(out) as film:
        assert film.size == (160, 96)
    lines = capsys.readouterr().out.splitlines()
    assert [line.rpartition(":")[0] for line in lines] == [
        "undamaged", "caudal:missing@0.5", "gyro:noise=0.1", "Film"
    ]  # fmt: skip
    far = [float(line.rpartition(": ")[2].split()[0]) for line in lines[:3]]
    assert len(set(far)) == 3


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--label", "a", "b", "--damage", "none", "none", "none"], "label must be 1 or 3"),
        (["--out", "a.avi"], "suffix"),
        (["--damage", "tail:missing"], "damage part"),
    ],
)
def test_mistakes_are_one_line(
    controller_file: Path, words: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["film", str(controller_file), *words, *SMALL]) == 2
    error = capsys.readouterr().err
    assert sentence in error
    assert error.count("\n") == 1
