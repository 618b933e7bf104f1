"""The comparer of what environments return finds each kind of difference."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.comparing import assert_same

MASK = np.array([True, False])
LATE = {"sensor_delay": np.array([0.4, 0.0]), "_sensor_delay": MASK}
INFO = {"x_position": np.array([1.0, 2.0]), "_x_position": MASK}
SEEN = np.zeros((2, 3), np.float32)


def objects(*values: Any) -> Any:
    """Return an array of objects, as Gymnasium's ``final_obs`` is."""
    found = np.empty(len(values), object)
    found[:] = values
    return found


@pytest.mark.parametrize(
    ("found", "want"),
    [
        (SEEN, SEEN[:1]),
        (SEEN, SEEN.astype(np.float64)),
        (SEEN, np.where(np.eye(2, 3), np.nan, SEEN)),
        (SEEN, SEEN + np.float32(1e-30)),
        (np.array([True]), np.array([1])),
        ((SEEN, 1.0), (SEEN,)),
        ((SEEN, 1.0), (SEEN, 2.0)),
        (objects(None, None), objects(None, SEEN[0])),
        (objects(SEEN[0], SEEN[0]), objects(None, SEEN[0])),
        (INFO, {}),
        ({}, INFO),
        (INFO, INFO | {"_x_position": ~MASK}),
        (INFO, INFO | {"x_position": np.array([3.0, 2.0])}),
        ({"final_info": INFO}, {"final_info": INFO | {"x_position": np.array([3.0, 2.0])}}),
        (LATE | {"_sensor_delay": ~MASK}, LATE),
        (LATE | {"sensor_delay": np.array([0.4, 0.2]), "_sensor_delay": MASK | True}, LATE),
        ({"sensor_scale": np.array([1.0, 0.5])}, {}),
        ({"sensor_scale": 1.0}, {"sensor_scale": 0.5}),
    ],
)
def test_a_difference_is_found(found: Any, want: Any) -> None:
    with pytest.raises(AssertionError):
        assert_same(found, want)


@pytest.mark.parametrize(
    ("found", "want"),
    [
        (SEEN, SEEN.copy()),
        (np.full(2, np.nan), np.full(2, np.nan)),
        (SEEN, objects(None, SEEN[0])),
        (INFO, INFO | {"x_position": np.array([1.0, 9.0])}),  # of whom nothing is said
        (LATE | {"_sensor_delay": MASK | True}, LATE),
        ({"sensor_scale": np.ones(2), "_sensor_scale": MASK | True}, {}),
        ({"sensor_scale": 0.5}, {"sensor_scale": 0.5}),
    ],
)
def test_what_is_the_same_is(found: Any, want: Any) -> None:
    assert_same(found, want)


def test_no_more_than_the_error_is_allowed() -> None:
    assert_same(SEEN, SEEN + np.float32(1e-7), 1e-6)
    with pytest.raises(AssertionError):
        assert_same(SEEN, SEEN + np.float32(1e-5), 1e-6)
