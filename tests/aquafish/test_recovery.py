"""The case study, small: it reports, resumes to the byte, and refuses mistakes in one line."""

from __future__ import annotations

import contextlib
import html
import io
import json
import os
import re
import runpy
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from PIL import Image

from aquafish.cli import main
from aquafish.online import thresholds
from aquafish.online.agent import SelfModelAgent
from aquafish.online.gaits import load_library
from aquafish.recovery import command, figures, swimming_on
from aquafish.recovery.command import CaseStudy, _settings
from aquafish.recovery.page import report_page
from aquafish.recovery.report import build_report
from aquafish.recovery.treatment import EVOLVED_BODIES, TREATMENTS, treat
from aquafish_gym import held_out
from aquafish_gym.bodies import body_array, read_bodies, sample_stamp
from aquafish_gym.morphology import Morphology
from aquafish_gym.plans import check_plan
from aquafish_gym.rendering import film
from aquafish_gym.runs.command_line import read_morphology
from aquafish_gym.utils.validation import InvalidArgumentError
from gait.controllers.controller import Controller
from tests.browser import browser
from tests.golden import SMALL_STUDY as SMALL
from tests.golden import digest, kept
from tests.in_process import jobs_in_process
from tests.pictures import is_drawn
from tests.plans import ODD

PICTURES = ["bodies", "sizes", "paths", "fitness", "distances"]
SCRIPT = Path(__file__).parents[2] / "examples" / "damage_recovery.py"
FAST_TREATMENTS = ("undamaged", "none", "joint", "oracle-neat", "oracle", "oracle-fins")


class Done(NamedTuple):
    returncode: int
    stderr: str
    stdout: str = ""


def recover(out: Path, *arguments: str) -> Done:
    text, errors = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(text), contextlib.redirect_stderr(errors):
        code = main(["recover", "--out", str(out), *arguments])
    return Done(code, errors.getvalue(), text.getvalue())


def results(out: Path) -> dict[str, bytes]:
    """Return file -> content of all results."""
    files = [path for end in ("json", "md") for path in out.rglob(f"*.{end}")]
    return {str(path.relative_to(out)): path.read_bytes() for path in sorted(files)}


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("recovery") / "study"
    with jobs_in_process():
        done = recover(out, *SMALL)
    assert done.returncode == 0, done.stderr
    return out


