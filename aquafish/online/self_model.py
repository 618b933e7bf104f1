"""A robot's model of itself that it carries along, corrected by its sensors as it swims.

A cubature Kalman filter (I. Arasaratnam and S. Haykin, "Cubature Kalman filters", 2009) corrects
the simulated state by what the inertial measurement unit observes. The error of a state has nine
numbers and one for each of F fins: a small rotation about the body's axes, the velocity in the
world, the angular velocity and the fin angles. The position is only predicted: nothing depends on
it.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from aquafish.online import thresholds
from aquafish_gym.command import scale_action
from aquafish_gym.engines.compiled.lanes import LaneBatch
from aquafish_gym.physics.layout import FIELDS, JOINTS, layout, state_of
from aquafish_gym.plans import BodyPlan
from aquafish_gym.scenario import MAXIMUM_CURRENT, MAXIMUM_SPIN, Scenario
from aquafish_gym.sense import imu
from aquafish_gym.utils.array_types import Floats
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    finite_array,
    instance,
    integer,
    real_array,
)

MAXIMUM_ACTION_STEPS = 1000  # of 0.01 s


SENSOR_FIELDS = ("gyro_noise", "sensor_bias", "sensor_stuck", "sensor_dropped")  # of a scenario
ATTITUDE_ERRORS = slice(0, 3)  # of the error of a state
VELOCITY_ERRORS = slice(3, 6)
SPIN_ERRORS = slice(6, 9)
FIN_ERRORS = slice(9, None)


def error_size(plan: BodyPlan) -> int:
    """Return E, the size of the error of a state."""
    return FIN_ERRORS.start + len(plan.fins)


@cache
def _points(size: int) -> Floats:
    """Return the cubature points (2 E, E) of a standard normal error."""
    points: Floats = np.sqrt(size) * np.concatenate([np.eye(size), -np.eye(size)])
    return points


class SelfModel:
    """A robot's model of itself, in the state that it is in now.

    Parameters
    ----------
    robot
        A scenario of one robot: its body, servos, water and sensors.
    fin_angles
        (F,) at the start, rad. It begins at rest.
    model_error, start_error
        (4,) see ``thresholds.MODEL_ERROR`` and ``thresholds.START_ERROR``; positive.
    hold
        For how many steps of 0.01 s an action is held.

    Attributes
    ----------
    state
        (R,) the estimate: rows of the plan's ``aquafish_gym.physics.layout``.
    covariance
        (E, E) of its error.
    noise
        (9,) see :func:`noise_of`.
    log_likelihood
        Of all observations so far, up to a constant.

    Examples
    --------
    >>> model = SelfModel(Scenario.create(gyro_noise=[0.01]), (0.0, 0.5, 1.0))
    >>> model.step((0.2, -0.2, 1.0))
    >>> model.correct(imu_readings(model.state[:, None])[0]) < 0.1
    True
    """

    def __init__(
        self,
        robot: Scenario,
        fin_angles: ArrayLike,
        model_error: Floats = thresholds.MODEL_ERROR,
        start_error: Floats = thresholds.START_ERROR,
        hold: int = 20,
    ) -> None:
        if len(instance("robot", robot, Scenario)) != 1:
            raise InvalidArgumentError(f"robot must be one robot; got {robot!r}")
        angles = finite_array("fin_angles", fin_angles, (len(robot.plan.fins),), unit="rad")
        self.model_error = finite_array("model_error", model_error, (4,), 0.0)
        self.hold = integer("hold", hold, 1, MAXIMUM_ACTION_STEPS)
        start = finite_array("start_error", start_error, (4,), 0.0)
        self.covariance: Floats = np.diag(error_sds(robot.plan, start) ** 2)
        self.log_likelihood = 0.0
        self.become(robot, layout(robot.plan).start(angles[None])[:, 0])

    def copy(self) -> SelfModel:
        """Return a model that goes on from the same state by itself."""
        fins = len(self.robot.plan.fins)
        twin = SelfModel(self.robot, np.zeros(fins), self.model_error, hold=self.hold)
        twin.become(self.robot, self.state)
        twin.covariance = self.covariance
        twin.log_likelihood = self.log_likelihood
        return twin

    def become(self, robot: Scenario, state: Floats) -> None:
        """Replace the robot and its state (R,); keep the covariance."""
        self.robot = robot
        self.state = state
        self.noise = noise_of(robot)
        points = np.zeros(2 * error_size(robot.plan) + 1, np.intp)
        self._lanes = LaneBatch(robot.take(points), np.float64, threads=1, states=state[:, None])

    def step(self, action: ArrayLike) -> None:
        """Predict the state after an action (F,) in [-1, 1]."""
        plan = self.robot.plan
        action = finite_array("action", action, (len(plan.fins),))
        spread = self._spread()
        points = moved(plan, self.state, np.concatenate([np.zeros((1, spread.shape[1])), spread]))
        self._lanes.states[:] = points
        self._lanes.advance(np.tile(scale_action(plan, action), (points.shape[1], 1)), self.hold)
        ended = self._lanes.states.astype(np.float64)
        errors = state_errors(plan, ended[:, 1:], ended[:, 0])
        mean = errors.mean(axis=0)
        self.state = moved(plan, ended[:, 0], mean[None])[:, 0]
        errors -= mean
        added = np.diag(error_sds(plan, self.model_error) ** 2)
        self.covariance = errors.T @ errors / len(errors) + added

    def _spread(self) -> Floats:
        """Return the errors (2 E, E) whose mean square is the covariance."""
        return _points(len(self.covariance)) @ np.linalg.cholesky(self.covariance).T

    def follow(self, action: ArrayLike, observed: Floats) -> float:
        """Predict the state after an action (F,), and correct it by what was observed (9,) then.

        Return what :meth:`correct` returns.
        """
        self.step(action)
        return self.correct(observed)

    def used(self, observed: Floats) -> NDArray[np.bool_]:
        """Return which channels (9,) of an observation correct the state."""
        found: NDArray[np.bool_] = np.isfinite(self.noise) & np.isfinite(observed)
        return found

    def correct(self, observed: Floats) -> float:
        """Correct the state by an observation (9,), NaN where a channel was not observed.

        Return the squared error of its prediction in standard deviations: chi-square with a degree
        of freedom for each channel that is used, if the model is right.
        """
        errors, seen, covariance, innovation = self._compare(observed)
        cross = errors.T @ seen / len(errors)
        gain = np.linalg.solve(covariance, cross.T).T
        correction = np.asarray(gain @ innovation, np.float64)
        self.state = moved(self.robot.plan, self.state, correction[None])[:, 0]
        # A wild reading would make it faster than the physics can simulate, for ever.
        for field, most in (("velocity", MAXIMUM_CURRENT), ("spin", MAXIMUM_SPIN)):
            self.state[FIELDS[field]] = self.state[FIELDS[field]].clip(-most, most)
        left = self.covariance - gain @ cross.T
        self.covariance = 0.5 * (left + left.T) + 1e-14 * np.eye(len(left))
        square = float(innovation @ np.linalg.solve(covariance, innovation))
        self.log_likelihood -= 0.5 * (square + float(np.linalg.slogdet(covariance)[1]))
        return square

    def surprise(self, observed: Floats) -> Floats:
        """Return how many standard deviations (9,) each channel of an observation is off.

        0 of one that is not used.
        """
        _, _, covariance, innovation = self._compare(observed)
        return np.abs(innovation) / np.sqrt(np.diag(covariance))

    def _compare(self, observed: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Return errors (2 E, E) of the state and what they change of the observation (2 E, 9).

        Also the covariance (9, 9) of the observation, and its innovation (9,).
        """
        used = self.used(observed)
        errors = self._spread()
        seen = imu_readings(moved(self.robot.plan, self.state, errors))
        mean = seen.mean(axis=0)
        seen = np.where(used, seen - mean, 0.0)
        noise = np.where(used, np.hypot(self.noise, thresholds.LEAST_OBSERVATION_SD), 1.0)
        covariance = seen.T @ seen / len(errors) + np.diag(noise**2)
        innovation = np.where(used, observed - self.robot.sensor_bias[0] - mean, 0.0)
        return errors, seen, covariance, innovation


