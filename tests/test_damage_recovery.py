"""The case study, small: it runs to a report, goes on after an interruption, and refuses."""

from __future__ import annotations

import json
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from aquafish_gym.runs.locks import only_here

pytest.importorskip("pybullet")

SCRIPT = pathlib.Path(__file__).parent.parent / "examples" / "damage_recovery.py"
SMALL = ("--rounds", "2", "--steps", "64", "--models", "6", "--angle-sets", "6", "--generations",
         "3", "--population", "12", "--gait-poses", "1", "--poses", "2", "--seconds", "2",
         "--engine", "numba", "--no-film")  # fmt: skip
TREATMENTS = ["undamaged", "none", "out-of-band", "oracle"]


def recover(out: pathlib.Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(SCRIPT), "--out", str(out), *arguments],
        capture_output=True,
        text=True,
    )


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    out = tmp_path_factory.mktemp("recovery") / "study"
    done = recover(out, *SMALL, "--seeds", "2")
    assert done.returncode == 0, done.stderr
    return out


def test_the_report_holds_every_number(study: pathlib.Path) -> None:
    report = json.loads((study / "report.json").read_text())
    assert list(report["treatments"]) == TREATMENTS
    for row in report["treatments"].values():
        for key in ("objective_fitness", "native_distance", "target_distance"):
            assert isinstance(row[key], float)
        assert "share_of_oracle" in row
        assert "target_distance_random_poses" in row
    assert report["treatments"]["oracle"]["objective_fitness"] == 1.0
    assert report["treatments"]["undamaged"]["objective_fitness"] == pytest.approx(1 - 0.4 / 9)
    assert report["seeds"] == [0, 1]
    assert report["config"]["damage"] == "left_pectoral:length=0.5"
    assert report["versions"]["numpy"]
    assert all(row["replicates"] == 2 for row in report["paired"])


def test_the_figures_and_the_report_for_people_are_there(study: pathlib.Path) -> None:
    text = (study / "report.md").read_text()
    for name in ("bodies.png", "paths.png", "fitness.png", "distances.png"):
        assert (study / name).stat().st_size > 5000
        assert f"({name})" in text
    for treatment in TREATMENTS:
        assert f"| {treatment} |" in text


def test_the_oracle_swims_its_own_body(study: pathlib.Path) -> None:
    """Its model is the target, so both distances are one number, up to the lanes' float32."""
    report = json.loads((study / "report.json").read_text())
    row = report["treatments"]["oracle"]
    assert row["native_distance"] == pytest.approx(row["target_distance"], abs=1e-9)


