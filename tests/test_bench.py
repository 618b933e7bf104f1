"""The benchmark command: it runs, its table is whole, and mistakes are told in a line."""

from __future__ import annotations

import json
import pathlib
import subprocess
import sys

import pytest

from aquafish_gym.bench import Bench, rows

pytest.importorskip("pybullet")


def bench(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "aquafish_gym.bench", *arguments],
        capture_output=True,
        text=True,
        cwd=pathlib.Path(__file__).parents[1],
    )


def test_it_writes_every_row_with_its_ratio(tmp_path: pathlib.Path) -> None:
    out = tmp_path / "bench.json"
    done = bench("--robots", "32", "--steps", "20", "--bullet-robots", "1", "--turns", "1",
                 "--out", str(out))  # fmt: skip
    assert done.returncode == 0, done.stderr
    rows = json.loads(out.read_text())["rows"]
    assert rows[0]["engine"] == "pybullet"
    assert rows[0]["ratio_to_pybullet"] == 1
    assert {r["dtype"] for r in rows if r["engine"] == "numba"} == {"float32", "float64"}
    assert all(r["robot_steps_per_second"] > 0 for r in rows)
    assert "best of 1 turn\n" in "\n".join(map(str.rstrip, done.stdout.splitlines())) + "\n"
    assert "x PyBullet" in done.stdout
    assert max(map(len, done.stdout.splitlines())) <= 80


@pytest.mark.parametrize(
    ("program", "first"),
    [("bench", "Time the engines and print robot-steps a second."),
     ("agreement", "Print how far the engines differ on the same random trials.")],
)  # fmt: skip
def test_help_says_what_it_does(program: str, first: str) -> None:
    command = [sys.executable, "-m", f"aquafish_gym.{program}", "--help"]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert said.split("\n\n")[1] == first


def test_a_row_swims_as_many_robots_as_it_says() -> None:
    """Also where a batch is smaller than another row's."""
    config = Bench(robots=2, bullet_robots=3, steps=1)
    assert {len(row.call()) == row.robots for row in rows(config)} == {True}  # type: ignore[arg-type]
    assert {row.robots for row in rows(config)} == {2, 3, 16}


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--turns", "0"), "turns must be a whole number of at least 1; got 0"),
        (("--seed", "-1"), "seed must be a whole number of at least 0; got -1"),
        (("--out", "tests"), "out must be a file; tests is a directory"),
    ],
)
def test_a_mistake_is_one_line(arguments: tuple[str, ...], sentence: str) -> None:
    done = bench(*arguments)
    assert done.returncode == 2
    assert done.stderr.splitlines() == [f"aquafish_gym.bench: {sentence}"]
