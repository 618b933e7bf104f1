"""Faults of sensors, and the observations of faulty sensors.

:func:`break_sensor` defines the words for faults of sensors, such as "noise" and "stuck", and
:class:`Sensors` observes with them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.damage.delays import DelayLines, delay_steps, longest
from aquafish_gym.scenario import CHANNELS, TIMESTEP, Scenario
from aquafish_gym.sense import faulty
from aquafish_gym.utils.array_types import Flags, Floats, Reals, Rows

LARGEST_SCALE_PRODUCT = 1e200  # of the scales of a channel; its product with a reading is finite
GYRO_CHANNELS = slice(CHANNELS.index("gyro_x"), len(CHANNELS))
#: The index of the robot in a batch of one.
ONLY_ROBOT: Rows = np.zeros(1, np.intp)


class Readings(NamedTuple):
    """The properties of C sensor channels of each of n robots."""

    noise: Floats  #: (n, C) standard deviation of the white noise
    bias: NDArray[np.floating]  #: (n, C) added to the truth after it is scaled
    stuck: Flags  #: (n, C) whether each repeats the first reading after it got stuck
    dropped: Flags  #: (n, C) whether each reads 0
    scale: Floats  #: (n, C) factor on the truth
    delay: Floats  #: (n, C) delay, s
    hold: Floats  #: (n, C) time for which each repeats a reading, s; 0 is without repeats

    @classmethod
    def whole(cls, count: int, channels: int, dtype: type[np.floating] = np.float64) -> Self:
        """Return the properties of sensors without faults, with biases of type ``dtype``."""
        shape = (count, channels)
        noise, bias = np.zeros(shape), np.zeros(shape, dtype)
        stuck, dropped = np.zeros((2, *shape), np.bool_)
        return cls(noise, bias, stuck, dropped, np.ones(shape), *np.zeros((2, *shape)))

    @classmethod
    def of(cls, robots: Scenario) -> Self:
        """Return the properties of the channels ``CHANNELS`` in a scenario.

        Only the gyro's channels have noise.
        """
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
    """Break the channels that an index or a slice selects, in place.

    ``word`` is the fault and ``number`` its size: a standard deviation, a bias, a factor, or a
    time in s. The words "stuck" and "dropped" ignore it.
    """
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
            robots.scale[:, channels] = np.clip(
                product, -LARGEST_SCALE_PRODUCT, LARGEST_SCALE_PRODUCT
            )
        case "delay" | "hold":
            break_link(robots.delay, robots.hold, channels, word, number)


def break_link(
    delay: Floats, hold: Floats, channels: Any, word: str, number: float | Floats
) -> None:
    """Add a delay or a hold of ``number`` s to the channels that an index selects, in place.

    Delays add up; of two holds the longer one counts.
    """
    if word == "delay":
        delay[:, channels] += number
    else:
        hold[:, channels] = np.maximum(hold[:, channels], number)


class Sensors:
    """C sensor channels of each of B robots, some of them faulty.

    ``readings`` holds their present properties. ``broken`` is whether any channel ever was faulty
    or will be late. Until then :meth:`observe` would return the truth, and callers skip it.
    Observations are numbers of type ``dtype``, one every ``dt`` s.
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
        self._fresh = np.zeros((count, channels), np.bool_)  # gets stuck at its next reading
        self._held = np.zeros((count, channels), dtype)
        self._dt = dt
        self._lines = DelayLines(count, channels, dtype)

    @property
    def remembers(self) -> bool:
        """Whether a channel is or may become late, so that :meth:`observe` must see every step."""
        return self._lines.active

    def remember(self, seconds: ArrayLike) -> None:
        """Keep readings from now on, for later delays of up to ``seconds``."""
        steps = longest(seconds, self._dt)
        if steps:
            self.broken = True
            self._lines.remember(steps)

    def update(self, rows: Rows, readings: Readings) -> None:
        """Set the properties (n, C) of the sensors of robots ``rows`` (n,) from now on."""
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
        """Return the observations (n, k) of the robots ``rows`` (n,).

        The first C of the k numbers are the sensors'; the others only saturate.

        Parameters
        ----------
        truth
            (n, k) what sensors without faults observe.
        low, high
            (k,) bounds at which observations saturate.
        rngs
            A generator for each of all B robots, or one that they share.
        """
        now = self.readings.take(rows)
        observed = truth.copy()
        sensed = observed[:, : now.bias.shape[1]]  # a view: writing to it writes to ``observed``
        noisy = now.noise > 0.0
        white = _draw(rngs, rows, noisy.sum(axis=1)) if noisy.any() else None
        _misread(sensed, now, noisy, white)
        sensed[:] = self._lines.carry(sensed, rows)
        sensed[:], self._held[rows] = faulty(
            sensed, self._held[rows], self._fresh[rows], now.stuck, now.dropped
        )
        self._fresh[rows] = False
        np.clip(observed, low, high, out=observed)
        return observed

    def record(self, truth: Floats, rng: np.random.Generator) -> Floats:
        """Return the observations (T, C) of a single robot in T steps.

        They equal those of T calls of :meth:`observe` with infinite bounds, to the last bit.
        """
        now = Readings(*(np.repeat(table, len(truth), axis=0) for table in self.readings))
        noisy = now.noise > 0.0
        sensed = truth.copy()
        _misread(sensed, now, noisy, rng.standard_normal(np.count_nonzero(noisy)))
        if self._lines.active:
            steps = np.split(sensed, len(sensed))
            sensed = np.concatenate([self._lines.carry(step, ONLY_ROBOT) for step in steps])
        held = np.where(self._fresh, sensed[:1], self._held)
        observed, _ = faulty(sensed, held, np.zeros_like(sensed), now.stuck, now.dropped)
        self._held[:] = held
        self._fresh[:] = False
        found: Floats = observed
        return found


def _misread(sensed: Reals, now: Readings, noisy: Flags, white: Floats | None) -> None:
    """Scale true readings (n, C), and add bias and noise, in place.

    ``white`` holds a standard normal number for each channel that is ``noisy`` (n, C).
    """
    if (now.scale != 1.0).any():
        with np.errstate(over="ignore"):  # it saturates
            sensed *= now.scale
    sensed += now.bias
    if white is not None:
        sensed[noisy] += now.noise[noisy] * white


def _draw(
    rngs: Sequence[np.random.Generator] | np.random.Generator, rows: Rows, counts: Rows
) -> Floats:
    """Return standard normal numbers, ``counts[i]`` for the robot ``rows[i]``, concatenated."""
    if isinstance(rngs, np.random.Generator):
        return rngs.standard_normal(int(counts.sum()))
    drawn = zip(rows.tolist(), counts.tolist(), strict=True)
    return np.concatenate([rngs[robot].standard_normal(count) for robot, count in drawn if count])
