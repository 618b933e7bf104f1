"""Noticing that something broke: the surprise of observations, against chance and model error."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish.online.case import Moment
from aquafish.online.recognition import find_fins
from aquafish.online.self_model import (
    FIN_ERRORS,
    LEAST_OBSERVATION_SD,
    MODEL_ERROR,
    START_ERROR,
    SelfModel,
    predict,
)
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

WINDOWS = (1, 2, 4, 8, 16)  # actions over which squared innovations are summed
# The probability of a false alarm in each window and action, of a model without error.
ACTION_ALARM_PROBABILITY = 1e-7
# An alarm needs this many times the greatest surprise that was seen while nothing broke: in water
# that the model describes, and in foreign water.
SURPRISE_MARGIN = 2.0
FOREIGN_SURPRISE_MARGIN = 5.0
FIN_ANGLE_ACTIONS = 5  # after which unknown fin angles are found
FIN_ANGLE_ERROR = 0.2  # rad, of the angles that are found
WATER_ACTIONS = 25  # after which the water is known
CALIBRATION_ACTIONS = 50  # after which the model's error is known
SETTLED_ACTIONS = 10  # after which the filter has forgotten its initial state
SILENT_ACTIONS = 3  # after which a channel without a reading is reported
GLITCH_SDS = 10.0  # from which a single reading is a glitch, and is ignored
ERROR_SCALES = (1.0, 10.0, 100.0, 1000.0)  # of ``MODEL_ERROR``
FOREIGN_ERROR_SCALE = 100.0  # least error scale in water that the model does not describe
WATERS = (False, True)  # without and with added mass
DRAGS = (0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.3)  # factors on the fins' drag that foreign water may have
PREDICTED_ACTIONS = 10  # in each open-loop prediction
PREDICTION_INTERVAL = 5  # actions between two open-loop predictions


@dataclass
class SurpriseMonitor:
    """Sums of squared innovations over windows.

    An alarm needs more than chance explains, and more than was ever seen while nothing broke: in
    water that the model does not know, its error is no noise.
    """

    margin: float = SURPRISE_MARGIN
    squares: list[float] = field(default_factory=list)
    used: list[int] = field(default_factory=list)
    highest: dict[int, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        finite_array("margin", self.margin, (), 0.0)

    def add(self, square: float, used: int, calm: bool = False) -> bool:
        """Add the squared innovation of ``used`` channels; return whether it is alarming.

        If ``calm``, nothing has broken.
        """
        self.squares.append(square)
        self.used.append(used)
        del self.squares[: -max(WINDOWS)], self.used[: -max(WINDOWS)]
        alarming = False
        for window in WINDOWS:
            if len(self.squares) < window:
                break
            total = sum(self.squares[-window:])
            if calm:
                self.highest[window] = max(self.highest.get(window, 0.0), total)
            usual = self.margin * self.highest.get(window, 0.0)
            alarming |= total > max(_by_chance(sum(self.used[-window:])), usual)
        return alarming and not calm

    def clear(self) -> None:
        """Forget the squared innovations, but not the highest sums."""
        self.squares.clear()
        self.used.clear()


class ReadingHistory:
    """The last two readings of each sensor channel, and for how many actions it has given none.

    ``expected`` (9,) are the channels that should give readings.
    """

    def __init__(self, expected: NDArray[np.bool_]) -> None:
        self._expected = expected
        self._last = np.full((2, len(CHANNELS)), np.nan)
        self._silence = np.zeros(len(CHANNELS), np.intp)
        self._longest = 0 * self._silence

    def changed(self, observed: Floats) -> NDArray[np.bool_]:
        """Return which channels (9,) read something else now after they repeated a reading."""
        older, old = self._last
        found: NDArray[np.bool_] = (older == old) & (old != observed) & np.isfinite(observed)
        return found

    def add(self, observed: Floats) -> list[str]:
        """Add an observation; return in words which channels give no readings, each once."""
        fresh = np.isfinite(observed)
        self._last[:, fresh] = self._last[1, fresh], observed[fresh]
        self._silence = np.where(fresh, 0, self._silence + 1)
        new = self._expected & (self._silence == SILENT_ACTIONS) & (self._longest < SILENT_ACTIONS)
        self._longest = np.maximum(self._longest, self._silence)
        return [f"{CHANNELS[i]} gives no readings" for i in np.flatnonzero(new)]


@cache
def _by_chance(freedom: int) -> float:
    from scipy.stats import chi2  # slow to import

    return float(chi2.isf(ACTION_ALARM_PROBABILITY, freedom)) if freedom else 0.0


class ErrorCalibration:
    """Measures the model's error in the first ten seconds, in which nothing may break.

    Filters with several model errors, in water without and with added mass, run side by side; the
    likeliest is taken. If even that is much in error, the water is foreign, and filters with other
    drags of the fins follow. Fin angles that are None are found after a second.

    Observations (9,) are NaN where a channel was not observed. A single reading that surprises even
    the most tolerant filter is not used either.
    """

    def __init__(self, robot: Scenario, fin_angles: ArrayLike | None, hold: int) -> None:
        if len(instance("robot", robot, Scenario)) != 1:
            raise InvalidArgumentError(f"robot must be one robot; got {robot!r}")
        integer("hold", hold, 1)
        if fin_angles is not None:
            fin_angles = finite_array("fin_angles", fin_angles, (3,), unit="rad")
        self._robots = [replace(robot, reactive=reactive) for reactive in WATERS]
        self.unknown, self._fitted = fin_angles is None, False
        self._hold, self._start_error = hold, START_ERROR
        self._fins = np.zeros(3) if fin_angles is None else fin_angles
        self._past: list[tuple[Floats, Floats]] = []
        self._begin()

    def _begin(self) -> None:
        """Begin again, with the actions and observations of the past."""
        self._models = [
            SelfModel(robot, self._fins, MODEL_ERROR * scale, self._start_error, self._hold)
            for robot in self._robots
            for scale in ERROR_SCALES
        ]
        self._squares: list[list[tuple[float, int]]] = [[] for _ in self._models]
        self._moments: list[list[Moment]] = [[] for _ in self._models]
        self._surprising = np.zeros(len(CHANNELS), np.bool_)
        for action, observed in self._past:
            self._step(action, observed)

    @property
    def best(self) -> int:
        """The number of the likeliest model so far."""
        return int(np.argmax([model.log_likelihood for model in self._models]))

    @property
    def model(self) -> SelfModel:
        """The likeliest model so far."""
        return self._models[self.best]

    @property
    def other_water(self) -> str:
        """In words, how the likeliest model's water differs from that of the library's gaits."""
        robot = self.model.robot
        drag = "" if (robot.drag == 1.0).all() else f"drag of the fins x {robot.drag[0, 0]:g}"
        return "; ".join(filter(None, ["added mass" if robot.reactive else "", drag]))

    @property
    def foreign(self) -> bool:
        """Whether the water seems to be another than the model's."""
        return bool(self.model.model_error[0] >= FOREIGN_ERROR_SCALE * MODEL_ERROR[0])

    def add(self, action: Floats, observed: Floats) -> bool:
        """Add an action (3,) and the observation (9,) after it; return whether that is enough."""
        wanted = spelled((len(CHANNELS),))
        action = finite_array("action", action, (3,))
        observed = real_array("observed", observed, wanted)
        if observed.shape != (len(CHANNELS),):
            raise InvalidArgumentError(f"observed must have shape {wanted}; got {observed.shape}")
        past = self._past
        past.append((action, observed))
        self._step(action, observed)
        heard = sum(bool(np.isfinite(seen).any()) for _, seen in past)
        if self.unknown and heard == FIN_ANGLE_ACTIONS:
            self.unknown, self._start_error = False, START_ERROR.copy()
            self._start_error[FIN_ERRORS] = FIN_ANGLE_ERROR
            actions, seen = (np.array(column) for column in zip(*past, strict=True))
            self._fins = find_fins(self._robots, seen, actions, self._hold)
            self._begin()
        elif (
            len(past) in (WATER_ACTIONS, CALIBRATION_ACTIONS) and self.foreign and not self._fitted
        ):
            robot, self._fitted = self.model.robot, True
            self._robots = [replace(robot, drag=np.array([[drag, 1.0]])) for drag in DRAGS]
            self._begin()
        return len(past) == CALIBRATION_ACTIONS

    def _step(self, action: Floats, observed: Floats) -> None:
        states = [model.state for model in self._models]
        for model in self._models:
            model.step(action)
        observed = self._without_glitches(observed)
        for state, model, squares, moments in zip(
            states, self._models, self._squares, self._moments, strict=True
        ):
            moments.append(Moment(state, action, observed))
            squares.append((model.correct(observed), int(model.used(observed).sum())))
            if len(moments) == SETTLED_ACTIONS:
                model.log_likelihood = 0.0

    def _without_glitches(self, observed: Floats) -> Floats:
        """Return an observation, NaN where one reading alone surprises every filter."""
        if self.unknown:
            return observed
        surprise = np.min([model.surprise(observed) for model in self._models], axis=0)
        before, self._surprising = self._surprising, surprise > GLITCH_SDS
        return np.where(self._surprising & ~before, np.nan, observed)

    def finish(self) -> tuple[SurpriseMonitor, Floats]:
        """Return a watch, and the rms error (9,) of open-loop predictions, without the noise."""
        model = self.model
        moments = self._moments[self.best]
        errors = []
        watch = SurpriseMonitor(FOREIGN_SURPRISE_MARGIN if self.foreign else SURPRISE_MARGIN)
        for square, used in self._squares[self.best][SETTLED_ACTIONS:]:
            watch.add(square, used, calm=True)
        for first in range(
            SETTLED_ACTIONS, len(moments) - PREDICTED_ACTIONS + 1, PREDICTION_INTERVAL
        ):
            part = moments[first : first + PREDICTED_ACTIONS]
            actions = np.array([moment.action for moment in part])
            predicted, _ = predict(model.robot, part[0].state, actions, self._hold)
            errors.append(predicted[0] - np.array([moment.observed for moment in part]))
        seen = np.isfinite(errors)
        count = seen.sum(axis=(0, 1))
        mean = np.square(np.where(seen, errors, 0.0)).sum(axis=(0, 1)) / np.maximum(count, 1)
        mean[count == 0] = mean.max()  # of a channel that was never observed
        noise = np.where(np.isfinite(model.noise), model.noise, 0.0)
        return watch, np.sqrt(np.maximum(mean - noise**2, LEAST_OBSERVATION_SD**2))
