"""``simulate`` on the compiled engine: its schedule, and trials that begin in mid-series."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.engines.compiled.lanes import LaneBatch
from aquafish_gym.imu import ImuLog, join_logs
from aquafish_gym.physics.kinematics import SWEEP
from aquafish_gym.scenario import TIMESTEP, Scenario


def simulate_lanes(
    scenario: Scenario,
    commands: NDArray[np.float64],
    steps: int,
    dtype: type[np.floating],
    substeps: int,
    threads: int | None,
    record: str,
    interval: int,
    begun: int,
) -> ImuLog:
    """Simulate a scenario with the compiled engine; see :func:`aquafish_gym.simulate`."""
    rates = np.zeros((len(scenario), 3))
    if begun:
        rates = _joint_rates(scenario, commands, TIMESTEP / substeps, interval, begun)
    lanes = LaneBatch(scenario, dtype, substeps, threads, rates=rates)
    logs = []
    for begin, end, change in scenario.segments(steps):
        if change is not None:
            lanes.update(change.rows, change.to)
        logs.append(
            lanes.advance(commands, end - begin, record, scenario.servo_lag, interval, begun)
        )
    return join_logs(logs)


def _joint_rates(
    scenario: Scenario, commands: NDArray[np.float64], h: float, interval: int, begun: int
) -> NDArray[np.float64]:
    """Return how fast the joints (B, 3) turn when trials begin in mid-series, rad/s."""
    # The sample before the first one, of which each command takes a share.
    series = commands.reshape(len(scenario), -1, 3)
    ends = begun - scenario.servo_lag / TIMESTEP
    first = interval * np.arange(series.shape[1])
    followed = np.clip(ends[:, None] - first, 0.0, 1.0)
    share = followed - np.append(followed[:, 1:], np.zeros((len(scenario), 1)), axis=1)
    mean = scenario.servo_gain * np.einsum("bk,bkc->bc", share, series)
    rates: NDArray[np.float64] = 2.0 * np.pi * mean
    phase = scenario.fin_angles[:, 2]
    rates[:, 2] = SWEEP * (np.sin(phase) - np.sin(phase - rates[:, 2] * h)) / h
    return rates
