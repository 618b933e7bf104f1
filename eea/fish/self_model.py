"""A robot's model of itself that it carries along, corrected by its sensors as it swims.

A cubature Kalman filter (I. Arasaratnam and S. Haykin, "Cubature Kalman filters", 2009) corrects
the simulated state by what the inertial measurement unit observes. The error of a state has twelve
numbers: a small rotation about the body's axes, the velocity in the world, the angular velocity and
the three fin angles. The position is only predicted: nothing depends on it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.command import scale_action
from aquafish_gym.engines.compiled.lanes import LaneBatch
from aquafish_gym.physics.layout import FIELDS, LEFT, RATES, angles_of_rows, start_rows
from aquafish_gym.scenario import Scenario

Floats = NDArray[np.float64]

SIZE = 12  # of the error of a state
ATTITUDE, VELOCITY, SPIN, FINS = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)
#: Standard deviations (12,) that the model's own error adds in an action: rad, units/s, rad/s, rad.
MODEL_ERROR: Floats = np.repeat([1e-5, 1e-4, 1e-4, 1e-5], 3)
#: Of the state at the start: a robot at rest moves against water that may flow.
START_ERROR: Floats = np.repeat([1e-4, 0.2, 1e-4, 1e-4], 3)
#: Standard deviation of an observation without noise, for rounding and single precision.
FLOOR = 2e-4
_POINTS: Floats = np.sqrt(SIZE) * np.concatenate([np.eye(SIZE), -np.eye(SIZE)])  # (24, 12)


class Innovation(NamedTuple):
    """An observation compared with its prediction."""

    error: Floats  #: (9,) observed minus predicted; 0 of channels that are not used.
    covariance: Floats  #: (9, 9) of the error, as predicted.

    @property
    def square(self) -> float:
        """The squared error in standard deviations: chi-square, if the model is right."""
        return float(self.error @ np.linalg.solve(self.covariance, self.error))


class SelfModel:
    """A robot's model of itself, in the state that it is in now.

    Parameters
    ----------
    robot
        A scenario of one robot: its body, servos and water.
    fin_angles
        (3,) at the start, rad. It begins at rest.
    noise
        (9,) standard deviations of the observations (up, north, gyro); infinite for a channel that
        is not used.
    model_error
        (12,) see ``MODEL_ERROR``.
    hold
        For how many steps of 0.01 s an action is held.

    Attributes
    ----------
    state
        (25,) the estimate, in the order of ``aquafish_gym.physics.layout``.
    covariance
        (12, 12) of its error.
    log_likelihood
        Of all observations so far, up to a constant.

    Examples
    --------
    >>> model = SelfModel(Scenario.create(), (0.0, 0.5, 1.0), np.full(9, 0.01))
    >>> model.step((0.2, -0.2, 1.0))
    >>> model.correct(observe(model.state[:, None])[0]).square < 0.1
    True
    """

    def __init__(
        self,
        robot: Scenario,
        fin_angles: ArrayLike,
        noise: Floats,
        model_error: Floats = MODEL_ERROR,
        hold: int = 20,
    ) -> None:
        self.noise, self.model_error, self.hold = noise, model_error, hold
        self.covariance: Floats = np.diag(START_ERROR**2)
        self.log_likelihood = 0.0
        self.become(robot, start_rows(np.array([fin_angles], np.float64))[:, 0])

    def become(self, robot: Scenario, state: Floats) -> None:
        """Take another robot, in a state (25,), for what it is; its error stays."""
        self.robot, self.state = robot, state
        points = np.zeros(2 * SIZE + 1, np.intp)
        self._lanes = LaneBatch(robot.take(points), np.float64, threads=1)

    def step(self, action: ArrayLike) -> None:
        """Predict the state after an action (3,) in [-1, 1]."""
        spread = _POINTS @ np.linalg.cholesky(self.covariance).T
        points = moved(self.state, np.concatenate([np.zeros((1, SIZE)), spread]))
        self._lanes.place(points)
        self._lanes.advance(np.tile(scale_action(action), (points.shape[1], 1)), self.hold)
        ended = self._lanes.rows()
        errors = difference(ended[:, 1:], ended[:, 0])
        mean = errors.mean(axis=0)
        self.state = moved(ended[:, 0], mean[None])[:, 0]
        errors -= mean
        self.covariance = errors.T @ errors / len(errors) + np.diag(self.model_error**2)

    def correct(self, observed: Floats) -> Innovation:
        """Correct the state by an observation (9,), and return how it differed."""
        used = np.isfinite(self.noise)
        errors = _POINTS @ np.linalg.cholesky(self.covariance).T
        seen = observe(moved(self.state, errors))
        mean = seen.mean(axis=0)
        seen = np.where(used, seen - mean, 0.0)
        cross = errors.T @ seen / len(errors)
        noise = np.where(used, np.hypot(self.noise, FLOOR), 1.0)
        innovation = Innovation(
            np.where(used, observed - mean, 0.0), seen.T @ seen / len(errors) + np.diag(noise**2)
        )
        gain = np.linalg.solve(innovation.covariance, cross.T).T
        self.state = moved(self.state, (gain @ innovation.error)[None])[:, 0]
        left = self.covariance - gain @ cross.T
        self.covariance = 0.5 * (left + left.T) + 1e-14 * np.eye(SIZE)
        self.log_likelihood -= 0.5 * (
            innovation.square + float(np.linalg.slogdet(innovation.covariance)[1])
        )
        return innovation


def predict(
    robots: Scenario, state: Floats, actions: Floats, hold: int = 20
) -> tuple[Floats, Floats]:
    """Return what N robots would observe (N, K, 9) after each action (K, 3).

    All begin in one state (25,). Also return the states (25, N) in which they end. In single
    precision, on one thread.
    """
    lanes = LaneBatch(robots, threads=1)
    lanes.place(np.repeat(state[:, None], len(robots), axis=1))
    observed = np.empty((len(robots), len(actions), 9))
    for k, command in enumerate(scale_action(actions)):
        lanes.advance(np.tile(command, (len(robots), 1)), hold)
        observed[:, k] = observe(lanes.rows())
    return observed, lanes.rows()


def observe(states: Floats) -> Floats:
    """Return what the inertial measurement unit observes, (N, 9), in states (25, N)."""
    x, y, z, w = states[FIELDS["orientation"]]
    up = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
    north = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    return np.array([*up, *north, *states[FIELDS["spin"]]]).T


def moved(state: Floats, errors: Floats) -> Floats:
    """Return states (25, N) that differ from one (25,) by errors (N, 12)."""
    states = np.repeat(state[:, None], len(errors), axis=1)
    half = 0.5 * errors[:, ATTITUDE].T
    turn = np.array([*half, np.sqrt(np.maximum(1.0 - (half**2).sum(axis=0), 0.0))])
    states[FIELDS["orientation"]] = _product(states[FIELDS["orientation"]], turn)
    states[FIELDS["velocity"]] += errors[:, VELOCITY].T
    states[FIELDS["spin"]] += errors[:, SPIN].T
    angles = angles_of_rows(state)[:, None] + errors[:, FINS].T
    states[LEFT:RATES:2], states[LEFT + 1 : RATES : 2] = np.cos(angles), np.sin(angles)
    return states


def difference(states: Floats, state: Floats) -> Floats:
    """Return the errors (N, 12) by which states (25, N) differ from one (25,)."""
    inverse = state[FIELDS["orientation"]] * np.array([-1.0, -1.0, -1.0, 1.0])
    turn = _product(inverse[:, None], states[FIELDS["orientation"]])
    angles = angles_of_rows(states) - angles_of_rows(state)[:, None]
    errors: Floats = np.concatenate(
        [
            2.0 * turn[:3] * np.where(turn[3] < 0.0, -1.0, 1.0),
            states[FIELDS["velocity"]] - state[FIELDS["velocity"], None],
            states[FIELDS["spin"]] - state[FIELDS["spin"], None],
            np.arctan2(np.sin(angles), np.cos(angles)),
        ]
    ).T
    return errors


def _product(p: Floats, q: Floats) -> Floats:
    """Return the product (4, N) of quaternions (x, y, z, w)."""
    px, py, pz, pw = p
    qx, qy, qz, qw = q
    return np.array(
        [
            pw * qx + px * qw + py * qz - pz * qy,
            pw * qy - px * qz + py * qw + pz * qx,
            pw * qz + px * qy - py * qx + pz * qw,
            pw * qw - px * qx - py * qy - pz * qz,
        ]
    )