def predict(
    robots: Scenario, states: Floats, actions: Floats, hold: int = 20
) -> tuple[Floats, Floats]:
    """Return what the sensors of N robots would observe (N, K, 9) after each action (K, F).

    They begin in ``states`` (R, N), or all in one (R,). Also return the states (R, N) in which
    they end. Sensors are whole. In single precision, on one thread.
    """
    count = len(instance("robots", robots, Scenario))
    actions = finite_array("actions", actions, (None, len(robots.plan.fins)))
    integer("hold", hold, 1, MAXIMUM_ACTION_STEPS)
    rows = layout(robots.plan).state_rows
    states = real_array("states", states, f"({rows}, {count})")
    if states.shape not in ((rows,), (rows, 1), (rows, count)):
        raise InvalidArgumentError(
            f"states must have shape ({rows},) or ({rows}, {count}); got {states.shape}"
        )
    lanes = LaneBatch(robots, threads=1, states=states.reshape(len(states), -1))
    observed = np.empty((len(robots), len(actions), 9))
    for k, command in enumerate(scale_action(robots.plan, actions)):
        lanes.advance(np.tile(command, (len(robots), 1)), hold)
        observed[:, k] = np.transpose(imu(lanes.state()))
    return observed, lanes.states.astype(np.float64)


