"""A robot's session in a file: what it executed and what its IMU logged."""

from __future__ import annotations

import os
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from aquafish_gym.command import check_commands
from aquafish_gym.runs.arrays import read_arrays, write_arrays
from aquafish_gym.runs.storage import DamagedFileError
from eea.core.angles import Floats
from eea.core.behavior import Log
from eea.core.checks import ConfigurationError
from eea.core.replay import RecordedLog, ReplayTarget

SIGNALS = ("gyro", "rpy")


def save_session(path: str | os.PathLike[str], commands: ArrayLike, logs: Sequence[Log]) -> None:
    """Write what ``estimate_from_logs`` takes into an ``.npz`` file, at once or not at all.

    The logs, of one trial each and all of one length, hold ``gyro``, ``rpy`` or both.

    Raises
    ------
    ConfigurationError
        If commands and logs are not equally many, or the logs not equally long.
    InvalidArgumentError
        If a command is none of the fish's.
    """
    arrays = {"commands": check_commands(commands)}
    ReplayTarget(arrays["commands"], logs)  # refuses what could not be replayed
    for name in SIGNALS:
        found = [getattr(log, name, None) for log in logs]
        trials = [np.asarray(one, dtype=np.float64) for one in found if one is not None]
        trials = [one[0] if one.ndim == 3 and len(one) == 1 else one for one in trials]
        shapes = {one.shape for one in trials}
        if trials and (len(shapes) != 1 or len(trials) != len(logs) or trials[0].ndim != 2):
            raise ConfigurationError(
                f"logs must hold {name} of one trial each, all of one shape (T, axes), or none; "
                f"got {len(trials)} of {len(logs)}, of shapes {sorted(shapes)}"
            )
        arrays[name] = np.stack(trials) if trials else np.empty((len(logs), 0, 0))
    write_arrays(path, arrays)


def load_session(path: str | os.PathLike[str]) -> tuple[Floats, list[RecordedLog]]:
    """Return the commands (E, 3) and the E logs that ``save_session`` wrote.

    Raises
    ------
    InvalidArgumentError
        If the file cannot be read, is damaged or holds something else; the message names it.
    """
    shapes = {"commands": (None, 3)} | dict.fromkeys(SIGNALS, (None, None, None))
    arrays = read_arrays(path, shapes, "session")
    commands = check_commands(arrays["commands"])
    if {len(array) for array in arrays.values()} != {len(commands)}:
        raise DamagedFileError(f"session: {path} must hold a log for each command")
    signals = {n: arrays[n] if arrays[n].shape[1] else [None] * len(commands) for n in SIGNALS}
    return commands, [
        RecordedLog(gyro, rpy) for gyro, rpy in zip(signals["gyro"], signals["rpy"], strict=True)
    ]
