"""Plays a table of what is broken, for batches of arrays of any library.

On a device nothing waits for a number, and none is copied from there: which robots begin an episode
and what is broken of each are arrays. On NumPy a step in which nothing changes looks nothing up.
"""

from __future__ import annotations

import functools
import operator
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.damage import transmit
from aquafish_gym.damage.side import deepened
from aquafish_gym.damage.transmit import NEUTRAL
from aquafish_gym.envs.channels import SIDES, Channels
from aquafish_gym.stages import SlotTable, Stages
from aquafish_gym.utils.array_types import Rows

Arrays = dict[str, Any]  # of one library, on one device

_LARGEST_SINGLE = float(np.finfo(np.float32).max)
#: The words by which a channel is broken so that its numbers must be within its bounds.
_BREAKING = {
    "action": ("scale", "gain"),
    "observation": ("scale", "bias", "noise", "stuck", "dropped", "delay", "hold"),
}
#: What ``info`` has of each side: by the word, its type.
_SHOWN = {
    "action": {"gain": float, "seized": bool},
    "observation": {"noise": float, "bias": float, "lost": bool},
}
_SHOWN_LATE = {"scale": float, "delay": float, "hold": float}  # of both


class FaultPlayer:
    """Applies the faults of a table to batches (B, ...) of actions and observations.

    Parameters
    ----------
    channels
        The channels of a robot.
    count
        B.
    library
        The arrays' ``ArrayLibrary`` or ``NumPyLibrary``.
    double
        Whether actions and observations are computed in double precision, by their sides.
    white
        Returns standard normal numbers (B, C), given the deviations (B, C) of the noise and a mask
        (B,) of the robots that observe, or None.

    Attributes
    ----------
    everyone
        A mask (B,) of all robots.
    """

    def __init__(
        self,
        channels: Channels,
        count: int,
        library: Any,
        double: dict[str, bool],
        white: Callable[[Any, Any], Any],
    ) -> None:
        self._channels, self._count = channels, count
        self._library, self._white = library, white
        self._host: bool = library.on_host
        self._double = double
        names = {side: "float64" if double[side] else "float32" for side in SIDES}
        self._reals = {side: getattr(library.xp, name) for side, name in names.items()}
        self._bounds = {side: self._clipping(side) for side in SIDES}
        one = len(set(channels.neutral.tolist())) == 1
        self._neutral = float(channels.neutral[0]) if one else self._put(channels.neutral, "action")
        self._is_centred = one and self._neutral == 0.0
        self._tables: Arrays = {}  # (R, ...) by name; what is never broken has none
        self._rates: Arrays = {}
        self._slots = SlotTable(count, _neutral)  # on NumPy
        self._constants: dict[tuple[str, tuple[int, ...]], Any] = {}  # what ``info`` has of nothing
        self._clock = 0  # steps that all robots have taken
        self._due = 0  # on NumPy, the step of the clock at which something changes next
        # On NumPy, what ``info`` has until something changes, without late channels or with them.
        self._truth: dict[bool, Arrays] = {}
        self._idle = False  # whether no episode of a table that was drawn has a fault
        everyone = library.put(np.asarray(True), "bool")
        self.everyone = library.xp.broadcast_to(everyone, (count,))
        zeros = np.zeros(count, np.int64)
        self._state: Arrays = {
            "start": self._put(zeros),
            "row": self._put(zeros),
            "now": {side: {} for side in SIDES},
            **{side: {} for side in SIDES},
        }
        self._turn = library.compiled(self._turned)
        self._act = library.compiled(self._acted)
        self._sense = library.compiled(self._sensed)
        self._choose = library.compiled(self._chosen)

    def play(self, stages: Stages, starts: Rows, following: Rows | None) -> None:
        """Begin episodes that were drawn before, one after the other.

        Robots begin with the episodes ``starts`` (B,); ``following`` is the episode after each, or
        None if it is the same.
        """
        self._tables = {
            name: self._put_column(name, column)
            for name, column in stages.columns.items()
            if (column != _neutral(name)).any()
        }
        self._tables["faults"] = self._put(stages.columns["faults"])
        self._tables["until"] = self._put(stages.until)
        if following is not None:
            self._tables["following"] = self._put(stages.first[following[stages.episode]])
        self._rates = {name: self._put_column(name, rate) for name, rate in stages.rates.items()}
        if self._rates:
            self._tables["since"] = self._put(stages.since)
        self._prepare(stages)
        self._state["following"] = self._put(stages.first[starts])
        self._turn_all(self.everyone)
        self._idle = not stages.columns["faults"].any()

    def load(self, robots: Rows, stages: Stages) -> None:
        """Let robots (n,) on NumPy begin the n episodes of a table as their next ones.

        Each robot has rows of its own, which are replaced.
        """
        room = self._slots.room
        known = self._slots.stages.columns
        columns = {
            name: self._put_column(name, column)
            for name, column in stages.columns.items()
            if name in known or name == "faults" or (column != _neutral(name)).any()
        }
        rates = {name: self._put_column(name, rate) for name, rate in stages.rates.items()}
        self._slots.put(robots, stages._replace(columns=columns, rates=rates))
        mine = self._slots.stages
        self._tables = {**mine.columns, "until": mine.until, "since": mine.since}
        self._rates = dict(mine.rates)
        self._state["row"] = self._slots.moved(self._state["row"], room)
        self._state["following"] = mine.first
        self._prepare(stages)

    def act(self, actions: Any) -> Any:
        """Return what actuators make of actions (B, ...): the same array where none is broken."""
        if not self._busy("action"):
            return actions
        with np.errstate(over="ignore"):  # it saturates
            self._state, acted = self._act(self._state, actions, self._clock)
        return acted

    def advance(self, begins: Any = None) -> None:
        """Count a step, after which other faults may be active.

        The robots of the mask ``begins`` (B,), if there is one, begin an episode instead.
        """
        self._clock += 1
        if self._idle or (self._host and begins is None and self._clock < self._due):
            return
        self._turn_all(begins)

    def begin(self, begins: Any) -> None:
        """Let the robots of a mask (B,) begin an episode."""
        if not self._idle:
            self._turn_all(begins)

    def observe(self, observations: Any, mask: Any = None) -> Any:
        """Return what sensors make of observations (B, ...): the same array where none is broken.

        Only the robots of a ``mask`` (B,) observe, if there is one; rows of others mean nothing.
        """
        if not self._busy("observation"):
            return observations
        deviation = self._state["now"]["observation"].get("noise")
        white = None if deviation is None else self._white(deviation, mask)
        with np.errstate(over="ignore"):  # it saturates
            self._state, seen = self._sense(self._state, observations, white, self._clock, mask)
        return seen

    def choose(self, mask: Any, then: Any, otherwise: Any) -> Any:
        """Return an array (B, ...), whose rows are ``then`` where a mask (B,) is True."""
        return self._choose(mask, then, otherwise)

    def mask(self, mask: Any) -> Any:
        """Return a mask (B,) as an array of the library."""
        return self._library.put(mask, "bool")

    def copy(self, array: Any) -> Any:
        """Return a copy of an array that may be written to."""
        return self._library.copy(array)

    def truth(self) -> Arrays:
        """Return what is broken, by its names in ``info``; on NumPy copies of it."""
        if not self._host:
            return self._told()
        late = self._channels.late
        if late not in self._truth:
            self._truth = {late: self._told()}
        return {name: column.copy() for name, column in self._truth[late].items()}

    def _told(self) -> Arrays:
        """Return what is broken, by its names in ``info``."""
        now = self._state["now"]
        found: Arrays = {"faults": now["faults"]}
        for side in SIDES:
            words = _SHOWN[side] | (_SHOWN_LATE if self._channels.late else {})
            space = getattr(self._channels, side)
            for word, kind in words.items():
                found[f"{side}_{word}"] = self._shown(now[side], word, kind, space.shape)
        return found

    def _shown(self, now: Arrays, word: str, kind: type, shape: tuple[int, ...]) -> Any:
        """Return a word's numbers (B, ...), whether or not anything has it."""
        shape = (self._count, *shape)
        names = ("stuck", "dropped") if word == "lost" else (word,)
        if word in ("delay", "hold"):
            names = (f"{word}_seconds",)
        columns = [now[name] for name in names if name in now]
        if columns:
            column = functools.reduce(operator.or_, columns) if len(columns) > 1 else columns[0]
            column = column if column.ndim == len(shape) else column.reshape(shape)
            return column.astype(kind, copy=False) if self._host else column
        if (word, shape) not in self._constants:
            one = self._put(np.asarray(NEUTRAL.get(word, 0), kind))
            self._constants[word, shape] = self._library.xp.broadcast_to(one, shape)
        return self._constants[word, shape]

    def _busy(self, side: str) -> bool:
        """Whether numbers of a side are changed or remembered."""
        now = self._state["now"][side]
        state = self._state[side]
        return bool(now) or "past" in state or "done" in state

    def _turn_all(self, begins: Any) -> None:
        """Let robots become what the table says of this step."""
        self._state = self._turn(self._tables, self._rates, self._state, self._clock, begins)
        if self._host:
            self._truth = {}
            state = self._state
            growing = any(rate[state["row"]].any() for rate in self._rates.values())
            due = int((state["until"] + state["start"]).min())
            self._due = self._clock + 1 if growing else due

    # What an episode needs.

    def _prepare(self, stages: Stages) -> None:
        """Let channels remember what the faults of a table need."""
        for side in SIDES:
            state = self._state[side]
            shape = (self._count, self._channels.sizes[side])
            zeros = np.zeros(shape)
            if f"{side}_seized" in self._tables and "done" not in state:
                state["done"] = state["last"] = self._put(zeros, side)
            if f"{side}_stuck" in self._tables and "reading" not in state:
                state["reading"] = self._put(zeros, side)
                state["fresh"] = self._put(zeros > 0.0)
            if f"{side}_hold_steps" in self._tables and "kept" not in state:
                state["kept"] = self._put(zeros, side)
                state["began"] = self._put(np.zeros(shape, np.int64))
            delays = stages.columns.get(f"{side}_delay_steps")
            depth = 0 if delays is None else 1 + int(delays.max(initial=0))
            if depth > 1 and "past" not in state:
                state["past"] = self._put(np.zeros((depth, *shape)), side)
                state["cells"] = self._put(np.arange(zeros.size).reshape(shape))
            elif depth > 1 and depth > len(state["past"]):
                state["past"] = deepened(state["past"], self._clock, depth)

    def _put_column(self, name: str, column: NDArray[Any]) -> Any:
        """Return a column as an array of the library."""
        side, _, word = name.partition("_")
        if self._host and word != "bias":  # double precision, whatever that of observations
            return column
        return self._put(column, side)

    def _put(self, values: NDArray[Any], side: str = "action") -> Any:
        """Return NumPy's numbers as an array of the library, in the precision of a side."""
        real = "float64" if self._double.get(side, True) else "float32"
        integer = "int64" if self._host else "int32"
        dtype = {"b": "bool", "i": integer, "f": real}[values.dtype.kind]
        if dtype == "float32":  # has no number as large as a product of scales may be
            values = values.clip(-_LARGEST_SINGLE, _LARGEST_SINGLE)
        return self._library.put(values, dtype)

    def _clipping(self, side: str) -> tuple[Any, Any] | None:
        """Return bounds as numbers where all channels have the same; None where they have none."""
        low, high = self._channels.bounds[side]
        if not self._host and (low <= -_LARGEST_SINGLE).all() and (high >= _LARGEST_SINGLE).all():
            return None
        if len(set(low)) == len(set(high)) == 1:
            return float(low[0]), float(high[0])
        return self._put(low, side), self._put(high, side)

    # The following are functions of arrays alone, which a library may compile.

    def _turned(
        self, tables: Arrays, rates: Arrays, state: Arrays, clock: int, begins: Any
    ) -> Arrays:
        """Return the state at a step of all robots, with the faults of each robot's row.

        The robots of the mask ``begins`` begin an episode.
        """
        xp, before = self._library.xp, state["now"]
        start, row = state["start"], state["row"]
        if "until" in state:
            row = row + (state["until"] == clock - start)
        if begins is not None:
            start = xp.where(begins, clock, start)
            row = xp.where(begins, state["following"], row)
        slow = any(f"{side}_hold_steps" in tables for side in SIDES)
        step = clock - start if rates or slow else None
        now = self._look_up(tables, rates, row, step)
        state = state | {"start": start, "row": row, "now": now}
        for name in ("until", "following"):
            if name in tables:
                state[name] = self._library.rows(tables[name], row)
        of_robots = None if begins is None else begins[:, None]
        count = None if step is None else step[:, None]
        for side in SIDES:
            state[side] = transmit.change(
                xp, state[side], before[side], now[side], count, of_robots
            )
        return state

    def _count_of(self, state: Arrays, side: str, clock: int) -> Any:
        """Return the steps (B, 1) of each robot's episode; None where a side does not need them."""
        if "past" in state[side] or "kept" in state[side]:
            return (clock - state["start"])[:, None]
        return None

    def _look_up(self, tables: Arrays, rates: Arrays, row: Any, step: Any) -> Arrays:
        """Return what is broken in rows (B,), by side and word."""
        found: Arrays = {side: {} for side in SIDES}
        found["faults"] = self._library.rows(tables["faults"], row)
        for name, table in tables.items():
            side, word, key = _place(name)
            if not word:  # "faults", "until" and the like
                continue
            column = self._library.rows(table, row)
            if name in rates:
                steps = step - self._library.rows(tables["since"], row)
                grown = self._library.rows(rates[name], row) * steps[:, None]
                column = transmit.bias(self._library.xp, column, grown)
            if self._host and word != "latched" and not (column != NEUTRAL.get(word, 0)).any():
                continue
            found[side][key] = column
        for side, words in _BREAKING.items():
            if self._bounds[side] is None and (side == "observation" or self._is_centred):
                continue  # intact channels are what the broken ones are by 1 and 0
            now = found[side]
            masks = [
                now[word] if word in ("stuck", "dropped") else now[word] != NEUTRAL.get(word, 0)
                for word in words
                if word in now
            ]
            if masks:
                now["broken"] = functools.reduce(operator.or_, masks)
        return found

    def _acted(self, state: Arrays, actions: Any, clock: int) -> tuple[Arrays, Any]:
        """Return the state and what actuators make of actions."""
        library = self._library
        xp = library.xp
        now = state["now"]["action"]
        commanded = _flat(library.cast(actions, self._reals["action"]))
        count = self._count_of(state, "action", clock)
        commanded, side = transmit.carry(
            library, now, state["action"], commanded, count, clock, self._neutral
        )
        acted = commanded
        if "scale" in now or "gain" in now:
            acted = transmit.actuate(
                lambda actions: self._clip("action", actions), commanded, self._neutral,
                now.get("scale"), now.get("gain"),
            )  # fmt: skip
        if "broken" in now:  # what others are commanded outside of the space is left as it is
            acted = xp.where(now["broken"], acted, commanded)
        if "seized" in now:
            latched = now.get("latched", 0.0)
            if "latched" in now:
                latched = xp.where(xp.isnan(latched), side["last"], latched)
            acted = xp.where(now["seized"], latched, acted)
        if "done" in side:
            side["done"] = self._clip("action", acted)
        dtype = self._channels.action.dtype if self._host else actions.dtype
        return state | {"action": side}, _shaped(library.cast(acted, dtype), actions)

    def _sensed(
        self, state: Arrays, observations: Any, white: Any, clock: int, mask: Any
    ) -> tuple[Arrays, Any]:
        """Return the state and what sensors make of observations."""
        library = self._library
        now = state["now"]["observation"]
        truth = _flat(library.cast(observations, self._reals["observation"]))
        count = self._count_of(state, "observation", clock)
        mask = None if mask is None else mask[:, None]
        seen, side = transmit.sense(
            library, now, state["observation"], truth, white, count, clock, mask
        )
        if self._bounds["observation"] is not None:
            # What intact sensors read outside of the space is left to the environment.
            seen = self._clip("observation", seen)
            seen = library.xp.where(now["broken"], seen, truth) if "broken" in now else truth
        dtype = self._channels.observation.dtype if self._host else observations.dtype
        found = _shaped(library.cast(seen, dtype), observations)
        return state | {"observation": side}, found

    def _clip(self, side: str, numbers: Any) -> Any:
        bounds = self._bounds[side]
        return numbers if bounds is None else self._library.clip(numbers, *bounds)

    def _chosen(self, mask: Any, then: Any, otherwise: Any) -> Any:
        return self._library.xp.where(mask.reshape(-1, *[1] * (then.ndim - 1)), then, otherwise)


def _neutral(name: str) -> float:
    """Return what a column holds where nothing is broken."""
    return NEUTRAL.get(name.partition("_")[2], 0)


@functools.cache  # in each step, of each table
def _place(name: str) -> tuple[str, str, str]:
    """Return the side and the word of a column, and the key of what holds of it now.

    What the functions of ``transmit`` are given as "delay" and "hold" is in steps.
    """
    side, _, word = name.partition("_")
    key = f"{word}_seconds" if word in ("delay", "hold") else word.removesuffix("_steps")
    return side, word, key


def _flat(array: Any) -> Any:
    """Return an array (B, ...) as (B, channels)."""
    return array if array.ndim == 2 else array.reshape(array.shape[0], -1)


def _shaped(flat: Any, like: Any) -> Any:
    """Return an array (B, channels) in the shape of another one."""
    return flat if like.ndim == 2 else flat.reshape(like.shape)
