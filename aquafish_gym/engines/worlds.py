"""One robot at a time, told a new command every few steps: what an environment needs."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from pkgutil import resolve_name
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.engines.base import (
    MAXIMUM_CURRENT,
    MAXIMUM_DRAG,
    MAXIMUM_GAIN,
    MAXIMUM_LAG,
    MAXIMUM_SUBSTEPS,
    TIMESTEP,
)
from aquafish_gym.imu import ImuLog, unwrap_rpy
from aquafish_gym.physics.arithmetic import Vector
from aquafish_gym.physics.attitude import attitude
from aquafish_gym.physics.kinematics import State, rotation
from aquafish_gym.utils.validation import finite_array, flag, integer

Triple = tuple[float, float, float]

# A robot has diverged once the squares of its velocity (units/s) and spin (rad/s) sum to this,
# though its numbers may stay finite for some steps more. (Bullet cuts speeds off, and a runaway
# would never get to infinity there.)
RUNAWAY = 1e12


class World(Protocol):
    """One robot in the water."""

    @property
    def diverged(self) -> bool:
        """Whether it ran away; see ``RUNAWAY``."""

    def reset(self, morphology: NDArray[np.float64], fin_angles: Triple, current: Triple) -> None:
        """Put a robot of nine sizes at the origin, at rest, upright, facing +y.

        ``fin_angles`` are the left and right pectoral angle and the caudal phase, rad;
        ``current`` is the water's own velocity in the world, units/s.
        """

    def become(self, morphology: NDArray[np.float64]) -> None:
        """Give the robot another body in mid-swim; it stays where it is and moves on as it does."""

    def flow(self, current: Triple) -> None:
        """Let the water move at another velocity from now on, units/s in the world."""

    def advance(self, command: Vector, steps: int = 1) -> None:
        """Hold a command (rev/s, rev/s, Hz) for some steps of 0.01 s."""

    def state(self) -> State:
        """Return the robot's state on plain floats."""

    @property
    def fin_angles(self) -> Vector:
        """Left and right pectoral angle and caudal phase in [-pi, pi], rad."""

    def close(self) -> None:
        """Free what the world holds; closing twice does no harm."""


# Loaded when first asked for: they know this module, and it not them.
WORLDS: dict[str, str] = {
    "numba": "aquafish_gym.engines.compiled.single:CompiledWorld",
    "pybullet": "aquafish_gym.engines.bullet.world:BulletWorld",
}


class ServoWorld:
    """A world whose servos turn at gain times the command that was given ``lag`` seconds before.

    A servo's speed is steady within a step of 0.01 s: it is the mean, over the step, of what the
    command was then. Before the first command it is nothing.

    Parameters
    ----------
    world
        The world that it all happens in; it is closed with this one.
    servo_gain
        (3,) of the left, the right and the caudal servo; one that is seized has 0. Set in
        mid-swim, it holds at once, whenever the command was given.
    lag
        In s.
    """

    def __init__(self, world: World, servo_gain: Triple, lag: float) -> None:
        self.world = world
        self.servo_gain = servo_gain
        whole, self._rest = divmod(lag / TIMESTEP, 1.0)
        # The commands that lie less than lag and a step back, of which the first two count.
        self._given: deque[NDArray[np.float64]] = deque(maxlen=int(whole) + 2)
        self._forget()

    def _forget(self) -> None:
        self._given.extend(np.zeros((self._given.maxlen or 0, 3)))

    @property
    def diverged(self) -> bool:
        """Whether the robot ran away."""
        return self.world.diverged

    def reset(self, morphology: NDArray[np.float64], fin_angles: Triple, current: Triple) -> None:
        """See :class:`World`; the servos stand still again."""
        self._forget()
        self.world.reset(morphology, fin_angles, current)

    def become(self, morphology: NDArray[np.float64]) -> None:
        """See :class:`World`."""
        self.world.become(morphology)

    def flow(self, current: Triple) -> None:
        """See :class:`World`."""
        self.world.flow(current)

    def advance(self, command: Vector, steps: int = 1) -> None:
        """See :class:`World`."""
        for _ in range(steps):
            self._given.append(np.array(command))
            older, newer = self._given[0], self._given[1]
            told = np.array(self.servo_gain) * (self._rest * older + (1.0 - self._rest) * newer)
            left, right, caudal = told.tolist()
            self.world.advance((left, right, caudal))

    def state(self) -> State:
        """See :class:`World`."""
        return self.world.state()

    @property
    def fin_angles(self) -> Vector:
        """See :class:`World`."""
        return self.world.fin_angles

    def close(self) -> None:
        """See :class:`World`."""
        self.world.close()


def with_servos(world: World, servo_gain: Triple, lag: float) -> World:
    """Return the world itself if its servos do what they are told, else a :class:`ServoWorld`."""
    ideal = lag == 0.0 and servo_gain == (1.0, 1.0, 1.0)
    return world if ideal else ServoWorld(world, servo_gain, lag)