def test_a_second_run_repeats_the_first_to_the_byte(
    study: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    """Lost parts are done anew, one worker or two, and give the same files."""
    again = tmp_path / "again"
    shutil.copytree(study, again)
    shutil.rmtree(again / "seed-001" / "out-of-band")
    (again / "seed-000" / "oracle" / "outcome.json").unlink()
    done = recover(again, *SMALL, "--seeds", "2", "--workers", "1")
    assert done.returncode == 0, done.stderr
    assert "undamaged" not in done.stderr, "finished jobs are not run again"
    for name in ("report.json", "report.md"):
        assert (again / name).read_bytes() == (study / name).read_bytes()


def test_a_swim_that_diverged_counts_as_no_progress_and_is_told(
    study: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    again = tmp_path / "again"
    shutil.copytree(study, again)
    path = again / "seed-000" / "none" / "outcome.json"
    outcome = json.loads(path.read_text())
    outcome["diverged"], outcome["target_distance"] = 1, 0.0
    path.write_text(json.dumps(outcome))
    done = recover(again, *SMALL, "--seeds", "2")
    assert done.returncode == 0, done.stderr
    assert "1 swims on the damaged robot diverged" in (again / "report.md").read_text()


def test_a_study_is_not_continued_by_other_code(
    study: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    again = tmp_path / "again"
    shutil.copytree(study, again)
    held = json.loads((again / "config.json").read_text())
    (again / "config.json").write_text(json.dumps(held | {"source": "other"}))
    done = recover(again, *SMALL, "--seeds", "2")
    assert done.returncode == 2
    assert "holds a study with source 'other'" in done.stderr
    done = recover(again, *SMALL, "--seeds", "2", "--redraw")
    assert done.returncode == 0, done.stderr
    assert json.loads((again / "report.json").read_text())["config"]["source"] == "other"
    assert recover(again, *SMALL, "--seeds", "3", "--redraw").returncode == 2
    (again / "config.json").write_text("{")
    done = recover(again, *SMALL, "--seeds", "2")
    assert done.returncode == 2
    assert "config.json is damaged" in done.stderr


def test_two_commands_do_not_share_a_folder(study: pathlib.Path) -> None:
    with only_here(study):
        done = recover(study, *SMALL, "--seeds", "2")
    assert done.returncode == 2
    assert f"is in use by another command, process {os.getpid()} since " in done.stderr


def test_without_pybullet_the_study_is_whole_but_for_the_robots_picture(
    tmp_path: pathlib.Path,
) -> None:
    hidden = (
        "import importlib.util, runpy, sys; sys.modules['pybullet'] = None; "
        "find = importlib.util.find_spec; "
        "importlib.util.find_spec = lambda n, *a: None if n == 'pybullet' else find(n, *a); "
        "sys.argv = sys.argv[1:]; runpy.run_path(sys.argv[0], run_name='__main__')"
    )
    out = tmp_path / "out"
    script = [str(SCRIPT), "--out", str(out), *SMALL]
    done = subprocess.run(
        [sys.executable, "-c", hidden, *script],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": str(SCRIPT.parent)},
    )
    assert done.returncode == 0, done.stderr
    assert "need PyBullet" in done.stderr
    assert (out / "report.json").exists()
    assert (out / "paths.png").exists()
    assert not (out / "bodies.png").exists()


def test_another_configuration_in_the_same_folder_is_refused(study: pathlib.Path) -> None:
    done = recover(study, *SMALL, "--damage", "caudal:missing")
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert "holds a study with damage 'left_pectoral:length=0.5'" in done.stderr


MISTAKES = {
    "damage": (("--damage", "left_pectorl:length=0.5"), "did you mean 'left_pectoral'"),
    "engine": (("--engine", "bullet"), "did you mean 'pybullet'"),
    "steps": (("--steps", "100"), "steps must be a power of two; got 100"),
    "body": (("--morphology", "nowhere.json"), "morphology must be a file that can be read"),
    "models": (("--models", "0"), "estimation.population must be"),
    "seeds": (("--seeds", "0"), "seeds must be a whole number of at least 1; got 0"),
    "option": (("--round", "3"), "did you mean --rounds"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_one_line(mistake: str, tmp_path: pathlib.Path) -> None:
    arguments, message = MISTAKES[mistake]
    done = recover(tmp_path / "out", *arguments)
    assert done.returncode == 2
    assert message in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "out").exists(), "nothing was written"


def test_an_unwritable_folder_is_refused(tmp_path: pathlib.Path) -> None:
    (tmp_path / "file").write_text("")
    done = recover(tmp_path / "file" / "out", *SMALL)
    assert done.returncode == 2
    assert done.stderr.startswith("damage_recovery: out")
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_run_leaves_what_can_be_read_and_gone_on_with(
    tmp_path: pathlib.Path, sent: signal.Signals
) -> None:
    out = tmp_path / "out"
    process = subprocess.Popen(
        [sys.executable, str(SCRIPT), "--out", str(out), *SMALL, "--generations", "4000"],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    histories = [out / "seed-000" / t / "history.csv" for t in ("undamaged", "out-of-band")]
    deadline = time.monotonic() + 120
    while not any(h.exists() for h in histories):
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.1)
    os.kill(process.pid, sent)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "interrupted" in said
    assert "Traceback" not in said
    assert json.loads((out / "config.json").read_text())["eea"]["rounds"] == 2
    written = next(h for h in histories if h.exists())
    assert written.read_text().splitlines()[0].startswith("generation,best")


def test_a_self_model_that_is_broken_off_goes_on(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(SCRIPT.parent))
    from aquafish_gym import Damage, Morphology
    from eea import EEAConfig
    from eea.core.estimation import EstimationConfig
    from gait.evolve import EvolveConfig
    from gait.transfer import TransferConfig
    from recovery.treatments import Job, _model

    eea = EEAConfig(steps=16, rounds=3, estimation=EstimationConfig(6, 4))
    where = TransferConfig(target_engine="numba")
    damage = Damage.parse("left_pectoral:length=0.5")

    def job(name: str) -> Job:
        (tmp_path / name).mkdir(exist_ok=True)
        evolution = EvolveConfig(threads=1)
        return Job("none", 0, Morphology.nominal(), damage, eea, evolution, where, tmp_path / name)

    def stop(text: str, _share: float) -> None:
        if "round 2/3" in text:
            raise KeyboardInterrupt

    said: list[str] = []
    whole = _model(job("whole"), lambda text, _: said.append(text))
    assert len(said) == 4
    with pytest.raises(KeyboardInterrupt):
        _model(job("stopped"), stop)
    said.clear()
    assert _model(job("stopped"), lambda text, _: said.append(text)) == whole
    assert said[0] == "self-model: 2 rounds done"
    assert len(said) == 2
    assert sorted(path.name for path in (tmp_path / "stopped").iterdir()) == [
        "model.json",
        "rounds.jsonl",
    ]


def test_statistics_by_hand() -> None:
    sys.path.insert(0, str(SCRIPT.parent))
    try:
        from recovery.statistics import mean_interval, ratio_interval, sign_test
    finally:
        sys.path.pop(0)
    assert sign_test([1.0] * 10) == pytest.approx(2 / 2**10)
    assert sign_test([1.0, -1.0, 0.0]) == 1.0
    assert mean_interval(np.arange(4.0)) is None
    assert mean_interval(np.full(6, 2.0)) == [2.0, 2.0]
    rng = np.random.default_rng(1)
    held = 0
    for _ in range(200):
        interval = mean_interval(rng.normal(size=10))
        assert interval is not None
        held += interval[0] <= 0 <= interval[1]
    assert 180 <= held <= 199, "near 95% of them hold the true mean"
    low, high = ratio_interval(rng.normal(3, 0.1, 10), rng.normal(6, 0.1, 10)) or (0, 0)
    assert low < 0.5 < high
