"""A trial of a broken fish: where its fins begin, and the log of its broken sensors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from aquafish_gym.damage import CHANNELS, Damage
from aquafish_gym.damage.sensors import GYRO, Sensors
from aquafish_gym.engines.worlds import Triple
from aquafish_gym.imu import ImuLog, unwrap_rpy
from aquafish_gym.physics.attitude import attitude, rotations
from aquafish_gym.scenario import Scenario
from eea.core.angles import Floats, wrap

_ATTITUDE = slice(0, GYRO.start)  # the channels of up and north
_ONLY = np.zeros(1, np.intp)


def initial_angles(angles: Floats, first: Floats, damage: Damage) -> Floats:
    """Return the fin angles (3,) in rad at which a trial begins.

    A fin whose servo turns, or has no power, begins where it was drawn, at ``angles`` (3,); one
    whose servo is seized at its angle, or else where it was in the ``first`` trial (3,).
    """
    broken = damage.edit(Scenario.fill({"body": np.zeros((1, 9)), "fin_angles": first[None]}))
    found = broken.fin_angles[0]  # NaN without power
    seized = (broken.servo_gain[0] == 0.0) & ~np.isnan(found)
    return np.where(seized, np.where(found == first, first, wrap(found)), angles)


def apply_sensor_faults(
    log: ImuLog, scenario: Scenario, start: Floats, resting: Triple, rng: np.random.Generator
) -> ImuLog:
    """Return a log (1, T, 3) as broken sensors record it.

    The attitude is the one that best fits the observed directions up and north: Wahba's problem,
    solved by singular values (Markley 1988).

    Parameters
    ----------
    log
        Roll, pitch, yaw and gyro.
    scenario
        Of the trial's one robot.
    start
        (3, 3) from body to world when the trial begins.
    resting
        The gyroscope's reading then, rad/s.
    rng
        Of the noise.
    """
    stages = {0: scenario} | {change.step: change.to for change in scenario.schedule}
    wrong = [
        (one.sensor_bias != 0.0) | one.sensor_stuck | one.sensor_dropped for one in stages.values()
    ]
    broken = np.any(wrong, axis=(0, 1))
    noisy = any(one.gyro_noise.any() for one in stages.values())
    if log.rpy is None or log.gyro is None or log.diverged.any() or not (broken.any() or noisy):
        return log
    turns = np.concatenate([start[None], rotations(np.asarray(log.rpy[0], np.float64))])
    felt = np.concatenate([np.array(resting)[None], log.gyro[0]])
    truth = np.concatenate([turns[:, 2], turns[:, 1], felt], axis=1)
    sensors, observed = Sensors(1, np.float64), np.empty_like(truth)
    unlimited = np.full(len(CHANNELS), np.inf)
    for step in range(len(truth)):
        if step in stages:
            sensors.update(_ONLY, stages[step])
        observed[step] = sensors.observe(truth[step : step + 1], unlimited, [rng], _ONLY)[0]
    rpy = log.rpy
    if broken[_ATTITUDE].any():
        rpy = rpy_of([start, *_fitting(observed[1:, 0:3], observed[1:, 3:6])])
    return replace(log, rpy=rpy, gyro=observed[None, 1:, GYRO])


def rpy_of(turns: Sequence[Floats]) -> Floats:
    """Return roll, pitch and yaw (1, T, 3), continuous, of a start and T matrices (3, 3) after."""
    return unwrap_rpy(np.array([attitude(r.tolist()) for r in turns]))[None, 1:]


def _fitting(up: Floats, north: Floats) -> Floats:
    """Return the rotations (T, 3, 3), body to world, that fit best two directions (T, 3)."""
    both = np.stack([np.zeros_like(up), north, up], axis=1)  # the world's axes, by rows
    u, _, v = np.linalg.svd(both)
    u[:, :, 2] *= np.linalg.det(u @ v)[:, None]
    fitted: Floats = u @ v
    return fitted