def sample(world: World) -> list[float]:
    """Return what :func:`log_of_samples` takes of a moment: 13 numbers, NaN once diverged."""
    if world.diverged:
        return [math.nan] * 13
    state = world.state()
    return [*state.position, *state.orientation, *state.spin, *world.fin_angles]


def log_of_samples(samples: NDArray[np.float64], record: str = "attitude") -> ImuLog:
    """Return the log of B robots that began upright, from their :func:`sample` s (B, T, 13).

    ``record`` is as of :func:`aquafish_gym.simulate`.
    """
    rpy = np.full((len(samples), samples.shape[1] + 1, 3), math.nan)
    lasts = np.isfinite(samples[:, :, 0]).sum(axis=1)
    for log, robot, good in zip(rpy, samples, lasts.tolist(), strict=True):
        turns = [attitude(rotation(tuple(q))) for q in robot[:good, 3:7].tolist()]
        log[: good + 1] = unwrap_rpy(np.array([(0.0, 0.0, 0.0), *turns]))
    pose = record == "pose"
    return ImuLog(
        rpy=None if record == "gyro" else rpy[:, 1:],
        gyro=None if record == "rpy" else samples[:, :, 7:10],
        position=samples[:, :, :3] if pose else None,
        quaternion=samples[:, :, 3:7] if pose else None,
        fin_angles=samples[:, :, 10:] if pose else None,
        diverged=lasts < samples.shape[1],
    )


@dataclass(frozen=True, kw_only=True)
class WorldConfig:
    """What a world is like besides the robot's body; by default, as all models have it.

    Raises
    ------
    InvalidArgumentError
        If a field is not as it should be.

    Examples
    --------
    >>> WorldConfig(servo_gain=(1.0, 0.0, 1.0), drag=(1.2, 0.9)).current
    (0.0, 0.0, 0.0)
    """

    current: Triple = (0.0, 0.0, 0.0)
    """The water's own velocity in the world, x, y and z in units/s, up to 20 each way."""
    drag: tuple[float, float] = (1.0, 1.0)
    """What the drag of the fins, and that of the body, is multiplied by: 0 to 10."""
    servo_gain: Triple = (1.0, 1.0, 1.0)
    """The left, right and caudal servo's speeds are gain times command, -2 to 2; a seized one's
    gain is 0, a reversed one's -1."""
    lag: float = 0.0
    """How long after it was given a command is obeyed, in s: 0 to 1."""
    reactive: bool = False
    """Whether the water also resists acceleration; see docs/physics.md."""
    substeps: int = 1
    """Physics steps in 0.01 s: 1 to 64."""

    def __post_init__(self) -> None:
        for name, count, low, high, unit in (
            ("current", 3, -MAXIMUM_CURRENT, MAXIMUM_CURRENT, "units/s"),
            ("drag", 2, 0.0, MAXIMUM_DRAG, ""),
            ("servo_gain", 3, -MAXIMUM_GAIN, MAXIMUM_GAIN, ""),
        ):
            values = finite_array(name, getattr(self, name), (count,), low, high, unit)
            object.__setattr__(self, name, tuple(values.tolist()))
        late = float(finite_array("lag", self.lag, (), 0.0, MAXIMUM_LAG, "s"))
        object.__setattr__(self, "lag", late)
        flag("reactive", self.reactive)
        integer("substeps", self.substeps, 1, MAXIMUM_SUBSTEPS)


def make_world(
    engine: str,
    reactive: bool = False,
    *,
    drag: ArrayLike = (1.0, 1.0),
    servo_gain: ArrayLike = (1.0, 1.0, 1.0),
    lag: float = 0.0,
    substeps: int = 1,
) -> World:
    """Return a world of an engine that ``check_engine`` allowed; reset it before its first step.

    Parameters
    ----------
    engine
        A name in ``WORLDS``.
    reactive
        Whether the water has the terms of ``physics/reactive.py``.
    drag
        (2,) what the drag of the fins, and that of the body, is multiplied by: 0 to 10.
    servo_gain
        (3,) the servos' speeds are gain times command, -2 to 2.
    lag
        How long after it was given a command is obeyed, 0 to 1 s; see :class:`ServoWorld`.
    substeps
        Physics steps in 0.01 s.

    Raises
    ------
    InvalidArgumentError
        If one of these is not as it should be.

    Examples
    --------
    >>> world = make_world("numba", servo_gain=(1.0, 0.0, 1.0))  # the right flipper is seized
    >>> world.reset(np.full(9, 0.3), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    >>> world.advance((0.5, 0.5, 0.0), steps=50)
    >>> [round(angle, 3) for angle in world.fin_angles]
    [1.571, 0.0, 0.0]
    """
    config = WorldConfig(
        drag=drag,  # type: ignore[arg-type]  # whatever makes two numbers
        servo_gain=servo_gain,  # type: ignore[arg-type]
        lag=lag,
        reactive=reactive,
        substeps=substeps,
    )
    world: World = resolve_name(WORLDS[engine])(
        reactive=config.reactive, substeps=config.substeps, drag=config.drag
    )
    return with_servos(world, config.servo_gain, config.lag)
