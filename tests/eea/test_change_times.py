"""When a command changed is known only to within a row, and inferred where rows are far apart."""

from __future__ import annotations

import numpy as np
import pytest

from aquafish_gym import Damage, Morphology, simulate
from aquafish_gym.engines.api import TIMESTEP
from aquafish_gym.engines.compiled.single import CompiledWorld
from aquafish_gym.scenario import Scenario
from eea import SwimLog, check_log, infer_log, load_posterior, save_posterior, watch_swim
from eea.fish.known import known_body
from eea.fish.log_changes import LogChange
from eea.fish.windows import MOST_UNKNOWN_CHANGES, log_windows

BODY = Damage.parse("left_pectoral:length=0.5").apply(Morphology.nominal())
NOISE = 0.02  # rad/s
LOW = np.array([-0.5, -0.5, 0.2])
HIGH = np.array([0.5, 0.5, 1.0])


def performed(times, values, steps):
    """Return the mean command (steps, 3) in each 0.01 s of ``values`` from ``times`` on."""
    turned = np.cumsum(values[:-1] * np.diff(times)[:, None], axis=0)
    turned = np.concatenate([np.zeros((1, 3)), turned])
    edges = TIMESTEP * np.arange(steps + 1)
    passed = np.stack([np.interp(edges, times, axis) for axis in turned.T], axis=1)
    return np.clip(np.diff(passed, axis=0) / TIMESTEP, [-0.5, -0.5, 0.0], [0.5, 0.5, 1.0])


def swim(rows, seed, seconds=8.0, apart=(0.8, 2.2), rest=True, become=None):
    """Return a log with a row every ``rows`` steps, and the times when its commands changed, s.

    They change anywhere between rows. The robot may become another after 6 s.
    """
    rng = np.random.default_rng(seed)
    times = [0.4 * rows * TIMESTEP if rest else 0.0]
    while times[-1] < seconds:
        times.append(times[-1] + rng.uniform(*apart))
    values = rng.uniform(LOW, HIGH, (len(times), 3))
    steps = round(seconds / TIMESTEP)
    series = performed(np.array([-1.0, *times]), np.vstack([np.zeros(3), values]), steps)
    world = CompiledWorld()
    angles = rng.uniform(-np.pi, np.pi, 3)
    world.start(Scenario.create(BODY, fin_angles=angles))
    rates = [np.zeros(3)]
    for step, command in enumerate(series.tolist()):
        if become is not None and step == 600:
            world.update(Scenario.create(become))
        world.advance(tuple(command))
        rates.append(np.array(world.state().spin))
    first = rows if rest else 200
    at = np.arange(first, steps + 1, rows)
    gyro = np.array(rates)[at] + rng.normal(0.0, NOISE, (len(at), 3))
    time = TIMESTEP * at
    commands = values[np.searchsorted(times, time + 1e-9, "right") - 1]
    return SwimLog(time, gyro, commands), np.array(times)


def test_changes_between_close_rows_are_at_their_rows():
    for rows in (0.001, 0.005, 0.01):
        time = rows * np.arange(400)
        commands = np.where(time[:, None] < 0.3, [0.1, 0.2, 0.3], [0.4, -0.2, 0.8])
        cut = log_windows(SwimLog(time, np.sin(time)[:, None] * np.ones(3), commands))
        assert cut.changes is None
        assert cut.unknown() == 0


def test_each_change_between_rows_that_are_far_apart_is_unknown_within_them():
    log, times = swim(5, seed=1)
    cut = log_windows(log)
    assert cut.changes is not None
    assert cut.unknown() == cut.unknown(0) == np.sum(times < log.time[-1])
    begin = log.time[0] - 0.05
    begun = times[: cut.unknown()]
    assert (begin + TIMESTEP * cut.changes.earliest[0] < begun).all()
    assert (begun <= begin + TIMESTEP * cut.changes.latest[0]).all()
    shares = (begun - begin) / TIMESTEP - cut.changes.earliest[0]
    shares /= cut.changes.latest[0] - cut.changes.earliest[0]
    found = cut.commands(np.array([0, 0]), [np.array([share, 1.0]) for share in shares])
    values = log.commands[np.searchsorted(log.time, begun)]
    wanted = performed(np.append(begun, 99.0) - begin, np.vstack([values, values[-1:]]), 700)
    np.testing.assert_allclose(found[0, 5:700], wanted[5:], atol=1e-9)
    np.testing.assert_allclose(found[1], cut.series[0], atol=1e-12)  # at the rows


