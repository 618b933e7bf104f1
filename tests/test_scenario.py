"""Scenarios: defaults, checks at the door, selection and concatenation of rows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from aquafish_gym.scenario import Change, Scenario
from aquafish_gym.utils.validation import InvalidArgumentError


def scheduled() -> Scenario:
    """Return four robots, of which 1 and 3 lose a servo at step 10."""
    whole = Scenario.create(current=np.arange(12.0).reshape(4, 3))
    rows = np.array([1, 3])
    broken = replace(whole.take(rows), servo_gain=np.array([(1, 1, 0.1), (1, 1, 0.3)]))
    return replace(whole, schedule=(Change(10, rows, broken),))


def test_default_scenario_is_the_nominal_robot_in_still_water() -> None:
    one = Scenario.create()
    assert len(one) == 1
    assert one.body.shape == one.sensor_bias.shape == (1, 9)
    assert one.drag.tolist() == [[1, 1]]
    assert one.servo_gain.tolist() == [[1, 1, 1]]
    assert not any(np.any(one.arrays()[name]) for name in ("current", "servo_lag", "faults"))


@pytest.mark.parametrize(
    ("fields", "named"),
    [
        ({"drag": (1.0, 11.0)}, "drag"),
        ({"servo_lag": "late"}, "servo_lag"),
        ({"gyro_noise": -1.0}, "gyro_noise"),
        ({"servo_lags": 0.1}, "did you mean 'servo_lag'"),
        ({"body": np.full((2, 9), 0.1), "current": np.zeros((3, 3))}, "equally many"),
    ],
)
def test_wrong_field_is_refused_by_name(fields: dict[str, object], named: str) -> None:
    with pytest.raises(InvalidArgumentError, match=named):
        Scenario.create(**fields)


def test_selected_rows_keep_their_changes() -> None:
    chosen = scheduled().take([3, 0, 3, 1])
    assert chosen.current[:, 0].tolist() == [9, 0, 9, 3]
    (change,) = chosen.schedule
    assert change.step == 10
    assert change.rows.tolist() == [0, 2, 3]
    assert change.to.servo_gain[:, 2].tolist() == [0.3, 0.3, 0.1]
    assert scheduled().take([0, 2]).schedule == ()


def test_parts_concatenate_to_the_whole() -> None:
    whole = scheduled()
    again = Scenario.concatenate([whole.take(slice(0, 2)), whole.take(slice(2, None))])
    for name, array in whole.arrays().items():
        np.testing.assert_array_equal(array, again.arrays()[name])
    (change,) = again.schedule
    assert change.rows.tolist() == [1, 3]
    assert change.to.servo_gain[:, 2].tolist() == [0.1, 0.3]
