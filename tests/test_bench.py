"""The benchmark command: it runs, its table is whole, and mistakes are told in a line."""

from __future__ import annotations

import json
import pathlib
import subprocess
import sys

import pytest

pytest.importorskip("pybullet")


def bench(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "aquafish_gym.bench", *arguments], capture_output=True, text=True
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


def test_a_mistake_is_one_line() -> None:
    done = bench("--turns", "0")
    assert done.returncode == 2
    assert done.stderr.splitlines() == [
        "aquafish_gym.bench: turns must be a whole number of at least 1; got 0"
    ]
