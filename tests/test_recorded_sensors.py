"""A recorded swim has the observations of one step after another."""

from __future__ import annotations

import numpy as np
import pytest

from aquafish_gym import Damage
from aquafish_gym.damage.sensors import sensor_columns
from aquafish_gym.damage.side import Side
from aquafish_gym.scenario import CHANNELS, TIMESTEP, Scenario

ONLY = np.zeros(1, np.intp)


@pytest.mark.parametrize(
    "damage",
    [
        "gyro:noise=0.1; gyro_x:bias=0.3",
        "gyro_z:stuck; up_x:dropped@0.1",
        "gyro_y:stuck@0.05+0.1; gyro_x:scale=1.5; gyro:noise=0.02@0.2",
        "gyro_x:delay=0.03; gyro_y:hold=0.05@0.1; north_z:delay=0.02; gyro_y:stuck@0.2",
    ],
)
def test_a_record_is_what_is_observed_step_by_step(damage: str) -> None:
    scenario = Damage.parse(damage).edit(Scenario.create())
    truth = np.random.default_rng(1).normal(size=(30, len(CHANNELS)))
    alone, recorded = (Side(1, len(CHANNELS), TIMESTEP) for _ in range(2))
    for sensors in (alone, recorded):
        sensors.remember(scenario.sensor_delay)
        sensors.update(ONLY, sensor_columns(scenario.beginning.columns()))
    one, other = np.random.default_rng(2), np.random.default_rng(2)
    expected, found = [], []
    for begin, end, _, to in scenario.segments(len(truth)):
        for sensors in (alone, recorded) if to else ():
            sensors.update(ONLY, sensor_columns(to.columns()))
        rows = np.split(truth[begin:end], end - begin)
        expected += [alone.observe(row, -np.inf, np.inf, [one], ONLY) for row in rows]
        found.append(recorded.record(truth[begin:end], other))
    np.testing.assert_array_equal(np.concatenate(found), np.concatenate(expected))


def test_segments_cover_all_steps_once_and_changes_begin_them() -> None:
    scenario = Damage.parse("caudal:missing@0.1+0.2; gyro_x:dropped@0.5").edit(Scenario.create())
    assert [(s.begin, s.end, s.to is None) for s in scenario.segments(40)] == [
        (0, 10, True),
        (10, 30, False),
        (30, 40, False),
    ]
    assert [(s.begin, s.end) for s in Scenario.create().segments(7)] == [(0, 7)]
