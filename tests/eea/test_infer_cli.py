"""The commands infer and watch: from a file to a body, to why there is none, or to a change."""

from __future__ import annotations

import json
import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from aquafish_gym import Damage, Morphology, simulate
from aquafish_gym.bodies import read_bodies
from aquafish_gym.utils.storage import read_document
from aquafish_gym.utils.validation import InvalidArgumentError
from eea import (
    FitConfig,
    RecordedLog,
    SwimLog,
    check_log,
    infer_changes,
    infer_log,
    load_posterior,
    read_log,
    save_posterior,
    watch_swim,
    write_log,
)
from eea.__main__ import main
from eea.fish import known_body
from eea.fish.known import Watched
from eea.fish.log_changes import DEGREE, LogChange
from eea.fish.log_checks import CHECKLIST
from eea.infer.known import Verdict
from fish_swims import BODY as SHORT
from fish_swims import swim, together
from tests.eea.infer.swing import infer as infer_swing
from tests.pictures import is_drawn

EXAMPLES = Path(__file__).parents[2] / "examples"
SWIM, BODY = EXAMPLES / "logs" / "swim.csv", EXAMPLES / "logs" / "body.json"
FAST = [(0.5, -0.5, 1.0), (-0.5, -0.5, 0.5), (0.5, 0.5, 1.0)]
LEFT = Damage.parse("left_pectoral:length=0.5").apply(Morphology.nominal())


def recorded(commands, seed=0, steps=128, noise=0.01):
    """Return the log of a fish with half a left flipper."""
    rng = np.random.default_rng(seed)
    angles = rng.uniform(-np.pi, np.pi, (len(commands), 3))
    felt = simulate(LEFT, commands, angles, steps, dtype="float64", record="gyro").gyro
    logs = [one + noise * rng.standard_normal(one.shape) for one in felt]
    return SwimLog.of_trials(commands, [RecordedLog(one) for one in logs])


def test_the_example_is_written_again_to_the_same_bytes(tmp_path):
    write = runpy.run_path(str(EXAMPLES / "recorded_swim.py"))["RecordedSwim"]
    write(out=tmp_path).execute()
    for path in (SWIM, BODY):
        assert (tmp_path / path.name).read_bytes() == path.read_bytes()
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


def test_a_log_without_motion_is_refused(tmp_path, capsys):
    for noise in (0.01, 0.0):
        write_log(tmp_path / "still.csv", recorded([(0.0, 0.0, 0.0)] * 2, noise=noise))
        assert main(["infer", "--log", str(tmp_path / "still.csv")]) == 2
        said = capsys.readouterr()
        assert "log must contain motion: no servo moves" in said.err
        assert said.out == ""


def test_a_still_trial_is_named_and_without_the_truth_there_is_no_fitness(tmp_path, capsys):
    write_log(tmp_path / "swim.csv", recorded([FAST[0], (0.0, 0.0, 0.0)]))
    words = ["infer", "--log", str(tmp_path / "swim.csv"), "--threads", "1", "--nuisances"]
    assert main(words) == 0
    said = capsys.readouterr().out.splitlines()
    assert said[0] == "in trial 2 no servo moves: it tells little about the body"
    assert said[2].split() == ["in", "units", "of", "5", "cm", "found", "90%", "interval"]
    assert not any("OBJ_FIT" in line or "true" in line or "besides" in line for line in said)
    assert float(said[4].split()[1]) == pytest.approx(0.8, abs=0.05)


def at_times(time, told, seed=0):
    """Return what a gyroscope reads at odd times (T,) of a swim under told (T, 3) commands."""
    steps = int(np.ceil(time[-1] / 0.01)) + 4
    within = 0.01 * np.arange(steps) + 0.005
    held = told[np.searchsorted(time, within, "right") - 1]
    rng = np.random.default_rng(seed)
    angles = rng.uniform(-np.pi, np.pi, 3)
    log = simulate(LEFT, held[None], angles, steps, dtype="float64", record="gyro")
    felt = np.concatenate([np.zeros((1, 1, 3)), np.asarray(log.gyro)], axis=1)[0]
    seen = CubicSpline(0.01 * np.arange(steps + 1), felt)(time)
    return seen + rng.normal(0.0, 0.01, seen.shape)


