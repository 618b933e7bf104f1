"""Broken action and observation channels of batches that step arrays of any library, on a device.

Nothing waits for a number of the device, and none is copied from it: which robots begin an episode
and what is broken of each are arrays there. :class:`Channels` states what the words mean and lists
the stages of an episode; here they are looked up.
"""

from __future__ import annotations

import functools
import operator
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.damage import Damage
from aquafish_gym.damage.delays import STEP_ROUNDING, delay_steps
from aquafish_gym.envs.array_episodes import draw_episodes
from aquafish_gym.envs.array_libraries import ArrayLibrary
from aquafish_gym.envs.channels import Channels, actuate
from aquafish_gym.utils.array_types import Floats

SINGLE_PRECISION_STEP_ROUNDING = 1e-5  # as ``STEP_ROUNDING``
Arrays = dict[str, Any]  # of one library, on one device
SIDES = ("action", "observation")

_LARGEST_STEP = 2**31 - 1
_LARGEST_SINGLE = float(np.finfo(np.float32).max)
_MISREADING = tuple(
    f"observation_{one}" for one in ("scale", "bias", "noise", "lost", "delay_steps", "hold_steps")
)
_OBSERVED = ("reading", "fresh", *(f"observation_{one}" for one in ("kept", "past", "first")))
_WHOLE = {"action_gain": 1.0, "action_scale": 1.0, "observation_scale": 1.0}  # all others are 0


