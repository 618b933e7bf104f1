"""The observations of broken sensors: the one statement of each word about a sensor."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.damage.delays import DelayLines, delay_steps, longest
from aquafish_gym.scenario import CHANNELS, TIMESTEP, Scenario
from aquafish_gym.sense import faulty
from aquafish_gym.utils.array_types import Flags, Floats, Reals, Rows

LARGEST_PRODUCT = 1e200  # of factors: times any reading it stays finite
GYRO_CHANNELS = slice(CHANNELS.index("gyro_x"), len(CHANNELS))
#: The rows of a batch of one robot.
ONLY_ROBOT: Rows = np.zeros(1, np.intp)


class Readings(NamedTuple):
    """How C sensor channels of n robots read."""

    noise: Floats  #: (n, C) standard deviation of the white noise in each observation
    bias: NDArray[np.floating]  #: (n, C) added
    stuck: Flags  #: (n, C) whether each repeats its first observation
    dropped: Flags  #: (n, C) whether each reads 0
    scale: Floats  #: (n, C) by which the truth is multiplied
    delay: Floats  #: (n, C) by which each is late, s
    hold: Floats  #: (n, C) for how long each repeats a reading, s; 0 is not at all

    @classmethod
    def whole(cls, count: int, channels: int, dtype: type[np.floating] = np.float64) -> Self:
        """Return the tables of whole sensors, with biases of type ``dtype``."""
        shape = (count, channels)
        noise, bias = np.zeros(shape), np.zeros(shape, dtype)
        stuck, dropped = np.zeros((2, *shape), np.bool_)
        return cls(noise, bias, stuck, dropped, np.ones(shape), *np.zeros((2, *shape)))

    @classmethod
    def of(cls, robots: Scenario) -> Self:
        """Return how the sensors ``CHANNELS`` of robots read; the gyro alone has noise."""
        noise = np.zeros(robots.sensor_bias.shape)
        noise[:, GYRO_CHANNELS] = robots.gyro_noise[:, None]
        return cls(
            noise,
            robots.sensor_bias,
            robots.sensor_stuck,
            robots.sensor_dropped,
            robots.sensor_scale,
            robots.sensor_delay,
            robots.sensor_hold,
        )

    def take(self, rows: Any) -> Self:
        """Return the robots that ``rows`` selects; views of them if it is a slice."""
        return type(self)(*(table[rows] for table in self))

    @property
    def broken(self) -> Flags:
        """Which channels (n, C) are faulty."""
        read: Flags = (self.noise != 0.0) | (self.bias != 0.0) | (self.scale != 1.0)
        late: Flags = (self.delay != 0.0) | (self.hold != 0.0)
        return read | late | self.stuck | self.dropped


def break_sensor(robots: Readings, channels: Any, word: str, number: float) -> None:
    """Break the sensor channels that an index or a slice selects, in place."""
    match word:
        case "noise":
            robots.noise[:, channels] = np.hypot(robots.noise[:, channels], number)
        case "bias":
            robots.bias[:, channels] += number
        case "stuck":
            robots.stuck[:, channels] = True
        case "dropped":
            robots.dropped[:, channels] = True
        case "scale":
            product = robots.scale[:, channels] * number
            robots.scale[:, channels] = np.clip(product, -LARGEST_PRODUCT, LARGEST_PRODUCT)
        case "delay" | "hold":
            break_link(robots.delay, robots.hold, channels, word, number)


def break_link(
    delay: Floats, hold: Floats, channels: Any, word: str, number: float | Floats
) -> None:
    """Let the channels that an index selects deliver late or seldom, in place.

    One late link follows another; of two slow ones the slower counts.
    """
    if word == "delay":
        delay[:, channels] += number
    else:
        hold[:, channels] = np.maximum(hold[:, channels], number)


class Sensors:
    """C sensor channels of each of B robots, some of them faulty.

    ``readings`` holds their faults. ``broken`` is whether any channel ever was faulty; where none
    was, nothing is computed. Observations are numbers of type ``dtype``, one every ``dt`` s.
    """

    def __init__(
        self,
        count: int,
        dtype: type[np.floating] = np.float32,
        channels: int = len(CHANNELS),
        dt: float = TIMESTEP,
    ) -> None:
        self.broken = False
        self.readings = Readings.whole(count, channels, dtype)
        self._fresh = np.zeros((count, channels), np.bool_)  # stuck from the next observation on
        self._held = np.zeros((count, channels), dtype)
        self._dt, self._lines = dt, DelayLines(count, channels, dtype)

    @property
    def remembers(self) -> bool:
        """Whether readings must pass, also of whole sensors: a channel ever is or will be late."""
        return self._lines.active

    def remember(self, seconds: ArrayLike) -> None:
        """Keep readings from now on, for later delays of up to ``seconds``."""
        steps = longest(seconds, self._dt)
        if steps:
            self.broken = True
            self._lines.remember(steps)

    def update(self, rows: Rows, readings: Readings) -> None:
        """Set how the robots ``rows`` (n,) read in later observations."""
        if not self.broken and not readings.broken.any():
            return
        self.broken = True
        self._fresh[rows] = readings.stuck & ~self.readings.stuck[rows]
        for table, new in zip(self.readings, readings, strict=True):
            table[rows] = new
        delay = delay_steps(readings.delay, self._dt)
        self._lines.update(rows, delay, readings.hold / self._dt)

    def reset(self, rows: Rows) -> None:
        """Forget the observations of these robots: an episode begins."""
        self.readings.stuck[rows] = False
        self._lines.reset(rows)

    def observe(
        self,
        truth: Reals,
        low: ArrayLike,
        high: ArrayLike,
        rngs: Sequence[np.random.Generator] | np.random.Generator,
        rows: Rows,
    ) -> Reals:
        """Return the observations (n, k) of the robots ``rows``, which begin with the C channels.

        Parameters
        ----------
        truth
            What whole sensors would observe.
        low, high
            The ends (k,) at which sensors saturate.
        rngs
            The generators of all B robots, or one for all of them.
        """
        now = self.readings.take(rows)
        observed = truth.copy()
        felt = observed[:, : now.bias.shape[1]]  # a view
        noisy = now.noise > 0.0
        white = _draw(rngs, rows, noisy.sum(axis=1)) if noisy.any() else None
        _misread(felt, now, noisy, white)
        felt[:] = self._lines.carry(felt, rows)
        felt[:], self._held[rows] = faulty(
            felt, self._held[rows], self._fresh[rows], now.stuck, now.dropped
        )
        self._fresh[rows] = False
        np.clip(observed, low, high, out=observed)
        return observed

    def record(self, truth: Floats, rng: np.random.Generator) -> Floats:
        """Return the observations (T, C) of a single robot in T steps, without limits.

        They are those of T calls of :meth:`observe`, to the last bit.
        """
        rows = np.zeros(1, np.intp)
        now = Readings(*(np.repeat(table, len(truth), axis=0) for table in self.readings))
        noisy = now.noise > 0.0
        felt = truth.copy()
        _misread(felt, now, noisy, rng.standard_normal(np.count_nonzero(noisy)))
        if self._lines.active:
            steps = np.split(felt, len(felt))
            felt = np.concatenate([self._lines.carry(step, rows) for step in steps])
        held = np.where(self._fresh, felt[:1], self._held)
        observed, _ = faulty(felt, held, np.zeros_like(felt), now.stuck, now.dropped)
        self._held[:] = held
        self._fresh[:] = False
        found: Floats = observed
        return found


def _misread(felt: Reals, now: Readings, noisy: Flags, white: Floats | None) -> None:
    """Scale true readings (n, C), and add bias and noise, in place.

    ``white`` are normal numbers for the ``noisy`` channels (n, C), one after another.
    """
    if (now.scale != 1.0).any():
        with np.errstate(over="ignore"):  # it saturates
            felt *= now.scale
    felt += now.bias
    if white is not None:
        felt[noisy] += now.noise[noisy] * white


def _draw(
    rngs: Sequence[np.random.Generator] | np.random.Generator, rows: Rows, counts: Rows
) -> Floats:
    """Return ``counts`` (n,) normal numbers for each of the robots ``rows``, one after another."""
    if isinstance(rngs, np.random.Generator):
        return rngs.standard_normal(int(counts.sum()))
    drawn = zip(rows.tolist(), counts.tolist(), strict=True)
    return np.concatenate([rngs[robot].standard_normal(count) for robot, count in drawn if count])
