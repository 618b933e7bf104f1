"""The scenario of a simulation: B robots, the water they swim in, and what breaks when.

Damage, tiers, worlds that differ from their models, fault hypotheses and nuisance parameters are
edits of a :class:`Scenario`'s fields. Engines simulate it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from numbers import Real
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.bodies import body_array
from aquafish_gym.morphology import FINS
from aquafish_gym.utils.array_types import Flags, Floats
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    brief,
    finite_array,
    flag,
    one_of,
    sequence,
)

TIMESTEP = 0.01  # s, Sec. 4; the interval of the IMU's samples
MAXIMUM_CURRENT = 20.0  # units/s: 1 m/s
MAXIMUM_SPIN = 100.0  # rad/s
LARGEST_SCALE = 100.0  # factor of a sensor
LONGEST_DELAY = 100.0  # s, of a channel of the robot
#: What the inertial measurement unit observes: two directions and the angular velocity.
CHANNELS = tuple(f"{sense}_{axis}" for sense in ("up", "north", "gyro") for axis in "xyz")


class _Field(NamedTuple):
    """The shape of one robot's row, its range, its unit and its default."""

    row: tuple[int, ...]
    low: float
    high: float
    unit: str
    default: float


# Every field that a user may set, except the body, whose ranges ``DIMENSIONS`` states.
_FIELDS: dict[str, _Field] = {
    "fin_angles": _Field((3,), -np.inf, np.inf, "rad", 0.0),
    "velocity": _Field((3,), -MAXIMUM_CURRENT, MAXIMUM_CURRENT, "units/s", 0.0),
    "spin": _Field((3,), -MAXIMUM_SPIN, MAXIMUM_SPIN, "rad/s", 0.0),
    "current": _Field((3,), -MAXIMUM_CURRENT, MAXIMUM_CURRENT, "units/s", 0.0),
    "drag": _Field((2,), 0.0, 10.0, "", 1.0),
    "fin_density": _Field((), 0.0, 100.0, "", 1.0),
    "servo_gain": _Field((3,), -2.0, 2.0, "", 1.0),
    "servo_lag": _Field((), 0.0, 1.0, "s", 0.0),
    "gyro_noise": _Field((), 0.0, MAXIMUM_SPIN, "rad/s", 0.0),
    "sensor_bias": _Field((9,), -MAXIMUM_SPIN, MAXIMUM_SPIN, "", 0.0),
    "sensor_scale": _Field((9,), -LARGEST_SCALE, LARGEST_SCALE, "", 1.0),
    "sensor_delay": _Field((9,), 0.0, LONGEST_DELAY, "s", 0.0),
    "sensor_hold": _Field((9,), 0.0, LONGEST_DELAY, "s", 0.0),
    "servo_delay": _Field((3,), 0.0, LONGEST_DELAY, "s", 0.0),
    "servo_hold": _Field((3,), 0.0, LONGEST_DELAY, "s", 0.0),
}


#: The fields of late, slow and scaled channels.
LATE_FIELDS = ("sensor_scale", "sensor_delay", "sensor_hold", "servo_delay", "servo_hold")