class ArrayChannels:
    """Applies faults to batches (B, ...) of actions and observations on a device.

    Parameters
    ----------
    channels
        The channels of B robots: their spaces, and the length of a step.
    damages, first_damages
        B of them, which may be random; those of the first episodes may be others.
    observations
        (B, ...) of the library and on the device of all that follow.
    rng
        Draws the episodes of random damage. Noise is drawn on the device.

    Raises
    ------
    InvalidArgumentError
        If the library is unknown.
    """

    def __init__(
        self,
        channels: Channels,
        damages: Sequence[Damage],
        first_damages: Sequence[Damage],
        observations: Any,
        rng: np.random.Generator,
    ) -> None:
        self._library = ArrayLibrary(observations, int(rng.integers(2**31)))
        self._xp = self._library.xp
        double = str(observations.dtype).endswith("float64")
        self._real = "float64" if double else "float32"
        self._rounding = STEP_ROUNDING if double else SINGLE_PRECISION_STEP_ROUNDING
        self._sizes = {side: len(low) for side, (low, _) in channels.bounds.items()}
        self._bounds = {side: self._clipping(*ends) for side, ends in channels.bounds.items()}
        one = len(set(channels.neutral.tolist())) == 1
        self._neutral = float(channels.neutral[0]) if one else self._put(channels.neutral)
        self._type = getattr(self._xp, self._real)

        count = len(damages)
        episodes = draw_episodes(damages, first_damages, channels.parts, rng)
        tables = channels.tables(episodes.damages)
        of_rows = np.searchsorted(tables.first, np.arange(len(tables.until)), "right") - 1
        columns = tables.columns | _in_steps(tables.columns, channels.dt)
        columns["until"] = tables.until.clip(max=_LARGEST_STEP)
        columns["following"] = tables.first[episodes.following[of_rows]]
        whole = {name: _WHOLE.get(name, 0.0) for name in columns}
        broken = {name for name, column in columns.items() if (column != whole[name]).any()}
        if "action_seized" in broken:
            broken.add("held")
        broken.discard("following")
        if "dropped" not in broken:
            broken.discard("observation_lost")  # is what is stuck
        if not episodes.repeat:
            broken.add("following")
        self._beginnings = self._put(tables.first[episodes.starts])
        self._breaks = {side: any(name.startswith(side) for name in broken) for side in SIDES}
        self._breaks["observation"] |= "stuck" in broken
        #: By name, a row for each stage. What is never broken of any robot has none.
        self._tables: Arrays = {name: self._put(columns[name]) for name in sorted(broken)}
        delays = {side: np.unique(columns[f"{side}_delay_steps"]).tolist() for side in SIDES}
        self._delays = {side: [steps for steps in delays[side] if steps] for side in SIDES}

        shown = channels.truth()
        shapes = {name: (count, *column.shape[1:]) for name, column in shown.items()}
        self._constant = {
            name: self._xp.broadcast_to(
                self._put(np.asarray(whole[name], column.dtype)), shapes[name]
            )
            for name, column in shown.items()
            if name not in broken and not (name == "observation_lost" and "stuck" in broken)
        }
        #: What is shown of each table, and its shape where it has another.
        self._shapes = {
            name: None if len(shape) == len(columns[name].shape) else shape
            for name, shape in shapes.items()
            if name not in self._constant
        }
        #: A mask (B,) of all robots.
        self.everyone = self._xp.broadcast_to(self._put(np.asarray(True)), (count,))
        self._remembers = any(name.endswith("_steps") for name in broken)
        self._clock = 0  # steps that all robots have taken
        self._state = self._begun(self._beginnings)
        self._turn = self._library.compiled(self._turned)
        self._act = self._library.compiled(self._acted)
        self._sense = self._library.compiled(self._sensed)
        self._choose = self._library.compiled(self._chosen)

    def act(self, actions: Any) -> Any:
        """Return what actuators make of actions (B, ...)."""
        if not self._breaks["action"]:
            return actions
        self._state, acted = self._act(self._state, actions)
        return acted

    def advance(self, begins: Any = None) -> None:
        """Count a step, after which other faults may be active.

        The robots of the mask ``begins`` (B,), if there is one, begin an episode instead.
        """
        self._change(1, begins)

    def begin(self, begins: Any) -> None:
        """Let the robots of a mask (B,) begin an episode."""
        self._change(0, begins)

    def observe(self, observations: Any, mask: Any = None) -> Any:
        """Return what sensors make of observations (B, ...).

        Only the robots of a ``mask`` (B,) observe, if there is one; rows of others mean nothing.
        """
        if not self._breaks["observation"]:
            return observations
        white = None
        if "observation_noise" in self._tables:
            white = self._library.normal((len(observations), self._sizes["observation"]))
        state, seen = self._sense(self._state, observations, white)
        if mask is not None:
            kept = [name for name in _OBSERVED if name in state]
            state |= {name: self.choose(mask, state[name], self._state[name]) for name in kept}
        self._state = state
        return seen

    def choose(self, mask: Any, then: Any, otherwise: Any) -> Any:
        """Return arrays (B, ...), whose rows are ``then`` where a mask (B,) is True."""
        return self._choose(mask, then, otherwise)

    def mask(self, mask: Any) -> Any:
        """Return a mask (B,) as an array on the device."""
        return self._library.put(mask, "bool")

    def copy(self, array: Any) -> Any:
        """Return a copy of an array that may be written to."""
        return self._library.copy(array)

    def truth(self) -> Arrays:
        """Return what is broken, by its names in ``info``: arrays that must not be written to."""
        now = self._state["now"]
        return self._constant | {
            name: now[name] if shape is None else now[name].reshape(shape)
            for name, shape in self._shapes.items()
        }

    def _change(self, steps: int, begins: Any) -> None:
        if any(self._breaks.values()):
            self._clock += steps
            self._state = self._turn(self._tables, self._state, self._clock, begins)

    def _put(self, values: NDArray[Any]) -> Any:
        """Return NumPy's numbers as an array on the device, in the precision of this batch."""
        dtype = {"b": "bool", "i": "int32", "f": self._real}[values.dtype.kind]
        if dtype == "float32":  # has no number as large as a product of scales may be
            values = values.clip(-_LARGEST_SINGLE, _LARGEST_SINGLE)
        return self._library.put(values, dtype)

    def _clipping(self, low: Floats, high: Floats) -> tuple[Any, Any] | None:
        """Return bounds as numbers where all channels have the same; None where they have none."""
        if (low <= -_LARGEST_SINGLE).all() and (high >= _LARGEST_SINGLE).all():
            return None
        if len(set(low)) == len(set(high)) == 1:
            return float(low[0]), float(high[0])
        return self._put(low), self._put(high)

    def _look_up(self, tables: Arrays, rows: Any) -> Arrays:
        """Return what is broken in the stages ``rows`` (B,), by name."""
        now = {name: self._library.rows(table, rows) for name, table in tables.items()}
        if "observation_lost" not in now and "stuck" in now:
            now["observation_lost"] = now["stuck"]
        return now

    def _begun(self, rows: Any) -> Arrays:
        """Return the state of robots that begin an episode with the stages ``rows`` (B,)."""
        count = len(rows)
        zeros = {side: self._put(np.zeros((count, n))) for side, n in self._sizes.items()}
        steps = {side: self._put(np.zeros((count, n), int)) for side, n in self._sizes.items()}
        now = self._look_up(self._tables, rows)
        nothing = self._put(np.zeros(count, int))
        state: Arrays = {"start": nothing, "row": rows, "now": now}
        if self._remembers:
            state["step"] = nothing  # of the episode
        if "action_seized" in now:
            state |= {"done": zeros["action"], "last": zeros["action"]}
        if "stuck" in now:
            self._none = self._put(np.zeros((count, self._sizes["observation"]), np.bool_))
            state |= {"reading": zeros["observation"], "fresh": now["stuck"]}
        for side in SIDES:
            if f"{side}_hold_steps" in now:
                state |= {f"{side}_kept": zeros[side], f"{side}_began": steps[side]}
            if self._delays[side]:
                state[f"{side}_past"] = (zeros[side],) * (max(self._delays[side]) + 1)
                first = self._neutral if side == "action" else 0.0
                state[f"{side}_first"] = zeros[side] + first
        return state

    # The following are functions of arrays alone, which a library may compile.

    def _turned(self, tables: Arrays, state: Arrays, clock: int, begins: Any) -> Arrays:
        """Return the state at a step of all robots, with the faults of each robot's stage.

        The robots of the mask ``begins`` begin an episode.
        """
        xp = self._xp
        before, start = state["now"], state["start"]
        step = clock - start
        row = state["row"] + (before["until"] == step)
        if begins is not None:
            start = xp.where(begins, clock, start)
            row = xp.where(begins, before.get("following", self._beginnings), row)
        now = self._look_up(tables, row)
        state = state | {"start": start, "row": row, "now": now}
        if self._remembers:
            state["step"] = clock - start
        if "action_seized" in now:  # from now on, it does what it did last
            fresh = now["action_seized"] & ~before["action_seized"]
            state["last"] = xp.where(fresh, state["done"], state["last"])
        if "stuck" in now:
            stood = before["stuck"] if begins is None else before["stuck"] & ~begins[:, None]
            state["fresh"] = now["stuck"] & ~stood
        for side in SIDES:
            name = f"{side}_hold_steps"
            if name in now:
                fresh = now[name] != before[name]
                fresh = fresh if begins is None else fresh | begins[:, None]
                began = xp.where(fresh, state["step"][:, None], state[f"{side}_began"])
                state[f"{side}_began"] = began
        return state

    def _acted(self, state: Arrays, actions: Any) -> tuple[Arrays, Any]:
        """Return the state and what actuators make of actions, as :meth:`Channels.act` does."""
        xp, now = self._xp, state["now"]
        asked = _flat(self._library.cast(actions, self._type))
        state, asked = self._carried("action", state, asked)
        acted = asked
        turning = [name for name in ("action_scale", "action_gain") if name in now]
        if self._bounds["action"] is None and self._neutral == 0.0:
            for name in turning:  # of whole ones they are 1
                acted = now[name] * acted
        elif turning:
            turned = self._any(now[name] != 1.0 for name in turning)
            moved = actuate(
                lambda actions: self._clip("action", actions), asked, self._neutral,
                now.get("action_scale"), now.get("action_gain"),
            )  # fmt: skip
            acted = xp.where(turned, moved, asked)
        if "action_seized" in now:
            held = xp.where(xp.isnan(now["held"]), state["last"], now["held"])
            acted = xp.where(now["action_seized"], held, acted)
            state = state | {"done": self._clip("action", acted)}
        return state, _shaped(self._library.cast(acted, actions.dtype), actions)

    def _sensed(self, state: Arrays, observations: Any, white: Any) -> tuple[Arrays, Any]:
        """Return the state and what sensors make of observations, as ``Sensors.observe`` does."""
        xp, now = self._xp, state["now"]
        truth = _flat(self._library.cast(observations, self._type))
        sensed = truth
        if "observation_scale" in now:
            sensed = sensed * now["observation_scale"]
        if "observation_bias" in now:
            sensed = sensed + now["observation_bias"]
        if white is not None:
            sensed = sensed + now["observation_noise"] * white
        state, sensed = self._carried("observation", state, sensed)
        if "stuck" in now:
            reading = xp.where(state["fresh"], sensed, state["reading"])
            state = state | {"reading": reading, "fresh": self._none}
            sensed = xp.where(now["stuck"], reading, sensed)
        if "dropped" in now:
            sensed = xp.where(now["dropped"], xp.zeros_like(sensed), sensed)
        if self._bounds["observation"] is None:
            seen = sensed
        else:  # what whole sensors read outside of the space is left to the environment
            broken = self._any(
                now[name] if name == "observation_lost" else now[name] != _WHOLE.get(name, 0.0)
                for name in _MISREADING
                if name in now
            )
            seen = xp.where(broken, self._clip("observation", sensed), truth)
        return state, _shaped(self._library.cast(seen, observations.dtype), observations)

    @staticmethod
    def _any(masks: Iterable[Any]) -> Any:
        """Return where any of some masks is True; None if there is none."""
        return functools.reduce(operator.or_, masks) if (masks := list(masks)) else None

    def _clip(self, side: str, numbers: Any) -> Any:
        bounds = self._bounds[side]
        return numbers if bounds is None else self._xp.clip(numbers, *bounds)

    def _carried(self, side: str, state: Arrays, numbers: Any) -> tuple[Arrays, Any]:
        """Return the state and what late and slow channels deliver: ``DelayLines.carry``."""
        if not self._remembers:
            return state, numbers
        xp, now = self._xp, state["now"]
        count = state["step"][:, None]  # numbers of the episode that came before
        if f"{side}_hold_steps" in now:
            period = now[f"{side}_hold_steps"]
            held = period > 0.0
            since = self._library.cast(count - state[f"{side}_began"], numbers.dtype)
            one = xp.where(held, period, xp.ones_like(period))
            turn = xp.floor(since / one + self._rounding)
            same = turn == xp.floor((since - 1.0) / one + self._rounding)
            numbers = xp.where(held & same, state[f"{side}_kept"], numbers)
            state = state | {f"{side}_kept": numbers}
        if self._delays[side]:
            delay = now[f"{side}_delay_steps"]
            past = (numbers, *state[f"{side}_past"][:-1])
            first = state[f"{side}_first"]
            if side == "observation":
                first = xp.where(count == 0, numbers, first)
            for steps in self._delays[side]:
                numbers = xp.where(delay == steps, past[steps], numbers)
            numbers = xp.where(delay > count, first, numbers)
            state = state | {f"{side}_past": past, f"{side}_first": first}
        return state, numbers

    def _chosen(self, mask: Any, then: Any, otherwise: Any) -> Any:
        if isinstance(then, dict):
            return {name: self._chosen(mask, then[name], otherwise[name]) for name in then}
        if isinstance(then, tuple):
            pairs = zip(then, otherwise, strict=True)
            return tuple(self._chosen(mask, one, other) for one, other in pairs)
        return self._xp.where(mask.reshape(-1, *[1] * (then.ndim - 1)), then, otherwise)


def _flat(array: Any) -> Any:
    """Return an array (B, ...) as (B, channels)."""
    return array if array.ndim == 2 else array.reshape(array.shape[0], -1)


def _shaped(flat: Any, like: Any) -> Any:
    """Return an array (B, channels) in the shape of another one."""
    return flat if like.ndim == 2 else flat.reshape(like.shape)


def _in_steps(columns: Arrays, dt: float) -> Arrays:
    """Return the delays and holds of columns in steps of ``dt`` s."""
    found: Arrays = {}
    for side in SIDES:
        found[f"{side}_delay_steps"] = delay_steps(columns[f"{side}_delay"], dt)
        found[f"{side}_hold_steps"] = columns[f"{side}_hold"] / dt
    return found
