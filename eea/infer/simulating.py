"""Calls of a robot's simulator: counted, within a budget, and past candidates that fail."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eea.core.checks import ConfigurationError, as_array, brief, masked
from eea.core.floating import callers_errors
from eea.infer.statement import RobotModel, Values

SILENT_SECONDS = 4.0  # of a search, after which its progress is said again
SILENT_SIMULATIONS = 100  # and a tenth of all so far
SLOW_SECONDS = 0.01  # a simulation: how long one takes is said
NOTED_NUMBERS = 20  # of a candidate that raised


class OutOfBudgetError(Exception):
    """The budget of simulations or of seconds has ended."""


class OneByOne:
    """A simulator of batches that calls a simulator of one trial for each; see `one_by_one`."""

    def __init__(self, simulate: Callable[[Mapping[str, float], Any], Any]) -> None:
        if not callable(simulate):
            raise ConfigurationError(f"simulate must be a function; got {brief(simulate)}")
        self._simulate = simulate
        self.failed = 0  #: Trials for which it raised an exception.
        self.first_failure = ""

    def __call__(self, values: Values, inputs: Any) -> NDArray[Any]:
        """Return the signal (B, T, channels) of B trials, NaN where the simulator raised."""
        count = len(next(iter(values.values())))
        signals: dict[int, NDArray[Any]] = {}
        shapes: set[tuple[int, ...]] = set()
        failures: list[tuple[int, Exception]] = []
        for b in range(count):
            own = {name: float(value[b]) for name, value in values.items()}
            try:
                signal = as_array(self._simulate(own, None if inputs is None else inputs[b]))
            except Exception as error:
                failures.append((b, error))
                continue
            shapes.add(signal.shape)
            if signal.ndim != 2 or len(shapes) > 1:
                raise ConfigurationError(
                    "simulate must return the signal (T, channels) of one trial, the same for the "
                    f"same inputs; it returned {signal.dtype} of shape "
                    f"{' and '.join(map(str, sorted(shapes)))}"
                )
            signals[b] = signal
        if failures:
            self._note(values, *failures[0], len(failures), bool(signals))
        whole = np.full((count, *shapes.pop()), np.nan)
        for b, signal in signals.items():
            whole[b] = signal
        return whole

    def _note(self, values: Values, first: int, why: Exception, count: int, others: bool) -> None:
        """Remember trials that failed; raise the first failure where there is no other trial."""
        if not others:  # perhaps a mistake of the simulator's
            why.add_note(_of_each(values, first))
            raise why
        self.failed += count
        self.first_failure = self.first_failure or _described(values, first, why)


def one_by_one(simulate: Callable[[Mapping[str, float], Any], Any]) -> OneByOne:
    """Return a simulator of batches that calls a simulator of one trial for each.

    Parameters
    ----------
    simulate
        Takes the values by name, as floats, and the inputs of one trial; returns its signal
        (T, channels). Where it raises an exception, the trial cannot be simulated: it is left out,
        and the answer says so.

    Raises
    ------
    ConfigurationError
        If ``simulate`` is not callable; and when called, if trials of the same inputs have signals
        of other shapes.

    Examples
    --------
    >>> def fall(values, times):
    ...     return (values["height"] - 4.9 * times**2)[:, None]
    >>> one_by_one(fall)({"height": np.array([10.0, 20.0])}, np.zeros((2, 3))).shape
    (2, 3, 1)
    """
    return OneByOne(simulate)


class Simulations:
    """A robot's simulator as a fit calls it.

    It counts simulated trials, says every few seconds that the search goes on, ends at a budget,
    and leaves out candidates for which the simulator raises an exception.

    Parameters
    ----------
    robot
        The robot.
    progress
        Called with the present step in words.
    evaluations, seconds
        The budget; None for no end.
    interruptible
        Whether Ctrl-C ends the search as a budget does, rather than the program.
    """

    def __init__(
        self,
        robot: RobotModel,
        progress: Callable[[str], None] | None = None,
        evaluations: int | None = None,
        seconds: float | None = None,
        interruptible: bool = False,
    ) -> None:
        if isinstance(robot.simulate, Simulations):  # of an earlier fit
            robot = robot.simulate.robot
        self.robot: RobotModel = robot
        self.counting = True  #: Whether a fit goes on.
        #: Whether a search goes on, which a budget may end; to weigh what it found takes some more.
        self.searching = False
        self._progress = progress
        self._most = math.inf if evaluations is None else evaluations
        self._until = math.inf if seconds is None else time.monotonic() + seconds
        self.interruptible = interruptible
        self._doing = "fitting"
        self._said = time.monotonic()
        self._said_at = 0
        self._seconds = 0.0
        self.count = 0  #: Trials that were simulated.
        self.ended = ""  #: Why the search has ended before its time; then nothing is refused.
        self._failed = 0
        self._first_failure = ""
        simulate = robot.simulate
        self._alone = simulate if isinstance(simulate, OneByOne) else None
        self._before = self._alone.failed if self._alone else 0

    def begin(self, hypothesis: str) -> None:
        """Say what is fitted from now on."""
        self._doing = hypothesis
        self.searching = True
        self._say(hypothesis)

    def end(self, why: str) -> None:
        """End the search: what is simulated from now on is for the answer so far."""
        self.ended = self.ended or why

    def release(self) -> None:
        """Let what is asked of the answer simulate without a budget."""
        self.counting = False
        self._most = math.inf
        self._until = math.inf
        self._progress = None

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences on candidates that could not be simulated."""
        alone = self._alone.failed - self._before if self._alone else 0
        failed = self._failed + alone
        if not failed:
            return ()
        first = self._first_failure or (self._alone.first_failure if self._alone else "")
        return (
            f"simulate raised for {failed} of {self.count} candidates, which were left out; first "
            f"{first}",
        )

    def __call__(self, values: Values, inputs: Any, fine: bool = True) -> NDArray[Any]:
        """Return the signal (B, T, channels) of B trials; NaN of one for which it raised."""
        count = len(next(iter(values.values())))
        if self.searching and not self.ended:
            self._check_budget(count)
        self._report()
        began = time.monotonic()
        try:
            signal = self.robot.signal(values, inputs, fine)
        except Exception as error:
            signal = self._without_failures(values, inputs, fine, error)
        self._seconds += time.monotonic() - began
        self.count += count
        return signal

    def _check_budget(self, count: int) -> None:
        if self.count + count > self._most:
            raise OutOfBudgetError(f"the budget of {self._most} simulations")
        if time.monotonic() > self._until:
            raise OutOfBudgetError("the budget of seconds")

    def _report(self) -> None:
        new = self.count - self._said_at
        late = time.monotonic() - self._said > SILENT_SECONDS
        if new and (late or new >= max(SILENT_SIMULATIONS, 0.1 * self.count)):
            of = "" if math.isinf(self._most) else f" of {self._most}"
            each = self._seconds / self.count
            pace = f", {each:.2g} s each" if each > SLOW_SECONDS else ""
            self._say(f"{self._doing}, {self.count}{of} simulations{pace}")

    def _say(self, words: str) -> None:
        self._said = time.monotonic()
        self._said_at = self.count
        if self._progress is not None:
            self._progress(words)

    def _without_failures(
        self, values: Values, inputs: Any, fine: bool, error: Exception
    ) -> NDArray[Any]:
        """Return the signal of a batch that raised, with NaN for the trials that do so alone."""
        count = len(next(iter(values.values())))
        found: list[tuple[NDArray[np.intp], NDArray[Any]]] = []
        failed: list[tuple[int, Exception]] = []
        self._in_halves(values, inputs, fine, np.arange(count), found, failed)
        if not failed or (not found and self._takes_one(values, inputs, fine)):
            raise ConfigurationError(
                f"simulate must take a batch: it raised {type(error).__name__} ({error}) for "
                f"{count} trials at once, and not for one alone. Where it takes one trial, wrap "
                "it: one_by_one(simulate)"
            ) from error
        first, why = failed[0]
        if not found:
            error.add_note(_of_each(values, first))
            raise error
        shape = np.shape(found[0][1])
        signal = np.full((count, *shape[1:]), np.nan, np.result_type(found[0][1], np.float32))
        for rows, some in found:
            signal[rows] = np.ma.filled(some, np.nan) if masked(some) else some
        self._failed += len(failed)
        self._first_failure = self._first_failure or _described(values, first, why)
        return signal

    def _takes_one(self, values: Values, inputs: Any, fine: bool) -> bool:
        """Return whether the simulator takes the values of one trial, as numbers."""
        own: Any = {name: float(value[0]) for name, value in values.items()}
        try:
            signal = self.robot.signal(own, None if inputs is None else inputs[0], fine)
        except Exception:
            return False
        return np.ndim(signal) == 2

    def _in_halves(
        self,
        values: Values,
        inputs: Any,
        fine: bool,
        rows: NDArray[np.intp],
        found: list[tuple[NDArray[np.intp], NDArray[Any]]],
        failed: list[tuple[int, Exception]],
    ) -> None:
        """Simulate rows in ever smaller parts, until those that raise are alone."""
        for part in np.array_split(rows, min(2, len(rows))):
            own = {name: value[part] for name, value in values.items()}
            given = None if inputs is None else inputs[part]
            try:
                found.append((part, self.robot.signal(own, given, fine)))
            except Exception as error:
                if len(part) == 1:
                    failed.append((int(part[0]), error))
                else:
                    self._in_halves(values, inputs, fine, part, found, failed)


