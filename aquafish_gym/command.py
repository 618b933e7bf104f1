"""Commands: a speed for each servo (Sec. 3.1), the actions that they are scaled from, how late
servos follow them, and where the fins are once they are obeyed."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.physics.arithmetic import Number, floor, where_less
from aquafish_gym.physics.kinematics import Numbers
from aquafish_gym.physics.printing import straight_line
from aquafish_gym.plans import BodyPlan
from aquafish_gym.utils.validation import InvalidArgumentError, finite_array


def check_commands(
    plan: BodyPlan, commands: ArrayLike, argument: str = "commands"
) -> NDArray[np.float64]:
    """Return commands as a (B, F) array in rev/s or Hz; one may be given as (F,)."""
    shape = (None, len(plan.fins))
    return finite_array(
        argument, commands, shape, plan.command_low, plan.command_high, "rev/s or Hz", flat=True
    )


def check_series(
    plan: BodyPlan, commands: ArrayLike, argument: str = "commands"
) -> NDArray[np.float64]:
    """Return commands (B, F), as :func:`check_commands` does, or series of them, (B, K, F)."""
    try:
        series = np.ndim(commands) == 3
    except ValueError:  # ragged; the check says so better
        series = False
    if not series:
        return check_commands(plan, commands, argument)
    shape = (None, None, len(plan.fins))
    checked = finite_array(
        argument, commands, shape, plan.command_low, plan.command_high, "rev/s or Hz"
    )
    if not checked.shape[1]:
        raise InvalidArgumentError(
            f"{argument} must hold a command at least; got shape {checked.shape}"
        )
    return checked


def servo_speeds(plan: BodyPlan, action: Sequence[Number]) -> Numbers:
    """Return the command, rev/s or Hz, of an action in [-1, 1]: floats or rows (B,)."""
    ranges = zip(action, plan.command_low.tolist(), plan.command_high.tolist(), strict=True)
    return tuple(low + 0.5 * (x + 1.0) * (high - low) for x, low, high in ranges)


def lane_servo_speeds(plan: BodyPlan, action: Sequence[Number]) -> Numbers:
    """Return :func:`servo_speeds` in one multiplication and one addition a servo.

    The compiled loop uses this form. The two differ by rounding, and committed results hold for
    each of them to the bit.
    """
    ranges = zip(action, plan.command_low.tolist(), plan.command_high.tolist(), strict=True)
    return tuple((low + high) / 2 + (high - low) / 2 * x for x, low, high in ranges)


def scale_action(plan: BodyPlan, action: ArrayLike) -> NDArray[np.float64]:
    """Map actions, clipped to [-1, 1], shape (..., F), to servo commands in rev/s or Hz."""
    clipped = np.clip(np.asarray(action, dtype=np.float64), -1.0, 1.0)
    return np.stack(servo_speeds(plan, tuple(np.moveaxis(clipped, -1, 0))), axis=-1)


@functools.cache
def still_action(plan: BodyPlan) -> tuple[float, ...]:
    """Return the action at which all servos stand: 0, or -1 where a servo has one direction."""
    return tuple(0.0 if fin.turns else -1.0 for fin in plan.fins)


def lag_parts(lag: Number) -> tuple[Number, Number]:
    """Return the full steps of a lag, in steps, and the share of a step's newer command.

    In each step a late servo first follows the older of two consecutive commands, and then the
    newer one, which was given those steps before.
    """
    steps = floor(lag)
    return steps, steps + 1.0 - lag


def late_command(older: Numbers, newer: Numbers, share: Number) -> Numbers:
    """Return the command that late servos follow in a step: its mean over the step.

    So a servo's speed is constant within a step, and its angle is continuous in the lag.
    """
    return tuple(_mean(a, b, share) for a, b in zip(older, newer, strict=True))


def _mean(older: Number, newer: Number, share: Number) -> Number:
    mean = share * newer + (1.0 - share) * older
    # Exact where both are one: the mean would be rounded.
    return where_less(older, newer, mean, where_less(newer, older, mean, newer))


def reckon(angles: Numbers, speeds: Numbers, turn: Number) -> Numbers:
    """Return fin angles after servos turned at ``speeds``: dead reckoning from the command.

    ``turn`` is the angle per unit of speed: the time in s for angles in turns, 2 pi times the time
    for angles in rad. The speeds are gain times command, so a wrong belief about a gain shows here.
    """
    return tuple(angle + turn * speed for angle, speed in zip(angles, speeds, strict=True))


class Servos(NamedTuple):
    """This module's functions for the servos of one plan, which compiled code can call.

    ``reckon`` takes the servos' gains and the command in place of their speeds.
    """

    speeds: Callable[[Numbers], Numbers]
    lane_speeds: Callable[[Numbers], Numbers]
    late_command: Callable[[Numbers, Numbers, Number], Numbers]
    reckon: Callable[[Numbers, Numbers, Numbers, Number], Numbers]


@functools.cache
def servos(plan: BodyPlan) -> Servos:
    """Return the servos of a plan."""
    fins = (0.0,) * len(plan.fins)

    def reckoned(angles: Numbers, gain: Numbers, command: Numbers, turn: Number) -> Numbers:
        return reckon(angles, tuple(a * b for a, b in zip(gain, command, strict=True)), turn)

    return Servos(
        straight_line("servo_speeds", functools.partial(servo_speeds, plan), fins),
        straight_line("lane_servo_speeds", functools.partial(lane_servo_speeds, plan), fins),
        straight_line("late_command", late_command, fins, fins, 0.0),
        straight_line("reckon", reckoned, fins, fins, fins, 0.0),
    )
