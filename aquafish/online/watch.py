"""Noticing that something broke: the surprise of observations, against chance and model error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.scenario import Scenario
from eea.fish.self_model import FLOOR, MODEL_ERROR, SelfModel, predict

Floats = NDArray[np.float64]

WINDOWS = (1, 2, 4, 8, 16)  # actions over which surprise is summed
ALARM = 1e-7  # probability of a false alarm in each window and action, of a model without error
MARGIN = 2.0  # by which surprise must exceed the greatest that was seen while nothing broke
CALIBRATION = 50  # actions in which the model's error is measured
SETTLED = 10  # actions after which the filter has forgotten how it began
ERROR_SCALES = (1.0, 10.0, 100.0, 1000.0)  # of ``MODEL_ERROR``
AHEAD, EVERY = 10, 5  # open-loop predictions: how many actions, and how often


class Moment(NamedTuple):
    """One action, and what came before and after it."""

    state: Floats  #: (25,) before it.
    action: Floats  #: (3,)
    observed: Floats  #: (9,) after it.


@dataclass
class Watch:
    """Sums of squared innovations over windows.

    An alarm needs more than chance explains, and more than was ever seen while nothing broke: in
    water that the model does not know, its error is no noise.
    """

    used: int  #: How many channels are used.
    squares: list[float] = field(default_factory=list)
    highest: dict[int, float] = field(default_factory=dict)

    def add(self, square: float, calm: bool = False) -> bool:
        """Add one observation's; return whether it is alarming. If ``calm``, nothing has broken."""
        self.squares.append(square)
        del self.squares[: -max(WINDOWS)]
        alarming = False
        for window in WINDOWS:
            if len(self.squares) < window:
                break
            total = sum(self.squares[-window:])
            if calm:
                self.highest[window] = max(self.highest.get(window, 0.0), total)
            usual = MARGIN * self.highest.get(window, 0.0)
            alarming |= total > max(_by_chance(window * self.used), usual)
        return alarming and not calm


@cache
def _by_chance(freedom: int) -> float:
    from scipy.stats import chi2  # slow to import

    return float(chi2.isf(ALARM, freedom))


class Calibration:
    """Measures the model's error in the first ten seconds, in which nothing may break.

    Filters with several model errors, in water without and with added mass, run side by side; the
    likeliest is taken.
    """

    def __init__(
        self, robot: Scenario, fin_angles: Floats, noise: Floats, hold: int, waters: Sequence[bool]
    ) -> None:
        self.models = [
            SelfModel(
                Scenario.fill(robot.arrays(), reactive),
                fin_angles,
                noise,
                MODEL_ERROR * scale,
                hold,
            )
            for reactive in waters
            for scale in ERROR_SCALES
        ]
        self._squares: list[list[float]] = []
        self._moments: list[list[Moment]] = [[] for _ in self.models]

    @property
    def best(self) -> SelfModel:
        """The likeliest model so far."""
        return max(self.models, key=lambda model: model.log_likelihood)

    def add(self, action: Floats, observed: Floats) -> bool:
        """Add an action (3,) and the observation (9,) after it; return whether that is enough."""
        squares = []
        for model, moments in zip(self.models, self._moments, strict=True):
            before = model.state
            model.step(action)
            squares.append(model.correct(observed).square)
            moments.append(Moment(before, action, observed))
            if len(moments) == SETTLED:
                model.log_likelihood = 0.0
        self._squares.append(squares)
        return len(self._squares) == CALIBRATION

    def finish(self) -> tuple[Watch, Floats]:
        """Return a watch, and the rms error (9,) of open-loop predictions, without the noise."""
        model = self.best
        which = self.models.index(model)
        watch = Watch(int(np.isfinite(model.noise).sum()))
        for squares in self._squares[SETTLED:]:
            watch.add(squares[which], calm=True)
        moments, errors = self._moments[which], []
        for first in range(SETTLED, len(moments) - AHEAD + 1, EVERY):
            part = moments[first : first + AHEAD]
            actions = np.array([moment.action for moment in part])
            predicted, _ = predict(model.robot, part[0].state, actions, model.hold)
            errors.append(predicted[0] - np.array([moment.observed for moment in part]))
        known = np.where(np.isfinite(model.noise), model.noise, 0.0)
        mean = np.square(errors).mean(axis=(0, 1))
        return watch, np.sqrt(np.maximum(mean - known**2, FLOOR**2))
