"""A recorded session of a robot as a target: its trials are replayed one by one."""

from __future__ import annotations

from collections.abc import Sequence

from numpy.typing import ArrayLike

from eea.core.angles import Floats
from eea.core.behavior import Log
from eea.core.checks import ConfigurationError, TargetError, finite
from eea.core.experiment import Performed


class ReplayTarget:
    """A target that replays a robot's trials, whatever command is requested.

    Parameters
    ----------
    commands
        Shape (E, c): what the robot executed.
    logs
        One of each trial.

    Raises
    ------
    ConfigurationError
        If commands and logs are not equally many, or there is none.

    Examples
    --------
    >>> import numpy as np
    >>> from eea.core.experiment import RecordedLog
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

    def perform(self, command: Floats) -> Performed:  # noqa: ARG002
        """Return the next log with its command; raise ``TargetError`` after the last."""
        if self._next == len(self):
            raise TargetError(
                f"the recorded session holds {len(self)} trials, and all have been replayed; "
                f"config.rounds must be at most {len(self)}"
            )
        self._next += 1
        return Performed(self._logs[self._next - 1], self._commands[self._next - 1])
