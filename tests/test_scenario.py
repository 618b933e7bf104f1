"""Scenarios: defaults, checks at the door, selection and concatenation of rows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from aquafish_gym.damage import Damage
from aquafish_gym.engines.api import simulate_scenario
from aquafish_gym.engines.compiled.lanes import LaneBatch
from aquafish_gym.engines.world_batch import WorldBatch
from aquafish_gym.engines.worlds import make_world
from aquafish_gym.envs.batching import make_swimmers
from aquafish_gym.morphology import Morphology
from aquafish_gym.physics.layout import layout
from aquafish_gym.plans import AQUAFISH
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.validation import InvalidArgumentError
from aquafish_gym.world_config import WorldConfig
from tests.scenarios import with_changes


def scheduled() -> Scenario:
    """Return four robots, of which 1 and 3 lose a servo at step 10."""
    whole = Scenario.create(current=np.arange(12.0).reshape(4, 3))
    rows = np.array([1, 3])
    broken = replace(whole.take(rows), servo_gain=np.array([(1, 1, 0.1), (1, 1, 0.3)]))
    return with_changes(whole, [(10, rows, broken)])


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
    assert chosen.beginning.current[:, 0].tolist() == [9, 0, 9, 3]
    _, (begin, end, robots, to) = chosen.segments(30)
    assert (begin, end) == (10, 30)
    assert robots.tolist() == [0, 2, 3]
    assert to is not None
    assert to.servo_gain[:, 2].tolist() == [0.3, 0.3, 0.1]
    assert len([*scheduled().take([0, 2]).segments(30)]) == 1


def test_parts_concatenate_to_the_whole() -> None:
    whole = scheduled()
    again = Scenario.concatenate([whole.take(slice(0, 2)), whole.take(slice(2, None))])
    for name, array in whole.arrays().items():
        np.testing.assert_array_equal(array, again.arrays()[name])


def test_a_world_is_that_of_all_stages() -> None:
    """Its water stays when a servo breaks, whichever is said first."""
    world = WorldConfig(
        current=(0.1, 0.2, 0.3), drag=(2.0, 3.0), servo_gain=(0.5, 1.0, 1.0), lag=0.1
    )
    damage = Damage.parse("left_pectoral:weak=0.5@1; caudal:missing@2")
    whole = Scenario.create()
    one = world.edit(damage.edit(whole))
    two = damage.edit(world.edit(whole))
    for name, table in one.arrays().items():
        np.testing.assert_array_equal(table, two.arrays()[name], name)
    assert one.servo_gain[-1].tolist() == [0.25, 1.0, 1.0]


def dead(count: int = 1) -> Scenario:
    """Return robots whose tail's servo is dead from the start."""
    return Damage.parse("caudal:dead").edit(Scenario.create([Morphology.nominal()] * count))


def test_each_robot_draws_the_angles_of_its_dead_servos() -> None:
    both = [np.random.default_rng(seed) for seed in (0, 1)]
    drawn = dead(2).draw_angles(both).fin_angles
    expected = [np.random.default_rng(seed).uniform(-np.pi, np.pi) for seed in (0, 1)]
    np.testing.assert_array_equal(drawn, [(0.0, 0.0, angle) for angle in expected])
    whole = Scenario.create()
    assert whole.draw_angles(both[:1]) is whole
    assert both[0].bit_generator.state == dead_state(0)
    for wrong in ([], both, [1], "no"):
        with pytest.raises(InvalidArgumentError, match="rngs must be"):
            whole.draw_angles(wrong)  # type: ignore[arg-type]


def dead_state(seed: int) -> object:
    """Return the state of a generator that drew one angle."""
    rng = np.random.default_rng(seed)
    rng.uniform()
    return rng.bit_generator.state


STARTS: dict[str, Callable[[Scenario], object]] = {
    "simulate": lambda robot: simulate_scenario(robot, np.zeros((1, 3)), 10),
    "simulate, pybullet": lambda robot: simulate_scenario(
        robot, np.zeros((1, 3)), 10, "pybullet", "float64"
    ),
    "lanes": LaneBatch,
    "lanes, later": lambda robot: LaneBatch(Scenario.create()).start(robot),
    "world": lambda robot: make_world("numba", robot),
    "world, pybullet": lambda robot: make_world("pybullet", robot),
    "batch": lambda robot: WorldBatch(robot, "numba"),
    "environments": lambda robot: make_swimmers(robot, "numba", None, None),
}


@pytest.mark.parametrize(
    "start",
    [pytest.param(one, marks=pytest.mark.pybullet) if "pybullet" in one else one for one in STARTS],
)
def test_no_swim_begins_before_the_angles_are_drawn(start: str) -> None:
    with pytest.raises(InvalidArgumentError, match=r"robot 0 has a dead caudal servo.*draw_angles"):
        STARTS[start](dead())
    STARTS[start](dead().draw_angles([np.random.default_rng(0)]))


def test_robots_in_mid_swim_have_no_angle_to_draw() -> None:
    """A servo that died is where it was; an agent imagines such robots from a state."""
    state = layout(AQUAFISH).start(np.array([(0.0, 0.0, 1.0)]))
    lanes = LaneBatch(dead(3), np.float64, states=state)
    lanes.advance(np.full((3, 3), 0.5), 10)
    assert not lanes.diverged.any()
    np.testing.assert_allclose(layout(AQUAFISH).angles(lanes.states)[2], 1.0)
