"""Noticing that something broke: the surprise of observations, against chance and model error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from aquafish.online.case import Moment
from aquafish_gym.scenario import Scenario
from eea.fish.recognition import find_fins
from eea.fish.self_model import FINS, FLOOR, MODEL_ERROR, START_ERROR, SelfModel, predict

Floats = NDArray[np.float64]

WINDOWS = (1, 2, 4, 8, 16)  # actions over which surprise is summed
ALARM = 1e-7  # probability of a false alarm in each window and action, of a model without error
# An alarm needs this many times the greatest surprise that was seen while nothing broke: in water
# that the model describes, and in foreign water.
MARGIN, FOREIGN_MARGIN = 2.0, 5.0
FOUND, FOUND_ERROR = 5, 0.2  # actions after which unknown fin angles are found, and within how much
WATER, CALIBRATION = 25, 50  # actions after which the water is known, and the model's error
SETTLED = 10  # actions after which the filter has forgotten how it began
ERROR_SCALES = (1.0, 10.0, 100.0, 1000.0)  # of ``MODEL_ERROR``
FOREIGN = 100.0  # least error scale in water that the model does not describe
WATERS = (False, True)  # without and with added mass
DRAGS = (0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.3)  # factors on the fins' drag that foreign water may have
AHEAD, EVERY = 10, 5  # open-loop predictions: how many actions, and how often


@dataclass
class Watch:
    """Sums of squared innovations over windows.

    An alarm needs more than chance explains, and more than was ever seen while nothing broke: in
    water that the model does not know, its error is no noise.
    """

    margin: float = MARGIN
    squares: list[float] = field(default_factory=list)
    highest: dict[int, float] = field(default_factory=dict)

    def add(self, square: float, used: int, calm: bool = False) -> bool:
        """Add the squared innovation of ``used`` channels; return whether it is alarming.

        If ``calm``, nothing has broken.
        """
        self.squares.append(square)
        del self.squares[: -max(WINDOWS)]
        alarming = False
        for window in WINDOWS:
            if len(self.squares) < window:
                break
            total = sum(self.squares[-window:])
            if calm:
                self.highest[window] = max(self.highest.get(window, 0.0), total)
            usual = self.margin * self.highest.get(window, 0.0)
            alarming |= total > max(_by_chance(window * used), usual)
        return alarming and not calm


@cache
def _by_chance(freedom: int) -> float:
    from scipy.stats import chi2  # slow to import

    return float(chi2.isf(ALARM, freedom))


class Calibration:
    """Measures the model's error in the first ten seconds, in which nothing may break.

    Filters with several model errors, in water without and with added mass, run side by side; the
    likeliest is taken. If even that is much in error, the water is foreign, and filters with other
    drags of the fins follow. Fin angles that are None are found after a second.
    """

    def __init__(self, robot: Scenario, fin_angles: Floats | None, hold: int) -> None:
        self._robots = [replace(robot, reactive=reactive) for reactive in WATERS]
        self.unknown, self._fitted = fin_angles is None, False
        self._hold, self._start_error = hold, START_ERROR
        self._fins = np.zeros(3) if fin_angles is None else fin_angles
        self._begin(())

    def _begin(self, past: Sequence[Moment]) -> None:
        """Begin again, with what was done and observed."""
        self._models = [
            SelfModel(robot, self._fins, MODEL_ERROR * scale, self._start_error, self._hold)
            for robot in self._robots
            for scale in ERROR_SCALES
        ]
        self._squares: list[list[float]] = [[] for _ in self._models]
        self._moments: list[list[Moment]] = [[] for _ in self._models]
        for moment in past:
            self._step(moment.action, moment.observed)

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
        return bool(self.model.model_error[0] >= FOREIGN * MODEL_ERROR[0])

    def add(self, action: Floats, observed: Floats) -> bool:
        """Add an action (3,) and the observation (9,) after it; return whether that is enough."""
        self._step(action, observed)
        past = self._moments[0]
        if self.unknown and len(past) == FOUND:
            self.unknown, self._start_error = False, START_ERROR.copy()
            self._start_error[FINS] = FOUND_ERROR
            actions, seen = np.array([m.action for m in past]), np.array([m.observed for m in past])
            self._fins = find_fins(self._robots, seen, actions, self._hold)
            self._begin(past)
        elif len(past) in (WATER, CALIBRATION) and self.foreign and not self._fitted:
            robot, self._fitted = self.model.robot, True
            self._robots = [replace(robot, drag=np.array([[drag, 1.0]])) for drag in DRAGS]
            self._begin(past)
        return len(past) == CALIBRATION

    def _step(self, action: Floats, observed: Floats) -> None:
        for model, squares, moments in zip(self._models, self._squares, self._moments, strict=True):
            moments.append(Moment(model.state, action, observed))
            model.step(action)
            squares.append(model.correct(observed))
            if len(moments) == SETTLED:
                model.log_likelihood = 0.0

    def finish(self) -> tuple[Watch, Floats]:
        """Return a watch, and the rms error (9,) of open-loop predictions, without the noise."""
        model, moments, errors = self.model, self._moments[self.best], []
        watch = Watch(FOREIGN_MARGIN if self.foreign else MARGIN)
        used = np.isfinite(model.noise)
        for square in self._squares[self.best][SETTLED:]:
            watch.add(square, int(used.sum()), calm=True)
        for first in range(SETTLED, len(moments) - AHEAD + 1, EVERY):
            part = moments[first : first + AHEAD]
            actions = np.array([moment.action for moment in part])
            predicted, _ = predict(model.robot, part[0].state, actions, self._hold)
            errors.append(predicted[0] - np.array([moment.observed for moment in part]))
        mean = np.square(errors).mean(axis=(0, 1))
        return watch, np.sqrt(np.maximum(mean - np.where(used, model.noise, 0.0) ** 2, FLOOR**2))
