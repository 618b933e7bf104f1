"""The scenario of a simulation: B robots, the water they swim in, and what breaks when.

Damage, tiers, worlds that differ from their models, fault hypotheses and nuisance parameters are
edits of a :class:`Scenario`'s fields. Engines simulate it. It is a table of R rows, one at least
for each robot, which swims on as the next row says once its step has come.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal
from numbers import Real
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.bodies import body_array
from aquafish_gym.plans import AQUAFISH, BodyPlan, PlanLike, check_plan, plan_of
from aquafish_gym.stages import NEVER, Player, Stages
from aquafish_gym.utils.array_types import Flags, Floats, Rows
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
LARGEST_GAIN = 2.0  # of a servo
LARGEST_SCALE = 100.0  # factor of a sensor
LONGEST_DELAY = 100.0  # s, of a channel of the robot
#: What the inertial measurement unit observes: two directions and the angular velocity.
CHANNELS = tuple(f"{sense}_{axis}" for sense in ("up", "north", "gyro") for axis in "xyz")
GYRO_CHANNELS = slice(CHANNELS.index("gyro_x"), len(CHANNELS))


class _Field(NamedTuple):
    """The shape of one robot's row, its range, its unit and its default.

    A shape of ``FINS`` is a number for each fin.
    """

    row: tuple[int, ...]
    low: float
    high: float
    unit: str
    default: float


FINS = (-1,)
_OF_CHANNELS = (len(CHANNELS),)
# Every field that a user may set, except the body, whose ranges the plan states.
_FIELDS: dict[str, _Field] = {
    "fin_angles": _Field(FINS, -np.inf, np.inf, "rad", 0.0),
    "velocity": _Field((3,), -MAXIMUM_CURRENT, MAXIMUM_CURRENT, "units/s", 0.0),
    "spin": _Field((3,), -MAXIMUM_SPIN, MAXIMUM_SPIN, "rad/s", 0.0),
    "current": _Field((3,), -MAXIMUM_CURRENT, MAXIMUM_CURRENT, "units/s", 0.0),
    "drag": _Field((2,), 0.0, 10.0, "", 1.0),
    "fin_density": _Field((), 0.0, 100.0, "", 1.0),
    "servo_gain": _Field(FINS, -LARGEST_GAIN, LARGEST_GAIN, "", 1.0),
    "servo_lag": _Field((), 0.0, 1.0, "s", 0.0),
    "gyro_noise": _Field((), 0.0, MAXIMUM_SPIN, "rad/s", 0.0),
    "sensor_bias": _Field(_OF_CHANNELS, -MAXIMUM_SPIN, MAXIMUM_SPIN, "", 0.0),
    "sensor_scale": _Field(_OF_CHANNELS, -LARGEST_SCALE, LARGEST_SCALE, "", 1.0),
    "sensor_delay": _Field(_OF_CHANNELS, 0.0, LONGEST_DELAY, "s", 0.0),
    "sensor_hold": _Field(_OF_CHANNELS, 0.0, LONGEST_DELAY, "s", 0.0),
    "servo_delay": _Field(FINS, 0.0, LONGEST_DELAY, "s", 0.0),
    "servo_hold": _Field(FINS, 0.0, LONGEST_DELAY, "s", 0.0),
}


def _row(name: str, plan: BodyPlan) -> tuple[int, ...]:
    """Return the shape of one robot's row of a field."""
    row = _FIELDS[name].row
    return (len(plan.fins),) if row == FINS else row


