"""A log that no body explains: what is wrong with it is found, and said before all numbers."""

from __future__ import annotations

import numpy as np
import pytest

from aquafish_gym import Damage, Morphology, simulate
from aquafish_gym.utils.storage import read_document
from eea import RecordedLog, SwimLog, check_log, infer_log, load_posterior, write_log
from eea.__main__ import main
from eea.fish.log_changes import DEGREE, LogChange
from eea.fish.log_checks import CHECKLIST
from tests.pictures import is_drawn

COMMANDS = [(0.5, -0.5, 1.0), (-0.5, -0.4, 0.5), (0.5, 0.5, 1.0)]
SLOW = [(0.12, -0.1, 0.25), (-0.1, -0.06, 0.15), (0.08, 0.12, 0.3)]


def swim(seed=3, commands=COMMANDS, steps=128, noise=0.01, reading=None):
    """Return the log of a fish with half a left flipper; ``reading`` changes its gyroscope's."""
    body = Damage.parse("left_pectoral:length=0.5").apply(Morphology.nominal())
    rng = np.random.default_rng(seed)
    angles = rng.uniform(-np.pi, np.pi, (len(commands), 3))
    logs = [
        simulate(body, u, a, steps, dtype="float64") for u, a in zip(commands, angles, strict=True)
    ]
    noisy = [one.gyro[0] + rng.normal(0.0, noise, one.gyro[0].shape) for one in logs]
    return SwimLog.of_trials(
        commands, [RecordedLog(gyro if reading is None else reading(gyro)) for gyro in noisy]
    )


def spoiled(log, time=1.0, gyro=None, flippers=(0, 1)):
    """Return a log as a careless logger writes it."""
    return SwimLog(
        time * log.time,
        log.gyro if gyro is None else gyro(log.gyro),
        log.commands[:, [*flippers, 2]],
        log.trial,
    )


CASES = {
    "x and y exchanged": (
        lambda log: spoiled(log, gyro=lambda g: g[:, [1, 0, 2]]),
        "with x and y of the gyroscope exchanged a body fits",
    ),
    "ROS": (
        lambda log: spoiled(log, gyro=lambda g: g @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]]).T),
        "taken from the log's -y, x and z, as in ROS a body fits",
    ),
    "sign of z": (
        lambda log: spoiled(log, gyro=lambda g: g * (1, 1, -1)),
        "with the sign of z of the gyroscope changed a body fits",
    ),
    "flippers": (
        lambda log: spoiled(log, flippers=(1, 0)),
        "with the commands of the left and right flipper exchanged (or",
    ),
    "clock too slow": (
        lambda log: spoiled(log, time=1.2),
        "with time running 1.2 times as fast a body fits",
    ),
    "clock too fast": (
        lambda log: spoiled(log, time=0.8),
        "with time running 0.8 times as fast a body fits",
    ),
    "a constant": (
        lambda log: spoiled(log, gyro=lambda g: g + np.array([0.0, 0.0, 0.6])),
        "a constant taken from the gyroscope (0.6 rad/s from z) a body fits",
    ),
    "early": (
        lambda log: LogChange(rows=-3).apply(log),
        "with the gyroscope 30 ms later a body fits",
    ),
}


QUICK = "sign of z"  # each case takes seconds; the first is that of the command below


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=() if name == QUICK else pytest.mark.slow) for name in CASES],
)
def test_what_is_wrong_with_a_log_is_named(name):
    spoil, said = CASES[name]
    found = check_log(spoil(swim()), unexplained=1.0, threads=1)
    assert said in str(found)
    assert found.tried[0].good
    assert found.tried[0].unexplained < 0.05


@pytest.mark.slow
def test_degrees_are_named_where_a_slow_swim_passes_for_one_in_radians():
    log = swim(commands=SLOW, noise=1e-4, steps=160)
    degrees = spoiled(log, gyro=lambda g: g / DEGREE)
    found = check_log(degrees, threads=1)
    assert str(found).startswith("with the gyroscope read in degrees/s a body fits")
    assert found.unexplained > 0.5


@pytest.mark.slow
def test_a_log_of_noise_is_asked_about_in_all_respects():
    noise = np.random.default_rng(1).normal(0.0, 0.5, swim().gyro.shape)
    found = check_log(spoiled(swim(), gyro=lambda _: noise), unexplained=1.0, threads=1)
    assert not found.fits
    assert str(found).endswith(CHECKLIST)
    for word in ("time", "clock", "rad/s", "x right", "commands", "at rest"):
        assert word in CHECKLIST


def test_every_change_is_undone_by_its_inverse():
    log = swim()
    there, back = LogChange(axes=("-y", "x", "z")), LogChange(axes=("y", "-x", "z"))
    np.testing.assert_array_equal(back.apply(there.apply(log)).gyro, log.gyro)
    assert LogChange().apply(log).gyro.tobytes() == log.gyro.tobytes()
    late = LogChange(rows=2, delay=0.02).apply(log)
    first = log.blocks[0]
    np.testing.assert_allclose(late.time[1], log.time[first][3])
    np.testing.assert_array_equal(late.gyro[1], log.gyro[first][1])


def test_infer_says_first_that_no_body_fits_and_last_why(tmp_path, capsys):
    write_log(tmp_path / "swim.csv", CASES["x and y exchanged"][0](swim()))
    out = tmp_path / "out"
    words = ["infer", "--log", str(tmp_path / "swim.csv"), "--out", str(out), "--threads", "1"]
    assert main(words) == 0
    streams = capsys.readouterr()
    said = streams.out.splitlines()
    assert said[0].startswith("no body explains the log")
    assert "there are no intervals" in said[1]
    assert said[2].split() == ["in", "units", "of", "5", "cm", "found"]
    assert all(len(line.split()) == 2 for line in said[3:12])
    assert said[-1].startswith("with x and y of the gyroscope exchanged a body fits")
    assert "x right" in said[-1]
    assert not any("interval" in line for line in said[2:])
    assert streams.err.startswith("fitting 3 trials")
    assert read_document(out / "result.json", "eea.result/1")["belief"]["intervals"] == {}
    assert not load_posterior(out / "posterior.npz").good
    assert is_drawn(out / "posterior.png")


def test_an_estimate_prints_its_verdict_its_sizes_and_what_broke():
    lines = str(infer_log(swim(steps=200), threads=1)).splitlines()
    assert lines[0].startswith("the best fit leaves 0.0")
    assert lines[1].split() == ["in", "units", "of", "5", "cm", "found", "90%", "interval"]
    assert lines[3].split()[0] == "left_pectoral.length"
    assert lines[-1] == "compared with the undamaged fish, the left flipper has 50% of its length"