@dataclass(frozen=True, eq=False)
class Scenario:
    """What B robots are, what they swim in, and what breaks when.

    :meth:`create` checks its arguments and fills in defaults. The class itself, and
    ``dataclasses.replace``, trust their caller.

    Examples
    --------
    >>> scenario = Scenario.create(servo_gain=[(1.0, 1.0, 1.0), (1.0, 0.0, 1.0)])
    >>> len(scenario), scenario.body.shape, scenario.take(1).servo_gain.tolist()
    (2, (2, 9), [[1.0, 0.0, 1.0]])
    """

    body: Floats  # (B, 9) fin sizes in the order of ``DIMENSIONS``, units of 5 cm
    fin_angles: Floats  # (B, 3) at the start: pectorals' angles, caudal phase, rad; NaN: random
    velocity: Floats  # (B, 3) at the start, body axes, units/s
    spin: Floats  # (B, 3) angular velocity at the start, body axes, rad/s
    current: Floats  # (B, 3) velocity of the water in the world, units/s
    drag: Floats  # (B, 2) factors on the drag of the fins and on that of the body
    fin_density: Floats  # (B,) factor on the mass of the fins, or (B, 3) of each
    servo_gain: Floats  # (B, 3) servo speed over command; 0 is seized, -1 reversed
    servo_lag: Floats  # (B,) delay from a command to the servos' motion, s
    gyro_noise: Floats  # (B,) standard deviation in each observation and axis, rad/s
    sensor_bias: Floats  # (B, 9) added to each of ``CHANNELS``; of the gyro in rad/s
    sensor_scale: Floats  # (B, 9) factor on each channel
    sensor_delay: Floats  # (B, 9) age of what each channel is observed to say, s
    sensor_hold: Floats  # (B, 9) for how long each channel repeats a reading, s; 0 is not at all
    servo_delay: Floats  # (B, 3) age of the action that each servo follows, s
    servo_hold: Floats  # (B, 3) for how long each servo keeps to an action, s; 0 is not at all
    sensor_stuck: Flags  # (B, 9) whether each channel repeats its first observation
    sensor_dropped: Flags  # (B, 9) whether each channel is observed as 0
    faults: NDArray[np.int64]  # (B,) how many faults each robot has
    reactive: bool = False  # whether the water has added mass too; kernels are compiled for it
    schedule: tuple[Change, ...] = ()  # what changes after the start, in the order of its steps

    @classmethod
    def create(cls, body: object = None, *, reactive: bool = False, **fields: object) -> Self:
        """Return a scenario from checked arguments; a single row serves all robots.

        Parameters
        ----------
        body
            (B, 9) sizes, a ``Morphology``, a list of them, or None for the nominal body.
        reactive
            Whether the water also resists acceleration.
        **fields
            Other fields, (B, ...) or one row without its axis; each has a default that changes
            nothing. A single ``servo_gain`` is for all three servos. ``Damage.edit`` sets stuck and
            dropped sensors.

        Raises
        ------
        InvalidArgumentError, UnknownNameError
            If a field has the wrong shape or range, the fields differ in length, or there is no
            such field.
        """
        tables = {name: check_field(name, value) for name, value in fields.items()}
        spread = broadcast({"body": check_field("body", body), **tables})
        return cls.fill(spread, flag("reactive", reactive))

    @classmethod
    def fill(cls, fields: Mapping[str, NDArray[Any]], reactive: bool = False) -> Self:
        """Return a scenario of checked ``fields`` (B, ...), "body" among them, and of defaults."""
        batch = len(fields["body"])
        missing: dict[str, Any] = {
            name: np.full((batch, *field.row), field.default)
            for name, field in _FIELDS.items()
            if name not in fields
        }
        for name in ("sensor_stuck", "sensor_dropped"):
            missing[name] = np.zeros((batch, len(CHANNELS)), np.bool_)
        missing["faults"] = np.zeros(batch, np.int64)
        return cls(**{**missing, **fields}, reactive=reactive)

    def __len__(self) -> int:
        return len(self.body)

    @property
    def is_late(self) -> bool:
        """Whether a channel of any robot, as they are now, is late, slow or scaled."""
        scaled = bool((self.sensor_scale != 1.0).any())
        return scaled or any(
            vars(self)[name].any() for name in LATE_FIELDS if name != "sensor_scale"
        )

    def __repr__(self) -> str:
        return f"Scenario(B={len(self)}, {len(self.schedule)} changes)"

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the fields that have a row for each robot, by name."""
        return {name: value for name, value in vars(self).items() if isinstance(value, np.ndarray)}

    def copy(self) -> Self:
        """Return the scenario in arrays of its own, which may be written to."""
        own: dict[str, Any] = {name: value.copy() for name, value in self.arrays().items()}
        return replace(self, **own)

    def take(self, rows: Any) -> Self:
        """Return the robots that ``rows`` selects, as numpy would from (B,), schedule included."""
        chosen = np.atleast_1d(np.arange(len(self))[rows])
        taken: dict[str, Any] = {name: value[chosen] for name, value in self.arrays().items()}
        changes = [change.of_rows(chosen) for change in self.schedule]
        schedule = tuple(change for change in changes if len(change.rows))
        return replace(self, **taken, schedule=schedule)

    def draw_angles(self, rngs: Sequence[np.random.Generator]) -> Self:
        """Return the scenario with the angles of fins drawn whose servos are dead from the start.

        Each robot draws from its own generator; ``rngs`` are B. Other angles stay as they are.

        Raises
        ------
        InvalidArgumentError
            If ``rngs`` are no B generators.
        """
        rngs = sequence("rngs", rngs)
        if len(rngs) != len(self) or not all(isinstance(rng, np.random.Generator) for rng in rngs):
            raise InvalidArgumentError(
                f"rngs must be {len(self)} generators of numpy, one for each robot; "
                f"got {brief(rngs)}"
            )
        unknown = np.argwhere(np.isnan(self.fin_angles)).tolist()
        if not unknown:
            return self
        angles = self.fin_angles.copy()
        for robot, fin in unknown:
            angles[robot, fin] = rngs[robot].uniform(-np.pi, np.pi)
        return replace(self, fin_angles=angles)

    def check_angles(self) -> None:
        """Raise InvalidArgumentError if the angle of a dead servo's fin has not been drawn yet."""
        unknown = np.argwhere(np.isnan(self.fin_angles)).tolist()
        if unknown:
            robot, fin = unknown[0]
            raise InvalidArgumentError(
                f"scenario must have fin angles where a swim begins: robot {robot} has a dead "
                f"{FINS[fin]} servo, whose angle is random; draw it with scenario.draw_angles(rngs)"
            )

    def stages(self) -> list[Scenario]:
        """Return the robots at the start, and those of each change."""
        return [self, *(change.to for change in self.schedule)]

    def segments(self, steps: int) -> Iterator[Segment]:
        """Yield the stretches of ``steps`` steps of 0.01 s in which no robot changes, in order.

        The robots begin as the scenario says. Each later stretch begins with a change of the
        schedule; one at step 0 comes first.
        """
        changes = [change for change in self.schedule if change.step < steps]
        ends = [change.step for change in changes] + [steps]
        if ends[0] > 0:
            yield Segment(0, ends[0], None)
        for change, end in zip(changes, ends[1:], strict=True):
            yield Segment(change.step, end, change)

    @staticmethod
    def concatenate(scenarios: Sequence[Scenario]) -> Scenario:
        """Return the robots of several scenarios, one after another, in one."""
        if len({one.reactive for one in scenarios}) != 1:
            raise InvalidArgumentError("scenarios must be one or more, reactive all or none")
        names = scenarios[0].arrays()
        joined: dict[str, Any] = {
            name: np.concatenate([vars(one)[name] for one in scenarios]) for name in names
        }
        changes: dict[int, list[Change]] = {}
        first = 0
        for one in scenarios:
            for step, rows, to in one.schedule:
                changes.setdefault(step, []).append(Change(step, rows + first, to))
            first += len(one)
        schedule = tuple(
            Change(
                step,
                np.concatenate([change.rows for change in those]),
                Scenario.concatenate([change.to for change in those]),
            )
            for step, those in sorted(changes.items())
        )
        return replace(scenarios[0], **joined, schedule=schedule)


