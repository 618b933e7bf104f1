"""Watching from the first second: the whole robot, in still water or a current, is known by prior.

What broke before the model's error is measured is believed only if its fit is as good as chance
allows. In water that the model does not describe, nothing fits so well.
"""

from __future__ import annotations

import numpy as np

from aquafish.online import thresholds
from aquafish.online.belief import SurpriseMonitor, chance_bound
from aquafish.online.calibration import ErrorCalibration
from aquafish.online.case import Case, Moment
from aquafish.online.self_model import SelfModel
from aquafish_gym.damage import Damage
from aquafish_gym.scenario import CHANNELS
from aquafish_gym.utils.array_types import Floats


def early_drift() -> Floats:
    """Return the rms error (9,) of the model's own predictions, before it is measured."""
    return np.full(len(CHANNELS), thresholds.EARLY_DRIFT_RATIO * thresholds.LEAST_OBSERVATION_SD)


class EarlyWatch:
    """Looks for damage while a calibration goes on; the initial fin angles must be known.

    Until the filters of the whole robot predict well, damage from the start is a case. Then they
    are watched, and an alarm is a case.

    Parameters
    ----------
    calibration
        Without an action yet.
    back
        The number of actions before an alarm in which something may have broken.
    inferences
        Numbers of observations from an alarm on with which to infer.

    Attributes
    ----------
    case
        What is being explained, or None.
    monitor
        Of the filter that alarmed, or a new one.
    """

    def __init__(
        self, calibration: ErrorCalibration, back: int, inferences: tuple[int, ...]
    ) -> None:
        self._calibration = calibration
        self._back = back
        self._inferences = inferences
        self._watched: dict[int, SurpriseMonitor] = {}  # by the number of its filter
        self._surprised: dict[int, tuple[int, SurpriseMonitor]] = {}  # likewise, and when
        self._chosen = calibration.exact[0]
        self._alarmed = False
        self.monitor = SurpriseMonitor()
        self.case: Case | None = self._open(calibration.exact, 1, 0, thresholds.START_INFERENCES)

    @property
    def explaining(self) -> bool:
        """Whether an alarm is being explained."""
        return self._alarmed and self.case is not None

    @property
    def known(self) -> int | None:
        """The number of the likeliest filter that still predicts well, or None."""
        models = self._calibration.models
        return max(self._watched, key=lambda i: models[i].log_likelihood, default=None)

    @property
    def model(self) -> SelfModel:
        """The whole robot's filter."""
        return self._calibration.models[self._chosen]

    @property
    def moments(self) -> list[Moment]:
        """All moments, with the states of the whole robot's filter."""
        return self._calibration.moments[self._chosen]

    def add(self) -> bool:
        """Take in the calibration's last action; return whether to alarm."""
        if self._alarmed or self._calibration.fitted:
            return False
        squares = self._calibration.squares
        if not self._watched:
            for i in self._calibration.exact:
                total, used = np.sum(squares[i], axis=0)
                if len(squares[i]) >= thresholds.KNOWN_ACTIONS and total <= chance_bound(int(used)):
                    self._watched[i] = SurpriseMonitor()
                    for square, count in squares[i]:
                        self._watched[i].add(square, count, calm=True)
                    self.case = None
            return False
        steps = len(self.moments)
        surprised = [i for i, one in self._watched.items() if one.add(*squares[i][-1])]
        for i in surprised:
            self._surprised[i] = steps, self._watched.pop(i)
        if surprised and not self._watched:
            since = {i: step for i, (step, _) in self._surprised.items()}
            recent = [
                i
                for i in self._calibration.exact
                if i in since and steps - since[i] <= thresholds.LONGEST_DELAY_ACTIONS
            ]
            self._alarmed = True
            self._chosen = recent[0]
            self.monitor = self._surprised[self._chosen][1]
            first = max(min(since[i] for i in recent) - 1 - self._back, 0)
            self.case = self._open(recent, steps, first, self._inferences)
        return self._alarmed

    def due(self, steps: int) -> Case | None:
        """Return the case if it is inferred now, after some actions."""
        case = self.case
        if case is None or not case.is_due(steps):
            return None
        if not case.due:
            self.case = None
        return case

    def _open(self, filters: list[int], step: int, first: int, due: tuple[int, ...]) -> Case:
        """Return a case of a robot that was whole, in the water of any of some filters."""
        robots = [self._calibration.models[i].robot for i in filters]
        waters = list(dict.fromkeys(robots))  # each once, though its current may wander or not
        return Case(step, waters, [Damage()] * len(waters), first, list(due))
