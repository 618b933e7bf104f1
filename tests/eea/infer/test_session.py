"""Joint inference online and offline, and its posterior in a file."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from aquafish_gym.runs.arrays import write_arrays
from aquafish_gym.utils.validation import InvalidArgumentError
from eea import load_posterior, save_posterior
from eea.core.checks import ConfigurationError
from eea.core.session import streams
from eea.infer.file import to_arrays
from eea.infer.fit import fit
from eea.infer.session import JointInference
from eea.infer.statement import Number
from eea.infer.trials import Observed
from swing import CONFIG, PROBLEM, SWING, TRUTH, Swinging, infer


class Recorded(Swinging):
    """Keeps its trials, and fails once in one of them."""

    def __init__(self, fails_in=0):
        super().__init__()
        self.fails_in, self.commands, self.logs = fails_in, [], []

    def perform(self, command):
        if len(self.commands) + 1 == self.fails_in:
            self.fails_in = 0
            raise KeyboardInterrupt
        log = super().perform(command)
        self.commands.append(command)
        self.logs.append(log.gyro)
        return log


def test_offline_fits_equal_the_session():
    robot = Recorded()
    session = JointInference(robot, SWING, PROBLEM, CONFIG, 0, TRUTH)
    rng, earlier = streams(0)["estimation"], None
    for count, record in enumerate(session, 1):
        trials = Observed(np.array(robot.commands[:count]), np.array(robot.logs[:count]))
        earlier = fit(trials, SWING, CONFIG, rng, earlier)
        assert earlier.to_dict() == session.result.belief.to_dict()
        assert record.morphology == tuple(earlier.model)
        assert record.trials == earlier.warm_start.robots > 0


def test_interrupted_round_leaves_no_trace():
    expected = JointInference(Recorded(), SWING, PROBLEM, CONFIG, 0, TRUTH).run()
    session = JointInference(Recorded(fails_in=2), SWING, PROBLEM, CONFIG, 0, TRUTH)
    with pytest.raises(KeyboardInterrupt):
        session.run()
    assert len(session.result.rounds) == 1
    result = session.run()
    assert result.belief.to_dict() == expected.belief.to_dict()
    assert [replace(r, seconds=0.0) for r in result.rounds] == [
        replace(r, seconds=0.0) for r in expected.rounds
    ]


def test_session_stops_once_intervals_are_narrow():
    assert infer(max_interval_width=0.9, rounds=5).stopped == "narrow"
    assert infer(max_interval_width=0.0).stopped == "rounds"


def test_unknown_nuisances_and_infinite_signals_are_refused():
    with pytest.raises(ConfigurationError, match="nuisances must be one of bias; got 'bios'"):
        infer(nuisances=("bios",))
    trials = Observed(np.zeros((1, 1)), np.full((1, 64, 2), np.nan))
    with pytest.raises(ConfigurationError, match="signal must be finite"):
        fit(trials, SWING, CONFIG, np.random.default_rng(0))


BIAS = Number(-0.1, 0.1, mean=0.0, sd=0.05, varies=True)
DRIFTING = replace(SWING, numbers={**SWING.numbers, "bias": BIAS})


@pytest.fixture(scope="module")
def arrays():
    return to_arrays(infer(robot=DRIFTING, alternatives="always").belief)


def refused(path, arrays, said):
    write_arrays(path, arrays)
    with pytest.raises(InvalidArgumentError, match=said) as refusal:
        load_posterior(path)
    assert str(path) in str(refusal.value)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("motor", [1.0, 0.0])
def test_posterior_survives_a_file_to_the_bit(tmp_path, motor):
    belief = infer(motor=motor, robot=DRIFTING, alternatives="always").belief
    assert (belief.branches[0].hypothesis.name == "the motor is dead") == (motor == 0.0)
    if motor:  # sensors may have any unit: noise of 40,000 counts of a converter is a sensor's
        belief = replace(belief, sigma=4e4)
    save_posterior(tmp_path / "one.npz", belief)
    found = load_posterior(tmp_path / "one.npz")
    assert found.sigma == belief.sigma
    assert found.to_dict() == belief.to_dict()
    assert found.findings == belief.findings
    assert np.array_equal(*(one.sample(100, np.random.default_rng(3)) for one in (found, belief)))
    assert np.array_equal(found.angles(1), belief.angles(1))
    save_posterior(tmp_path / "again.npz", found)
    assert (tmp_path / "again.npz").read_bytes() == (tmp_path / "one.npz").read_bytes()


def test_wrong_headers_are_refused(arrays, tmp_path):
    header = json.loads(arrays["header"].tobytes())
    unlikely = [row | {"probability": 0.4 * row["probability"]} for row in header["branches"]]
    no_sense = {"p": 1.5, "whiteness_p": -0.1, "good": "yes", "rms": -1.0, "verdict": 3}
    for changes, said in (
        ({"schema": "eea.belief/1"}, "schema must be eea.posterior/6; it is 'eea.belief/1': infer"),
        ({"trials": 1}, "its parameters must be"),
        ({"numbers": {"bias": {"colour": 1.0}}}, "does not describe a posterior: TypeError"),
        ({"goodness": {}}, "does not describe a posterior: TypeError"),
        *(({"sigma": sigma}, "its sigma") for sigma in (float("nan"), -1.0, 10**400, 1e-300)),
        ({"samples": 10**12}, "its samples"),
        ({"trials": 10**9}, "its number of trials"),
        ({"branches": []}, "its probabilities' sum"),
        ({"branches": unlikely}, "its probabilities' sum"),
        *(
            ({"goodness": header["goodness"] | {field: value}}, f"its {field}")
            for field, value in no_sense.items()
        ),
    ):
        text = json.dumps(header | changes).encode()
        wrong = arrays | {"header": np.frombuffer(text, np.uint8)}
        refused(tmp_path / "posterior.npz", wrong, said)


def indefinite(_, arrays):
    """Return symmetric matrices with positive diagonals and a negative eigenvalue."""
    modes = arrays["cost"].size
    size = arrays["theta"].size // modes
    return np.tile(np.full((size, size), 2.0) - np.eye(size), (modes, 1, 1)).ravel()


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        ("theta", lambda a, _: a[:-1], "does not describe a posterior: ValueError"),
        ("header", lambda a, _: a[: len(a) // 2], "does not describe a posterior: JSONDecodeError"),
        ("cost", lambda a, _: a[None], "must have cost of shape"),
        ("information", lambda a, _: a * np.nan, "its information must be finite"),
        ("information", lambda a, _: -a, "its information must be at least 0"),
        ("information", lambda a, _: 1e40 * a, "its information must be at least 0 and at most"),
        ("information", lambda a, _: a + np.arange(a.size), "its information must be symmetric"),
        ("information", indefinite, "its information must have no negative eigenvalue"),
        ("theta", lambda a, _: a + 1.0001, r"its theta of .+ must lie in"),
        ("theta", lambda a, _: 1e300 * a, r"its theta of .+ must lie in"),
        ("cost", lambda a, _: a + 1e300, "its cost"),
        ("cost", lambda a, _: np.append(a, a[:1]), "not describe a post|its modes must|its theta"),
        ("gradient", lambda a, _: a * np.inf, "its gradient must be finite"),
    ],
)
def test_wrong_arrays_are_refused(arrays, tmp_path, name, change, said):
    wrong = arrays | {name: change(arrays[name], arrays)}
    refused(tmp_path / "posterior.npz", wrong, said)
