"""The robot's model of itself: a body and servos, simulated from a state that it carries along.

A cubature Kalman filter (Arasaratnam and Haykin 2009) corrects the state by what the inertial
measurement unit observes. Its error has twelve numbers: a small rotation of the attitude about the
body's axes, the velocity in the world, the angular velocity, and the three fin angles. The position
cannot be observed and needs none: the water is the same everywhere.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.command import scale_action
from aquafish_gym.engines.compiled.lanes import LaneBatch
from aquafish_gym.physics.layout import FIELDS, LEFT, RATES, angles_of_rows
from aquafish_gym.scenario import Scenario

Floats = NDArray[np.float64]

SIZE = 12  # of the error of a state
ATTITUDE, VELOCITY, SPIN, FINS = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)
#: Standard deviations that the model's own error adds to the state in an action of 0.2 s, in the
#: order of the error: rad, units/s, rad/s, rad.
MODEL_ERROR = np.repeat([1e-5, 1e-4, 1e-4, 1e-5], 3)
#: Of the state at the start: the water may flow, and a robot at rest then moves in it.
START_SD = np.repeat([1e-4, 0.2, 1e-4, 1e-4], 3)
FLOOR = 2e-4  # of an observation's standard deviation: rounding, and single precision
_POINTS = np.sqrt(SIZE) * np.concatenate([np.eye(SIZE), -np.eye(SIZE)])  # (24, 12)


class Robot(NamedTuple):
    """A body and servos."""

    body: Floats  #: (9,) fin sizes, units.
    servo_gain: Floats  #: (3,) servo speed over command.
    reactive: bool = False  #: Whether its water has added mass too.


class Innovation(NamedTuple):
    """What was observed beside what was predicted."""

    excess: Floats  #: (9,) observed less predicted.
    covariance: Floats  #: (9, 9) as the filter predicts it.

    @property
    def square(self) -> float:
        """The squared length in standard deviations, chi-square of the channels that are used."""
        return float(self.excess @ np.linalg.solve(self.covariance, self.excess))


class SelfModel:
    """A robot's model of itself in mid-swim.

    Parameters
    ----------
    robot
        What it takes itself to be.
    fin_angles
        (3,) at the start, rad; it begins at rest.
    noise
        (9,) standard deviations of the observations; infinite for a channel to be ignored.
    model_error
        (12,) see ``MODEL_ERROR``.
    hold
        Steps of 0.01 s that an action is held for.
    """

    def __init__(
        self,
        robot: Robot,
        fin_angles: ArrayLike,
        noise: Floats,
        model_error: Floats = MODEL_ERROR,
        hold: int = 20,
    ) -> None:
        self.robot, self.noise, self.model_error, self.hold = robot, noise, model_error, hold
        one = Scenario.fill({"body": robot.body[None], "fin_angles": np.array([fin_angles], float)})
        #: (25,) the state, as ``LaneBatch.rows``; ``covariance`` (12, 12) of its error.
        self.state: Floats = LaneBatch(one, np.float64, threads=1).rows()[:, 0]
        self.covariance: Floats = np.diag(START_SD**2)
        self.log_likelihood = 0.0  # of all observations so far
        self._lanes: LaneBatch | None = None

    def become(self, robot: Robot, state: Floats) -> None:
        """Take another robot, in a state (25,), for what it is."""
        self.robot, self.state, self._lanes = robot, state, None

    def step(self, action: ArrayLike) -> None:
        """Predict the state after an action (3,) in [-1, 1]."""
        spread = np.linalg.cholesky(self.covariance)
        points = moved(self.state, np.concatenate([np.zeros((1, SIZE)), _POINTS @ spread.T]))
        if self._lanes is None:
            self._lanes = lanes_of([self.robot] * len(points.T), np.float64)
        self._lanes.place(points)
        self._lanes.advance(np.tile(scale_action(action), (len(points.T), 1)), self.hold)
        ended = self._lanes.rows()
        away = difference(ended[:, 1:], ended[:, 0])
        mean = away.mean(axis=0)
        self.state = moved(ended[:, 0], mean[None])[:, 0]
        away -= mean
        self.covariance = away.T @ away / len(away) + np.diag(self.model_error**2)

    def correct(self, observed: Floats) -> Innovation:
        """Correct the state by an observation (9,); return what was surprising about it."""
        spread = np.linalg.cholesky(self.covariance)
        away = _POINTS @ spread.T
        seen = observe(moved(self.state, away))
        middle = seen.mean(axis=0)
        used = np.isfinite(self.noise)
        seen = np.where(used, seen - middle, 0.0)
        cross = away.T @ seen / len(away)
        covariance = seen.T @ seen / len(away)
        covariance += np.diag(np.where(used, self.noise, 1.0) ** 2 + FLOOR**2)
        excess = np.where(used, observed - middle, 0.0)
        gain = np.linalg.solve(covariance, cross.T).T
        self.state = moved(self.state, (gain @ excess)[None])[:, 0]
        left = self.covariance - gain @ cross.T
        self.covariance = 0.5 * (left + left.T) + 1e-14 * np.eye(SIZE)
        found = Innovation(excess, covariance)
        self.log_likelihood -= 0.5 * (found.square + np.linalg.slogdet(covariance)[1])
        return found

    def predict(self, robots: list[Robot], actions: Floats) -> tuple[Floats, Floats]:
        """Return what robots would observe, (N, K, 9), after each action (K, 3) from this state.

        Also return their last states (25, N).
        """
        return predict(robots, self.state, actions, self.hold)


def lanes_of(robots: list[Robot], dtype: type[np.floating] = np.float32) -> LaneBatch:
    """Return robots in the lanes, on one thread."""
    fields = {
        "body": np.array([robot.body for robot in robots]),
        "servo_gain": np.array([robot.servo_gain for robot in robots]),
    }
    return LaneBatch(Scenario.fill(fields, robots[0].reactive), dtype, threads=1)


def predict(
    robots: list[Robot], state: Floats, actions: Floats, hold: int
) -> tuple[Floats, Floats]:
    """See :meth:`SelfModel.predict`; ``state`` is (25,) for all or (25, N)."""
    lanes = lanes_of(robots)
    lanes.place(np.broadcast_to(state.reshape(len(state), -1), (len(state), len(robots))))
    seen = []
    for command in scale_action(actions):
        lanes.advance(np.tile(command, (len(robots), 1)), hold)
        seen.append(observe(lanes.rows()))
    return np.stack(seen, axis=1), lanes.rows()


def observe(rows: Floats) -> Floats:
    """Return what the inertial measurement unit observes, (B, 9), in states (25, B)."""
    x, y, z, w = rows[FIELDS["orientation"]]
    up = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
    north = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    return np.array([*up, *north, *rows[FIELDS["spin"]]]).T


def moved(state: Floats, errors: Floats) -> Floats:
    """Return states (25, N) that differ from one (25,) by errors (N, 12)."""
    rows = np.repeat(state[:, None], len(errors), axis=1)
    half = 0.5 * errors[:, ATTITUDE].T
    w = np.sqrt(np.maximum(1.0 - (half**2).sum(axis=0), 0.0))
    rows[FIELDS["orientation"]] = product(state[FIELDS["orientation"]][:, None], (*half, w))
    rows[FIELDS["velocity"]] += errors[:, VELOCITY].T
    rows[FIELDS["spin"]] += errors[:, SPIN].T
    angles = angles_of_rows(state)[:, None] + errors[:, FINS].T
    rows[LEFT:RATES:2], rows[LEFT + 1 : RATES : 2] = np.cos(angles), np.sin(angles)
    return rows


def difference(rows: Floats, state: Floats) -> Floats:
    """Return the errors (N, 12) by which states (25, N) differ from one (25,)."""
    x, y, z, w = state[FIELDS["orientation"]]
    turn = product(np.array([-x, -y, -z, w])[:, None], rows[FIELDS["orientation"]])
    turn = np.array(turn)
    angles = angles_of_rows(rows) - angles_of_rows(state)[:, None]
    return np.concatenate(
        [
            2.0 * turn[:3] * np.where(turn[3] < 0.0, -1.0, 1.0),
            rows[FIELDS["velocity"]] - state[FIELDS["velocity"], None],
            rows[FIELDS["spin"]] - state[FIELDS["spin"], None],
            np.arctan2(np.sin(angles), np.cos(angles)),
        ]
    ).T


def product(p: Floats, q: Floats | tuple[Floats, ...]) -> Floats:
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
