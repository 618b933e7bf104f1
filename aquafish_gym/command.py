"""What the robot is told: three servo speeds, held for the whole trial (Sec. 3.1)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.utils.validation import InvalidArgumentError, finite_array

SERVOS: tuple[str, ...] = ("left_pectoral", "right_pectoral", "caudal")

# Pectorals turn at [-0.5, 0.5] rev/s; the caudal fin sweeps +-30 degrees at [0, 1] Hz.
COMMAND_LOW: NDArray[np.float64] = np.array([-0.5, -0.5, 0.0])
COMMAND_LOW.setflags(write=False)
COMMAND_HIGH: NDArray[np.float64] = np.array([0.5, 0.5, 1.0])
COMMAND_HIGH.setflags(write=False)


def check_commands(commands: ArrayLike, argument: str = "commands") -> NDArray[np.float64]:
    """Return commands as a (B, 3) array in rev/s, rev/s and Hz; one may be given as (3,)."""
    return finite_array(
        argument, commands, (None, 3), COMMAND_LOW, COMMAND_HIGH, "rev/s or Hz", flat=True
    )


def check_series(commands: ArrayLike, argument: str = "commands") -> NDArray[np.float64]:
    """Return commands (B, 3), as :func:`check_commands` does, or series of them, (B, K, 3)."""
    try:  # as objects, since numpy warns of a masked number that it makes a float
        told = commands if hasattr(commands, "ndim") else np.asarray(commands, dtype=object)
        series = np.ndim(told) == 3
    except ValueError:  # ragged; the check says so better
        series = False
    if not series:
        return check_commands(commands, argument)
    checked = finite_array(
        argument, commands, (None, None, 3), COMMAND_LOW, COMMAND_HIGH, "rev/s or Hz"
    )
    if not checked.shape[1]:
        raise InvalidArgumentError(
            f"{argument} must hold a command at least; got shape {checked.shape}"
        )
    return checked


def scale_action(action: NDArray[np.floating]) -> NDArray[np.float64]:
    """Map actions in [-1, 1], shape (..., 3), to servo commands in rev/s, rev/s, Hz."""
    unit = 0.5 * (np.clip(np.asarray(action, dtype=np.float64), -1.0, 1.0) + 1.0)
    return COMMAND_LOW + unit * (COMMAND_HIGH - COMMAND_LOW)