#: The fields that say how a robot begins. The others say what it is, from a step on.
STARTS = ("fin_angles", "velocity", "spin")
_TIMES = ("first", "since", "until")
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

    fin_angles: Floats  # (B, F) at the start: angles, phases of fins that sweep, rad; NaN: random
    velocity: Floats  # (B, 3) at the start, body axes, units/s
    spin: Floats  # (B, 3) angular velocity at the start, body axes, rad/s
    # The rows of the table. Where nothing changes R is B, and row i is robot i.
    body: Floats  # (R, S) fin sizes in the order of the plan's ``dimensions``, units of 5 cm
    current: Floats  # (R, 3) velocity of the water in the world, units/s
    drag: Floats  # (R, 2) factors on the drag of the fins and on that of the body
    fin_density: Floats  # (R,) factor on the mass of the fins, or (R, F) of each
    servo_gain: Floats  # (R, F) servo speed over command; 0 is seized, -1 reversed
    servo_lag: Floats  # (R,) delay from a command to the servos' motion, s
    gyro_noise: Floats  # (R,) standard deviation in each observation and axis, rad/s
    sensor_bias: Floats  # (R, 9) added to each of ``CHANNELS``; of the gyro in rad/s
    sensor_scale: Floats  # (R, 9) factor on each channel
    sensor_delay: Floats  # (R, 9) age of what each channel is observed to say, s
    sensor_hold: Floats  # (R, 9) for how long each channel repeats a reading, s; 0 is not at all
    servo_delay: Floats  # (R, F) age of the action that each servo follows, s
    servo_hold: Floats  # (R, F) for how long each servo keeps to an action, s; 0 is not at all
    sensor_stuck: Flags  # (R, 9) whether each channel repeats its first observation
    sensor_dropped: Flags  # (R, 9) whether each channel is observed as 0
    faults: NDArray[np.int64]  # (R,) how many faults each robot has
    first: Rows  # (B,) the row with which each robot begins; its others follow
    since: Rows  # (R,) the step of 0.01 s from which each row holds
    until: Rows  # (R,) the step from which the next one does; ``NEVER`` in a robot's last row
    #: By how much fields (R, ...) grow in every ``stride`` steps of a row.
    rates: Mapping[str, Floats] = field(default_factory=dict)
    stride: int = 1
    reactive: bool = False  # whether the water has added mass too; kernels are compiled for it
    plan: BodyPlan = AQUAFISH

    @classmethod
    def create(
        cls,
        body: object = None,
        *,
        reactive: bool = False,
        plan: PlanLike | None = None,
        **fields: object,
    ) -> Self:
        """Return a scenario from checked arguments; a single row serves all robots.

        Parameters
        ----------
        body
            (B, S) sizes, a ``Morphology``, a list of them, or None for the nominal body.
        reactive
            Whether the water also resists acceleration.
        plan
            Of all robots, or its name in ``PLANS``. None is that of the bodies, else the paper's.
        **fields
            Other fields, (B, ...) or one row without its axis; each has a default that changes
            nothing. A single ``servo_gain`` is for all servos. ``Damage.edit`` sets stuck and
            dropped sensors.

        Raises
        ------
        InvalidArgumentError, UnknownNameError
            If a field has the wrong shape or range, the fields differ in length, or there is no
            such field.
        """
        plan = check_plan(plan_of(body) if plan is None else plan)
        tables = {name: check_field(name, value, plan) for name, value in fields.items()}
        spread = broadcast({"body": check_field("body", body, plan), **tables})
        return cls.fill(spread, flag("reactive", reactive), plan)

    @classmethod
    def fill(
        cls,
        fields: Mapping[str, NDArray[Any]],
        reactive: bool = False,
        plan: BodyPlan = AQUAFISH,
    ) -> Self:
        """Return a scenario of checked ``fields`` (B, ...), "body" among them, and of defaults."""
        batch = len(fields["body"])
        missing: dict[str, Any] = {
            name: np.full((batch, *_row(name, plan)), field.default)
            for name, field in _FIELDS.items()
            if name not in fields
        }
        for name in ("sensor_stuck", "sensor_dropped"):
            missing[name] = np.zeros((batch, len(CHANNELS)), np.bool_)
        missing["faults"] = np.zeros(batch, np.int64)
        missing["first"] = np.arange(batch)
        missing["since"] = np.zeros(batch, np.intp)
        missing["until"] = np.full(batch, NEVER)
        return cls(**{**missing, **fields}, reactive=reactive, plan=plan)

    def __len__(self) -> int:
        return len(self.first)

    def __repr__(self) -> str:
        return f"Scenario(B={len(self)}, {len(self.until) - len(self)} changes)"

    @property
    def is_late(self) -> bool:
        """Whether a channel of any robot is ever late, slow or scaled."""
        others = [name for name in LATE_FIELDS if name != "sensor_scale"]
        return bool((self.sensor_scale != 1.0).any()) or self.has(*others)

    def has(self, *fields: str) -> bool:
        """Return whether one of these fields is ever other than 0."""
        return any(vars(self)[name].any() for name in fields)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the fields that are arrays, by name."""
        return {name: value for name, value in vars(self).items() if isinstance(value, np.ndarray)}

    def columns(self) -> dict[str, NDArray[Any]]:
        """Return the fields (R, ...) that may change in mid-swim, by name."""
        return {
            name: value
            for name, value in self.arrays().items()
            if name not in STARTS and name not in _TIMES
        }

    @property
    def stages(self) -> Stages:
        """The table of the robots' columns, in steps of 0.01 s."""
        return Stages(self.first, self.since, self.until, self.columns(), self.rates, self.stride)

    def with_stages(self, stages: Stages) -> Self:
        """Return the robots, which begin as these do, with another table."""
        fields: dict[str, Any] = {**stages._asdict(), **stages.columns}
        del fields["columns"]
        return replace(self, **fields)

    def copy(self) -> Self:
        """Return the scenario in arrays of its own, which may be written to."""
        own: dict[str, Any] = {name: value.copy() for name, value in self.arrays().items()}
        return replace(self, **own)

    def take(self, rows: Any) -> Self:
        """Return the robots that ``rows`` selects, as numpy would from (B,), all rows of each."""
        robots = np.atleast_1d(np.arange(len(self))[rows])
        starts: dict[str, Any] = {name: vars(self)[name][robots] for name in STARTS}
        stages = self.stages
        counts = stages.counts[robots]
        first = np.cumsum(counts) - counts
        chosen = np.repeat(self.first[robots] - first, counts) + np.arange(counts.sum())
        return replace(self, **starts).with_stages(
            stages._replace(
                first=first,
                since=self.since[chosen],
                until=self.until[chosen],
                columns={name: column[chosen] for name, column in stages.columns.items()},
                rates={name: rate[chosen] for name, rate in self.rates.items()},
            )
        )

    @property
    def beginning(self) -> Self:
        """The robots as they begin, without their changes."""
        if len(self.until) == len(self) and not self.rates:
            return self
        return self._unchanging({name: each[self.first] for name, each in self.columns().items()})

    def then(self, step: int, later: Scenario) -> Self:
        """Return robots without changes that become those of another scenario at a step.

        They keep their motion: the fin angles and speeds of ``later`` are ignored.
        """
        count = len(self)
        columns = {
            name: np.stack([mine, vars(later)[name]], axis=1).reshape(-1, *mine.shape[1:])
            for name, mine in self.columns().items()
        }
        since = np.tile([0, step], count)
        until = np.tile([step, NEVER], count)
        return self.with_stages(Stages(np.arange(0, 2 * count, 2), since, until, columns, {}))

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
                f"{self.plan.names[fin]} servo, whose angle is random; draw it with "
                "scenario.draw_angles(rngs)"
            )

    def segments(self, steps: int) -> Iterator[Segment]:
        """Yield the stretches of ``steps`` steps of 0.01 s in which no robot changes, in order.

        The robots begin as the scenario says. Each later stretch begins with a change of some of
        them; one at step 0 comes first.
        """
        player = Player(self.stages)
        robots = np.zeros(0, np.intp)
        begin = 0
        while begin < steps:
            to = self._unchanging(player.move(robots), robots) if len(robots) else None
            end = min(int(player.next_change.min(initial=NEVER)), steps)
            if end > begin or to is not None:
                yield Segment(begin, end, robots, to)
            robots = np.flatnonzero(player.next_change == end)
            begin = end

    def _unchanging(self, columns: Mapping[str, NDArray[Any]], robots: Any = slice(None)) -> Self:
        """Return some of the robots with columns (n, ...) that never change."""
        starts: dict[str, Any] = {name: vars(self)[name][robots] for name in STARTS}
        count = len(starts["spin"])
        times = (np.arange(count), np.zeros(count, np.intp), np.full(count, NEVER))
        return replace(self, **starts).with_stages(Stages(*times, columns, {}))

    @staticmethod
    def concatenate(scenarios: Sequence[Scenario]) -> Scenario:
        """Return the robots of several scenarios, one after another, in one."""
        strides = {one.stride for one in scenarios if one.rates}
        waters = {(one.reactive, one.plan) for one in scenarios}
        if len(waters) != 1 or len(strides) > 1:
            raise InvalidArgumentError(
                "scenarios must be one or more, of one plan, reactive all or none, and grow in "
                "equal strides"
            )
        names = scenarios[0].arrays()
        joined: dict[str, Any] = {
            name: np.concatenate([vars(one)[name] for one in scenarios]) for name in names
        }
        rows = np.cumsum([0, *(len(one.until) for one in scenarios[:-1])])
        joined["first"] = np.concatenate(
            [one.first + before for one, before in zip(scenarios, rows, strict=True)]
        )
        growing = {name for one in scenarios for name in one.rates}
        joined["rates"] = {
            name: np.concatenate(
                [one.rates.get(name, np.zeros_like(vars(one)[name])) for one in scenarios]
            )
            for name in sorted(growing)
        }
        return replace(scenarios[0], **joined, stride=max(strides, default=1))


