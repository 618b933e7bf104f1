"""The case of an alarm: what the robot was before it, when it may have broken, and what it is."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import NamedTuple

import numpy as np

from aquafish.online import thresholds
from aquafish.online.recognition import Recognised, recognise
from aquafish.online.self_model import noise_of, predict
from aquafish_gym.damage import Damage
from aquafish_gym.damage.damage import MAXIMUM_FAULTS
from aquafish_gym.scenario import GYRO_CHANNELS, Scenario
from aquafish_gym.utils.array_types import Floats


class Moment(NamedTuple):
    """One action, and what came before and after it."""

    state: Floats  #: (R,) before it.
    action: Floats  #: (F,)
    observed: Floats  #: (9,) after it.


class Moments:
    """The moments of an episode by their numbers; only the latest are kept, for days of swimming.

    Parameters
    ----------
    kept
        How many.
    begun
        The first ones.
    """

    def __init__(self, kept: int, begun: Sequence[Moment] = ()) -> None:
        self._latest = deque(begun, maxlen=kept)
        self._count = len(begun)

    def __len__(self) -> int:
        return self._count

    def append(self, moment: Moment) -> None:
        """Add the next one."""
        self._latest.append(moment)
        self._count += 1

    def since(self, first: int) -> list[Moment]:
        """Return those from a number on, which must not be forgotten."""
        forgotten = self._count - len(self._latest)
        if first < forgotten:
            raise IndexError(f"first must be {forgotten} or later; got {first}")
        return list(islice(self._latest, first - forgotten, None))


@dataclass
class Case:
    """An alarm that is being explained."""

    step: int  #: The number of actions before the alarm.
    before: Sequence[Scenario]  #: What the robot may have been, the present belief first.
    broken: Sequence[Damage]  #: What is broken of each in ``before``.
    first: int  #: The first moment at which it may have broken.
    due: list[int]  #: Numbers of observations from the alarm on with which to infer again.
    #: The case of an alarm shortly before, whose fault may have been inferred wrongly.
    earlier: Case | None = None
    #: Whether it may also have broken just after the alarm: a lost sensor is observed at the end of
    #: an action, and a fin that broke with it moves the robot from the next one on.
    later: bool = False
    #: Whether all sizes and servo gains are fitted at once where no hypothesis fits.
    identifies: bool = False

    def settled(self, step: int) -> bool:
        """Whether an alarm at a step means another fault rather than a wrong belief."""
        return step - self.step >= thresholds.SETTLED_CASE_ACTIONS

    def is_due(self, step: int) -> bool:
        """Return whether the robot is inferred now, and count that as done."""
        due = bool(self.due) and step - self.step + 1 >= self.due[0]
        if due:
            self.due.pop(0)
        return due

    def look_back(self) -> None:
        """Let it have broken at other times: a mild fault takes a second to raise an alarm."""
        self.later = True
        self.first = min(self.first, max(self.step - 1 - thresholds.LONGEST_DELAY_ACTIONS, 0))

    @property
    def _starts(self) -> int:
        """The number of states at which it may have broken."""
        return self.step - self.first + self.later

    @property
    def inferences(self) -> int:
        """How many inferences of usual length one of this case takes."""
        own = math.ceil(len(self.before) * self._starts / thresholds.CHARGED_STARTS)
        return own + (self.earlier.inferences if self.earlier is not None else 0)

    def explain(self, moments: Moments, drift: Floats, gyro_noise: float, hold: int) -> Recognised:
        """Return what explains the moments since the first at which something may have broken.

        ``moments`` are those of the episode; ``drift`` (9,) is the rms error of the model's own
        predictions, and ``gyro_noise`` that of the whole gyroscope, rad/s. If one fault at the
        earlier alarm explains all moments since, that is the answer.
        """
        found = self._explain_alone(moments.since(self.first), drift, gyro_noise, hold)
        if self.earlier is None or found.unchanged:
            return found
        again = self.earlier.explain(moments, drift, gyro_noise, hold)
        return again if again.damage and again.fits else found

    def _explain_alone(
        self, moments: Sequence[Moment], drift: Floats, gyro_noise: float, hold: int
    ) -> Recognised:
        actions = np.array([moment.action for moment in moments])
        observed = np.array([moment.observed for moment in moments])
        # The filter has since followed the broken robot: what it was is simulated from there.
        states = [moments[0].state]
        for action in actions[: self._starts - 1]:
            states.append(predict(self.before[0], states[-1], action[None], hold)[1][:, 0])
        tolerance = np.maximum(thresholds.TOLERANCE_RATIO * drift, thresholds.CHANNEL_TOLERANCE)
        tolerance[GYRO_CHANNELS] = np.maximum(
            tolerance[GYRO_CHANNELS], thresholds.TOLERANCE_RATIO * gyro_noise
        )
        since = len(moments) - (self.step - 1 - self.first)  # the alarm
        readings = since * int(np.isfinite(noise_of(self.before[-1])).sum())
        identifies = self.identifies and readings >= thresholds.IDENTIFIED_READINGS
        found = recognise(
            self.before, states, observed, actions, drift, tolerance, hold, identifies
        )
        # The robot has all of them; what is said of it has the latest.
        faults = self.broken[found.before].faults + found.damage.faults
        damage = Damage(faults[-MAXIMUM_FAULTS:])
        return replace(found, damage=damage, onset=self.first + found.onset)


def open_case(
    beliefs: Sequence[tuple[Scenario, Damage]],
    moments: Moments,
    back: int,
    due: list[int],
    recent: Case | None,
    identifies: bool,
) -> Case:
    """Return the case of an alarm at the last of some moments.

    Parameters
    ----------
    beliefs
        What the robot may have been, and what was broken of it; the present belief first.
    moments
        Of the episode.
    back
        The number of actions before the alarm in which it may have broken.
    due
        Numbers of observations with which to infer.
    recent
        The case of the first of the alarms before, if any; it is reopened if its fault is believed.
    identifies
        Whether all sizes and servo gains are fitted at once where no hypothesis fits.
    """
    robots = [robot for robot, _ in beliefs]
    used = np.isfinite(noise_of(robots[0]))
    step = len(moments)
    first = max(step - 1 - back, 0)
    earliest = max(first - thresholds.OUTAGE_ACTIONS, 0)
    for moment in reversed(moments.since(earliest)[: first - earliest]):
        if np.isfinite(moment.observed[used]).any():
            break
        first -= 1
    case = Case(step, robots, [broken for _, broken in beliefs], first, due, identifies=identifies)
    believed = recent is not None and recent.before[0] is not robots[0]
    if recent is not None and believed and step - recent.step <= thresholds.REOPENED_ACTIONS:
        case.earlier = recent
    return case
