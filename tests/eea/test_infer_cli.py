"""The command infer: from a file alone to a body, or to why there is none."""

from __future__ import annotations

import runpy
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from aquafish_gym import Damage, Morphology, simulate
from aquafish_gym.bodies import read_bodies
from aquafish_gym.engines.api import simulate_scenario
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.storage import read_document
from aquafish_gym.utils.validation import InvalidArgumentError
from eea import (
    ConfigurationError,
    FitConfig,
    RecordedLog,
    SwimLog,
    infer_log,
    load_posterior,
    write_log,
)
from eea.__main__ import main
from tests.pictures import is_drawn

EXAMPLES = Path(__file__).parents[2] / "examples"
SWIM, BODY = EXAMPLES / "logs" / "swim.csv", EXAMPLES / "logs" / "body.json"
FAST = [(0.5, -0.5, 1.0), (-0.5, -0.5, 0.5), (0.5, 0.5, 1.0)]
LEFT, RIGHT = (
    Damage.parse(f"{side}_pectoral:length=0.5").apply(Morphology.nominal()).to_array()
    for side in ("left", "right")
)


def swum(bodies, commands, seed=0, steps=128, noise=0.01):
    """Return what fish (E, 9), of any size, feel under commands (E, 3), as a log."""
    rng = np.random.default_rng(seed)
    angles = rng.uniform(-np.pi, np.pi, (len(commands), 3))
    robots = Scenario.fill({"body": np.array(bodies), "fin_angles": angles})
    felt = simulate_scenario(
        robots, np.array(commands, dtype=float), steps, dtype="float64", record="gyro"
    ).gyro
    assert felt is not None
    noisy = felt + noise * rng.standard_normal(felt.shape)
    return SwimLog.of_trials(commands, [RecordedLog(one) for one in noisy])


def infer(log, tmp_path, capsys, *options):
    write_log(tmp_path / "swim.csv", log)
    assert main(["infer", "--log", str(tmp_path / "swim.csv"), "--threads", "1", *options]) == 0
    return capsys.readouterr().out.splitlines()


@pytest.fixture
def uncompiled(monkeypatch):
    """Fail a test that simulates a fish: a first simulation compiles for half a minute."""

    def simulated(*_arguments, **_options):
        pytest.fail("a fish was simulated before the refusal")

    monkeypatch.setattr("eea.fish.simulator.simulate", simulated)


def test_the_example_is_written_again_to_the_same_bytes(tmp_path):
    write = runpy.run_path(str(EXAMPLES / "recorded_swim.py"))["RecordedSwim"]
    write(out=tmp_path).execute()
    for path in (SWIM, BODY):
        assert (tmp_path / path.name).read_bytes() == path.read_bytes()


def test_a_refused_example_writes_nothing(tmp_path):
    write = runpy.run_path(str(EXAMPLES / "recorded_swim.py"))["RecordedSwim"]
    for name in ("damage", "later"):
        with pytest.raises(InvalidArgumentError, match="damage part"):
            write(out=tmp_path / "new", **{name: "tail:missing"}).execute()
    assert not (tmp_path / "new").exists()


def test_the_example_becomes_a_body_with_intervals_and_a_folder(tmp_path, capsys):
    out = tmp_path / "new" / "body"
    words = ["infer", "--log", str(SWIM), "--truth", str(BODY), "--out", str(out)]
    assert main(words) == 0
    said = capsys.readouterr().out.splitlines()
    result = read_document(out / "result.json", "eea.result/1")
    assert result["objective_fitness"] > 0.99
    assert "rounds" not in result
    low, high = load_posterior(out / "posterior.npz").interval(0.9)
    rows = [line.split() for line in said[2:11]]
    assert [row[0] for row in rows] == result["dimensions"]
    np.testing.assert_allclose([float(row[1]) for row in rows], result["morphology"], atol=6e-4)
    np.testing.assert_allclose([float(row[2]) for row in rows], low, atol=6e-4)
    np.testing.assert_allclose([float(row[4]) for row in rows], high, atol=6e-4)
    assert [float(row[5]) for row in rows] == result["truth"]
    assert any(line.startswith("OBJ_FIT 1.00; the true body") for line in said)
    assert any(line.startswith("servo gain  ") for line in said)
    assert said[0].startswith("the best fit leaves 0.009")
    assert said[-1] == "compared with the undamaged fish, the left flipper has 50% of its length"
    assert len(read_bodies(out / "bodies.json")) == 50
    assert is_drawn(out / "posterior.png")
    before = (out / "posterior.npz").read_bytes()
    assert main([*words, "--threads", "1"]) == 0, "the same command replaces it"
    assert (out / "posterior.npz").read_bytes() == before
    assert main([*words, "--seed", "1"]) == 2
    assert (
        "holds a body inferred from a recorded swim with seed 0, not 1" in capsys.readouterr().err
    )


