"""What an agent believes of its robot and of the water, what surprises it, and what it decided.

Changes in a recorded log, without a state before them, are ``eea.infer.known``'s.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from aquafish.online import thresholds
from aquafish.online.gaits import Gait
from aquafish.online.self_model import SelfModel
from aquafish_gym.damage import Damage
from aquafish_gym.scenario import CHANNELS, Scenario
from aquafish_gym.utils.array_types import Floats
from aquafish_gym.utils.validation import finite_array

Result = TypeVar("Result")


class Water(NamedTuple):
    """How well the self-model knows the water."""

    foreign: bool = False  #: Whether it has another law than the model's.
    predicted: bool = True  #: Whether the model predicts the gyroscope in it.
    wandering: bool = False  #: Whether its current depends on the place.


@dataclass
class Belief:
    """What the robot is, and how well that is known."""

    model: SelfModel  #: The robot as it is believed to be, in its present state.
    damage: Damage  #: What is broken of it.
    intact: Scenario  #: The robot without that, in the same water.
    drift: Floats  #: (9,) rms error of the model's own predictions.
    monitor: SurpriseMonitor  #: Of what surprises the model.
    water: Water

    def copy(self) -> Belief:
        """Return a belief whose model goes on by itself."""
        return replace(self, model=self.model.copy())


class Trusted(NamedTuple):
    """What was believed before an alarm, to which the agent returns where no hypothesis fits."""

    belief: Belief  #: Its model goes on beside the agent's.
    gait: Gait


@dataclass
class SurpriseMonitor:
    """Raises an alarm when the squared innovations of recent actions sum to too much.

    An alarm needs a sum above two bounds. One is the quantile of chi-squared, for noise. The other
    is ``margin`` times the largest sum before anything broke, for model error: in foreign water
    that is larger than noise.
    """

    margin: float = field(default_factory=lambda: thresholds.SURPRISE_MARGIN)
    #: Squared innovations, newest last.
    squares: list[float] = field(default_factory=list, init=False)
    #: The number of channels in each of them.
    used: list[int] = field(default_factory=list, init=False)
    #: Largest sum so far, by window.
    highest: dict[int, float] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        finite_array("margin", self.margin, (), 0.0)

    def add(self, square: float, used: int, calm: bool = False) -> bool:
        """Add an action's squared innovation of ``used`` channels; return whether to alarm.

        With ``calm``, nothing has broken yet: the sums raise the bound, and there is no alarm.
        """
        self.squares.append(square)
        self.used.append(used)
        del self.squares[: -max(thresholds.WINDOWS)], self.used[: -max(thresholds.WINDOWS)]
        alarming = False
        for window in thresholds.WINDOWS:
            if len(self.squares) < window:
                break
            total = sum(self.squares[-window:])
            if calm:
                self.highest[window] = max(self.highest.get(window, 0.0), total)
            error_bound = self.margin * self.highest.get(window, 0.0)
            alarming |= total > max(chance_bound(sum(self.used[-window:])), error_bound)
        return alarming and not calm

    def clear(self) -> None:
        """Forget the squared innovations, and keep the highest sums."""
        self.squares.clear()
        self.used.clear()


class ReadingHistory:
    """The last two readings of each sensor channel, and the number of actions since the last.

    ``expected`` (9,) is true of the channels that should give readings.
    """

    def __init__(self, expected: NDArray[np.bool_]) -> None:
        self._expected = expected
        self._last = np.full((2, len(CHANNELS)), np.nan)
        self._silence = np.zeros(len(CHANNELS), np.intp)  # actions since the last reading
        self._longest = np.zeros(len(CHANNELS), np.intp)  # silence so far

    def changed(self, observed: Floats) -> NDArray[np.bool_]:
        """Return which channels (9,) repeated a reading and now give a different one."""
        before_last, last = self._last
        found: NDArray[np.bool_] = (
            (before_last == last) & (last != observed) & np.isfinite(observed)
        )
        return found

    def add(self, observed: Floats) -> list[str]:
        """Add an observation (9,); return a message for each channel that fell silent.

        A channel is reported once, after ``FEWEST_OBSERVATIONS`` actions without a reading.
        """
        fresh = np.isfinite(observed)
        self._last[:, fresh] = self._last[1, fresh], observed[fresh]
        self._silence = np.where(fresh, 0, self._silence + 1)
        new = (
            self._expected
            & (self._silence == thresholds.FEWEST_OBSERVATIONS)
            & (self._longest < thresholds.FEWEST_OBSERVATIONS)
        )
        self._longest = np.maximum(self._longest, self._silence)
        return [f"{CHANNELS[i]} gives no readings" for i in np.flatnonzero(new)]


class Event(NamedTuple):
    """Something that the agent noticed or decided."""

    seconds: float  #: When, in the episode.
    #: "fins", "water", "sensor", "alarm", "inferred", "unknown", "chose" or "refined".
    what: str
    about: str  #: In words.
    cpu: float = 0.0  #: CPU seconds that it took.


class Thought(NamedTuple, Generic[Result]):
    """A result that can be used from an action on."""

    due: int
    event: Event
    result: Result


def thinking_actions(seconds: float, dt: float) -> int:
    """Return how many actions of ``dt`` seconds thinking takes: at least one.

    The present action is due now.

    Examples
    --------
    >>> thinking_actions(0.4, 0.2), thinking_actions(0.0, 0.2)
    (2, 1)
    """
    return max(1, math.ceil(seconds / dt - 1e-9))


def chance_bound(freedom: int) -> float:
    """Return the bound on the sum of ``freedom`` squared innovations for noise alone.

    It is a quantile of chi-squared.
    """
    return float(chdtri(freedom, thresholds.ALARM_PROBABILITY)) if freedom else 0.0


def predicts(drift: Floats, observed: Floats) -> bool:
    """Return whether a self-model predicts the gyroscope.

    ``drift`` (3,) is the rms error of its open-loop predictions, and ``observed`` (K, 3) what the
    gyroscope read, rad/s; NaN where it did not.
    """
    power = np.nanmean(np.square(observed)) if np.isfinite(observed).any() else 0.0
    return bool(np.mean(np.square(drift)) < thresholds.PREDICTED_SHARE**2 * power)