def test_a_log_of_any_rate_is_taken_as_it_is():
    """Interpolating the log instead would make its noise look like a wrong model."""
    rng = np.random.default_rng(1)
    parts = []
    for trial, command in enumerate(FAST[:2], 1):
        time = np.arange(100) / 40.0
        time[1:] += np.clip(rng.normal(0.0, 1.0, len(time) - 1), -3, 3) * 0.002
        told = np.tile(command, (len(time), 1))
        parts.append((time, at_times(time, told, trial), told, np.full(len(time), trial)))
    estimate = infer_log(SwimLog(*map(np.concatenate, zip(*parts, strict=True))), truth=LEFT)
    assert estimate.objective_fitness > 0.98
    assert estimate.belief.good


SLOW = [(0.12, -0.1, 0.25), (-0.1, -0.06, 0.15), (0.08, 0.12, 0.3)]


def halved(steps=128, trials=3):
    return recorded([(0.5, -0.5, 1.0), (-0.5, -0.4, 0.5), (0.5, 0.5, 1.0)][:trials], 3, steps)


def spoiled(log, time=1.0, gyro=None, flippers=(0, 1)):
    """Return a log as a careless logger writes it."""
    read = log.gyro if gyro is None else gyro(log.gyro)
    return SwimLog(time * log.time, read, log.commands[:, [*flippers, 2]], log.trial)


ROS = np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]])
EXCHANGED = {"gyro": lambda g: g[:, [1, 0, 2]]}
CASES = {
    "x and y of the gyroscope exchanged": EXCHANGED,
    "taken from the log's -y, x and z, as in ROS": {"gyro": lambda g: g @ ROS.T},
    "the sign of z of the gyroscope changed": {"gyro": lambda g: g * (1, 1, -1)},
    "the commands of the left and right flipper exchanged (or": {"flippers": (1, 0)},
    "time running 1.2 times as fast": {"time": 1.2},
    "time running 0.8 times as fast": {"time": 0.8},
    "(0.6 rad/s from z)": {"gyro": lambda g: g + np.array([0.0, 0.0, 0.6])},
}


@pytest.mark.slow
@pytest.mark.parametrize("said", [*CASES, "the gyroscope 30 ms later"])
def test_what_is_wrong_with_a_log_is_named(said):
    wrong = (
        spoiled(halved(), **CASES[said]) if said in CASES else LogChange(rows=-3).apply(halved())
    )
    found = check_log(wrong, unexplained=1.0, threads=1)
    assert said in str(found)
    assert "a body fits" in str(found)
    assert found.tried[0].good
    assert found.tried[0].unexplained < 0.05


@pytest.mark.slow
def test_degrees_are_named_where_a_slow_swim_passes_for_one_in_radians():
    log = recorded(SLOW, 3, 160, 1e-4)
    found = check_log(spoiled(log, gyro=lambda g: g / DEGREE), threads=1)
    assert str(found).startswith("with the gyroscope read in degrees/s a body fits")
    assert found.unexplained > 0.5


@pytest.mark.slow
def test_a_log_of_noise_is_asked_about_in_all_respects():
    noise = np.random.default_rng(1).normal(0.0, 0.5, halved().gyro.shape)
    found = check_log(spoiled(halved(), gyro=lambda _: noise), unexplained=1.0, threads=1)
    assert not found.fits
    assert str(found).endswith(CHECKLIST)
    for word in ("time", "clock", "rad/s", "x right", "commands", "at rest"):
        assert word in CHECKLIST


def test_every_change_is_undone_by_its_inverse():
    log = halved()
    there, back = LogChange(axes=("-y", "x", "z")), LogChange(axes=("y", "-x", "z"))
    np.testing.assert_array_equal(back.apply(there.apply(log)).gyro, log.gyro)
    assert LogChange().apply(log).gyro.tobytes() == log.gyro.tobytes()
    late = LogChange(rows=2, delay=0.02).apply(log)
    first = log.blocks[0]
    np.testing.assert_allclose(late.time[1], log.time[first][3])
    np.testing.assert_array_equal(late.gyro[1], log.gyro[first][1])