def _described(values: Values, row: int, why: Exception) -> str:
    """Return a failure in words, with the values of the candidate."""
    return f"{type(why).__name__} ({why}) at {_numbers(values, row)}"


def _of_each(values: Values, first: int) -> str:
    """Return a note on a batch of which no candidate could be simulated."""
    count = len(next(iter(values.values())))
    return (
        f"simulate raised this for each of {count} trials; first at {_numbers(values, first)}; "
        "return NaN for a trial that cannot be simulated"
    )


def _numbers(values: Values, row: int) -> str:
    """Return the values of one candidate in words."""
    said = [f"{name} {float(v[row]):.6g}" for name, v in islice(values.items(), NOTED_NUMBERS)]
    return ", ".join(said) + (", ..." if len(values) > NOTED_NUMBERS else "")


def simulated(
    robot: RobotModel, values: Values, inputs: Any, fine: bool, least: tuple[int, int]
) -> NDArray[Any]:
    """Return what a robot's simulator does, of at ``least`` (trials, samples).

    Raises
    ------
    ConfigurationError
        If its shape is not (trials, samples, channels), or its numbers are not real.
    """
    trials, samples = least
    with callers_errors():
        given = robot.signal(values, inputs, fine)
    signal = np.ma.filled(given, np.nan) if masked(given) else as_array(given)
    channels = len(robot.channels)
    sound = signal.dtype.kind in "fiu" and signal.ndim == 3
    if not (sound and signal[:, :samples].shape == (trials, samples, channels)):
        raise ConfigurationError(
            "simulate must return numbers of shape (trials, samples, channels) = "
            f"({trials}, {samples} or more, {channels}); it returned {signal.dtype} of shape "
            f"{signal.shape}" + ("" if trials == 1 else _for_one(signal, samples, channels))
        )
    return signal


def _for_one(signal: NDArray[Any], samples: int, channels: int) -> str:
    """Return the way out where a signal is that of one trial."""
    one = signal.ndim == 2 and len(signal) >= samples and signal.shape[1] == channels
    return ": where it takes one trial, wrap it: one_by_one(simulate)" if one else ""