@pytest.fixture
def again(study: Path, tmp_path: Path) -> Path:
    """A copy of the study that a test may change."""
    return Path(shutil.copytree(study, tmp_path / "again"))


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw no figures, which take longer than all else."""
    drawn = [f"{name}.png" for name in PICTURES]
    names = ("sizes", "distances", "sizes-narrow", "distances-narrow")
    svgs = dict.fromkeys(names, b"<svg/>")
    monkeypatch.setattr(figures, "draw_all", lambda *_args, **_options: (drawn, svgs))


def test_the_report_holds_every_treatment(study: Path) -> None:
    report = json.loads((study / "report.json").read_text())
    assert list(report["treatments"]) == list(TREATMENTS)
    fitness = {name: row["objective_fitness"] for name, row in report["treatments"].items()}
    assert [name for name, value in fitness.items() if value is None] == ["randomised"]
    assert fitness["oracle"] == fitness["oracle-fins"] == fitness["direct"] == 1.0
    assert fitness["joint"] == fitness["joint-fins"]  # one self-model, two gaits
    assert fitness["undamaged"] == pytest.approx(1 - 0.4 / 9)
    assert fitness["swims-on"] > 0.99
    trials = {name: row["trials"] for name, row in report["treatments"].items()}
    swims = 2 * (24 + 2 * 24)  # of the random candidates, and of two generations
    modelled = {"none": 2, "out-of-band": 2, "joint": 1, "joint-fins": 1, "direct": swims}
    assert trials == dict.fromkeys(TREATMENTS, 0) | modelled
    for outcome in report["replicates"]["joint"]:
        assert np.abs(outcome["fins"]["error"]).max() <= np.pi
        assert outcome["verdict"]
    for name in ("oracle", "oracle-fins", "oracle-neat"):  # each swims on its own model
        row = report["treatments"][name]
        assert row["native_distance"] == pytest.approx(row["target_distance"], abs=1e-9)
    text = (study / "report.md").read_text()
    for name in PICTURES:
        assert is_drawn(study / f"{name}.png")
        assert f"({name}.png)" in text


def test_the_command_ends_with_the_path_of_one_small_page(study: Path, again: Path) -> None:
    page = again / "report.html"
    page.unlink()
    done = recover(again, *SMALL, "--redraw")
    assert done.stdout.splitlines()[-1] == str(page)
    assert page.stat().st_size < 1_000_000
    assert page.read_bytes() == (study / "report.html").read_bytes()


def test_the_study_is_the_golden_case(study: Path) -> None:
    assert digest("recover", study) == kept()["recover"]


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("without", [False, True], ids=["intervals", "no intervals"])
def test_nothing_that_a_report_holds_is_markup_of_its_page(
    again: Path, monkeypatch: pytest.MonkeyPatch, without: bool
) -> None:
    hostile = "<script>alert(1)</script> & \"é' p < 1e-6"

    def page_of_hostile(job: Any, outcomes: Any, report: Any, *rest: Any) -> str:
        report["code"][0]["numpy"] = hostile
        for several in outcomes.values():
            for one in several:
                one["verdict"] = hostile
                if without:
                    one["interval"] = None
        return str(report_page(job, outcomes, report, *rest))

    monkeypatch.setattr("aquafish.recovery.page.report_page", page_of_hostile)
    assert recover(again, *SMALL, "--redraw").returncode == 0
    text = (again / "report.html").read_text()
    assert hostile not in text
    assert text.count(html.escape(hostile)) == 2
    assert "default-src 'none'" in text
    assert not re.search(r"<[^>]* (style|on\w+)=", text)


def test_the_page_opens_in_a_browser(study: Path, tmp_path: Path) -> None:
    address = (study / "report.html").as_uri()
    with browser(tmp_path) as page:
        for size in ((1100, 800), (390, 800)):
            page.requests.clear()
            page.open(address, *size)
            page.wait("document.querySelector('.replay')?.dataset.ready === 'yes'")
            page.wait("[...document.images].every(image => image.naturalWidth > 0)")
            assert page.value("document.images.length") == 2
            title = page.value("document.querySelector('h1').textContent")
            assert title.startswith("The left flipper has 50% of its length.")
            assert "joint inference (fins known)" in title  # a row of the plot below
            edges = "[...document.images].map(image => image.getBoundingClientRect().right)"
            assert max(page.value(edges)) <= size[0]  # whole, not cut off
            assert page.value("document.documentElement.scrollWidth") <= size[0]
            page.value("document.querySelector('.replay input').focus()")
            page.key("End")
            page.wait("document.querySelector('.replay button').textContent === 'again'")
            assert page.errors == []
            assert page.requests == [address]


def test_bodies_and_controllers_serve_the_next_command(study: Path) -> None:
    for treatment, spec in TREATMENTS.items():
        folder = study / "seed-000" / treatment
        controller = Controller.load(folder / "controller.json")
        body = read_morphology(folder / "morphology.json", "morphology")
        if spec.model == "joint":
            bodies = body_array(read_bodies(folder / "bodies.json"))
            assert controller.sample == sample_stamp(bodies)
            assert len(bodies) == EVOLVED_BODIES
        elif treatment == "randomised":
            assert body == Morphology.nominal()
            assert controller.sample is not None
        elif spec.online:
            assert body.left_pectoral[1] == pytest.approx(0.8, abs=0.02)
            # The first refinement is quick.
            assert controller.nodes <= thresholds.MAXIMUM_REFINED_NODES
            assert controller.to_dict() != load_library()[0].to_dict()  # that of a whole robot
        else:
            assert body == controller.morphology


@pytest.mark.slow
def test_without_pybullet_nothing_is_missing(study: Path, again: Path) -> None:
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
        [sys.executable, "-c", hidden, "recover", "--out", str(again), *usual,
         "--workers", "1"],
        capture_output=True,
        text=True,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert {p.name for p in again.glob("*.png")} == {p.name for p in study.glob("*.png")}
    assert (again / outcome).read_bytes() == (study / outcome).read_bytes()


def test_another_configuration_in_the_same_folder_is_refused(study: Path) -> None:
    done = recover(study, *SMALL, "--damage", "caudal:missing")
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert "holds a case study with damage 'left_pectoral:length=0.5'" in done.stderr


@pytest.mark.usefixtures("undrawn")
@pytest.mark.slow
def test_an_interrupted_study_resumes_to_the_byte(study: Path, again: Path) -> None:
    shutil.rmtree(again / "seed-000" / "out-of-band")
    for treatment in FAST_TREATMENTS:
        (again / "seed-000" / treatment / "outcome.json").unlink()
    done = recover(again, *SMALL, "--redraw")
    assert done.returncode == 2
    assert "lacks seed 0, " in done.stderr
    whole = len(TREATMENTS)
    process = begin(again, "--workers", "1")
    wait_for_outcomes(process, again, whole - len(FAST_TREATMENTS))
    os.kill(process.pid, signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert errors.splitlines()[-1].endswith("the same command resumes")
    assert "Traceback" not in errors
    assert len(list(again.glob("seed-*/*/outcome.json"))) < whole
    with jobs_in_process():
        assert recover(again, *SMALL, "--seeds", "1", "--workers", "1").returncode == 0
    assert results(again) == results(study)


@pytest.mark.usefixtures("undrawn")
def test_the_example_is_the_command(
    study: Path, again: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ["--out", str(again), *SMALL, "--engine", "numba", "--seeds", "1", "--redraw"]
    monkeypatch.setattr(sys, "argv", [str(SCRIPT), *words])
    (again / "report.json").unlink()
    with pytest.raises(SystemExit) as left:
        runpy.run_path(str(SCRIPT), run_name="__main__")
    assert left.value.code == 0
    assert results(again) == results(study)


def test_redraw_adds_the_film(again: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def draw_small(swims: Any, path: Path, width: int, height: int, *a: Any, **k: Any) -> None:
        film(swims, path, width // 5, height // 5, *a, **k)

    monkeypatch.setattr(figures, "film", draw_small)
    monkeypatch.setattr(figures, "save_figure", lambda *_: None)
    monkeypatch.setattr(figures, "encode_figure", lambda *_: b"<svg/>")
    words = [word for word in SMALL if word != "--no-film"]
    done = recover(again, *words, "--redraw")
    assert done.returncode == 0, done.stderr
    with Image.open(again / "film.webp") as drawn:
        assert drawn.n_frames > 10
    assert "(film.webp)" in (again / "report.md").read_text()
    (again / "film.mp4").unlink(missing_ok=True)
    drawn_again = []
    monkeypatch.setattr(figures, "film", lambda _swims, path, *_: drawn_again.append(path.name))
    with jobs_in_process():
        assert recover(again, *words).returncode == 0
    assert "film.webp" not in drawn_again
    assert "(film.webp)" in (again / "report.md").read_text()


@pytest.mark.slow
def test_a_dask_cluster_gives_the_same_bytes(study: Path, tmp_path: Path) -> None:
    """One of its two workers is killed."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None
    ) as cluster:
        out = tmp_path / "out"
        process = begin(out, "--scheduler", cluster.scheduler_address)
        wait_for_outcomes(process, out, 1)
        os.kill(cluster.workers[0].pid, signal.SIGKILL)
        _, errors = process.communicate(timeout=300)
        assert process.returncode == 0, errors
    assert results(out) == results(study)


