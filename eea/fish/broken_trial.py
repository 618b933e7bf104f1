"""A trial of a broken fish: what its servos do, what breaks meanwhile, what its sensor says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from aquafish_gym.damage import CHANNELS, Effect
from aquafish_gym.engines.worlds import Triple
from aquafish_gym.envs.course import GYRO, Course, Sensors
from aquafish_gym.imu import ImuLog, unwrap_rpy
from aquafish_gym.physics.attitude import attitude, rotations
from aquafish_gym.scenario import Change, Scenario, check_row
from eea.core.angles import Floats, wrap

_ATTITUDE = slice(0, GYRO.start)  # the channels that say where up and north are
_ONLY = np.zeros(1, np.intp)


def broken(scenario: Scenario, course: Course) -> Scenario:
    """Return a scenario of one robot as a course of damage has it, in steps of 0.01 s.

    Raises InvalidArgumentError if a servo is faster than worlds allow.
    """
    found = []
    for effect in course.effects:
        gains = check_row("servo_gain", scenario.servo_gain[0] * effect.gains)[None]
        found.append(replace(scenario, body=effect.body.to_array()[None], servo_gain=gains))
    only = np.zeros(1, np.intp)
    changes = zip(course.begins[1:], found[1:], strict=True)
    return replace(found[0], schedule=tuple(Change(step, only, to) for step, to in changes))


def placed(angles: Floats, effect: Effect, first: Floats) -> Floats:
    """Return fin angles (3,) in rad at which a trial begins: those of servos that turn as given.

    Of those that do not, one that is dead stands anywhere, as given, and one that is seized where
    it was seized, or else where it stood in the ``first`` trial (3,).
    """
    found = angles.copy()
    for fin, (gain, stands) in enumerate(zip(effect.gains, effect.stands, strict=True)):
        if stands is None and gain == 0.0:
            found[fin] = first[fin]
        elif isinstance(stands, float):
            found[fin] = wrap(np.array(stands))
    return found


def as_said(
    log: ImuLog, course: Course, start: Floats, resting: Triple, rng: np.random.Generator
) -> ImuLog:
    """Return a log (1, T, 3) as a broken sensor says it.

    The attitude is the one that fits best what the sensor says of up and north: Wahba's problem,
    solved by singular values (Markley 1988).

    Parameters
    ----------
    log
        Roll, pitch, yaw and gyro.
    course
        In steps of 0.01 s.
    start
        (3, 3) from body to world when the trial begins.
    resting
        What the gyroscope says then, rad/s.
    rng
        Of the noise.
    """
    wrong = [np.abs([e.biases, e.stuck, e.dropped]).max(axis=0) for e in course.effects]
    spoilt = np.max(wrong, axis=0) > 0
    noisy = any(effect.noise for effect in course.effects)
    if log.rpy is None or log.gyro is None or log.diverged.any() or not (spoilt.any() or noisy):
        return log
    turns = np.concatenate([start[None], rotations(np.asarray(log.rpy[0], np.float64))])
    felt = np.concatenate([np.array(resting)[None], log.gyro[0]])
    truth = np.concatenate([turns[:, 2], turns[:, 1], felt], axis=1)
    sensors, said = Sensors(1, np.float64), np.empty_like(truth)
    unlimited = np.full(len(CHANNELS), np.inf)
    for step in range(len(truth)):
        if step in course.begins:
            sensors.become([0], course.at(step))
        said[step] = sensors.say(truth[step : step + 1], unlimited, [rng], _ONLY)[0]
    rpy = log.rpy
    if spoilt[_ATTITUDE].any():
        rpy = rpy_of([start, *_fitting(said[1:, 0:3], said[1:, 3:6])])
    return replace(log, rpy=rpy, gyro=said[None, 1:, GYRO])


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
