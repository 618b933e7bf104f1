"""What each word about a part of the fish changes in rows of a table of robots.

The columns are the fields of a :class:`~aquafish_gym.scenario.Scenario`. Everything is in place.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.damage.words import parts_of
from aquafish_gym.plans import BodyPlan
from aquafish_gym.plans.plan import SIZES
from aquafish_gym.scenario import CHANNELS, GYRO_CHANNELS
from aquafish_gym.utils.array_types import Floats
from aquafish_gym.utils.validation import InvalidArgumentError, one_of

Columns = Mapping[str, NDArray[Any]]

LARGEST_SCALE_PRODUCT = 1e200  # of the scales of a channel; its product with a reading is finite
#: What each word about a fin's servo does to its channel. The engine's servos have a gain alone.
_SERVO_WORDS = {
    "weak": "weak", "scale": "weak", "reversed": "reversed", "seized": "dead", "dead": "dead",
    "delay": "delay", "hold": "hold",
}  # fmt: skip


@functools.cache
def _columns_of(plan: BodyPlan) -> dict[tuple[str, str], int]:
    """Return the column of each size of each fin."""
    return {(d.fin, d.size): i for i, d in enumerate(plan.dimensions)}


def break_part(
    plan: BodyPlan, columns: Columns, rows: Any, part: str, word: str, number: ArrayLike
) -> None:
    """Break a part of the robots in some rows, in place.

    Parameters
    ----------
    plan
        Of the robots.
    columns
        (R, ...) by the names of a scenario's fields: all that the word changes.
    rows
        An index or a slice.
    part, word
        Of ``parts_of(plan)``.
    number
        One for all rows, or one for each. Words without a number ignore it.

    Raises
    ------
    InvalidArgumentError, UnknownNameError
        If a size would exceed its maximum, or the plan has no such part.
    """
    one_of("damage part", part, parts_of(plan))
    if part in plan.names:
        _break_fin(plan, columns, rows, part, word, number)
    elif word == "noise":
        noise = columns["gyro_noise"]
        noise[rows] = np.hypot(noise[rows], number)
    elif part == "gyro":
        break_channels(columns, "sensor", rows, GYRO_CHANNELS, word, number)
    else:
        break_channels(columns, "sensor", rows, _only(CHANNELS.index(part)), word, number)


def _break_fin(
    plan: BodyPlan, columns: Columns, rows: Any, part: str, word: str, number: ArrayLike
) -> None:
    if word in _SERVO_WORDS:
        servo = _only(plan.names.index(part))
        break_channels(columns, "servo", rows, servo, _SERVO_WORDS[word], number)
    else:
        break_sizes(plan, columns["body"], rows, part, word, number)


def _only(channel: int) -> slice:
    return slice(channel, channel + 1)


def break_sizes(
    plan: BodyPlan, body: Floats, rows: Any, part: str, word: str, number: ArrayLike
) -> None:
    """Break the sizes of a fin of bodies (R, S), in place; other words than of sizes do nothing.

    InvalidArgumentError if a size would exceed its maximum.
    """
    columns = _columns_of(plan)
    match word:
        case "missing":
            for size in SIZES:
                body[rows, columns[part, size]] = 0.0
        case "entangled":
            column = columns[part, "width"]
            width = body[rows, column]
            body[rows, column] = width + number * (plan.dimensions[column].maximum - width)
        case _ if word in SIZES:
            column = columns[part, word]
            dimension = plan.dimensions[column]
            with np.errstate(over="ignore"):
                sizes = body[rows, column] * number
            largest = sizes.max(initial=0.0)
            if largest > dimension.maximum:  # to clip it would be another fault than was asked for
                raise InvalidArgumentError(
                    f"damage {part}:{word}={np.max(number)} would make {dimension.name} "
                    f"{largest:g}; it must lie in [0, {dimension.maximum:g}]"
                )
            body[rows, column] = sizes


def break_channels(
    columns: Columns, side: str, rows: Any, channels: slice, word: str, number: ArrayLike
) -> None:
    """Break some channels of a side, of sensors or actuators, in some rows, in place.

    Columns are named by the side and what they hold, such as "sensor_bias". Delays and biases add
    up, scales and gains multiply, and the longest hold counts. A seized actuator latches at its
    number, unless that is NaN.

    Raises
    ------
    InvalidArgumentError
        If the word is none about a channel.
    """
    number = np.reshape(number, (-1, 1))
    column = columns.get(f"{side}_{column_of(word)}")
    if column is None:
        raise InvalidArgumentError(f"word must be one about a channel of {side}; got {word!r}")
    now = column[rows, channels]
    match word:
        case "weak":
            found = now * number
        case "scale":
            found = np.clip(now * number, -LARGEST_SCALE_PRODUCT, LARGEST_SCALE_PRODUCT)
        case "reversed":
            found = -now
        case "dead":
            found = np.zeros_like(now)
        case "bias" | "delay":
            found = now + number
        case "noise":
            found = np.hypot(now, number)
        case "hold":
            found = np.maximum(now, number)
        case _:
            found = np.ones_like(now)
    column[rows, channels] = found
    if word == "seized":
        latched = columns[f"{side}_latched"]
        latched[rows, channels] = np.where(np.isnan(number), latched[rows, channels], number)


def column_of(word: str) -> str:
    """Return the name of the column that a word about a channel changes, without its side."""
    return "gain" if word in ("weak", "reversed", "dead") else word