class Segment(NamedTuple):
    """Steps of 0.01 s, from ``begin`` to before ``end``, in which no robot changes."""

    begin: int
    end: int
    change: Change | None  #: What changes when it begins, if anything.


class Change(NamedTuple):
    """A change of some robots of a scenario."""

    #: The first step of 0.01 s that it affects; at 0 the fins only begin with the speed of before.
    step: int
    rows: NDArray[np.intp]  #: (n,) which robots, in ascending order.
    #: The n robots from then on, in the same order. They keep their motion: ``fin_angles``,
    #: ``velocity`` and ``spin`` are ignored.
    to: Scenario

    def of_rows(self, chosen: NDArray[np.intp]) -> Change:
        """Return the change as it affects the robots ``chosen`` (m,), numbered from 0 on."""
        rows = np.flatnonzero(np.isin(chosen, self.rows))
        return Change(self.step, rows, self.to.take(np.searchsorted(self.rows, chosen[rows])))


def check_field(name: str, value: object, argument: str = "") -> NDArray[Any]:
    """Return a field's table (n, ...) from whatever describes it; ``argument`` is for messages.

    Raises
    ------
    InvalidArgumentError
        If it has not the shape or range of that field.
    """
    argument = argument or name
    if name == "body":
        return body_array(value, argument)  # type: ignore[arg-type]
    row, low, high, unit, _ = _FIELDS[one_of("field", name, _FIELDS)]
    if name == "servo_gain" and isinstance(value, Real | Decimal):
        value = [value] * 3
    return finite_array(argument, value, (None, *row), low, high, unit, flat=True)  # type: ignore[arg-type]


def check_row(name: str, value: object, argument: str = "") -> Floats:
    """Return one robot's row of a field other than the body; see :func:`check_field`."""
    row, low, high, unit, _ = _FIELDS[name]
    return finite_array(argument or name, value, row, low, high, unit)  # type: ignore[arg-type]


def broadcast(tables: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Return tables (n, ...) as (B, ...), all of one length; those of one row are repeated.

    Raises
    ------
    InvalidArgumentError
        If they have neither one row nor equally many.
    """
    lengths = {len(table) for table in tables.values()}
    batch = 0 if 0 in lengths else max(lengths)
    if lengths - {1, batch}:
        *most, last = tables
        raise InvalidArgumentError(
            f"{', '.join(most)} and {last} must be equally many, or one for all; "
            f"got {', '.join(str(len(table)) for table in tables.values())}"
        )
    # Repeating is several times faster than broadcasting and copying.
    return {
        name: np.ascontiguousarray(table if len(table) == batch else table.repeat(batch, axis=0))
        for name, table in tables.items()
    }
