"""The first ten seconds: how wrong is the self-model, in which water, and where are the fins?"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish.online import thresholds
from aquafish.online.belief import SurpriseMonitor
from aquafish.online.case import Moment
from aquafish.online.search import mismatch
from aquafish.online.self_model import SelfModel, noise_of, predict
from aquafish_gym.physics.layout import layout
from aquafish_gym.scenario import CHANNELS, Scenario
from aquafish_gym.utils.array_types import Floats
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    finite_array,
    instance,
    integer,
    real_array,
    spelled,
)

WATERS = (False, True)  # without and with added mass
_MOST_UNKNOWN_FINS = 6  # whose initial angles are found
_MOST_POSES = 16**4  # from which they are narrowed: with more fins, fewer angles of each


class ErrorCalibration:
    """Measures the model's error in the first 50 actions, in which nothing may break.

    Filters run side by side, one for each of several model errors, in water without and with added
    mass, and one more in each with a current that wanders, as where it depends on the place; the
    one of highest likelihood counts. If its model error is large, the water is foreign: filters
    with other drags of the fins replace them, and start from the first action. If ``fin_angles`` is
    None, the angles are estimated after five actions with readings.

    Observations (9,) are NaN where a channel gave no reading. Glitches are not used either: single
    readings that even the filter with the largest error did not expect.

    Attributes
    ----------
    unknown
        Whether the fin angles are not known yet.
    fitted
        Whether drags of the fins were tried.
    models, moments, squares
        The filters, and for each of them its moments and its squared innovations with the numbers
        of channels.
    """

    def __init__(self, robot: Scenario, fin_angles: ArrayLike | None, hold: int) -> None:
        if len(instance("robot", robot, Scenario)) != 1:
            raise InvalidArgumentError(f"robot must be one robot; got {robot!r}")
        integer("hold", hold, 1)
        fins = len(robot.plan.fins)
        if fin_angles is not None:
            fin_angles = finite_array("fin_angles", fin_angles, (fins,), unit="rad")
        elif fins > _MOST_UNKNOWN_FINS:
            raise InvalidArgumentError(
                f"fin_angles must be known of a fish of more than {_MOST_UNKNOWN_FINS} fins; got "
                f"None of {robot.plan!r}"
            )
        self._robots = [replace(robot, reactive=reactive) for reactive in WATERS]
        self.unknown = fin_angles is None
        self.fitted = False
        # Of the water, to come.
        self._checks = [thresholds.WATER_ACTIONS, thresholds.CALIBRATION_ACTIONS]
        self._hold = hold
        self._start_error = thresholds.START_ERROR
        self._fins = np.zeros(fins) if fin_angles is None else fin_angles
        self._past: list[tuple[Floats, Floats]] = []
        self._begin()

    def _begin(self) -> None:
        """Start new filters, and let them repeat all actions and observations so far."""
        errors = [thresholds.MODEL_ERROR * scale for scale in (1.0, *thresholds.ERROR_SCALES)]
        if not self.fitted:
            errors.insert(0, wandering_error())
        self.models = [
            SelfModel(robot, self._fins, error, self._start_error, self._hold)
            for robot in self._robots
            for error in errors
        ]
        self._forget_likelihoods()
        self.squares: list[list[tuple[float, int]]] = [[] for _ in self.models]
        self.moments: list[list[Moment]] = [[] for _ in self.models]
        self._surprising = np.zeros(len(CHANNELS), np.bool_)
        for action, observed in self._past:
            self._step(action, observed)

    def _forget_likelihoods(self) -> None:
        for model in self.models:
            model.log_likelihood = -thresholds.CURRENT_COST if wanders(model) else 0.0

    @property
    def exact(self) -> list[int]:
        """The indices of the filters of the least error of robot and water.

        Those of a current that wanders come last.
        """
        least = [
            i
            for i, one in enumerate(self.models)
            if one.model_error[0] == thresholds.MODEL_ERROR[0]
        ]
        return sorted(least, key=lambda i: wanders(self.models[i]))

    @property
    def best(self) -> int:
        """The index of the model of highest likelihood so far."""
        return int(np.argmax([model.log_likelihood for model in self.models]))

    @property
    def model(self) -> SelfModel:
        """The model of highest likelihood so far."""
        return self.models[self.best]

    @property
    def other_water(self) -> str:
        """A description of how the likeliest water differs from the library's; empty if not."""
        robot = self.model.robot
        mass = "added mass" if robot.reactive else ""
        drag = "" if (robot.drag == 1.0).all() else f"drag of the fins x {robot.drag[0, 0]:g}"
        current = "a current that wanders" if wanders(self.model) else ""
        return "; ".join(filter(None, [mass, drag, current]))

    @property
    def foreign(self) -> bool:
        """Whether the water is foreign: the likeliest model has a large error in it."""
        first = thresholds.ERROR_SCALES[0] * thresholds.MODEL_ERROR[0]
        return bool(self.model.model_error[0] > first)

    def add(self, action: Floats, observed: Floats, check: bool = True) -> bool:
        """Add an action (F,) and the observation (9,) after it; return whether it was the last.

        Without ``check``, whether the water is foreign is checked later.
        """
        wanted = (len(CHANNELS),)
        action = finite_array("action", action, self._fins.shape)
        observed = real_array("observed", observed, wanted)
        if observed.shape != wanted:
            raise InvalidArgumentError(
                f"observed must have shape {spelled(wanted)}; got {observed.shape}"
            )
        past = self._past
        past.append((action, observed))
        self._step(action, observed)
        with_readings = sum(bool(np.isfinite(seen).any()) for _, seen in past)
        if self.unknown and with_readings == thresholds.FIN_ANGLE_ACTIONS:
            self.unknown = False
            self._start_error = thresholds.START_ERROR.copy()
            self._start_error[-1] = thresholds.FIN_ANGLE_ERROR
            actions, seen = (np.array(column) for column in zip(*past, strict=True))
            self._fins = find_fins(self._robots, seen, actions, self._hold)
            self._begin()
        elif self._checks and len(past) >= self._checks[0] and check:
            del self._checks[0]
            if self.foreign and not self.fitted:
                robot = self.model.robot
                self.fitted = True
                self._robots = [
                    replace(robot, drag=np.array([[drag, 1.0]])) for drag in thresholds.DRAGS
                ]
                self._begin()
        return len(past) >= thresholds.CALIBRATION_ACTIONS

    def _step(self, action: Floats, observed: Floats) -> None:
        states = [model.state for model in self.models]
        for model in self.models:
            model.step(action)
        observed = self._without_glitches(observed)
        for state, model, squares, moments in zip(
            states, self.models, self.squares, self.moments, strict=True
        ):
            moments.append(Moment(state, action, observed))
            squares.append((model.correct(observed), int(model.used(observed).sum())))
        if len(self.squares[0]) == thresholds.SETTLED_ACTIONS:
            self._forget_likelihoods()

    def _without_glitches(self, observed: Floats) -> Floats:
        """Return an observation with NaN for glitches.

        A glitch surprises every filter, and the channel's reading before it did not.
        """
        if self.unknown:
            return observed
        before = self._surprising
        self._surprising = np.ones(len(CHANNELS), np.bool_)
        for model in reversed(self.models):  # that of the largest error is surprised least
            self._surprising &= model.surprise(observed) > thresholds.GLITCH_SDS
            if not self._surprising.any():
                break
        return np.where(self._surprising & ~before, np.nan, observed)

    def finish(self, known: int | None = None) -> tuple[SurpriseMonitor, Floats]:
        """Return a monitor, and the rms error (9,) of open-loop predictions less sensor noise.

        Both are of the filter of highest likelihood, or of the one with the number ``known``, which
        was watched. Something may have broken in the last actions: then they do not count. Where
        the current wanders the returned error is doubled: it may wander faster in another place.
        """
        best = self.best if known is None else known
        counted = None if known is None else -thresholds.LONGEST_DELAY_ACTIONS
        model = self.models[best]
        moments = self.moments[best][:counted]
        errors = []
        foreign = self.foreign and known is None
        monitor = SurpriseMonitor(
            thresholds.FOREIGN_SURPRISE_MARGIN if foreign else thresholds.SURPRISE_MARGIN
        )
        for square, used in self.squares[best][thresholds.SETTLED_ACTIONS : counted]:
            monitor.add(square, used, calm=True)
        for first in range(
            thresholds.SETTLED_ACTIONS,
            len(moments) - thresholds.PREDICTED_ACTIONS + 1,
            max(1, thresholds.PREDICTED_ACTIONS // 2),
        ):
            part = moments[first : first + thresholds.PREDICTED_ACTIONS]
            actions = np.array([moment.action for moment in part])
            predicted, _ = predict(model.robot, part[0].state, actions, self._hold)
            errors.append(predicted[0] - np.array([moment.observed for moment in part]))
        seen = np.isfinite(errors)
        count = seen.sum(axis=(0, 1))
        mean = np.square(np.where(seen, errors, 0.0)).sum(axis=(0, 1)) / np.maximum(count, 1)
        mean[count == 0] = mean.max()  # of a channel that was never observed
        noise = np.where(np.isfinite(model.noise), model.noise, 0.0)
        drift = np.sqrt(np.maximum(mean - noise**2, thresholds.LEAST_OBSERVATION_SD**2))
        return monitor, thresholds.WANDERING_MARGIN * drift if wanders(model) else drift


def wandering_error() -> Floats:
    """Return the model error (4,) of an exact robot and water, where the current wanders."""
    error = thresholds.MODEL_ERROR.copy()
    error[1] = thresholds.WANDERING_SPEED  # of the velocity
    return error


def wanders(model: SelfModel) -> bool:
    """Return whether a filter of a calibration lets the current wander."""
    return bool(np.array_equal(model.model_error, wandering_error()))


def find_fins(
    waters: Sequence[Scenario], observed: Floats, actions: Floats, hold: int = 20
) -> Floats:
    """Return the fin angles (F,), rad, at which a robot began at rest.

    ``waters`` are scenarios of one robot, in the waters that it may be in. It observed (K, 9) after
    each of its actions (K, F).
    """
    plan = waters[0].plan
    fins = len(plan.fins)
    most = math.floor(_MOST_POSES ** (1 / fins) + 1e-9)
    count = min(thresholds.POSES_PER_FIN, most)
    turn = 2 * np.pi * np.arange(count) / count
    spacing = turn[1]
    around = _grid(np.arange(-1, 2), fins)
    poses: Floats = _grid(turn, fins)
    for _ in range(thresholds.NARROWING_ROUNDS):
        costs = np.min(
            [
                mismatch(
                    predict(
                        robot.take(np.zeros(len(poses), np.intp)),
                        layout(plan).start(poses),
                        actions,
                        hold,
                    )[0],
                    observed,
                    noise_of(robot),
                )
                for robot in waters
            ],
            axis=0,
        )
        best = poses[np.argsort(costs, kind="stable")[: thresholds.NARROWED_HYPOTHESES]]
        spacing /= 2
        poses = (best[:, None] + spacing * around).reshape(-1, fins)
    found: Floats = best[0]
    return found


def _grid(axis: NDArray[Any], fins: int) -> NDArray[Any]:
    """Return all combinations (N, F) of the values of an axis."""
    return np.stack(np.meshgrid(*[axis] * fins), -1).reshape(-1, fins)
