"""The table of what is broken: its rows, growth, what a record observes, and robots that begin."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aquafish_gym.damage import TIERS, Damage, Fault, edit_each
from aquafish_gym.damage.sensors import sensor_columns
from aquafish_gym.damage.side import Side
from aquafish_gym.damage.words import PARTS, can_grow
from aquafish_gym.morphology import Morphology
from aquafish_gym.scenario import CHANNELS, TIMESTEP, Scenario
from aquafish_gym.stages import NEVER, SlotPlayer

HOLD = 20
DT = HOLD * TIMESTEP
NUMBERS = {"noise": 0.3, "bias": -0.4, "scale": 0.6, "delay": 0.4, "hold": 0.9, "weak": -0.5}


@st.composite
def damages(draw: st.DrawFn) -> Damage:
    """Return faults of every word that come, go and grow, often of the same part."""
    faults = []
    for _ in range(draw(st.integers(0, 5))):
        part = draw(st.sampled_from(["caudal", "gyro", "gyro_z", "up_x"]))
        word = draw(st.sampled_from(list(PARTS[part])))
        wanted = PARTS[part][word]
        number = None if wanted is None or wanted.optional else NUMBERS.get(word, 0.5)
        grows = can_grow(word, wanted) and draw(st.booleans())
        faults.append(
            Fault(
                part,
                word,
                number,
                draw(st.sampled_from([0.0, 0.3, 1.0, 1.7])),
                draw(st.sampled_from([None, 0.1, 0.8, 3.0])),
                draw(st.sampled_from([0.5, 1.0, 2.5])) if grows else None,
            )
        )
    return Damage(tuple(faults))


def now(damage: Damage, step: int) -> dict[str, np.ndarray]:
    """Return the fields of a robot in a control step, in which all that is broken lasts."""
    active = []
    for fault in damage:
        assert isinstance(fault.onset, float)
        first = math.ceil(fault.onset / DT - 1e-9)
        end = math.inf
        if fault.duration is not None:
            end = max(first + 1, math.ceil((fault.onset + fault.duration) / DT - 1e-9))
        if not first <= step < end:
            continue
        number = fault.number
        wanted = PARTS[fault.part][fault.word]
        if (
            fault.growth
            and number is not None
            and wanted is not None
            and wanted.neutral is not None
        ):
            share = min(1.0, (step - first + 1) * DT / fault.growth)
            number = wanted.neutral + share * (number - wanted.neutral)
        active.append(replace(fault, number=number, onset=0.0, duration=None, growth=None))
    return Damage(tuple(active)).edit(Scenario.create(), HOLD).columns()


@settings(max_examples=12)
@given(damages=st.lists(damages(), min_size=6, max_size=6), seed=st.integers(0, 99))
def test_robots_are_what_their_faults_make_of_them_in_each_step(
    damages: list[Damage], seed: int
) -> None:
    """Two robots begin three episodes each, one after another, at steps of their own."""
    rng = np.random.default_rng(seed)
    robots = Scenario.create([Morphology.nominal()] * 2)
    player = SlotPlayer(robots.stages)
    present = robots.copy().columns()
    playing = [Damage(), Damage()]
    began = np.zeros(2, int)
    for _ in range(3):
        rows = np.flatnonzero(rng.random(2) < 0.8)
        several = [damages.pop() for _ in rows]
        if len(rows):
            scenario = edit_each(robots.take(rows), several, HOLD)
            for name, values in player.begin(rows, scenario.stages).items():
                present[name][rows] = values
            began[rows] = 0
            for row, damage in zip(rows.tolist(), several, strict=True):
                playing[row] = damage
        for _ in range(int(rng.integers(1, 20))):
            for i in range(2):
                for name, values in now(playing[i], int(began[i])).items():
                    np.testing.assert_allclose(present[name][i], values[0], 1e-12, 1e-12, name)
            began += 1
            changed = np.flatnonzero(player.next_change == began * HOLD)
            for name, values in player.move(changed).items():
                present[name][changed] = values


def test_growth_is_one_row_however_long_it_takes() -> None:
    scenario = Damage.parse("gyro_z:bias=0.2@1~8").edit(Scenario.create(), 1)
    assert scenario.since.tolist() == [0, 100, 899]
    assert scenario.until.tolist() == [100, 899, NEVER]
    begins = [segment.begin for segment in scenario.segments(2000)]
    assert begins == [0, *range(100, 900)]


def test_two_that_grow_at_once_have_a_row_a_step() -> None:
    """Their product does not grow evenly."""
    both = Damage.parse("up_x:scale=3@1~2; up_x:scale=2@2~2").edit(Scenario.create(), HOLD)
    assert both.since.tolist() == [0, 100, *range(200, 280, HOLD), 280, 380]


@pytest.mark.parametrize("text", [f"random:{tier}@2-8+3~1" for tier in TIERS])
def test_a_robot_draws_the_same_alone_and_among_others(text: str) -> None:
    damage = Damage.parse(f"{text}; caudal:weak=0.5@1-2")
    together = damage.draw([np.random.default_rng(seed) for seed in range(200)])
    for seed in range(200):
        alone = damage.sample(np.random.default_rng(seed))
        assert Damage(tuple(together.faults(seed))) == alone
        assert len({fault.part for fault in alone.faults[:-1]}) == len(alone) - 1


def test_growth_goes_on_beside_a_robot_that_begins_without_damage() -> None:
    robots = Scenario.create([Morphology.nominal()] * 2)
    both = edit_each(robots, [Damage.parse("gyro_z:bias=0.8@0~8"), Damage()], HOLD)
    player = SlotPlayer(both.stages)
    first = np.zeros(1, int)
    for _ in range(3):
        bias = player.move(first)["sensor_bias"]
    player.begin(first + 1, robots.take(1).stages)
    assert player.next_change.tolist() == [4 * HOLD, NEVER]
    after = player.move(first)["sensor_bias"]
    np.testing.assert_allclose((after - bias)[0, -1], 0.8 * DT / 8.0)


def test_an_episode_in_mid_swim_goes_on_where_it_is() -> None:
    stages = (
        Damage.parse("gyro_z:bias=1@1+2~1; caudal:weak=0.5@2").edit(Scenario.create(), 10).stages
    )
    for step in range(0, 400, 10):
        played, found = SlotPlayer(stages), SlotPlayer(stages)
        expected = {name: column[:1].copy() for name, column in stages.columns.items()}
        while played.next_change[0] <= step:
            expected = played.move(np.zeros(1, int))
        columns = found.begin(np.zeros(1, int), stages, step)
        assert found.next_change == played.next_change
        for name, column in columns.items():
            np.testing.assert_allclose(column, expected[name], 1e-12, 1e-12)


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