class Segment(NamedTuple):
    """Steps of 0.01 s, from ``begin`` to before ``end``, in which no robot changes."""

    begin: int
    end: int
    robots: Rows  #: (n,) which robots change when it begins, in ascending order.
    to: Scenario | None  #: What these n are from then on; None if none changes.


def check_field(
    name: str, value: object, plan: BodyPlan = AQUAFISH, argument: str = ""
) -> NDArray[Any]:
    """Return a field's table (n, ...) from whatever describes it; ``argument`` is for messages.

    Raises
    ------
    InvalidArgumentError
        If it has not the shape or range of that field.
    """
    argument = argument or name
    if name == "body":
        return body_array(value, argument, plan)  # type: ignore[arg-type]
    _, low, high, unit, _ = _FIELDS[one_of("field", name, _FIELDS)]
    row = _row(name, plan)
    if name == "servo_gain" and isinstance(value, Real | Decimal):
        value = [value] * len(plan.fins)
    return finite_array(argument, value, (None, *row), low, high, unit, flat=True)  # type: ignore[arg-type]


def check_row(name: str, value: object, plan: BodyPlan = AQUAFISH, argument: str = "") -> Floats:
    """Return one robot's row of a field other than the body; see :func:`check_field`."""
    _, low, high, unit, _ = _FIELDS[name]
    row = _row(name, plan)
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