def test_a_log_may_have_rows_of_both_kinds():
    fast = 0.001 * np.arange(2000)
    time = np.append(fast, 2.0 + 0.02 * np.arange(200))
    commands = np.full((len(time), 3), 0.3)
    commands[time >= 1.0, 0] = -0.2
    commands[time >= 3.01, 1] = 0.1
    cut = log_windows(SwimLog(time, np.sin(time)[:, None] * np.ones(3), commands))
    assert cut.changes is not None
    assert cut.unknown() == 1
    np.testing.assert_allclose(cut.changes.earliest, [[300.0]])
    np.testing.assert_allclose(cut.changes.latest, [[302.0]])
    np.testing.assert_allclose(cut.changes.jump, [[[0.0, -0.2, 0.0]]])


def test_a_command_in_each_row_begins_at_its_row_and_the_output_says_so():
    rng = np.random.default_rng(0)
    time = 0.2 * np.arange(60)
    gyro = rng.normal(0.0, 0.1, (60, 3))
    cut = log_windows(SwimLog(time, gyro, rng.uniform(LOW, HIGH, (60, 3))))
    assert cut.changes is None
    assert cut.remarks == (
        "in trial 1 the commands change in most rows: each is taken to begin at its row, since the "
        "readings do not tell when between two rows",
    )


def test_a_window_of_many_changes_is_shorter():
    log, times = swim(2, seed=0, seconds=18.0, apart=(0.2, 0.3))
    assert len(times) > MOST_UNKNOWN_CHANGES + 5
    cut = log_windows(log)
    assert MOST_UNKNOWN_CHANGES - 5 < cut.unknown() < MOST_UNKNOWN_CHANGES + 5
    assert cut.remarks == ("of the 18 s of trial 1 the first 9.98 s are used",)


@pytest.mark.parametrize("rows", [pytest.param(4, marks=pytest.mark.slow), 10])
def test_a_slow_log_gives_the_body_and_when_its_commands_changed(rows, tmp_path):
    log, times = swim(rows, seed=3)
    found = infer_log(log, truth=BODY, threads=1)
    assert found.belief is not None
    assert found.belief.good, found.belief.verdict
    assert found.objective_fitness > 0.93
    low, high = found.interval(0.9)
    truth = BODY.to_array()
    assert ((low <= truth) & (truth <= high)).sum() >= 7
    begin = log.time[0] - rows * TIMESTEP
    last = begin + np.ceil((times - begin) / (rows * TIMESTEP) - 1e-9) * rows * TIMESTEP
    table = found.belief.table(0.99)
    for k, share in enumerate(1.0 - (last - times) / (rows * TIMESTEP), 1):
        if f"change {k} of the command@1" in table:
            _, least, most = table[f"change {k} of the command@1"]
            assert least - 0.02 <= share <= most + 0.02
    save_posterior(tmp_path / "slow.npz", found.belief)
    assert load_posterior(tmp_path / "slow.npz").table() == found.belief.table()


@pytest.mark.slow
def test_times_within_a_step_are_unknown_only_where_a_log_needs_them():
    log, _ = swim(1, seed=5, apart=(0.3, 0.6))
    found = infer_log(log, truth=BODY, threads=1)
    assert found.belief is not None
    assert found.belief.good, found.belief.verdict
    assert "change 2 of the command@1" in found.belief.table()
    rng = np.random.default_rng(5)
    series = np.repeat(rng.uniform(LOW, HIGH, (8, 3)), 100, axis=0)
    swum = simulate(BODY, series[None], (0.3, 1.0, -2.0), 800, dtype="float64", interval=1)
    log = SwimLog.of_trials([series], [swum])
    found = infer_log(log, truth=BODY, threads=1)
    assert found.belief is not None
    assert not any("change" in name for name in found.belief.table())


@pytest.mark.slow
def test_a_slow_log_with_a_mistake_is_explained_without_it():
    log, _ = swim(5, seed=4, seconds=6.0)
    wrong = SwimLog(log.time, log.gyro[:, [1, 0, 2]], log.commands)
    fits = check_log(wrong, threads=1).fits
    assert fits[0].change.axes == LogChange(axes=("y", "x", "z")).axes


@pytest.mark.parametrize("rows", [pytest.param(1, marks=pytest.mark.slow), 5, 10])
def test_a_slow_swim_of_an_unchanged_body_raises_no_alarm_and_of_a_broken_one_does(rows):
    belief = known_body(BODY, NOISE, ())
    log, _ = swim(rows, seed=2, seconds=12.0, rest=False)
    assert watch_swim(log, belief, threads=1).noticed is None
    broken = Damage.parse("caudal:length=0.5").apply(BODY)
    log, _ = swim(rows, seed=2, seconds=12.0, rest=False, become=broken)
    noticed = watch_swim(log, belief, threads=1, until_noticed=True).noticed
    assert noticed is not None
    assert noticed > 4.0
