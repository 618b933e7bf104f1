"""What the single and the batched environment share: arguments, senses, start, information."""

from __future__ import annotations

import math
from bisect import bisect
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import ArrayLike, NDArray

from aquafish_gym import command
from aquafish_gym.damage import Damage
from aquafish_gym.envs.course import Course, course_of
from aquafish_gym.envs.tasks import Memory
from aquafish_gym.imu import GOAL_RANGE, GYRO_RANGE
from aquafish_gym.morphology import Morphology
from aquafish_gym.physics.arithmetic import TAU, Number, Vector
from aquafish_gym.scenario import MAXIMUM_CURRENT, TIMESTEP
from aquafish_gym.utils.validation import InvalidArgumentError, brief, finite_array, integer, one_of

Floats = NDArray[np.float64]
Triple = tuple[float, float, float]

RECKONED = "reckoned"
OPTIONS = ("fin_angles", "morphology", "damage")


@dataclass(frozen=True)
class Conditions:
    """The robot, its water and how its fins stand at first; from :func:`check_conditions`.

    ``fin_angles`` is ``"random"`` or three angles in rad; an episode lasts so many ``seconds``.
    """

    morphology: Morphology
    damage: Damage
    fin_angles: str | Triple
    current: Triple
    seconds: float

    @cached_property
    def _courses(self) -> dict[float, Course]:
        return {}

    def _course(self, dt: float) -> Course:
        # To hash a damage for every robot would take longer than all else that a reset does.
        if dt not in self._courses:
            self._courses[dt] = course_of(self.damage, self.morphology, dt)
        return self._courses[dt]

    def with_options(self, options: object, also: tuple[str, ...] = ()) -> Conditions:
        """Return one episode's, with the options of ``reset``; those in ``also`` are not read."""
        if options is None:
            return self
        if not isinstance(options, Mapping):
            raise InvalidArgumentError(f"options must be a dictionary; got {brief(options)}")
        for name in options:
            one_of("options", name, OPTIONS + also)
        found = replace(
            self,
            morphology=Morphology.coerce(options.get("morphology", self.morphology)),
            damage=Damage.coerce(options.get("damage", self.damage)),
            fin_angles=check_fin_angles(options.get("fin_angles", self.fin_angles)),
        )
        for fault in found.damage:
            latest = fault.onset[1] if isinstance(fault.onset, tuple) else fault.onset
            if latest >= self.seconds:
                raise InvalidArgumentError(
                    f"damage must strike before the episode ends at {self.seconds:g} s; got {fault}"
                )
        if not found.damage.is_random:
            course_of(found.damage, found.morphology, 1.0)  # raises if it does not fit the body
        return found

    def draw(
        self, rng: np.random.Generator, dt: float, begin: Callable[[np.random.Generator], Memory]
    ) -> tuple[Course, Floats, Memory]:
        """Return what happens in an episode of steps of ``dt`` s, angles (3,) in rad, and a memory.

        That is what ``begin`` draws. Damage draws after it, so that from one seed a broken robot is
        to do what a whole one is.
        """
        if isinstance(self.fin_angles, str):
            angles = rng.uniform(-math.pi, math.pi, 3)
        else:
            angles = np.array(self.fin_angles)
        memory = begin(rng)
        if self.damage.is_random:
            course = course_of(self.damage.drawn(rng), self.morphology, dt)
        else:
            course = self._course(dt)
        for fin, stands in enumerate(course.effects[0].stands):
            if stands is not None:
                random = isinstance(stands, str)
                angles[fin] = rng.uniform(-math.pi, math.pi) if random else stands
        return course, angles, memory


def check_conditions(
    morphology: object, damage: object, current: ArrayLike, fin_angles: object, seconds: float
) -> Conditions:
    """Return conditions from an environment's arguments."""
    water = finite_array("current", current, (3,), -MAXIMUM_CURRENT, MAXIMUM_CURRENT, "units/s")
    x, y, z = water.tolist()
    whole = Conditions(Morphology.nominal(), Damage(), (0.0, 0.0, 0.0), (x, y, z), seconds)
    return whole.with_options(
        {"morphology": morphology, "damage": damage, "fin_angles": fin_angles}
    )


def check_fin_angles(value: object) -> str | Triple:
    """Return ``"random"`` or three angles in rad from ``"zero"``, ``"random"`` or three angles."""
    if isinstance(value, str):
        random = one_of("fin_angles", value, ("zero", "random")) == "random"
        return "random" if random else (0.0, 0.0, 0.0)
    left, right, phase = finite_array("fin_angles", value, (3,)).tolist()  # type: ignore[arg-type]
    return (left, right, phase)


def check_frame_skip(value: object, seconds: float) -> int:
    """Return the physics steps in each control step, of which an episode is a whole number."""
    steps = round(seconds / TIMESTEP)
    skip = integer("frame_skip", value, 1, steps)
    if steps % skip:
        divisors = [n for n in range(1, steps + 1) if steps % n == 0]
        after = bisect(divisors, skip)
        low, high = divisors[after - 1 : after + 1]
        raise InvalidArgumentError(
            f"frame_skip must divide {steps}, the physics steps of an episode of "
            f"{seconds:g} s; got {skip}; the nearest are {low} and {high}"
        )
    return skip


