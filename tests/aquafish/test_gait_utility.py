"""Gaits for the bodies that the trials allow: what they tell, and the commands that ask them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import eea.__main__
from aquafish.cli import main
from aquafish.gait_utility import GaitUtility, different
from aquafish.recovery.command import Recover
from aquafish.recovery.treatment import treat
from aquafish_gym.morphology import Morphology
from aquafish_gym.utils.validation import InvalidArgumentError
from eea.core.design import checked_utilities, robustness

QUICK = GaitUtility(threads=1, gaits=3, generations=3, population=20, poses=1, seconds=4.0)
HEALTHY = Morphology.nominal().to_array()
SMALL = ("--steps", "64", "--rounds", "2", "--target-engine", "numba", "--threads", "1",
         "--joint.bodies", "8", "--joint.poses", "8", "--joint.descents", "2",
         "--joint.polished", "1", "--joint.restarts", "0", "--joint.alternatives", "never",
         "--condition", "joint")  # fmt: skip


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """The command's own gaits are evolved as quickly as these tests want."""
    monkeypatch.setattr("aquafish.gait_utility.GaitUtility", lambda *_: QUICK)


def halved(column: int) -> np.ndarray:
    return HEALTHY * np.where(np.arange(9) == column, 0.5, 1.0)


def test_each_gait_swims_on_each_body_the_same_again() -> None:
    bodies = np.array([HEALTHY, halved(1), halved(4), HEALTHY])
    far = QUICK(bodies)
    assert far.shape == (3, 4)
    assert np.array_equal(far, QUICK(bodies))
    assert np.array_equal(far[:, 0], far[:, 3])
    assert not np.array_equal(far, GaitUtility(1, 1, 3, 3, 20, 1, 4.0)(bodies))
    assert len(np.unique(far.round(6), axis=0)) == 3  # the gaits are three, and differ


def test_a_gait_evolved_for_a_body_is_the_best_of_them_there() -> None:
    """So a trial that tells two such bodies apart is worth something, and one gait is not robust.

    What a fish with one flipper does to go straight turns that with the other in circles.
    """
    left, right = (HEALTHY * np.repeat(np.roll([0.0, 1.0, 1.0], k), 3) for k in (0, 1))
    utility = GaitUtility(threads=1, gaits=3, generations=8, population=60, seconds=10.0)
    far = utility(np.array([left, right]))
    assert far[:, 0].argmax() != far[:, 1].argmax()
    assert robustness(far) < 0.9
    assert robustness(utility(np.array([left, left]))) == 1.0


def test_bodies_that_are_alike_still_have_two_gaits() -> None:
    assert checked_utilities(QUICK, np.array([HEALTHY])).shape == (2, 1)


def test_those_that_differ_most_come_first_and_none_twice() -> None:
    points = np.array([[0.0, 0.0], [0.1, 0.0], [1.0, 0.0], [0.0, 0.6], [1.0, 0.0]])
    assert different(points, 3).tolist() == [2, 3, 1]
    assert different(points, 9).tolist() == [2, 3, 1, 0]


@pytest.mark.parametrize(
    ("wrong", "message"),
    [({"gaits": 1}, "gaits must be"), ({"poses": 0}, "poses"), ({"population": 3}, "population")],
)
def test_wrong_settings_are_refused(wrong: dict[str, int], message: str) -> None:
    with pytest.raises(InvalidArgumentError, match=message):
        GaitUtility(**wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("words", "setting"),
    [
        (("--exploration.strategy", "gait"), "exploration.strategy = gait"),
        (("--joint.robust", "0.9"), "joint.robust"),
    ],
)
def test_a_package_without_gaits_says_where_they_are(
    words: tuple[str, str], setting: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert eea.__main__.main(["run", "--out", str(out), *SMALL, *words]) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"eea: {setting} needs gaits")
    assert "aquafish run" in said
    assert len(said.splitlines()) == 1
    study = ["study", "--out", str(out), "--conditions", "joint", "--steps", "64", *words]
    assert eea.__main__.main(study) == 2
    assert f"{setting} needs gaits, of which a study has none" in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.parametrize("condition", ["joint", "none"])
@pytest.mark.usefixtures("quick")
def test_a_run_chooses_trials_for_the_gait(condition: str, tmp_path: Path) -> None:
    few = ("--estimation.population", "6", "--estimation.generations", "2",
           "--exploration.population", "6", "--condition", condition)  # fmt: skip
    words = ["run", "--out", str(tmp_path), *SMALL, *few, "--exploration.strategy", "gait"]
    assert main(words) == 0
    rounds = json.loads((tmp_path / "result.json").read_text())["rounds"]
    assert [r["action_fitness"] is None for r in rounds] == [True, False]
    assert rounds[1]["action_fitness"] >= 0.0


@pytest.mark.parametrize(
    ("rule", "bound", "words"),
    [
        ("narrow", "1.0", "stopped: narrow, every 90% interval is at most 1 of its range"),
        (
            "robust",
            "0.0",
            "stopped: robust, one gait keeps at least 0% of what is possible on nine in ten",
        ),
    ],
)
@pytest.mark.usefixtures("quick")
def test_a_run_stops_early_and_says_why(
    rule: str, bound: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fitted = ("--joint.bodies", "96", "--joint.poses", "96", "--joint.descents", "24",
              "--joint.polished", "4", "--joint.nuisances", f"--joint.{rule}", bound)  # fmt: skip
    assert main(["run", "--out", str(tmp_path), *SMALL, *fitted]) == 0
    result = json.loads((tmp_path / "result.json").read_text())
    assert (result["stopped"], len(result["rounds"])) == (rule, 1)
    assert words in capsys.readouterr().out


@pytest.mark.slow
def test_the_case_study_chooses_joint_inferences_trials_as_told() -> None:
    small = Recover(
        rounds=2, joint_rounds=2, steps=64, models=6, angle_sets=6, generations=2, population=10,
        gait_poses=1, poses=1, seconds=1.0, target_engine="numba", joint_strategy="gait",
    )  # fmt: skip
    jobs = {job.treatment: job for job in small.treatments()}
    assert jobs["joint"].eea.strategy == "gait"
    assert jobs["out-of-band"].eea.strategy == "disagreement"
    joint = jobs["joint"]
    few = replace(joint.eea.joint, bodies=8, poses=8, descents=2, polished=1, restarts=0)
    joint = replace(joint, eea=replace(joint.eea, joint=few))
    outcome = treat(joint, lambda _text, _share: None)
    assert outcome["rounds"][1]["action_fitness"] >= 0.0
