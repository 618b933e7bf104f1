"""A posterior in a file: all of it again, or one error that names the file."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from aquafish_gym.runs.arrays import write_arrays
from aquafish_gym.utils.validation import InvalidArgumentError
from eea import load_posterior, save_posterior
from eea.core.checks import ConfigurationError
from eea.infer.file import to_arrays
from eea.infer.statement import Number
from swing import SWING, infer

BIAS = Number(-0.1, 0.1, mean=0.0, sd=0.05, varies=True)
DRIFTING = replace(SWING, numbers={**SWING.numbers, "bias": BIAS})


@pytest.fixture(scope="module")
def result():
    return infer(robot=DRIFTING, alternatives="always")


@pytest.fixture
def path(tmp_path):
    return tmp_path / "posterior.npz"


def header_of(arrays):
    return json.loads(arrays["header"].tobytes())


def with_header(arrays, **changes):
    text = json.dumps(header_of(arrays) | changes).encode()
    return arrays | {"header": np.frombuffer(text, np.uint8)}


def refused(path, message):
    with pytest.raises(InvalidArgumentError, match=message) as refusal:
        load_posterior(path)
    assert str(path) in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_sensors_may_have_any_unit(result, path):
    """A count of a converter is no rad/s: noise of 40,000 of them is a sensor's."""
    loud = replace(result.belief, sigma=4e4)
    save_posterior(path, loud)
    assert load_posterior(path).sigma == 4e4


@pytest.mark.parametrize("trial", [5, -1, 2.5])
def test_angles_of_a_trial_that_there_is_not_are_refused(result, trial):
    with pytest.raises(ConfigurationError, match="trial must be a whole number of at least 0 and"):
        result.belief.angles(trial)


@pytest.mark.parametrize("motor", [1.0, 0.0])
def test_posterior_survives_a_file_to_the_bit(path, motor):
    belief = infer(motor=motor, robot=DRIFTING, alternatives="always").belief
    assert (belief.branches[0].hypothesis.name == "the motor is dead") == (motor == 0.0)
    save_posterior(path, belief)
    found = load_posterior(path)
    assert found.to_dict() == belief.to_dict()
    assert found.findings == belief.findings
    assert np.array_equal(*(one.sample(100, np.random.default_rng(3)) for one in (found, belief)))
    assert np.array_equal(found.angles(1), belief.angles(1))
    again = path.with_name("again.npz")
    save_posterior(again, found)
    assert again.read_bytes() == path.read_bytes()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"schema": "eea.belief/1"}, "schema must be eea.posterior/6; it is 'eea.belief/1': infer"),
        ({"trials": 1}, "its parameters must be"),
        ({"numbers": {"bias": {"colour": 1.0}}}, "does not describe a posterior: TypeError"),
        ({"goodness": {}}, "does not describe a posterior: TypeError"),
        ({"sigma": float("nan")}, "its sigma"),
        ({"sigma": -1.0}, "its sigma"),
        ({"sigma": 10**400}, "its sigma"),
        ({"sigma": 1e-300}, "its sigma"),
        ({"samples": 10**12}, "its samples"),
        ({"trials": 10**9}, "its number of trials"),
        ({"branches": []}, "its probabilities' sum"),
    ],
)
def test_wrong_header_is_refused(result, path, changes, message):
    write_arrays(path, with_header(to_arrays(result.belief), **changes))
    refused(path, message)


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("theta", lambda a: a[:-1], "does not describe a posterior: ValueError"),
        ("header", lambda a: a[: len(a) // 2], "does not describe a posterior: JSONDecodeError"),
        ("cost", lambda a: a[None], "must have cost of shape"),
        ("information", lambda a: a * np.nan, "its information must be finite"),
        ("information", lambda a: -a, "its information must be at least 0"),
        ("information", lambda a: 1e40 * a, "its information must be at least 0 and at most"),
        ("information", lambda a: a + np.arange(a.size), "its information must be symmetric"),
        ("theta", lambda a: a + 10.0, r"its theta of .+ must lie in"),
        ("theta", lambda a: 1e300 * a, r"its theta of .+ must lie in"),
        ("cost", lambda a: a + 1e300, "its cost"),
        (
            "cost",
            lambda a: np.append(a, a[:1]),
            "does not describe a posterior|its modes must be|its theta",
        ),
        ("gradient", lambda a: a * np.inf, "its gradient must be finite"),
    ],
)
def test_wrong_arrays_are_refused(result, path, name, change, message):
    arrays = to_arrays(result.belief)
    write_arrays(path, arrays | {name: change(arrays[name])})
    refused(path, message)


def test_shapes_that_are_no_normal_distributions_are_refused(result, path):
    """A symmetric matrix with a positive diagonal may still have a negative eigenvalue."""
    arrays = to_arrays(result.belief)
    modes = arrays["cost"].size
    size = arrays["theta"].size // modes
    wrong = np.tile(np.full((size, size), 2.0) - np.eye(size), (modes, 1, 1))
    write_arrays(path, arrays | {"information": wrong.ravel()})
    refused(path, "its information must have no negative eigenvalue")


@pytest.mark.parametrize(
    ("field", "value"),
    [("p", 1.5), ("whiteness_p", -0.1), ("good", "yes"), ("rms", -1.0), ("verdict", 3)],
)
def test_a_goodness_of_no_sense_is_refused(result, path, field, value):
    arrays = to_arrays(result.belief)
    goodness = header_of(arrays)["goodness"] | {field: value}
    write_arrays(path, with_header(arrays, goodness=goodness))
    refused(path, f"its {field}")


def test_probabilities_that_do_not_sum_to_one_are_refused(result, path):
    arrays = to_arrays(result.belief)
    branches = [
        row | {"probability": 0.4 * row["probability"]} for row in header_of(arrays)["branches"]
    ]
    write_arrays(path, with_header(arrays, branches=branches))
    refused(path, "its probabilities' sum")
