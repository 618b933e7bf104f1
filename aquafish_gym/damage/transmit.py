"""What faults do to the numbers that channels carry.

One set of pure functions on arrays of NumPy, PyTorch, JAX and their like. ``xp`` is the arrays'
namespace. Numbers are (B, C): C channels of each of B robots. What describes a fault is (B, C),
too, or broadcasts to it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = Any  # of one library, on one device
Columns = dict[str, Array]  # by the word, what is broken of one side's channels
State = dict[str, Array]  # what one side's channels remember

#: By the word, what changes nothing; 0 or False where there is none here.
NEUTRAL: Mapping[str, float] = {"gain": 1.0, "scale": 1.0, "latched": math.nan}
#: Steps by which a channel may be late: what it is given in all of them is kept.
MAXIMUM_DELAY_STEPS = 10_000
STEP_ROUNDING = 1e-9  # of a step: what rounding may take from a count of steps
SINGLE_PRECISION_STEP_ROUNDING = 1e-5


def delay_steps(seconds: ArrayLike, dt: float) -> NDArray[np.int64]:
    """Return delays in s as whole steps of ``dt`` s, the nearest ones."""
    steps: NDArray[np.int64] = np.floor(np.asarray(seconds) / dt + 0.5).astype(np.int64)
    return steps


def longest_delay(seconds: ArrayLike, dt: float) -> int:
    """Return the longest of delays in s, in steps of ``dt`` s."""
    return math.floor(float(np.max(seconds, initial=0.0)) / dt + 0.5)


def scale(xp: Any, numbers: Array, factor: Array) -> Array:
    """Return numbers times a factor."""
    return _as(xp, numbers * factor, numbers)


def bias(xp: Any, numbers: Array, by: Array) -> Array:
    """Return numbers plus a bias."""
    return _as(xp, numbers + by, numbers)


def noise(xp: Any, numbers: Array, deviation: Array, white: Array) -> Array:
    """Return numbers plus noise of a standard deviation; ``white`` are standard normal numbers."""
    return _as(xp, numbers + deviation * white, numbers)


def hold(xp: Any, numbers: Array, period: Array, since: Array, kept: Array) -> tuple[Array, Array]:
    """Return numbers that are repeated for some steps, and those to keep for the next step.

    A channel takes the number of the first step at or after each multiple of ``period`` steps since
    the hold began, and repeats it in between. A period of 0 is without repeats.

    Parameters
    ----------
    period
        In steps.
    since
        The number of steps since the hold began.
    kept
        The numbers of the step before.
    """
    holds = period > 0.0
    steps = xp.asarray(since, dtype=period.dtype)
    divisor = xp.where(holds, period, 1.0)
    single = str(period.dtype).endswith("float32")
    rounding = SINGLE_PRECISION_STEP_ROUNDING if single else STEP_ROUNDING
    turn = xp.floor(steps / divisor + rounding)
    same = turn == xp.floor((steps - 1.0) / divisor + rounding)
    numbers = xp.where(holds & same, kept, numbers)
    return numbers, numbers


def delay(
    xp: Any,
    past: Array,
    steps: Array,
    count: Array,
    clock: Any,
    cells: Array,
    first: Any = None,
) -> Array:
    """Return the numbers (B, C) of some steps before.

    Parameters
    ----------
    past
        (D, B, C) the numbers of the last D steps: those of step k stand in entry k modulo D.
    steps
        By how many steps each channel is late, less than D.
    count
        (B, 1) how many steps the episode had before this one.
    clock
        The number of this step, whose numbers ``past`` has already; one for all, or (B, 1).
    cells
        (B, C) the numbers from 0 to B C - 1.
    first
        What is delivered before the first number arrives; None is the episode's first number.
    """
    back = xp.minimum(steps, xp.broadcast_to(count, steps.shape))
    index = (clock - back) % len(past) * (cells.shape[0] * cells.shape[1]) + cells
    numbers = past.reshape(-1)[index]
    return numbers if first is None else xp.where(steps > count, first, numbers)


def stick(
    xp: Any, numbers: Array, stuck: Array, fresh: Array, reading: Array
) -> tuple[Array, Array]:
    """Return numbers of channels that may be stuck, and their readings.

    A channel that is ``stuck`` repeats its reading. Where that is ``fresh``, the reading is first
    replaced by the present number.
    """
    reading = xp.where(fresh, numbers, reading)
    return xp.where(stuck, reading, numbers), reading


def drop(xp: Any, numbers: Array, dropped: Array) -> Array:
    """Return numbers, 0 where they are dropped."""
    return xp.where(dropped, 0.0, numbers)


def actuate(
    clip: Callable[[Array], Array],
    commanded: Array,
    neutral: Any,
    scale: Array | None = None,
    gain: Array | None = None,
) -> Array:
    """Return what actuators do of what is commanded.

    They do the action times ``scale``, and ``gain`` times its distance from ``neutral``; None is 1.
    ``clip`` returns actions within their bounds.
    """
    done = clip(commanded)
    if scale is not None:
        done = clip(scale * done)
    if gain is None:
        return done
    centred = isinstance(neutral, float) and neutral == 0.0
    return clip(gain * done if centred else neutral + gain * (done - neutral))


def carry(
    library: Any,
    now: Columns,
    state: State,
    numbers: Array,
    count: Array | None,
    clock: Any,
    first: Any = None,
    mask: Array | None = None,
) -> tuple[Array, State]:
    """Return what late and slow channels deliver of a step's numbers, and their state.

    ``library`` is an ``ArrayLibrary``; ``count``, ``clock`` and ``first`` are as of :func:`delay`.
    Where nothing is late or slow, ``count`` may be None.
    With a ``mask`` (B, 1), only its robots have this step; rows of others mean nothing.
    """
    xp = library.xp
    state = dict(state)
    if "hold" in now:
        since = count - state["began"]
        numbers, kept = hold(xp, numbers, now["hold"], since, state["kept"])
        state["kept"] = _under(xp, mask, kept, state["kept"])
    if "past" in state:
        past = state["past"]
        slot = clock % len(past)
        written = numbers if mask is None else xp.where(mask, numbers, past[slot])
        state["past"] = past = library.put_at(past, slot, written)
        if "delay" in now:
            numbers = delay(xp, past, now["delay"], count, clock, state["cells"], first)
    return numbers, state


def sense(
    library: Any,
    now: Columns,
    state: State,
    truth: Array,
    white: Array | None,
    count: Array | None,
    clock: Any,
    mask: Array | None = None,
) -> tuple[Array, State]:
    """Return what sensors make of true numbers before they saturate, and their state.

    ``white`` are standard normal numbers, where a sensor has noise; the others are as of
    :func:`carry`.
    """
    xp = library.xp
    numbers = misread(xp, now, truth, white)
    numbers, state = carry(library, now, state, numbers, count, clock, mask=mask)
    if "stuck" in now:
        fresh = state["fresh"]
        numbers, reading = stick(xp, numbers, now["stuck"], fresh, state["reading"])
        state["reading"] = _under(xp, mask, reading, state["reading"])
        state["fresh"] = xp.zeros_like(fresh) if mask is None else fresh & ~mask
    if "dropped" in now:
        numbers = drop(xp, numbers, now["dropped"])
    return numbers, state


def misread(xp: Any, now: Columns, truth: Array, white: Array | None) -> Array:
    """Return true numbers scaled, biased and with noise."""
    numbers = truth
    if "scale" in now:
        numbers = scale(xp, numbers, now["scale"])
    if "bias" in now:
        numbers = bias(xp, numbers, now["bias"])
    if "noise" in now and white is not None:
        numbers = noise(xp, numbers, now["noise"], white)
    return numbers


def change(
    xp: Any,
    state: State,
    before: Columns,
    now: Columns,
    count: Array | None,
    begins: Array | None = None,
) -> State:
    """Return the state of channels at a step from which on other faults hold.

    ``before`` and ``now`` are what is broken; the robots of the mask ``begins`` (B, 1) begin an
    episode.
    """
    state = dict(state)
    if "stuck" in now:
        stood = before.get("stuck")
        if stood is not None and begins is not None:
            stood = stood & ~begins
        state["fresh"] = now["stuck"] if stood is None else now["stuck"] & ~stood
    if "seized" in now:  # from now on, it does what it did last
        stood = before.get("seized")
        fresh = now["seized"] if stood is None else now["seized"] & ~stood
        state["last"] = xp.where(fresh, state["done"], state["last"])
    if "hold" in now:
        fresh = now["hold"] != before.get("hold", 0.0)
        if begins is not None:
            fresh = fresh | begins
        state["began"] = xp.where(fresh, count, state["began"])
    return state


def _as(xp: Any, found: Array, numbers: Array) -> Array:
    """Return numbers in the precision of others."""
    return found if found.dtype == numbers.dtype else xp.asarray(found, dtype=numbers.dtype)


def _under(xp: Any, mask: Array | None, new: Array, old: Array) -> Array:
    return new if mask is None else xp.where(mask, new, old)
