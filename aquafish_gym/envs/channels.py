"""The action and observation channels of any robot, and the table of what is broken of them."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.spaces import Box, Space
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.damage.breaking import Columns, break_channels, column_of
from aquafish_gym.damage.damage import Damage
from aquafish_gym.damage.draws import Draws, make_stages, ways_to_break
from aquafish_gym.damage.faults import Fault, channels_of
from aquafish_gym.damage.tiers import TIERS
from aquafish_gym.damage.transmit import NEUTRAL, delay_steps
from aquafish_gym.damage.words import CHANNEL_WORDS, RANDOM
from aquafish_gym.stages import Stages
from aquafish_gym.utils.array_types import Floats
from aquafish_gym.utils.validation import InvalidArgumentError, brief, finite_array

SIDES = ("action", "observation")
_FLAGS = ("seized", "stuck", "dropped")


class Channels:
    """The entries of the spaces of a robot, and of which faults they may be broken.

    Channels are the entries of a space in C order: A of the action, C of the observation.

    Parameters
    ----------
    action, observation
        The spaces of one robot.
    dt
        The length of a step in s; None if it is unknown.
    last_step
        How many steps an episode has; None if it is unknown.
    neutral
        See ``FaultWrapper``.

    Attributes
    ----------
    bounds
        By the side, the lowest and the highest number of each channel.
    neutral
        (A,) the action at which actuators do nothing.
    parts
        What random faults break: each channel by itself.
    late
        Whether a channel of any damage may be late, slow or scaled.

    Raises
    ------
    InvalidArgumentError
        If a space is no ``Box`` of numbers, or ``neutral`` lies outside of its space.
    """

    def __init__(
        self,
        action: Space[Any],
        observation: Space[Any],
        dt: float | None = None,
        last_step: int | None = None,
        neutral: ArrayLike | None = None,
    ) -> None:
        self.action, self.observation = _box("action", action), _box("observation", observation)
        self._dt, self._last_step = dt, last_step
        self.bounds = {"action": _bounds(self.action), "observation": _bounds(self.observation)}
        self.neutral: Floats = np.clip(0.0, *self.bounds["action"])
        if neutral is not None:
            several = isinstance(neutral, list | tuple) or np.ndim(neutral)
            one = () if several else finite_array("neutral", neutral, ())
            each = neutral if several else np.full(self.action.shape, one)
            ends = self.action.low, self.action.high
            self.neutral = finite_array("neutral", each, self.action.shape, *ends).ravel()
        self.sizes = {side: len(low) for side, (low, _) in self.bounds.items()}
        self.parts = {
            f"{side}_{i}": CHANNEL_WORDS[side] for side, n in self.sizes.items() for i in range(n)
        }
        self.late = False

    @property
    def dt(self) -> float:
        """The length of a step in s; 1 if it is unknown."""
        return self._dt or 1.0

    def check(self, value: object, last_step: int | None = None) -> Damage:
        """Return what ``Damage.coerce`` does; InvalidArgumentError if these robots cannot have it.

        It may be of unknown channels, begin after the end, or have times where ``dt`` is unknown.
        ``last_step`` is the length of an episode of one robot, if it has its own.
        """
        damage = Damage.coerce(value)
        self.late = self.late or damage.may_be_late
        for fault in damage:
            self._check_part(fault)
            if self._dt is None and fault.is_timed:
                raise InvalidArgumentError(
                    f"damage {fault} is timed in s, and the environment does not say how long a "
                    "step is: give dt in s, or dt=1 to count in steps"
                )
        if self._dt is not None:
            damage.check_steps(self._dt)
            last = self._last_step if last_step is None else last_step
            if last is not None:
                damage.check_onsets(last * self._dt)
        return damage

    def _check_part(self, fault: Fault) -> None:
        if fault.part == RANDOM:
            if not ways_to_break(TIERS[fault.word], self.parts):
                raise InvalidArgumentError(f"damage {fault} fits no channel of this environment")
            return
        side, where = channels_of(fault.part) if fault.is_of_channels else ("", slice(0, 0))
        size = self.sizes.get(side, 0)
        if not 0 < (size if where == slice(None) else where.stop) <= size:
            known = [f"{side}, {side}_0 to {side}_{n - 1}" for side, n in self.sizes.items() if n]
            raise InvalidArgumentError(
                f"damage part must be one of {', '.join(known)} and {RANDOM} in this environment; "
                f"got {fault.part!r}"
            )
        if fault.word == "seized" and fault.number is not None:
            low, high = (ends[where] for ends in self.bounds["action"])
            command = np.full(low.shape, fault.number)
            finite_array(f"damage {fault.part}:seized", command, low.shape, low, high)

    def stages(self, draws: Draws) -> Stages:
        """Return all that P damages break, in their order.

        Columns are named by side and word: "action_gain", "observation_bias". Those of times are in
        s as "delay" and "hold", and in steps as "delay_steps" and "hold_steps". "action_latched" is
        what a seized actuator does; NaN is what it did last. "faults" counts what is active. What
        is never broken has no column.
        """
        count = len(draws.kind)
        intact: dict[str, NDArray[Any]] = {"faults": np.zeros(count, np.int64)}
        for _, (part, word) in draws.used:
            side, _ = channels_of(part)
            several = ("seized", "latched") if word == "seized" else (column_of(word),)
            for name in several:
                dtype = np.bool_ if name in _FLAGS else np.float64
                shape = (count, self.sizes[side])
                intact[f"{side}_{name}"] = np.full(shape, NEUTRAL.get(name, 0), dtype)
        stages = make_stages(draws, self.dt, intact, _break)
        columns = _in_steps(stages.columns, self.dt)
        if "action_latched" in columns:
            self._hold(stages)
        return stages._replace(columns=columns)

    def _hold(self, stages: Stages) -> None:
        """Say what seized actuators do that no number is given for: they stay where they stand.

        They stand where they did in the row before, or at the neutral action as an episode begins.
        """
        seized, latched = (stages.columns[f"action_{name}"] for name in ("seized", "latched"))
        begin = latched[stages.first]
        latched[stages.first] = np.where(np.isnan(begin), self.neutral, begin)
        for i in range(1, int(stages.counts.max(initial=1))):
            rows = stages.first[stages.counts > i] + i
            stood = seized[rows - 1] & np.isnan(latched[rows])
            latched[rows] = np.where(stood, latched[rows - 1], latched[rows])


def _break(columns: Columns, rows: Any, part: str, word: str, number: ArrayLike) -> None:
    side, where = channels_of(part)
    break_channels(columns, side, rows, where, word, number)


def _in_steps(columns: Columns, dt: float) -> dict[str, NDArray[Any]]:
    """Return columns with their delays and holds also in steps of ``dt`` s."""
    found = dict(columns)
    for side in SIDES:
        if f"{side}_delay" in columns:
            found[f"{side}_delay_steps"] = delay_steps(columns[f"{side}_delay"], dt)
        if f"{side}_hold" in columns:
            found[f"{side}_hold_steps"] = columns[f"{side}_hold"] / dt
    return found


def _box(name: str, space: Space[Any]) -> Box[Any]:
    if not isinstance(space, Box) or space.dtype.kind not in "iuf":
        remedy = ": flatten it first by gymnasium.wrappers.FlattenObservation"
        raise InvalidArgumentError(
            f"the {name} space must be a Box of numbers; got {brief(space)}"
            + (remedy if name == "observation" else "")
        )
    return space


def _bounds(space: Box[Any]) -> tuple[Floats, Floats]:
    low, high = space.low.ravel().astype(np.float64), space.high.ravel().astype(np.float64)
    if space.dtype.kind == "f":  # what is larger would not be finite in the space's type
        most = float(np.finfo(space.dtype).max)
        low, high = low.clip(-most, most), high.clip(-most, most)
    return low, high