def check_action(action: object, shape: tuple[int, ...]) -> Floats:
    """Return an action as float64 of this shape, clipped to [-1, 1]."""
    if type(action) is np.ndarray and action.shape == shape and action.dtype.char in "efd":
        checked = action.astype(np.float64, "F")  # whose columns batches work on
        if np.isfinite(checked).all():
            return np.minimum(np.maximum(checked, -1.0, out=checked), 1.0, out=checked)
    return finite_array("action", action, shape).clip(-1.0, 1.0)  # type: ignore[arg-type]


def check_single_action(action: object) -> Triple:
    """Return ``check_action(action, (3,))`` as plain floats, which one robot is quicker with."""
    if type(action) is np.ndarray and action.shape == (3,) and action.dtype.char in "fd":
        left, right, caudal = action.tolist()
        # NaN fails this, too, and is refused below.
        if -1.0 <= left <= 1.0 and -1.0 <= right <= 1.0 and -1.0 <= caudal <= 1.0:
            return (left, right, caudal)
    left, right, caudal = check_action(action, (3,)).tolist()
    return (left, right, caudal)


def servo_speeds(action: Vector, gains: Vector) -> Vector:
    """Return the speeds of servos with these gains, rev/s, rev/s and Hz, for an action."""
    left, right, caudal = command.servo_speeds(action)
    return (gains[0] * left, gains[1] * right, gains[2] * caudal)


def check_observe_fins(value: object) -> tuple[bool, bool]:
    """Return whether the fins' angles are observed, and whether as reckoned rather than as true."""
    if isinstance(value, str) and value == RECKONED:
        return True, True
    if not isinstance(value, bool | np.bool_):
        raise InvalidArgumentError(
            f'observe_fins must be True, False or "{RECKONED}"; got {brief(value)}'
        )
    return bool(value), False


def reckon(angles: Vector, action: Vector, dt: float) -> Vector:
    """Return fin angles, rad, after ``dt`` s of an action, if the servos do as commanded."""
    return command.reckon(angles, command.servo_speeds(action), TAU * dt)


def action_space() -> Box[np.float32]:
    """Return the space of actions: three servos in [-1, 1]."""
    return Box(-1.0, 1.0, (3,), np.float32)


@cache
def limits(observe_fins: bool, has_goal: bool) -> Floats:
    """Return what no observation can exceed: up, north, gyro, the fins' sines and cosines, goal."""
    most = [1.0] * 6 + [np.float32(GYRO_RANGE)] * 3  # the space's bound
    most += [1.0] * 6 * observe_fins + [GOAL_RANGE] * 3 * has_goal
    found = np.array(most, np.float64)
    found.setflags(write=False)
    return found


def observation_space(observe_fins: bool, has_goal: bool) -> Box[np.float32]:
    """Return the space of observations; see ``AquaFishEnv``."""
    high = limits(observe_fins, has_goal).astype(np.float32)
    return Box(-high, high, dtype=np.float32)


def observe(
    quaternion: Iterable[Number],
    gyro: Iterable[Number],
    fin_angles: ArrayLike | None = None,
    way: Vector | None = None,
) -> NDArray[np.float32]:
    """Return what the robot feels, shape (9,), or more with the fins' angles or a goal.

    Every number may be a row (B,) instead; the answer is then (B, 9) or more. What leaves the
    observation space saturates. The quaternion is x, y, z, w, from body to world; the gyro about
    the body's axes, rad/s; the angles in rad; ``way`` is where the goal is from here, in the world.
    """
    x, y, z, w = quaternion
    xx, yz, wx = x * x, y * z, w * x
    up = (2 * (x * z - w * y), 2 * (yz + wx), 1 - 2 * (xx + y * y))
    north = (2 * (x * y + w * z), 1 - 2 * (xx + z * z), 2 * (yz - wx))
    # The world's z, then its y, in body axes: rows of the rotation matrix.
    senses = [*up, *north, *gyro]
    if fin_angles is not None:
        senses += [*np.sin(fin_angles), *np.cos(fin_angles)]
    if way is not None:
        east = (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y))
        senses += [way[0] * east[i] + way[1] * north[i] + way[2] * up[i] for i in range(3)]
    seen = np.array(senses).T
    most = limits(fin_angles is not None, way is not None)
    np.maximum(seen, -most, out=seen)
    np.minimum(seen, most, out=seen)
    return seen.astype(np.float32, "C")


def motion_info(before: Vector, after: Vector, dt: float) -> dict[str, Any]:
    """Return where the robot is and how fast it got there, in numbers or rows (B,)."""
    x, y, z = after
    square = x * x + y * y + z * z
    root = math.sqrt if isinstance(square, float) else np.sqrt
    return {
        "x_position": x,
        "y_position": y,
        "z_position": z,
        "x_velocity": (x - before[0]) / dt,
        "y_velocity": (y - before[1]) / dt,
        "z_velocity": (z - before[2]) / dt,
        "distance_from_origin": root(square),
    }
