"""The case study, small: it runs to a report, goes on after an interruption, and refuses."""

from __future__ import annotations

import importlib.util
import json
import os
import random
import runpy
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from aquafish.recovery.treatment import BODIES, WAYS
from aquafish_gym.bodies import body_array, read_bodies, sample_stamp
from aquafish_gym.command_line import read_morphology
from aquafish_gym.morphology import Morphology
from aquafish_gym.runs.folder import held
from aquafish_gym.runs.storage import read_document, write_document
from gait.controller import Controller
from recovering import COMMAND, SMALL, recover, results

TREATMENTS = list(WAYS)
PICTURES = ["paths", "fitness", "distances"]
if importlib.util.find_spec("pybullet"):
    PICTURES.append("bodies")
SCRIPT = Path(__file__).parents[2] / "examples" / "damage_recovery.py"


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("recovery") / "study"
    done = recover(out, *SMALL, "--seeds", "2")
    assert done.returncode == 0, done.stderr
    return out


@pytest.fixture
def again(study: Path, tmp_path: Path) -> Path:
    """A copy to be harmed."""
    return Path(shutil.copytree(study, tmp_path / "again"))


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures are drawn where they are looked at: they take longer than all else."""
    names = [f"{name}.png" for name in ("bodies", "paths", "fitness", "distances")]
    drawn = [name for name in names if name.removesuffix(".png") in PICTURES]
    monkeypatch.setattr("aquafish.recovery.figures.draw_all", lambda *_: drawn)


def test_the_report_holds_every_number(study: Path) -> None:
    report = json.loads((study / "report.json").read_text())
    assert list(report["treatments"]) == TREATMENTS
    for row in report["treatments"].values():
        for key in ("native_distance", "target_distance"):
            assert isinstance(row[key], float)
        assert "share_of_oracle" in row
        assert "target_distance_random_poses" in row
    fitness = {name: row["objective_fitness"] for name, row in report["treatments"].items()}
    assert [name for name, value in fitness.items() if value is None] == ["randomised"]
    assert fitness["oracle"] == fitness["oracle-fins"] == fitness["direct"] == 1.0
    assert fitness["joint"] == fitness["joint-fins"]  # one self-model, two gaits
    assert report["treatments"]["undamaged"]["objective_fitness"] == pytest.approx(1 - 0.4 / 9)
    trials = {name: row["trials"] for name, row in report["treatments"].items()}
    swims = 2 * (24 + 2 * 24)  # of the networks screened, and of two generations
    modelled = {"none": 2, "out-of-band": 2, "joint": 1, "joint-fins": 1, "direct": swims}
    assert trials == dict.fromkeys(TREATMENTS, 0) | modelled
    hours = report["treatments"]["direct"]["robot_hours"]
    assert len(hours) == 2
    assert all(h is None or 0.0 < h <= swims * 2.0 / 3600.0 for h in hours)
    for outcome in report["replicates"]["joint"]:
        assert np.abs(outcome["fins"]["error"]).max() <= np.pi
        low, found, high = (
            Morphology.coerce(body).to_array()
            for body in (
                outcome["interval"]["low"],
                outcome["morphology"],
                outcome["interval"]["high"],
            )
        )
        assert (low <= found).all()
        assert (found <= high).all()
        assert outcome["verdict"]
        assert "bodies" not in outcome
    assert report["seeds"] == [0, 1]
    assert report["config"]["damage"] == "left_pectoral:length=0.5"
    assert report["code"][0]["numpy"]
    assert all(row["replicates"] == 2 for row in report["paired"])


def test_the_figures_and_the_report_for_people_are_there(study: Path) -> None:
    text = (study / "report.md").read_text()
    for name in PICTURES:
        assert (study / f"{name}.png").stat().st_size > 5000
        assert f"({name}.png)" in text
    for treatment in TREATMENTS:
        assert f"| {treatment} |" in text


def test_the_oracle_swims_its_own_body(study: Path) -> None:
    """Its model is the target, so both distances are one number, up to the lanes' float32."""
    report = json.loads((study / "report.json").read_text())
    for name in ("oracle", "oracle-fins", "oracle-neat"):
        row = report["treatments"][name]
        assert row["native_distance"] == pytest.approx(row["target_distance"], abs=1e-9)
        assert row["share_of_oracle"] in (None, 1.0)


def test_bodies_and_controllers_are_there_for_the_next_command(study: Path) -> None:
    report = json.loads((study / "report.json").read_text())
    for treatment in TREATMENTS:
        folder = study / "seed-001" / treatment
        controller = Controller.load(folder / "controller.json")
        body = read_morphology(folder / "morphology.json", "morphology")
        if WAYS[treatment].model == "joint":
            bodies = body_array(read_bodies(folder / "bodies.json"))
            assert controller.sample == sample_stamp(bodies)
            assert len(bodies) == BODIES
        elif treatment == "randomised":
            assert body == Morphology.nominal()
            assert controller.sample is not None
        else:
            assert body == controller.morphology
            assert not (folder / "bodies.json").exists()
        assert body.to_dict() == report["replicates"][treatment][1]["morphology"]
    assert (
        read_morphology(study / "seed-001/undamaged/morphology.json", "m") == Morphology.nominal()
    )


