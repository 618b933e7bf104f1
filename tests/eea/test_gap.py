"""A target that differs from the world its models swim in, and the commands that offer it."""

from __future__ import annotations

import json

import numpy as np
import pytest

from aquafish_gym import Damage, Morphology, simulate
from aquafish_gym.utils.validation import InvalidArgumentError
from eea import EngineTarget, PaperConfig, RealityGap
from eea.__main__ import main
from eea.core.checks import ConfigurationError
from eea.core.config import EstimationConfig, ExplorationConfig
from eea.study.replicate import StudyWorld
from eea.study.study import Study
from tests.in_process import jobs_in_process

DAMAGE = "left_pectoral:length=0.5"
COMMAND = np.array([0.4, -0.3, 0.8])
STEPS = 128


def fish(gap: RealityGap, **options) -> EngineTarget:
    rng = np.random.default_rng(3)
    return EngineTarget(
        None, DAMAGE, rng, STEPS, options.pop("engine", "numba"), gap=gap, **options
    )


@pytest.mark.parametrize(
    ("gap", "told"),
    [
        (RealityGap(drag=(0.8, 1.2)), {"drag": (0.8, 1.2)}),
        (RealityGap(servo_gain=(0.9, 1.0, 1.1)), {"servo_gain": (0.9, 1.0, 1.1)}),
        (RealityGap(lag=0.05), {"lag": 0.05}),
        (RealityGap(reactive=True), {"reactive": True}),
        (RealityGap(current=(0.1, -0.2, 0.0)), {"current": (0.1, -0.2, 0.0)}),
        (RealityGap(substeps=8), {"substeps": 8}),
    ],
    ids=str,
)
def test_the_target_swims_in_the_world_that_the_gap_says(gap, told):
    target = fish(gap)
    log = target.perform(COMMAND)
    body, angles = target.morphology, target.start_angles
    same = simulate(body, COMMAND, angles, steps=STEPS, dtype="float64", **told)
    plain = simulate(body, COMMAND, angles, steps=STEPS, dtype="float64")
    assert np.array_equal(log.gyro, same.gyro)
    assert np.abs(log.gyro - plain.gyro).max() > 1e-4
    assert np.array_equal(fish(RealityGap()).morphology.to_array(), body.to_array())


def test_a_gap_is_relative_to_what_target_and_models_share():
    ours = fish(RealityGap(current=(0.1, 0.0, 0.0), substeps=4), current=(0.2, 0, 0), substeps=2)
    same = fish(RealityGap(), current=(0.1 + 0.2, 0, 0), substeps=8)
    assert np.array_equal(ours.perform(COMMAND).gyro, same.perform(COMMAND).gyro)


def test_noise_and_bias_are_the_gyroscopes_alone():
    clear = fish(RealityGap()).perform(COMMAND)
    noisy = fish(RealityGap(gyro_noise=0.02, gyro_bias=(0.5, 0.0, -0.5))).perform(COMMAND)
    apart = noisy.gyro - clear.gyro
    assert apart.mean(axis=(0, 1)) == pytest.approx([0.5, 0.0, -0.5], abs=0.01)
    assert apart.std(axis=(0, 1)) == pytest.approx(0.02, rel=0.25)
    lagged = apart[0, 1:] * apart[0, :-1]  # white: what was tells nothing of what comes
    assert (lagged[:, 1]).mean() == pytest.approx(0.0, abs=1.5e-4)


def test_all_gaps_hide_the_same_angles_and_make_the_same_noise():
    found = []
    for lag in (0.0, 0.02):
        noisy, clear = fish(RealityGap(gyro_noise=0.01, lag=lag)), fish(RealityGap(lag=lag))
        noise = [noisy.perform(COMMAND).gyro - clear.perform(COMMAND).gyro for _ in range(2)]
        found.append((noisy.start_angles, *noise))
    assert np.array_equal(found[0][0], found[1][0])
    for one, other in zip(found[0][1:], found[1][1:], strict=True):
        assert one == pytest.approx(other, abs=1e-12)
    assert np.abs(found[0][1] - found[0][2]).max() > 0.01  # it differs by trial


def test_a_gap_says_what_it_is():
    assert str(RealityGap()) == "nothing"
    gap = RealityGap(reactive=True, current=(0.1, 0.0, -0.1))
    assert str(gap) == "current 0.1 0 -0.1, reactive"
    assert RealityGap(**json.loads(json.dumps(gap.changes))) == gap


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"gyro_noise": -0.1}, "gyro_noise must lie in"),
        ({"gyro_bias": (0.0, 0.0, float("nan"))}, "gyro_bias must be finite"),
        ({"substeps": 0}, "substeps must be a whole number"),
    ],
)
def test_a_wrong_gap_is_refused(wrong, said):
    with pytest.raises(InvalidArgumentError, match=said):
        RealityGap(**wrong)


def test_a_target_wants_a_gap_and_no_more_substeps_than_there_are():
    with pytest.raises(ConfigurationError, match="gap must be of type RealityGap"):
        EngineTarget(gap=0.01, engine="numba")
    with pytest.raises(InvalidArgumentError, match="substeps must be"):
        fish(RealityGap(substeps=64), substeps=2)


QUICK = PaperConfig(
    condition="none",
    steps=32,
    rounds=1,
    exploration=ExplorationConfig(6, 3),
    estimation=EstimationConfig(population=8, generations=5),
)


@jobs_in_process()
def test_a_study_takes_a_gap_and_notes_it_only_if_there_is_one(tmp_path, monkeypatch):
    monkeypatch.setattr("eea.study.figures.save_study_figures", lambda *_: [])  # others draw them
    options = ["--preset", "smoke", "--conditions", "none", "--replicates", "1", "--workers", "1"]
    out = tmp_path / "study"
    assert main(["study", "--out", str(out), *options, "--gap.lag", "0.05"]) == 0
    assert json.loads((out / "study.json").read_text())["gap"] == {"lag": 0.05}
    assert "differs from its models' in lag 0.05" in (out / "summary.md").read_text()
    assert main(["study", "--out", str(out), *options]) == 2  # another world than the folder's
    plain = StudyWorld(Morphology.nominal(), Damage())
    assert "gap" not in Study({"none": QUICK}, (32,), 0, 1, plain).to_dict()
