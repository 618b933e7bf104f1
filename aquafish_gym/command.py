"""Commands: three servo speeds (Sec. 3.1), the actions that they are scaled from, how late servos
follow them, and where the fins are once they are obeyed."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.physics.arithmetic import Number, Vector, floor, where_less
from aquafish_gym.utils.validation import InvalidArgumentError, finite_array

SERVOS: tuple[str, ...] = ("left_pectoral", "right_pectoral", "caudal")

# Pectorals turn at [-0.5, 0.5] rev/s; the caudal fin sweeps +-30 degrees at [0, 1] Hz.
COMMAND_LOW: NDArray[np.float64] = np.array([-0.5, -0.5, 0.0])
COMMAND_LOW.setflags(write=False)
COMMAND_HIGH: NDArray[np.float64] = np.array([0.5, 0.5, 1.0])
COMMAND_HIGH.setflags(write=False)

# Tuples, which compiled code can read.
_LOW = tuple(float(v) for v in COMMAND_LOW)
_SPAN = tuple(float(v) for v in COMMAND_HIGH - COMMAND_LOW)
_MIDDLE = tuple(float(v) for v in (COMMAND_LOW + COMMAND_HIGH) / 2)
_REACH = tuple(float(v) for v in (COMMAND_HIGH - COMMAND_LOW) / 2)


def check_commands(commands: ArrayLike, argument: str = "commands") -> NDArray[np.float64]:
    """Return commands as a (B, 3) array in rev/s, rev/s and Hz; one may be given as (3,)."""
    return finite_array(
        argument, commands, (None, 3), COMMAND_LOW, COMMAND_HIGH, "rev/s or Hz", flat=True
    )


def check_series(commands: ArrayLike, argument: str = "commands") -> NDArray[np.float64]:
    """Return commands (B, 3), as :func:`check_commands` does, or series of them, (B, K, 3)."""
    try:
        series = np.ndim(commands) == 3
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


def servo_speeds(action: Vector) -> Vector:
    """Return the command, rev/s, rev/s and Hz, of an action in [-1, 1]: floats or rows (B,)."""
    left, right, caudal = action
    return (
        _LOW[0] + 0.5 * (left + 1.0) * _SPAN[0],
        _LOW[1] + 0.5 * (right + 1.0) * _SPAN[1],
        _LOW[2] + 0.5 * (caudal + 1.0) * _SPAN[2],
    )


def lane_servo_speeds(action: Vector) -> Vector:
    """Return :func:`servo_speeds` in one multiplication and one addition a servo.

    The compiled loop uses this form. The two differ by rounding, and committed results hold for
    each of them to the bit.
    """
    return (
        _MIDDLE[0] + _REACH[0] * action[0],
        _MIDDLE[1] + _REACH[1] * action[1],
        _MIDDLE[2] + _REACH[2] * action[2],
    )


def scale_action(action: ArrayLike) -> NDArray[np.float64]:
    """Map actions, clipped to [-1, 1], shape (..., 3), to servo commands in rev/s, rev/s, Hz."""
    clipped = np.clip(np.asarray(action, dtype=np.float64), -1.0, 1.0)
    return np.stack(servo_speeds(tuple(np.moveaxis(clipped, -1, 0))), axis=-1)


def lag_parts(lag: Number) -> tuple[Number, Number]:
    """Return the full steps of a lag, in steps, and the share of a step's newer command.

    In each step a late servo first follows the older of two consecutive commands, and then the
    newer one, which was given those steps before.
    """
    steps = floor(lag)
    return steps, steps + 1.0 - lag


def late_command(older: Vector, newer: Vector, share: Number) -> Vector:
    """Return the command that late servos follow in a step: its mean over the step.

    So a servo's speed is constant within a step, and its angle is continuous in the lag.
    """
    return (
        _mean(older[0], newer[0], share),
        _mean(older[1], newer[1], share),
        _mean(older[2], newer[2], share),
    )


def _mean(older: Number, newer: Number, share: Number) -> Number:
    mean = share * newer + (1.0 - share) * older
    # Exact where both are one: the mean would be rounded.
    return where_less(older, newer, mean, where_less(newer, older, mean, newer))


def reckon(angles: Vector, speeds: Vector, turn: Number) -> Vector:
    """Return fin angles after servos turned at ``speeds``: dead reckoning from the command.

    ``turn`` is the angle per unit of speed: the time in s for angles in turns, 2 pi times the time
    for angles in rad. The speeds are gain times command, so a wrong belief about a gain shows here.
    """
    return (
        angles[0] + turn * speeds[0],
        angles[1] + turn * speeds[1],
        angles[2] + turn * speeds[2],
    )