@pytest.mark.usefixtures("undrawn")
def test_what_is_lost_or_damaged_is_done_again_to_the_byte(study: Path, again: Path) -> None:
    """With one worker or two; what is whole is not done again."""
    shutil.rmtree(again / "seed-001" / "out-of-band")
    (again / "seed-000" / "oracle" / "outcome.json").unlink()
    flipped = again / "seed-000" / "none" / "outcome.json"
    content = bytearray(flipped.read_bytes())
    place = content.index(b'"target_distance": ') + 20
    content[place] ^= 1  # another digit, and JSON as before
    flipped.write_bytes(content)
    json.loads(content)
    done = recover(again, *SMALL, "--seeds", "2", "--redraw")
    assert done.returncode == 2, "no number of a damaged file is used"
    assert "does not match its checksum" in done.stderr or "lacks" in done.stderr
    done = recover(again, *SMALL, "--seeds", "2", "--workers", "1")
    assert done.returncode == 0, done.stderr
    assert f"damaged: {flipped}; seed 0, none is done anew" in done.stderr
    assert "undamaged" not in done.stderr
    assert results(again) == results(study)


@pytest.mark.usefixtures("undrawn")
def test_a_swim_that_diverged_counts_as_no_progress_and_is_told(again: Path) -> None:
    path = again / "seed-000" / "none" / "outcome.json"
    outcome = read_document(path)
    outcome["diverged"], outcome["target_distance"] = 1, 0.0
    write_document(path, outcome, "aquafish.result/1")
    done = recover(again, *SMALL, "--seeds", "2")
    assert done.returncode == 0, done.stderr
    assert "1 swim on the damaged robot diverged" in (again / "report.md").read_text()


def test_a_study_is_not_continued_by_other_code(again: Path) -> None:
    settings = again / "settings.json"
    description = read_document(settings)
    description["code"][0]["source"] = "other"
    write_document(settings, description, "aquafish.folder/1")
    done = recover(again, *SMALL, "--seeds", "2")
    assert done.returncode == 2
    assert "holds results of source other" in done.stderr
    done = recover(again, *SMALL, "--seeds", "2", "--redraw", "--format", "svg")
    assert done.returncode == 0, done.stderr
    assert json.loads((again / "report.json").read_text())["code"][0]["source"] == "other"
    assert "(paths.svg)" in (again / "report.md").read_text()
    assert (again / "paths.svg").read_bytes().startswith(b"<?xml")
    done = recover(again, *SMALL, "--seeds", "3", "--redraw")
    assert done.returncode == 2
    assert "lacks seed 2, out-of-band" in done.stderr
    settings.write_text("{")
    done = recover(again, *SMALL, "--seeds", "2")
    assert done.returncode == 2
    assert "settings.json" in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_two_commands_do_not_share_a_folder(study: Path) -> None:
    with held(study):
        done = recover(study, *SMALL, "--seeds", "2")
    assert done.returncode == 2
    assert f"is in use by another command, process {os.getpid()} since " in done.stderr


def test_another_configuration_in_the_same_folder_is_refused(study: Path) -> None:
    done = recover(study, *SMALL, "--damage", "caudal:missing")
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert "holds a case study with damage 'left_pectoral:length=0.5'" in done.stderr


