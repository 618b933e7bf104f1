"""The case of an alarm: what the robot was before it, when it may have broken, and what it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from aquafish.online.recognition import GYRO, Hypothesis, Recognised, recognise
from aquafish.online.self_model import predict
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.array_types import Floats

SETTLED = 10  # actions after an alarm from which on what was inferred is trusted
# A channel is broken if its rms error is more than this, and than these multiples of the model's
# own error and of the gyroscope's noise.
TOLERANCE, DRIFTS, NOISES = 0.02, 3.0, 3.0


class Moment(NamedTuple):
    """One action, and what came before and after it."""

    state: Floats  #: (25,) before it.
    action: Floats  #: (3,)
    observed: Floats  #: (9,) after it.


@dataclass
class Case:
    """An alarm that is being explained."""

    step: int  #: The number of actions before the alarm.
    before: Sequence[Scenario]  #: What the robot may have been, the present belief first.
    broken: Sequence[Hypothesis]  #: What is broken of each in ``before``.
    first: int  #: The first moment at which it may have broken.
    due: list[int]  #: Numbers of observations from the alarm on with which to infer again.

    def settled(self, step: int) -> bool:
        """Whether an alarm at a step means another fault rather than a wrong belief."""
        return step - self.step >= SETTLED

    def is_due(self, step: int) -> bool:
        """Return whether the robot is inferred now, and count that as done."""
        due = bool(self.due) and step - self.step + 1 >= self.due[0]
        if due:
            self.due.pop(0)
        return due

    def explain(
        self, moments: Sequence[Moment], drift: Floats, gyro_noise: float, hold: int
    ) -> Recognised:
        """Return what explains the moments since the first at which something may have broken.

        ``moments`` are all of the episode; ``drift`` (9,) is the rms error of the model's own
        predictions, and ``gyro_noise`` that of the whole gyroscope, rad/s.
        """
        moments = moments[self.first :]
        actions = np.array([moment.action for moment in moments])
        observed = np.array([moment.observed for moment in moments])
        # The filter has since followed the broken robot: what it was is simulated from there.
        states = [moments[0].state]
        for action in actions[: self.step - self.first]:
            states.append(predict(self.before[0], states[-1], action[None], hold)[1][:, 0])
        tolerance = np.maximum(DRIFTS * drift, TOLERANCE)
        tolerance[GYRO] = np.maximum(tolerance[GYRO], NOISES * gyro_noise)
        found = recognise(self.before, states, observed, actions, drift, tolerance, hold)
        return replace(found, hypothesis=self.broken[found.before].then(found.hypothesis))
