"""The action and observation channels of any robot, some of them broken, in batches."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from gymnasium.spaces import Box, Space
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.damage.damage import Damage, ways_to_break
from aquafish_gym.damage.delays import DelayLines, delay_steps, longest
from aquafish_gym.damage.faults import Fault, break_servo
from aquafish_gym.damage.sensors import (
    LARGEST_SCALE_PRODUCT,
    Readings,
    Sensors,
    break_link,
    break_sensor,
)
from aquafish_gym.damage.tiers import TIERS
from aquafish_gym.damage.words import CHANNEL_WORDS, RANDOM
from aquafish_gym.envs.robots import NO_CHANGE_STEP, Schedule
from aquafish_gym.utils.array_types import Floats, Rows
from aquafish_gym.utils.validation import InvalidArgumentError, brief, finite_array


class Tables(NamedTuple):
    """The stages of the damages of P episodes, R rows in all: those of an episode in order."""

    first: Rows  #: (P,) the row with which each episode begins
    until: Rows  #: (R,) the step with which the next row begins; ``NO_CHANGE_STEP`` if none does
    columns: dict[str, NDArray[Any]]  #: what is broken: (R,), or (R, channels) of one side


class Channels:
    """Applies faults to arrays of actions and observations, one row a robot.

    Channels are the entries of a space in C order: A of the action, C of the observation.

    Parameters
    ----------
    count
        B.
    action, observation
        The spaces of one robot.
    dt
        The length of a step in s; None if it is unknown.
    last_step
        How many steps an episode has; None if it is unknown.
    neutral
        See ``FaultWrapper``.

    Raises
    ------
    InvalidArgumentError
        If a space is no ``Box`` of numbers, or ``neutral`` lies outside of its space.
    """

    def __init__(
        self,
        count: int,
        action: Space[Any],
        observation: Space[Any],
        dt: float | None = None,
        last_step: int | None = None,
        neutral: ArrayLike | None = None,
    ) -> None:
        self.action, self.observation = _box("action", action), _box("observation", observation)
        self._dt, self._last_step = dt, last_step
        self._low, self._high = _bounds(self.action)
        self._ends = _bounds(self.observation)
        self._neutral = np.clip(0.0, self._low, self._high)
        if neutral is not None:
            several = isinstance(neutral, list | tuple) or np.ndim(neutral)
            one = () if several else finite_array("neutral", neutral, ())
            each = neutral if several else np.full(self.action.shape, one)
            ends = self.action.low, self.action.high
            self._neutral = finite_array("neutral", each, self.action.shape, *ends).ravel()
        self._sizes = {"action": len(self._low), "observation": len(self._ends[0])}
        #: What random faults break: each channel by itself.
        self.parts = {
            f"{side}_{i}": CHANNEL_WORDS[side] for side, n in self._sizes.items() for i in range(n)
        }
        actuators, dtype = (count, len(self._low)), self.observation.dtype
        self._gain = np.ones(actuators)
        self._scale = np.ones(actuators)
        self._delay, self._hold = np.zeros((2, *actuators))  # s
        self._lines = DelayLines(count, len(self._low), first=self._neutral)
        self._seized = np.zeros(actuators, np.bool_)
        self._held = np.zeros(actuators)  # what seized actuators do
        self._done = np.tile(self._neutral, (count, 1))  # what all did in the last step
        # Half precision has too small a range for the numbers of faults.
        real = dtype.type if dtype in (np.float32, np.float64) else np.float64
        self._sensors = Sensors(count, real, self._sizes["observation"], dt or 1.0)
        self._broken = self._sensors.readings.broken
        self._acts = self._senses = False  # whether any actuator, any sensor is broken
        self._late = False  # whether any channel ever was or will be late, slow or scaled
        self._faults, self._step = np.zeros((2, count), np.int64)
        self._schedule = Schedule(count)  # of the faults that are active from a step on
        self._everyone = np.arange(count)

    @property
    def bounds(self) -> dict[str, tuple[Floats, Floats]]:
        """The lowest and the highest number of each channel of both sides."""
        return {"action": (self._low, self._high), "observation": self._ends}

    @property
    def neutral(self) -> Floats:
        """The action (A,) at which actuators do nothing."""
        neutral: Floats = self._neutral
        return neutral

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
        self._late = self._late or damage.may_be_late
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
        side, where = fault.channels or ("", slice(0, 0))
        size = self._sizes.get(side, 0)
        if not 0 < (size if where == slice(None) else where.stop) <= size:
            known = [f"{side}, {side}_0 to {side}_{n - 1}" for side, n in self._sizes.items() if n]
            raise InvalidArgumentError(
                f"damage part must be one of {', '.join(known)} and {RANDOM} in this environment; "
                f"got {fault.part!r}"
            )
        if fault.word == "seized" and fault.number is not None:
            low, high = self._low[where], self._high[where]
            command = np.full(low.shape, fault.number)
            finite_array(f"damage {fault.part}:seized", command, low.shape, low, high)

    def start(self, rows: Rows, damages: Sequence[Damage]) -> None:
        """Let the robots ``rows`` (n,) begin an episode with n damages that are not random."""
        self._step[rows] = 0
        self._done[rows] = self._neutral
        self._seized[rows] = False
        self._sensors.reset(rows)
        self._lines.reset(rows)
        self._expect(damages)
        self._plan(rows, damages)
        self._change(rows)

    def _plan(self, rows: Rows, damages: Sequence[Damage]) -> None:
        """Schedule n damages of the robots ``rows`` (n,), from their first step on."""
        self._schedule.clear(rows)
        for robot, damage in zip(rows.tolist(), damages, strict=True):
            for step, faults in damage.stages(self.dt):
                self._schedule.add(robot, step, faults)

    def _expect(self, damages: Sequence[Damage]) -> None:
        """Let channels keep their numbers, where one will be late in an episode."""
        dt = self.dt
        delays = {"action": 0.0, "observation": 0.0}  # all of a robot's may add up, s
        for damage in damages:
            for side in delays:
                late = [f.number or 0.0 for f in damage if f.word == "delay" and _side(f) == side]
                delays[side] = max(delays[side], sum(late))
        self._sensors.remember(delays["observation"])
        self._lines.remember(longest(delays["action"], dt))

    def advance(self) -> None:
        """Count a step, after which other faults may be active."""
        self._step += 1
        changed = np.flatnonzero(self._step == self._schedule.next_change)
        if len(changed):
            self._change(changed)

    def act(self, actions: Floats) -> NDArray[Any] | None:
        """Return what actuators make of finite actions (B, ...); None where none is broken."""
        asked = actions.reshape(self._gain.shape)
        if self._lines.active:
            asked = self._lines.carry(asked, self._everyone)
        if not self._acts and not self._lines.active:
            self._done = self._clip(asked)
            return None
        turned = (self._gain != 1.0) | (self._scale != 1.0)
        moved = actuate(self._clip, asked, self._neutral, self._scale, self._gain)
        whole = np.where(turned, moved, self._clip(asked))
        self._done = np.where(self._seized, self._held, whole)
        # What whole channels are asked outside of the space is left to the environment.
        acted = np.where(self._seized | turned, self._done, asked)
        return _as(self.action, acted).reshape(actions.shape)

    def _clip(self, actions: Floats) -> Floats:
        return np.clip(actions, self._low, self._high)

    def observe(
        self,
        observations: NDArray[Any],
        rngs: Sequence[np.random.Generator] | np.random.Generator,
        rows: Rows,
    ) -> NDArray[Any]:
        """Return what the robots ``rows`` observe, (n, ...), where whole ones ``observations``.

        ``rngs`` as in :meth:`Sensors.observe`. Where no sensor is broken nothing is copied.
        """
        if not self._senses:
            return observations
        truth = observations.reshape(len(rows), self._sizes["observation"]).astype(
            self._sensors.readings.bias.dtype
        )
        sensed = self._sensors.observe(truth, *self._ends, rngs, rows)
        seen = np.where(self._broken[rows], sensed, truth)
        return _as(self.observation, seen).reshape(observations.shape)

    def truth(self) -> dict[str, NDArray[Any]]:
        """Return copies of what is broken, by its names in ``info``."""
        now = self._sensors.readings
        actions = self.action
        observations = self.observation
        tables: list[tuple[str, NDArray[Any], Box[Any]]] = [
            ("action_gain", self._gain.copy(), actions),
            ("action_seized", self._seized.copy(), actions),
            ("observation_noise", now.noise.copy(), observations),
            ("observation_bias", now.bias.astype(np.float64), observations),
            ("observation_lost", now.stuck | now.dropped, observations),
            *self._late_tables(),
        ]
        found = {name: table.reshape(len(table), *space.shape) for name, table, space in tables}
        return {"faults": self._faults.copy(), **found}

    def _late_tables(self) -> list[tuple[str, NDArray[Any], Box[Any]]]:
        """Return what is late, slow or scaled; nothing where nothing ever is."""
        if not self._late:
            return []
        now = self._sensors.readings
        actions = self.action
        observations = self.observation
        return [
            ("action_scale", self._scale.copy(), actions),
            ("action_delay", self._delay.copy(), actions),
            ("action_hold", self._hold.copy(), actions),
            ("observation_scale", now.scale.copy(), observations),
            ("observation_delay", now.delay.copy(), observations),
            ("observation_hold", now.hold.copy(), observations),
        ]

    def _change(self, rows: Rows) -> None:
        """Let robots be broken by the faults of their next stage."""
        self._sensors.update(rows, self._break(rows))
        dt = self.dt
        self._lines.update(rows, delay_steps(self._delay[rows], dt), self._hold[rows] / dt)
        self._broken = self._sensors.readings.broken
        self._acts = bool((self._seized | (self._gain != 1.0) | (self._scale != 1.0)).any())
        self._senses = self._sensors.remembers or bool(self._broken.any())

    def _break(self, rows: Rows) -> Readings:
        """Set actuators as the faults of the next stage do; return what these do to sensors."""
        bias = self._sensors.readings.bias
        readings = Readings.whole(len(rows), bias.shape[1], bias.dtype.type)
        for i, robot in enumerate(rows.tolist()):
            faults = self._schedule.pop(robot)
            self._faults[robot] = len(faults)
            stood = self._seized[robot].copy()  # and stands there still
            self._gain[robot], self._seized[robot] = 1.0, False
            self._scale[robot] = 1.0
            self._delay[robot] = self._hold[robot] = 0.0
            for fault in faults:
                side, where = fault.channels or ("", slice(0, 0))
                number = 0.0 if fault.number is None else fault.number
                if side == "observation":
                    break_sensor(readings.take(slice(i, i + 1)), where, fault.word, number)
                elif fault.word in ("delay", "hold"):
                    one = slice(robot, robot + 1)
                    break_link(self._delay[one], self._hold[one], where, fault.word, number)
                elif fault.word == "scale":
                    product = self._scale[robot, where] * number
                    self._scale[robot, where] = np.clip(
                        product, -LARGEST_SCALE_PRODUCT, LARGEST_SCALE_PRODUCT
                    )
                elif fault.word != "seized":
                    break_servo(self._gain[robot : robot + 1], where, fault.word, number)
                else:
                    self._seized[robot, where] = True
                    if fault.number is not None:
                        self._held[robot, where], stood[where] = number, True
            fresh = self._seized[robot] & ~stood
            self._held[robot, fresh] = self._done[robot, fresh]
        return readings

    def tables(self, damages: Sequence[Damage]) -> Tables:
        """Return all stages of P damages that are not random, as tables of a row for each."""
        others = Channels(
            len(damages), self.action, self.observation, self._dt, self._last_step,
            self._neutral.reshape(self.action.shape),
        )  # fmt: skip
        others._late = True
        everyone = others._everyone
        others._plan(everyone, damages)
        began = np.zeros(len(damages), np.int64)
        rows, found = everyone, []
        while len(rows):
            for table, new in zip(others._sensors.readings, others._break(rows), strict=True):
                table[rows] = new
            others._done[:] = np.nan  # later, what a seized actuator did last
            found.append((rows, began, others._stage(rows)))
            rows = np.flatnonzero(others._schedule.next_change != NO_CHANGE_STEP)
            began = others._schedule.next_change[rows]
        robots, steps = (np.concatenate(parts) for parts in list(zip(*found, strict=True))[:2])
        order = np.argsort(robots, kind="stable")
        columns = {
            name: np.concatenate([stage[name] for *_, stage in found])[order]
            for name in found[0][2]
        }
        robots, steps = robots[order], steps[order]
        follows = np.append(robots[1:] == robots[:-1], False)
        until = np.where(follows, np.roll(steps, -1), NO_CHANGE_STEP)
        return Tables(np.searchsorted(robots, everyone), until, columns)

    def _stage(self, rows: Rows) -> dict[str, NDArray[Any]]:
        """Return what is broken of ``rows`` now, by its name in ``info``, and what else matters."""
        now = self._sensors.readings
        more = {"held": self._held, "stuck": now.stuck, "dropped": now.dropped}
        found = self.truth() | more
        sides = {name: self._sizes.get(name.partition("_")[0]) for name in found}
        return {
            name: column[rows] if sides[name] is None else column[rows].reshape(-1, sides[name])
            for name, column in found.items()
        }


def actuate(
    clip: Callable[[Any], Any], asked: Any, neutral: Any, scale: Any | None, gain: Any | None
) -> Any:
    """Return what broken actuators do that are not seized: arrays (B, A) of any library.

    They do the action times ``scale``, and ``gain`` times its distance from ``neutral``; None is 1.
    ``clip`` returns actions within their bounds.
    """
    done = clip(asked)
    if scale is not None:
        done = clip(scale * done)
    if gain is None:
        return done
    centred = isinstance(neutral, float) and neutral == 0.0
    return clip(gain * done if centred else neutral + gain * (done - neutral))


def _side(fault: Fault) -> str:
    """Return "action", "observation" or, of the robot's own parts, nothing."""
    return "" if fault.channels is None else fault.channels[0]


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


def _as(space: Box[Any], values: NDArray[np.floating]) -> NDArray[Any]:
    """Return values in the type of a space, rounded where that is of whole numbers."""
    return (values if space.dtype.kind == "f" else np.rint(values)).astype(space.dtype)