def observed_directions(readings: Floats) -> Floats:
    """Return readings (9,), NaN where up or north has no length: one axis may read 0, not all.

    An observation of nothing but zeros was not transmitted.
    """
    if not readings.any():
        return np.full_like(readings, np.nan)
    for direction in (slice(0, 3), slice(3, 6)):
        if not readings[direction].any():
            readings[direction] = np.nan
    return readings


def noise_of(robot: Scenario) -> Floats:
    """Return the standard deviations (9,) of one robot's observations.

    Infinite of channels that are dropped or stuck: they are not used.
    """
    lost = robot.sensor_dropped[0] | robot.sensor_stuck[0]
    return np.where(lost, np.inf, np.repeat([0.0, 0.0, robot.gyro_noise[0]], 3))


def imu_readings(states: Floats) -> Floats:
    """Return what the inertial measurement unit observes, (N, 9), in states (R, N)."""
    return np.array(imu(state_of(list(states[:JOINTS])))).T


def error_sds(plan: BodyPlan, kinds: Floats) -> Floats:
    """Return the standard deviations (E,) of an error, of those of its four kinds of numbers."""
    return np.repeat(kinds, (3, 3, 3, len(plan.fins)))


def moved(plan: BodyPlan, state: Floats, errors: Floats) -> Floats:
    """Return states (R, N) that differ from one (R,) by errors (N, E)."""
    states = np.repeat(state[:, None], len(errors), axis=1)
    turned = Rotation.from_quat(state[FIELDS["orientation"]])
    turned *= Rotation.from_rotvec(errors[:, ATTITUDE_ERRORS])
    states[FIELDS["orientation"]] = turned.as_quat().T
    states[FIELDS["velocity"]] += errors[:, VELOCITY_ERRORS].T
    states[FIELDS["spin"]] += errors[:, SPIN_ERRORS].T
    angles = layout(plan).angles(state)[:, None] + errors[:, FIN_ERRORS].T
    joints = states[layout(plan).joints]
    joints[::2], joints[1::2] = np.cos(angles), np.sin(angles)
    return states


def state_errors(plan: BodyPlan, states: Floats, state: Floats) -> Floats:
    """Return the errors (N, E) by which states (R, N) differ from one (R,)."""
    before = Rotation.from_quat(state[FIELDS["orientation"]])
    turn = before.inv() * Rotation.from_quat(states[FIELDS["orientation"]].T)
    angles = layout(plan).angles(states) - layout(plan).angles(state)[:, None]
    errors: Floats = np.concatenate(
        [
            turn.as_rotvec().T,
            states[FIELDS["velocity"]] - state[FIELDS["velocity"], None],
            states[FIELDS["spin"]] - state[FIELDS["spin"], None],
            np.arctan2(np.sin(angles), np.cos(angles)),
        ]
    ).T
    return errors
