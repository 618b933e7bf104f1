"""A recorded session of a robot as a target: what it did is told again, command by command."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from numpy.typing import ArrayLike, NDArray

from eea.core.angles import Floats
from eea.core.behavior import Log
from eea.core.checks import ConfigurationError, TargetError, finite
from eea.core.experiment import Performed


@dataclass(frozen=True)
class RecordedLog:
    """The plainest log: samples of one or both signals.

    Examples
    --------
    >>> import numpy as np
    >>> RecordedLog(gyro=np.zeros((256, 3))).rpy is None
    True
    """

    #: Angular velocity about the body's axes in rad/s, shape (T, axes), or (B, T, axes).
    gyro: NDArray[Any] | None = None
    rpy: NDArray[Any] | None = None  #: The attitude's angles in rad, unwrapped, of such a shape.


class ReplayTarget:
    """A target that repeats what a robot did, whatever it is asked for, and says so.

    It takes the commands (E, c) that the robot executed and their logs, of one trial each; other
    numbers of them raise ``ConfigurationError``.

    Examples
    --------
    >>> import numpy as np
    >>> target = ReplayTarget([[0.1], [0.2]], [RecordedLog(np.zeros((64, 1)))] * 2)
    >>> len(target), target.perform(np.array([0.9])).command
    (2, array([0.1]))
    """

    def __init__(self, commands: ArrayLike, logs: Sequence[Log]) -> None:
        self._commands = finite("commands", commands, (None, None))
        if not isinstance(logs, Sequence):
            raise ConfigurationError(
                f"logs must be a sequence of logs, of one trial each; got a {type(logs).__name__}"
            )
        self._logs = list(logs)
        if len(self._commands) != len(self._logs) or not self._logs:
            raise ConfigurationError(
                "commands and logs must be equally many, and at least one; "
                f"got {len(self._commands)} and {len(self._logs)}"
            )
        self._next = 0

    def __len__(self) -> int:
        return len(self._logs)

    def perform(self, command: Floats) -> Performed:  # noqa: ARG002 - the past cannot be asked
        """Return the session's next log, with the command that it is of; else ``TargetError``."""
        if self._next == len(self):
            raise TargetError(
                f"the recorded session holds {len(self)} trials, and all have been replayed; "
                f"config.rounds must be at most {len(self)}"
            )
        self._next += 1
        return Performed(self._logs[self._next - 1], self._commands[self._next - 1])