def begin(out: Path, *arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "aquafish", "recover", "--out", str(out), *SMALL, *arguments],
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


def test_a_plan_has_its_own_damage_and_held_out_ones() -> None:
    jobs = CaseStudy(plan="tail-fish").treatments()
    assert {str(job.damage) for job in jobs} == {"tail:length=0.5"}
    assert {check_plan(job.gait.plan).name for job in jobs} == {"tail-fish"}
    jobs = CaseStudy(plan="four-fins", held_out=True, replicates=2).treatments()
    assert {str(job.damage) for job in jobs} == set(held_out("four-fins recovery", [0, 1]))
    treatments = {job.treatment for job in CaseStudy(plan=ODD.to_dict()).treatments()}  # type: ignore[arg-type]
    assert treatments == TREATMENTS.keys() - {"swims-on"}  # without a library of gaits
    with pytest.raises(InvalidArgumentError, match="damage part must be one of fore_left"):
        CaseStudy(plan="four-fins", damage="caudal:missing").treatments()


@pytest.mark.slow  # compiles the tail fish in both waters
def test_all_of_a_study_swims_in_the_same_water(monkeypatch: pytest.MonkeyPatch) -> None:
    """Trials, models, gaits and both bodies; the same seed in plain water has other numbers."""
    known = []

    def agent(robot: Any, **options: Any) -> SelfModelAgent:
        known.append(robot.reactive)
        return SelfModelAgent(robot=robot, **options)

    monkeypatch.setattr(swimming_on, "SelfModelAgent", agent)
    small = {
        "plan": "tail-fish", "damage": "tail:length=0.7", "rounds": 2, "joint_rounds": 2,
        "models": 6, "angle_sets": 6, "generations": 3, "population": 12, "gait_poses": 1,
        "search_generations": 3, "search_restarts": 1, "random_candidates": 10,
        "search_population": 10, "poses": 2, "seconds": 2.0, "target_engine": "numba",
    }  # fmt: skip
    plain, reactive = (
        {
            job.treatment: treat(job)
            for job in CaseStudy(**small, reactive=water).treatments()
            if job.treatment in ("out-of-band", "joint", "oracle", "swims-on")
        }
        for water in (False, True)
    )
    for name, found in reactive.items():
        assert found["target_distance"] > 3 * plain[name]["target_distance"]
        assert found["native_distance"] > 3 * plain[name]["native_distance"]
        if name != "swims-on":
            evolved = found["generations"][-1]["distance"]  # in single precision
            assert found["native_distance"] == pytest.approx(evolved, rel=0.1)
    for name in ("out-of-band", "joint"):
        assert reactive[name]["rounds"] != plain[name]["rounds"]
    # Trials in one water and models in the other would have another water as a finding.
    assert "as noise would" in reactive["joint"]["verdict"]
    assert not any("resists acceleration" in finding for finding in reactive["joint"]["findings"])
    best = reactive["oracle"]
    assert best["native_distance"] == pytest.approx(best["target_distance"], abs=1e-9)
    assert known == [False] * 3 + [True] * 3
    assert reactive["swims-on"]["objective_fitness"] > 0.99


