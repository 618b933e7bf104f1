"""The sensors, or the servos, of robots on NumPy: what is broken, and what they remember."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.damage import transmit
from aquafish_gym.damage.transmit import NEUTRAL, delay_steps
from aquafish_gym.utils.array_libraries import NumPyLibrary
from aquafish_gym.utils.array_types import Reals, Rows

Generators = Sequence[np.random.Generator] | np.random.Generator
NUMPY = NumPyLibrary()


class Side:
    """C channels of each of B robots, of which a step's numbers come in each call.

    Parameters
    ----------
    count, channels
        B and C.
    dt
        The length of a step, s.
    dtype
        Of the numbers.
    first
        (C,) what a delayed channel delivers before the first number arrives; None is the episode's
        first number.
    """

    def __init__(
        self,
        count: int,
        channels: int,
        dt: float,
        dtype: Any = np.float64,
        first: ArrayLike | None = None,
    ) -> None:
        self._shape = (count, channels)
        self._dt = dt
        self._dtype = dtype
        self._first = first
        self._now: transmit.Columns = {}  # of the words that ever held
        self._state: transmit.State = {}
        self._count = np.zeros(count, np.int64)  # numbers of the episode that came
        self._broken = np.zeros(count, np.bool_)  # whether anything of each is broken

    @property
    def broken(self) -> bool:
        """Whether a channel ever was broken or may become late; else it carries the truth."""
        return bool(self._now or self._state)

    @property
    def remembers(self) -> bool:
        """Whether a channel ever was or may become late or slow."""
        return "past" in self._state or "hold" in self._now

    def start(self, rows: Rows) -> None:
        """Forget what these robots carried: an episode begins, whose faults come by an update."""
        self._count[rows] = 0
        for word in ("stuck", "hold", "delay"):
            if word in self._now:
                self._now[word][rows] = 0

    def remember(self, seconds: ArrayLike) -> None:
        """Keep numbers from now on, for later delays of up to ``seconds``."""
        depth = 1 + transmit.longest_delay(seconds, self._dt)
        if depth > 1:
            self._deepen(depth)

    def update(self, rows: Rows, columns: Mapping[str, NDArray[Any]]) -> None:
        """Let robots ``rows`` (n,) have ``columns`` (n, C) from now on, by their words.

        "delay" and "hold" are in s.
        """
        dt = self._dt
        steps = delay_steps(columns["delay"], dt)
        now = {**columns, "delay": steps, "hold": columns["hold"] / dt}
        for word, column in now.items():
            if word not in self._now and (column != NEUTRAL.get(word, 0)).any():
                self._begin_word(word, column.dtype)
        if self.broken and "bias" in columns and "bias" not in self._now:
            self._begin_word("bias", self._dtype)  # by which -0 is read as 0 whatever is broken
        if not self._now:
            return
        broken = [(column != NEUTRAL.get(word, 0)).any(axis=1) for word, column in now.items()]
        self._broken[rows] = np.logical_or.reduce(broken)
        if "delay" in self._now:
            self._deepen(1 + int(steps.max(initial=0)))
        now = {word: now[word] for word in self._now}
        before = {word: table[rows] for word, table in self._now.items()}
        kept = [name for name in ("fresh", "began") if name in self._state]
        state: transmit.State = {name: self._state[name][rows] for name in kept}
        for word, column in now.items():
            self._now[word][rows] = column
        state = transmit.change(np, state, before, now, self._count[rows, None])
        for name, array in state.items():
            self._state[name][rows] = array

    def carry(self, numbers: NDArray[Any], rows: Rows) -> NDArray[Any]:
        """Take a step's numbers (n, C) of the robots ``rows``, and return what is delivered."""
        if not self.remembers:
            return numbers
        now, state = self._of(rows)
        clock = self._count[rows, None]
        found, state = transmit.carry(NUMPY, now, state, numbers, clock, clock, self._first)
        self._keep(rows, state)
        delivered: NDArray[Any] = found
        return delivered

    def sense(self, truth: Reals, rows: Rows, rngs: Generators) -> Reals:
        """Return what the sensors of the robots ``rows`` make of the truth (n, C), unbounded.

        ``rngs`` are a generator for each of all B robots, or one that they share.
        """
        now, state = self._of(rows)
        clock = self._count[rows, None]
        white = self._white(now, rows, rngs)
        with np.errstate(over="ignore"):  # it saturates
            found, state = transmit.sense(NUMPY, now, state, truth, white, clock, clock)
        self._keep(rows, state)
        sensed: Reals = found
        return sensed

    def observe(
        self, truth: Reals, low: ArrayLike, high: ArrayLike, rngs: Generators, rows: Rows
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
            As of :meth:`sense`.
        """
        observed = truth.copy()
        channels = slice(self._shape[1])
        broken = self._broken[rows]
        if self.remembers or broken.all():
            observed[:, channels] = self.sense(truth[:, channels], rows, rngs)
        else:
            self._count[rows[~broken]] += 1
            some = np.flatnonzero(broken)
            observed[some, channels] = self.sense(truth[some, channels], rows[some], rngs)
        np.clip(observed, low, high, out=observed)
        return observed

    def record(self, truth: Reals, rng: np.random.Generator) -> Reals:
        """Return the observations (T, C) of a single robot in T steps.

        They equal those of T calls of :meth:`sense`, to the last bit.
        """
        if self.remembers:  # each step depends on those before
            rows = np.zeros(1, np.intp)
            return np.concatenate([self.sense(step[None], rows, rng) for step in truth])
        now, state = self._now, self._state
        noisy = np.broadcast_to(now.get("noise", 0.0), truth.shape) > 0.0
        white = np.zeros(truth.shape)
        white[noisy] = rng.standard_normal(np.count_nonzero(noisy))
        found = transmit.misread(np, now, truth, white)
        if "stuck" in now:
            state["reading"] = np.where(state["fresh"], found[:1], state["reading"])
            state["fresh"] = np.zeros_like(state["fresh"])
            found = np.where(now["stuck"], state["reading"], found)
        self._count += len(truth)
        recorded: Reals = transmit.drop(np, found, now["dropped"]) if "dropped" in now else found
        return recorded

    def _begin_word(self, word: str, dtype: Any) -> None:
        """Let a word have a column, and what it remembers."""
        self._now[word] = np.full(
            self._shape, NEUTRAL.get(word, 0), self._dtype if word == "bias" else dtype
        )
        if word == "stuck":
            self._state["fresh"] = np.zeros(self._shape, np.bool_)
            self._state["reading"] = np.zeros(self._shape, self._dtype)
        elif word == "hold":
            self._state["began"] = np.zeros(self._shape, np.int64)
            self._state["kept"] = np.zeros(self._shape, self._dtype)

    def _deepen(self, depth: int) -> None:
        """Remember the numbers of ``depth`` steps at least."""
        if "past" not in self._state:
            self._state["past"] = np.zeros((1, *self._shape), self._dtype)
            self._state["cells"] = np.arange(self._shape[0] * self._shape[1]).reshape(self._shape)
        past = self._state["past"]
        if depth > len(past):
            self._state["past"] = deepened(past, self._count - 1, depth)

    def _of(self, rows: Rows) -> tuple[transmit.Columns, transmit.State]:
        """Return what is broken of these robots, and what they remember; not copies if of all."""
        if len(rows) == len(self._count):
            return self._now, self._state
        state = {
            name: array[:, rows] if name == "past" else array[rows]
            for name, array in self._state.items()
        }
        if "cells" in state:
            shape = state["cells"].shape
            state["cells"] = np.arange(shape[0] * shape[1]).reshape(shape)
        return {word: column[rows] for word, column in self._now.items()}, state

    def _keep(self, rows: Rows, state: transmit.State) -> None:
        """Keep the state of these robots after a step, and count it."""
        if len(rows) == len(self._count):
            self._state = state
        else:
            for name, array in state.items():
                if name == "past":
                    self._state[name][:, rows] = array
                elif name != "cells":
                    self._state[name][rows] = array
        self._count[rows] += 1

    def _white(self, now: transmit.Columns, rows: Rows, rngs: Generators) -> Any:
        """Return standard normal numbers (n, C), drawn where channels have noise, or None."""
        noisy = now["noise"] > 0.0 if "noise" in now else None
        if noisy is None or not noisy.any():
            return None
        white = np.zeros(noisy.shape)
        if isinstance(rngs, np.random.Generator):
            white[noisy] = rngs.standard_normal(np.count_nonzero(noisy))
        else:
            drawn = zip(rows.tolist(), noisy.sum(axis=1).tolist(), strict=True)
            white[noisy] = np.concatenate(
                [rngs[robot].standard_normal(count) for robot, count in drawn if count]
            )
        return white


def deepened(past: NDArray[Any], clock: ArrayLike, depth: int) -> NDArray[Any]:
    """Return the numbers (depth, B, C) of the last steps, given those of fewer.

    The last step has the number ``clock``, one or (B,); that of step k stands in entry k modulo
    the depth. What is older than all that was kept is the oldest of it.
    """
    count = past.shape[1]
    robots = np.arange(count)
    clocks = np.broadcast_to(clock, (count,))
    found = np.empty((depth, *past.shape[1:]), past.dtype)
    for age in range(depth):
        kept = past[(clocks - min(age, len(past) - 1)) % len(past), robots]
        found[(clocks - age) % depth, robots] = kept
    return found