def test_infer_says_first_that_no_body_fits_and_last_why(tmp_path, capsys):
    write_log(tmp_path / "swim.csv", spoiled(halved(64, trials=2), **EXCHANGED))
    out = tmp_path / "out"
    words = ["infer", "--log", str(tmp_path / "swim.csv"), "--out", str(out), "--threads", "1"]
    assert main([*words, "--nuisances"]) == 0
    streams = capsys.readouterr()
    said = streams.out.splitlines()
    assert said[0].startswith("no body explains the log")
    assert "there are no intervals" in said[1]
    assert said[2].split() == ["in", "units", "of", "5", "cm", "found"]
    assert all(len(line.split()) == 2 for line in said[3:12])
    assert said[-1].startswith("with x and y of the gyroscope exchanged a body fits")
    assert "x right" in said[-1]
    assert not any("interval" in line for line in said[2:])
    assert streams.err.startswith("fitting 2 trials")
    assert read_document(out / "result.json", "eea.result/1")["belief"]["intervals"] == {}
    assert not load_posterior(out / "posterior.npz").good
    assert is_drawn(out / "posterior.png")


STRUCK = 320  # samples


@pytest.fixture(scope="module")
def belief(tmp_path_factory):
    """Return a posterior inferred from a swim in a file."""
    folder = tmp_path_factory.mktemp("belief")
    write_log(folder / "swim.csv", swim(1, 520))
    log = read_log(folder / "swim.csv")
    found = infer_log(log, FitConfig(alternatives="never"), moving=True, threads=1)
    save_posterior(folder / "posterior.npz", found.belief)
    return folder / "posterior.npz"


@pytest.fixture
def watch(belief, tmp_path):
    """Return a function that writes a swim and watches it by the command."""

    def run(log, *words, posterior=belief):
        write_log(tmp_path / "swim.csv", log)
        files = ["--log", str(tmp_path / "swim.csv"), "--posterior", str(posterior)]
        out = ["--out", str(tmp_path / "out"), "--threads", "1"]
        return main(["watch", *files, *out, *words])

    return run


def test_a_swim_of_the_same_body_is_said_to_be_that(watch, capsys):
    assert watch(swim(5, 520)) == 0
    assert "4 windows: this is still the body that was inferred" in capsys.readouterr().out


def test_a_change_is_printed_plotted_and_saved(watch, tmp_path, capsys):
    other = Damage.parse("right_pectoral:length=0.6").apply(Morphology.coerce(SHORT))
    assert watch(swim(6, 720, other, STRUCK)) == 0
    assert "this is no longer the body that was inferred" in capsys.readouterr().out
    document = json.loads((tmp_path / "out" / "watched.json").read_text())
    assert 0.01 * STRUCK < document["noticed"] < 0.01 * STRUCK + 3.0
    assert [row["same"] for row in document["windows"]] == [True] * 3 + [False] * 3
    assert is_drawn(tmp_path / "out" / "watched.png")


def test_nothing_is_written_for_a_wrong_option_or_posterior(watch, tmp_path, capsys):
    for option in ("alarm", "seed", "threads"):
        assert watch(swim(5, 200), f"--{option}", "-1") == 2
        assert f"{option} must be" in capsys.readouterr().err
    np.savez(tmp_path / "other.npz", x=np.zeros(3))
    assert watch(swim(5, 200), posterior=tmp_path / "other.npz") == 2
    assert "posterior" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_the_seconds_of_all_trials_count(belief):
    log = together(swim(5, 320), swim(7, 320))
    watched = watch_swim(log, load_posterior(belief), threads=1)
    lasted = float(np.ptp(log.time[log.trial == log.trial[0]]))
    np.testing.assert_allclose(watched.time, [1.2, 2.2, lasted + 1.2, lasted + 2.2], atol=0.02)
    assert str(watched).startswith(f"{watched.time[-1]:.4g} s of swimming, 4 windows")


def test_a_posterior_of_another_robot_and_still_water_are_refused(belief):
    log, other = swim(5, 200), infer_swing().belief
    for judge in (watch_swim, infer_changes):
        with pytest.raises(
            ValueError, match="belief must be a posterior of this fish, with left_p"
        ):
            judge(log, other)
    silent = replace(known_body(Morphology.nominal(), 0.01), sigma=-1.0)
    with pytest.raises(ValueError, match="belief must be a posterior: its sigma"):
        infer_changes(log, silent)
    still = replace(log, commands=0.0 * log.commands)
    with pytest.raises(ValueError, match="no servo moves in any of its trials"):
        watch_swim(still, load_posterior(belief))


def test_a_change_is_noticed_by_the_end_of_a_window_and_no_chance_is_stated_as_0():
    looks = (Verdict(0.5, True, 1.0), Verdict(0.0, False, 99.0))
    said = str(Watched(np.array([1.2, 2.2]), looks, 1e-6))
    assert "by 2.2 s this is no longer the body that was inferred (p < 1e-300; one" in said
