"""A posterior in a file: whole again, or one error that names the file."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from aquafish_gym.runs.arrays import write_arrays
from aquafish_gym.runs.storage import DamagedFileError
from aquafish_gym.utils.validation import InvalidArgumentError
from eea import load_posterior, save_posterior
from eea.core.checks import ConfigurationError, TargetError
from eea.joint.problem import AS_COMMANDED
from eea.joint.serialization import to_arrays
from swing import TRUTH, infer


@pytest.fixture(scope="module")
def result():
    return infer(alternatives="always", per_trial=("bias",))


@pytest.fixture
def path(tmp_path):
    return tmp_path / "posterior.npz"


def header_of(arrays):
    return json.loads(arrays["header"].tobytes())


def with_header(arrays, **changes):
    text = json.dumps(header_of(arrays) | changes).encode()
    return arrays | {"header": np.frombuffer(text, np.uint8)}


def test_a_posterior_comes_back_to_the_digit(result, path):
    save_posterior(path, result.belief)
    found = load_posterior(path)
    low, high = found.interval(0.8)
    assert np.array_equal([low, high], result.interval(0.8))
    assert (low < high).all()
    assert np.array_equal(found.sample(100, np.random.default_rng(3)), result.sample(100, 3))
    assert found.table(0.5) == result.belief.table(0.5)
    assert found.findings == result.belief.findings
    assert found.to_dict() == result.belief.to_dict()
    assert np.array_equal(found.angles(1), result.belief.angles(1))
    again = path.with_name("again.npz")
    save_posterior(again, found)
    assert again.read_bytes() == path.read_bytes()


def test_each_hypothesis_comes_back(path):
    result = infer(motor=0.0, alternatives="always")
    names = [branch.hypothesis.name for branch in result.belief.branches]
    assert names[0] == "the motor is dead"
    save_posterior(path, result.belief)
    found = load_posterior(path)
    assert [branch.hypothesis.name for branch in found.branches] == names
    assert [b.probability for b in found.branches] == [
        b.probability for b in result.belief.branches
    ]
    assert np.abs(found.model - TRUTH).max() < 0.05
    hypotheses = {b.hypothesis.name: b.hypothesis for b in found.branches}
    assert hypotheses.get(AS_COMMANDED.name, AS_COMMANDED) == AS_COMMANDED


def test_what_was_read_says_that_it_cannot_simulate(result, path):
    save_posterior(path, result.belief)
    joint = load_posterior(path).branches[0].parameters.joint
    with pytest.raises(TargetError, match="read from a file cannot simulate"):
        joint.simulate(np.ones((1, 2)), np.ones((1, 2)), np.ones((1, 1)), np.ones((1, 1)), True)


def test_another_kind_of_belief_is_not_saved(path):
    with pytest.raises(ConfigurationError, match="belief must be of type JointPosterior; got None"):
        save_posterior(path, None)
    assert not path.exists()


def refused(path, message):
    with pytest.raises(InvalidArgumentError, match=message) as refusal:
        load_posterior(path)
    assert str(path) in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_a_damaged_or_foreign_file_is_refused(result, path):
    refused(path, "posterior must be a file that can be read")
    save_posterior(path, result.belief)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    refused(path, "is not a whole archive")
    middle = bytearray(whole)
    middle[len(whole) // 2] ^= 1
    path.write_bytes(bytes(middle))
    refused(path, "is not a whole archive")
    path.write_text("{}")
    refused(path, "is not a whole archive")
    np.savez(path, commands=np.zeros((2, 3)))
    refused(path, "must hold the arrays cost, gradient, header, information, theta and no others")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"schema": "eea.belief/0"}, "its schema must be eea.belief/1; it is 'eea.belief/0'"),
        ({"trials": 10**9}, "its number of trials must be a whole number .* at most 10000"),
        ({"trials": 1}, "its parameters must be"),
        ({"branches": []}, "must hold as many numbers as its header says"),
        ({"nuisances": [{"name": "bias"}]}, "lacks something: KeyError"),
        ({"goodness": {}}, "lacks something: TypeError"),
        ({"parts": {"arm": None}}, "lacks something: TypeError"),
        ({"problem": 3}, "lacks something: TypeError"),
        ({"sigma": "much"}, "lacks something: ValueError"),
    ],
)
def test_a_header_that_does_not_fit_is_refused(result, path, changes, message):
    write_arrays(path, with_header(to_arrays(result.belief), **changes))
    refused(path, message)


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("theta", lambda a: a[:-1], "its theta must hold as many numbers"),
        ("cost", lambda a: np.append(a, 0.0), "must hold as many numbers as its header says"),
        ("information", lambda a: -a, "information must have no negative eigenvalue"),
        ("theta", lambda a: a + np.nan, "theta must be finite"),
        ("theta", lambda a: a + 100.0, r"theta of .* must be in \[0, 1\]"),
        ("gradient", lambda a: a[None], r"must have gradient of shape \(any,\)"),
        ("header", lambda a: a[: len(a) // 2], "lacks something: JSONDecodeError"),
        ("header", lambda _: np.frombuffer(b"[" * 10**5, np.uint8), "lacks something"),
    ],
)
def test_numbers_that_do_not_fit_are_refused(result, path, name, change, message):
    arrays = to_arrays(result.belief)
    write_arrays(path, arrays | {name: change(arrays[name])})
    refused(path, message)


def test_probabilities_that_are_none_are_refused(result, path):
    arrays = to_arrays(result.belief)
    rows = [row | {"probability": -1.0} for row in header_of(arrays)["branches"]]
    write_arrays(path, with_header(arrays, branches=rows))
    with pytest.raises(DamagedFileError, match="its probabilities must sum to 1"):
        load_posterior(path)


def test_a_result_that_is_shown_round_by_round_stays_small(result):
    text = json.dumps(result.to_dict())
    assert len(text) < 30_000
    belief = json.loads(text)["belief"]
    assert set(belief["intervals"]) == {"50%", "80%", "90%"}
    assert sum(belief["hypotheses"].values()) == pytest.approx(1.0)
    modes = belief["modes"][result.belief.branches[0].hypothesis.name]
    values = dict(zip(modes["names"], modes["values"][0], strict=True))
    assert values["arm.length"] == pytest.approx(TRUTH[0], abs=0.05)


def test_a_wider_interval_includes_a_narrower_one(result):
    ends = [result.interval(mass) for mass in (0.5, 0.8, 0.95)]
    for (low, high), (wider_low, wider_high) in pairwise(ends):
        assert (wider_low <= low).all()
        assert (high <= wider_high).all()
    assert replace(result, belief=None).belief is None
    with pytest.raises(TargetError, match='only the condition "joint" has a posterior'):
        replace(result, belief=None).interval()