def test_a_study_says_in_which_water_it_swims() -> None:
    study = CaseStudy(plan="tail-fish", reactive=True)
    jobs = study.treatments()
    assert all(job.reactive for job in jobs)
    assert _settings(jobs)["reactive"] is True
    again, replay = study._commands(jobs[0])
    assert again == "aquafish recover --plan tail-fish --reactive"
    assert replay.endswith(" --reactive")
    plain = CaseStudy(plan="tail-fish")
    assert "reactive" not in _settings(plain.treatments())
    assert "--reactive" not in " ".join(plain._commands(plain.treatments()[0]))
    with pytest.raises(InvalidArgumentError, match="reactive must be True or False"):
        CaseStudy(reactive="yes").treatments()  # type: ignore[arg-type]


@pytest.mark.usefixtures("undrawn")
def test_the_report_and_its_page_name_added_mass(
    again: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = "in water with added mass, and so do all its models."
    assert words not in (again / "report.md").read_text() + (again / "report.html").read_text()
    whole = build_report
    monkeypatch.setattr(
        command, "build_report", lambda config, *rest: whole({**config, "reactive": True}, *rest)
    )
    assert recover(again, *SMALL, "--redraw").returncode == 0
    assert words in (again / "report.md").read_text()
    assert words in (again / "report.html").read_text()


@pytest.mark.slow
def test_a_robot_of_any_plan_recovers(tmp_path: Path) -> None:
    """All that is written names its plan, and the report is drawn and read again."""
    plan = tmp_path / "odd.json"
    plan.write_text(ODD.to_json())
    out = tmp_path / "odd"
    with jobs_in_process():
        done = recover(out, *SMALL, "--plan", str(plan), "--damage", "keel:length=0.5")
    assert done.returncode == 0, done.stderr
    folder = out / "seed-000" / "joint"
    assert read_bodies(folder / "morphology.json")[0].plan == ODD
    assert {body.plan for body in read_bodies(folder / "bodies.json")} == {ODD}
    assert Controller.load(folder / "controller.json").plan == ODD
    report = (out / "report.md").read_text()
    assert "Damage: `keel:length=0.5`" in report
    assert "The robot is 15 cm long" in report
    assert is_drawn(out / "bodies.png")
    before = results(out)
    with jobs_in_process():
        again = recover(out, *SMALL, "--plan", str(plan), "--damage", "keel:length=0.5")
    assert again.returncode == 0
    assert results(out) == before