def test_without_pybullet_the_study_is_whole_but_for_the_robots_picture(
    study: Path, again: Path
) -> None:
    """The default engine is then the compiled one, said in one line."""
    outcome = "seed-000/out-of-band/outcome.json"
    (again / outcome).unlink()
    for picture in again.glob("*.png"):
        picture.unlink()
    hidden = (
        "import importlib.util, sys; sys.modules['pybullet'] = None; "
        "find = importlib.util.find_spec; "
        "importlib.util.find_spec = lambda n, *a: None if n == 'pybullet' else find(n, *a); "
        "from aquafish.cli import main; sys.exit(main())"
    )
    usual = [word for word in SMALL if word not in ("--target-engine", "numba")]
    done = subprocess.run(
        [sys.executable, "-c", hidden, "recover", "--out", str(again), *usual, "--seeds", "2",
         "--workers", "1"],
        capture_output=True,
        text=True,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("PyBullet is not installed here") == 1
    assert "need PyBullet" in done.stderr
    assert (again / "paths.png").exists()
    assert not (again / "bodies.png").exists()
    assert (again / outcome).read_bytes() == (study / outcome).read_bytes()


MISTAKES = {
    "damage": (("--damage", "left_pectorl:length=0.5"), "did you mean 'left_pectoral'"),
    "steps": (("--steps", "100"), "steps must be a power of two; got 100"),
    "body": (("--morphology", "nowhere.json"), "morphology must be a file that can be read"),
    "device": (("--morphology", "/dev/zero"), "morphology must be a regular file"),
    "nothing": (("--out", ""), "--out must not be empty"),
    "digits": (("--seed", "1" + "0" * 400), "seed must be"),
    "models": (("--models", "0"), "estimation.population must be"),
    "seeds": (
        ("--seeds", "0"),
        "seeds must be a whole number of at least 1 and at most 100000; got 0",
    ),
    "many seeds": (("--seeds", "100000000"), "seeds must be"),
    "workers": (("--workers", "0"), "workers must be"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_one_line(mistake: str, tmp_path: Path) -> None:
    arguments, message = MISTAKES[mistake]
    done = recover(tmp_path / "out", *arguments)
    assert done.returncode == 2
    assert message in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "out").exists(), "nothing was written"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--target-engine", "bullet"), "'numba'"),
        (("--round", "3"), "--rounds"),
        (("--format", "pgn"), "'svg'"),
    ],
)
def test_a_misspelt_option_is_told_the_right_one(
    arguments: tuple[str, ...], message: str, tmp_path: Path
) -> None:
    done = recover(tmp_path / "out", *arguments)
    assert done.returncode == 2
    assert message in done.stderr
    assert not (tmp_path / "out").exists()


def test_a_scheduler_that_nobody_is_at_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    done = recover(tmp_path / "out", *SMALL, "--scheduler", "nowhere")
    assert done.returncode == 2
    assert "scheduler must be the address of a dask scheduler" in done.stderr


def test_an_unwritable_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    done = recover(tmp_path / "file" / "out", *SMALL)
    assert done.returncode == 2
    assert "out must be a directory that can be written" in done.stderr
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    "sent", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.slow)]
)
def test_an_interrupted_run_says_so_and_goes_on(
    study: Path, again: Path, sent: signal.Signals
) -> None:
    """Which it does while three of its treatments are still to be done, or again."""
    for treatment in ("randomised", "oracle", "oracle-fins"):
        shutil.rmtree(again / "seed-001" / treatment)
    whole = 2 * len(TREATMENTS)
    process = begin(again, "--seeds", "2", "--workers", "1")
    wait_for_outcomes(process, again, whole - 2)
    os.kill(process.pid, sent)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130
    assert said.splitlines()[-1].endswith("the same command resumes")
    assert "Traceback" not in said
    assert len(list(again.glob("seed-*/*/outcome.json"))) < whole
    assert recover(again, *SMALL, "--seeds", "2", "--workers", "1").returncode == 0
    assert results(again) == results(study)


@pytest.mark.slow
def test_kills_at_random_instants_change_no_byte(study: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    rng = random.Random(1)
    for _ in range(4):
        process = begin(out, "--seeds", "2")
        time.sleep(rng.uniform(0.5, 8.0))
        process.kill()
        process.communicate()
    done = recover(out, *SMALL, "--seeds", "2")
    assert done.returncode == 0, done.stderr
    assert results(out) == results(study)
    assert not list(out.rglob(".*")), "what was being written is swept"


@pytest.mark.usefixtures("undrawn")
def test_the_example_is_the_command(
    study: Path, again: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The options that its readers know are there too."""
    words = ["--out", str(again), *SMALL, "--engine", "numba", "--seeds", "2", "--redraw"]
    monkeypatch.setattr(sys, "argv", [str(SCRIPT), *words])
    (again / "report.json").unlink()
    with pytest.raises(SystemExit) as left:
        runpy.run_path(str(SCRIPT), run_name="__main__")
    assert left.value.code == 0
    assert results(again) == results(study)


@pytest.mark.slow
def test_a_dask_cluster_gives_the_same_bytes(study: Path, tmp_path: Path) -> None:
    """Two workers of a cluster that knows nothing of the folder, one of which is killed."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None
    ) as cluster:
        out = tmp_path / "out"
        process = begin(out, "--seeds", "2", "--scheduler", cluster.scheduler_address)
        wait_for_outcomes(process, out, 1)
        os.kill(cluster.workers[0].pid, signal.SIGKILL)
        _, said = process.communicate(timeout=300)
        assert process.returncode == 0, said
    assert results(out) == results(study)


def begin(out: Path, *arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [*COMMAND, "--out", str(out), *SMALL, *arguments],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def wait_for_outcomes(process: subprocess.Popen[str], out: Path, count: int) -> None:
    deadline = time.monotonic() + 120
    while len(list(out.glob("seed-*/*/outcome.json"))) < count:
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.05)