def test_without_the_truth_there_is_no_fitness(tmp_path, capsys):
    said = infer(swum([LEFT] * 2, FAST[:2]), tmp_path, capsys, "--nuisances")
    assert said[1].split() == ["in", "units", "of", "5", "cm", "found", "90%", "interval"]
    assert not any("OBJ_FIT" in line or "true" in line or "besides" in line for line in said)
    assert float(said[3].split()[1]) == pytest.approx(0.8, abs=0.05)


@pytest.mark.usefixtures("uncompiled")
@pytest.mark.parametrize(("moving", "name"), [(False, "curent"), (True, "current")])
def test_infer_log_refuses_nuisances_that_a_log_has_not(moving, name):
    log = swum([LEFT], FAST[:1])
    with pytest.raises(ConfigurationError, match="nuisances must be one of"):
        infer_log(log, FitConfig(nuisances=(name,)), moving=moving)


@pytest.mark.parametrize("noise", [0.01, 0.0])
def test_a_log_without_motion_is_refused(noise, tmp_path, capsys):
    write_log(tmp_path / "still.csv", swum([LEFT] * 2, [(0.0, 0.0, 0.0)] * 2, noise=noise))
    assert main(["infer", "--log", str(tmp_path / "still.csv")]) == 2
    said = capsys.readouterr()
    assert "log must contain motion: no servo moves" in said.err
    assert said.out == ""


def test_a_still_trial_among_others_is_named(tmp_path, capsys):
    log = swum([LEFT] * 2, [FAST[0], (0.0, 0.0, 0.0)])
    said = infer(log, tmp_path, capsys, "--nuisances")
    assert said[0] == "in trial 2 no servo moves: it tells little about the body"
    assert float(said[4].split()[1]) == pytest.approx(0.8, abs=0.05)


def at_times(time, told, seed=0, body=LEFT):
    """Return what a gyroscope reads at odd times (T,) of a swim under told (T, 3) commands."""
    steps = int(np.ceil(time[-1] / 0.01)) + 4
    within = 0.01 * np.arange(steps) + 0.005
    held = told[np.searchsorted(time, within, "right") - 1]
    rng = np.random.default_rng(seed)
    angles = rng.uniform(-np.pi, np.pi, 3)
    log = simulate(body, held[None], angles, steps, dtype="float64", record="gyro")
    felt = np.concatenate([np.zeros((1, 1, 3)), np.asarray(log.gyro)], axis=1)[0]
    seen = CubicSpline(0.01 * np.arange(steps + 1), felt)(time)
    return seen + rng.normal(0.0, 0.01, seen.shape)


@pytest.mark.parametrize(("rate", "jitter"), [(104.0, 0.0), (40.0, 0.002)])
def test_a_log_of_any_rate_is_taken_as_it_is(rate, jitter):
    """Interpolating the log instead would make its noise look like a wrong model."""
    rng = np.random.default_rng(1)
    parts = []
    for trial, command in enumerate(FAST[:2], 1):
        time = np.arange(int(2.5 * rate)) / rate
        time[1:] += np.clip(rng.normal(0.0, 1.0, len(time) - 1), -3, 3) * jitter
        told = np.tile(command, (len(time), 1))
        parts.append((time, at_times(time, told, trial), told, np.full(len(time), trial)))
    estimate = infer_log(SwimLog(*map(np.concatenate, zip(*parts, strict=True))), truth=LEFT)
    assert estimate.objective_fitness > 0.98
    assert estimate.belief.good
