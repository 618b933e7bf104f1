"""The benchmark command: every group runs, and what it compares is the same work."""

from __future__ import annotations

import json
import platform
import re
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from aquafish_gym import simulate
from experiments.results import RESULTS
from instruments.benchmarks import starting
from instruments.benchmarks.__main__ import main
from instruments.benchmarks.defaults import say_defaults, work_defaults
from instruments.benchmarks.measure import measure
from instruments.benchmarks.report import make_records
from instruments.benchmarks.rows import GROUPS, Settings, load_provider

TINY = Settings(robots=17, steps=4, seed=0, cores=2, quick=True)
NEEDS = {"mujoco": "mujoco", "learning": "stable_baselines3", "training": "stable_baselines3"}


MARKS = {
    **dict.fromkeys(("widths", "tasks", "pictures"), pytest.mark.slow),  # they compile, or draw
    **dict.fromkeys(("bodies", "learning"), pytest.mark.pybullet),  # they compare with it
}


@pytest.mark.parametrize("name", [pytest.param(name, marks=MARKS.get(name, ())) for name in GROUPS])
def test_every_group_runs(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if name in NEEDS:
        pytest.importorskip(NEEDS[name])
    # New processes would compile for seconds.
    monkeypatch.setattr(
        starting, "_FIRST_RESULT", "import os; assert os.environ['NUMBA_CACHE_DIR']"
    )
    with ExitStack() as cleanup:
        group = load_provider(name)(TINY, cleanup)
        timings = measure(group, turns=1, least_seconds=0, tick=lambda: None)
    assert [timing.row for timing in timings] == group.rows
    records = make_records(name, group, timings)
    assert all(record["rate"] > 0 for record in records)
    assert any(record["ratio"] for record in records)


def test_missing_package_leaves_out_its_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "stable_baselines3.common.vec_env", None)
    with ExitStack() as cleanup:
        group = load_provider("learning")(TINY, cleanup)
    assert not group.rows
    assert group.notes


@pytest.mark.pybullet
def test_neat_python_baseline_swims_the_same_distance() -> None:
    """It would be no comparison if its robot heard or did something else."""
    from aquafish_gym.engines.bullet.world import BulletWorld
    from aquafish_gym.morphology import Morphology
    from gait.search.neat import Evolution
    from gait.swims.swim import swim
    from instruments.benchmarks.gait import _build, swim_as_usual

    body = Morphology.nominal()
    world = BulletWorld()
    evolution = Evolution(_build, 10, seed=3)
    genomes, controllers = evolution.genomes[:3], evolution.ask().controllers[:3]
    found = [swim_as_usual(world, genome, body, steps=203) for genome in genomes]
    world.close()
    wanted = [swim(c, body, seconds=2.03).distance for c in controllers]
    assert min(map(abs, wanted)) > 0.01
    assert found == pytest.approx(wanted, abs=1e-6)


def test_mujoco_baseline_turns_the_same_fins() -> None:
    """It would be no comparison if its servos did not follow, or if it had given up."""
    pytest.importorskip("mujoco")
    from aquafish_gym.plans import AQUAFISH
    from instruments.benchmarks.mujoco_rollout import Rollout
    from instruments.verification.trials import random_trials

    trials = random_trials(40, seed=1)
    log = simulate(trials.morphologies, trials.commands, trials.fin_angles, steps=200,
                   dtype="float64", record="pose")  # fmt: skip
    assert log.fin_angles is not None
    with ExitStack() as cleanup:
        work = Rollout(trials, 200, 1.0, 1, cleanup)
        states = work.run()
        dry = Rollout(trials, 200, 0.0, 1, cleanup).run()
    assert work.broken_off == 0
    assert states.shape == (40, 200, 20)
    away = states[:, :, 8:10] - log.fin_angles[:, :, :2]
    assert abs(np.sin(away / 2)).max() < 1e-4
    assert (
        abs(states[:, :, 10] - AQUAFISH.fins[-1].sweep * np.sin(log.fin_angles[:, :, 2])).max()
        < 1e-4
    )
    assert len(np.unique(states[:, -1, 1])) == 40
    assert abs(states[:, -1, 1:4] - dry[:, -1, 1:4]).max() > 0.01  # there is water


ROOT = Path(__file__).parent.parent
MEASURED = {
    name: result.commands[0].partition(" --only ")[2].split()
    for name, result in RESULTS.items()
    if result.commands[0].startswith("python -m instruments.benchmarks ")
}


@pytest.mark.parametrize("name", MEASURED)
def test_committed_figures_were_measured_with_the_present_defaults(name: str) -> None:
    """A default that changes what a step is makes every figure a figure of something else."""
    (file,) = RESULTS[name].files
    assert (ROOT / file).read_text("utf-8").endswith(f"\n{say_defaults(MEASURED[name])}\n")


def test_work_defaults_are_the_environments() -> None:
    found = work_defaults(GROUPS)
    for name, make in (("AquaFish-v0", gym.make), ("make_vec", gym.make_vec)):
        env: Any = make("AquaFish-v0")
        assert found[f"{name}.frame_skip"] == env.unwrapped.frame_skip
        env.close()
    made: Any = gym.make_vec("AquaFish-v0").unwrapped
    assert np.dtype(made._swimmers.dtype) == found["make_vec.dtype"]


def test_figures_stand_on_one_page() -> None:
    """Nowhere else can they go stale."""
    pages = [ROOT / "README.md", *ROOT.glob("docs/*.md"), *ROOT.glob("docs/*/*.md")]
    sources = [
        file
        for name in ("aquafish", "aquafish_gym", "eea", "gait")
        for file in (ROOT / name).rglob("*.py")
    ]
    for file in {*pages, *sources} - {ROOT / "docs" / "performance.md"}:
        assert not re.search(r"\d [kM] ?(robot-|env-)?(steps)?/s\b", file.read_text("utf-8")), file


@pytest.mark.pybullet
def test_a_folder_gets_records_with_ratios_of_one_run_and_a_table(tmp_path: Path) -> None:
    words = ["--quick", "--robots", "32", "--steps", "8", "--turns", "1"]
    assert main([*words, "--only", "physics", "bodies", "--out", str(tmp_path)]) == 0
    text = (tmp_path / "bench.json").read_text()
    assert platform.node() not in text
    written = json.loads(text)
    compared = [row for row in written["rows"] if row["ratio_to"] is not None]
    assert len(compared) >= 8
    for row in compared:
        reference = written["rows"][row["ratio_to"] - 1]
        assert reference["group"] == row["group"]
        assert row["ratio"] == pytest.approx(row["rate"] / reference["rate"])
    assert written["commit"]
    assert written["defaults"] == work_defaults(["physics", "bodies"])
    table = (tmp_path / "table.md").read_text("utf-8")
    assert "pack a batch" in table
    assert table.endswith(f"\n{say_defaults(['physics', 'bodies'])}\n")
