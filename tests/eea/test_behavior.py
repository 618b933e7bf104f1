from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from eea.core.behavior import modulus, similarity, summarize
from eea.core.checks import TargetError
from eea.core.experiment import RecordedLog

GYRO = np.random.default_rng(0).normal(size=(4, 16, 3))
LOG = RecordedLog(GYRO)


def test_behavior_is_the_transform_of_each_rate_in_degrees():
    found = summarize(LOG)
    assert found.shape == (4, 3 * 9)
    for axis in range(3):
        expected = np.fft.rfft(np.degrees(GYRO[2, :, axis]))
        assert np.allclose(found[2, 9 * axis : 9 * (axis + 1)], expected)


def test_one_trial_is_a_batch_of_one_in_its_own_precision():
    assert np.array_equal(summarize(RecordedLog(GYRO[1])), summarize(LOG)[1:2])
    single = RecordedLog(GYRO.astype("f4"))
    assert summarize(single).dtype == np.complex64
    for i in range(4):
        alone = summarize(RecordedLog(single.gyro[i : i + 1]))
        assert np.array_equal(alone[0], summarize(single)[i])


def test_similarity_is_one_less_the_mean_difference_over_max():
    a, b = np.array([[3.0 + 4.0j, 0.0]]), np.array([[0.0j, 100.0]])
    assert similarity(a, b) == pytest.approx(1 - (5.0 + 100.0) / 2 / 100.0)


BEHAVIORS = hnp.arrays(
    np.complex128, (2, 7), elements=st.complex_numbers(max_magnitude=1e4, allow_nan=False)
)


@given(BEHAVIORS)
def test_similarity_is_symmetric_and_at_most_one(pair):
    a, b = pair
    assert similarity(a, b) == similarity(b, a) <= 1.0
    assert similarity(a, a) == 1.0
    assert np.allclose(modulus(a), np.abs(a))


@pytest.mark.parametrize(
    ("log", "message"),
    [
        (None, "must return a log with gyro; it returned None"),
        (RecordedLog([[1.0], [2.0, 3.0]]), "gyro of a robot is ragged"),
        (RecordedLog(np.zeros((1, 3))), r"at least 2 steps; got \(1, 1, 3\)"),
    ],
)
def test_bad_logs_are_refused(log, message):
    with pytest.raises(TargetError, match=message):
        summarize(log)


def test_log_of_another_length_is_refused():
    assert np.array_equal(summarize(LOG, 16, 3), summarize(LOG))
    for steps in (15, 17, 32):
        message = f"the fish must log trials of {steps} steps, .*; it logged 16"
        with pytest.raises(TargetError, match=message):
            summarize(LOG, steps, source="the fish")
