"""``simulate`` on the compiled engine: its schedule, and trials that begin in mid-series."""

from __future__ import annotations

import numpy as np

from aquafish_gym.command import lag_parts, late_command
from aquafish_gym.engines.worlds import batch_class, longest_lags, remembered_steps
from aquafish_gym.imu import ImuLog, join_logs
from aquafish_gym.scenario import TIMESTEP, Scenario
from aquafish_gym.utils.array_types import Floats


def simulate_lanes(
    scenario: Scenario,
    commands: Floats,
    steps: int,
    dtype: type[np.floating],
    substeps: int,
    threads: int | None,
    record: str,
    interval: int,
    begun: int,
    engine: str = "numba",
) -> ImuLog:
    """Simulate a scenario with the engine "numba" or "cuda"; see :func:`aquafish_gym.simulate`."""
    given = None
    rates = np.zeros(scenario.fin_angles.shape)
    if begun:
        given = _given_before(scenario, commands, interval, begun)
        rates = _joint_rates(scenario, given, TIMESTEP / substeps)
    batch = batch_class(engine)
    lanes = batch(scenario, dtype, substeps, threads, rates=rates, given=given)
    logs = []
    for begin, end, robots, to in scenario.segments(steps):
        if to is not None:
            lanes.update(to, robots)
        logs.append(lanes.log(commands, end - begin, record, interval, begun))
    return join_logs(logs)


def _given_before(scenario: Scenario, commands: Floats, interval: int, begun: int) -> Floats:
    """Return the last commands of a series (B, D, F) of which ``begun`` steps have passed."""
    series = commands.reshape(len(scenario), -1, commands.shape[-1])
    depth = remembered_steps(float(longest_lags(scenario).max(initial=0.0)))
    steps = np.arange(begun - depth, begun)
    given = series[:, np.clip(steps // interval, 0, series.shape[1] - 1)]
    given[:, steps < 0] = 0.0
    return given


def _joint_rates(scenario: Scenario, given: Floats, h: float) -> Floats:
    """Return how fast the joints (B, 3) turn after they were ``given`` commands, rad/s."""
    robot = scenario.beginning
    lag_steps, share = lag_parts(robot.servo_lag / TIMESTEP)
    newer = given.shape[1] - 1 - lag_steps.astype(np.intp)
    robots = np.arange(len(scenario))
    older_command, newer_command = (given[robots, at].T for at in (newer - 1, newer))
    followed = np.array(late_command(tuple(older_command), tuple(newer_command), share)).T
    rates: Floats = 2.0 * np.pi * (robot.servo_gain * followed)
    for i, fin in enumerate(scenario.plan.fins):
        if not fin.turns:
            phase = scenario.fin_angles[:, i]
            rates[:, i] = fin.sweep * (np.sin(phase) - np.sin(phase - rates[:, i] * h)) / h
    return rates
