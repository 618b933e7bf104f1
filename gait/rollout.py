"""Swims of controllers: a population in the compiled engine, or one robot in any engine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.bodies import MorphologiesLike, body_array
from aquafish_gym.engines.api import TIMESTEP, check_engine
from aquafish_gym.engines.worlds import Triple
from aquafish_gym.morphology import Morphology, MorphologyLike
from aquafish_gym.rollout import rollout
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.validation import InvalidArgumentError, finite_array, integer, one_of
from aquafish_gym.world_config import WorldConfig
from gait.controller import INTERVAL, MAXIMUM_SEED, Controller, program_of
from gait.policy import ControllerLike, new_policy

SECONDS = 20.0  # Sec. 5: "as far forward as possible in 20 seconds"
MAXIMUM_POSES = 10_000
MAXIMUM_THREADS = 1024
_MODEL_WORLD = WorldConfig()  # made once: its checks take as long as a short swim
ZERO_POSE = (0.0, 0.0, 0.0)  # both flippers arms-back, the tail straight

# "gait" in ASCII. One seed often serves the environments and the estimation, too, whose streams
# follow from the bare seed: without this a run's poses would be the angles that the target hides.
_GAIT = 0x67616974


@dataclass(frozen=True)
class Swim:
    """One swim, sampled at its start and after each command of 0.05 s.

    Attributes
    ----------
    time
        (T,) in s.
    position
        (T, 3) of the capsule's centre in the world, units of 5 cm, from the origin.
    quaternion
        (T, 4) from body to world, (x, y, z, w).
    fin_angles
        (T, 3) left and right pectoral angle and caudal phase, in rad.
    current
        Velocity of the water in the world, in units/s.
    gyro, commands
        (N, 3) gyroscope at the end of each 0.01 s, rad/s about the body's axes, and the command
        until then, rev/s, rev/s and Hz; None for a swim read from a file.

    Examples
    --------
    >>> still = swim(lambda observation, time: (0.0, 0.0, 0.0), None, engine="numba", seconds=1)
    >>> len(still.time)
    21
    """

    time: NDArray[np.float64]
    position: NDArray[np.float64]
    quaternion: NDArray[np.float64]
    fin_angles: NDArray[np.float64]
    current: Triple = field(default=(0.0, 0.0, 0.0), kw_only=True)
    gyro: NDArray[np.float64] | None = field(default=None, kw_only=True)
    commands: NDArray[np.float64] | None = field(default=None, kw_only=True)

    @property
    def distance(self) -> float:
        """Distance along the world's +y relative to the water, in units; NaN if it diverged.

        A gait gains nothing from a current that carries it. ``position`` is over ground.
        """
        return float(self.position[-1, 1] - self.current[1] * self.time[-1])

    def __repr__(self) -> str:
        return f"Swim(distance {self.distance:.2f} units in {self.time[-1]:g} s)"


def stream(seed: int, *key: int) -> np.random.SeedSequence:
    """Return this package's random stream ``key`` of a seed."""
    return np.random.SeedSequence([_GAIT, integer("seed", seed, 0, MAXIMUM_SEED)], spawn_key=key)


def random_poses(count: int, seed: int | np.random.SeedSequence) -> NDArray[np.float64]:
    """Return ``count`` random fin angles (count, 3), uniform over whole turns, in rad."""
    source = seed if isinstance(seed, np.random.SeedSequence) else stream(seed)
    size = (integer("count", count, 0, MAXIMUM_POSES), 3)
    return np.random.default_rng(source).uniform(-np.pi, np.pi, size)


def swim_all(
    controllers: Sequence[Controller],
    morphologies: MorphologiesLike,
    fin_angles: ArrayLike = (ZERO_POSE,),
    seconds: float = SECONDS,
    dtype: str = "float32",
    threads: int | None = None,
    world: WorldConfig | None = None,
    believed: ArrayLike | None = None,
    believed_gain: ArrayLike = (1.0, 1.0, 1.0),
) -> NDArray[np.float64]:
    """Return how far each controller swims in each swim, in one batch of the compiled engine.

    Parameters
    ----------
    controllers
        P controllers.
    morphologies
        Q bodies, or one for all: one as ``Morphology.coerce`` takes it, a list, or (Q, 9) sizes.
    fin_angles
        (Q, 3) initial left and right pectoral angle and caudal phase, rad; (1, 3) for all bodies.
        The i-th body swims from the i-th pose; see also ``fitness.every_pair``.
    seconds
        Length of a swim.
    dtype
        ``"float32"`` or ``"float64"``.
    threads
        None uses every core; no result depends on it.
    world
        The water and the servos, without a lag; None is ``WorldConfig()``.
    believed, believed_gain
        What controllers that sense their fins assume: initial angles (Q, 3) or (1, 3) in rad, None
        for the true ones, and servo gains (3,) or (Q, 3).

    Returns
    -------
    ndarray
        (P, Q) ``Swim.distance`` in units of 5 cm; NaN where a robot diverged.

    Raises
    ------
    InvalidArgumentError, UnknownNameError
        If an argument does not fit.

    Examples
    --------
    >>> swim_all([], [Morphology.nominal(), {"caudal": (0.0, 0.0, 0.0)}]).shape
    (0, 2)
    """
    world = lane_world(world)
    bodies = body_array(morphologies)
    if threads is not None:
        integer("threads", threads, 1, MAXIMUM_THREADS)
    poses = finite_array("fin_angles", fin_angles, (None, 3), unit="rad")
    swims = len(bodies) if len(poses) == 1 else len(poses)
    if len(bodies) not in (1, swims):
        raise InvalidArgumentError(
            "morphologies and fin_angles must be equally many, or one for all; "
            f"got {len(bodies)} and {len(poses)}"
        )
    steps = step_count(seconds)
    kind = np.float32 if one_of("dtype", dtype, ("float32", "float64")) == "float32" else np.float64
    angles, gains = _beliefs(poses, swims, believed, believed_gain)
    distances = np.empty((len(controllers), swims))
    if not distances.size:
        return distances
    fields = {
        "body": np.broadcast_to(bodies, (swims, 9)),
        "fin_angles": np.broadcast_to(poses, (swims, 3)),
    }
    scenario = world.edit(Scenario.fill(fields))
    kinds: dict[tuple[Any, ...], list[int]] = {}
    for i, controller in enumerate(controllers):
        kinds.setdefault(controller.kind, []).append(i)
    for those in kinds.values():
        some = [controllers[i] for i in those]
        found = rollout(
            program_of(some, swims),
            scenario.take(np.tile(np.arange(swims), len(some))),
            seconds=steps * TIMESTEP,
            believed=np.tile(angles, (len(some), 1)),
            believed_gain=np.tile(gains, (len(some), 1)),
            dtype=kind,
            threads=threads,
            substeps=world.substeps,
        )
        far = found.end[:, 1] - world.current[1] * (steps * TIMESTEP)
        distances[those] = far.reshape(len(some), swims)
    return distances


def _beliefs(
    poses: NDArray[np.float64], swims: int, believed: ArrayLike | None, gain: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the assumed fin angles (Q, 3) and servo gains (Q, 3) of each swim."""
    rows = {
        "believed": finite_array(
            "believed", poses if believed is None else believed, (None, 3), unit="rad"
        ),
        "believed_gain": finite_array("believed_gain", gain, (None, 3), flat=True),
    }
    for name, table in rows.items():
        if len(table) not in (1, swims):
            raise InvalidArgumentError(
                f"{name} must be one for all swims or {swims}; got {len(table)}"
            )
    angles, gains = rows.values()
    return np.broadcast_to(angles, (swims, 3)), np.broadcast_to(gains, (swims, 3))


def swim(
    controller: ControllerLike,
    morphology: MorphologyLike,
    fin_angles: ArrayLike = ZERO_POSE,
    engine: str = "auto",
    seconds: float = SECONDS,
    world: WorldConfig | None = None,
    believed: ArrayLike | None = None,
    believed_gain: ArrayLike = (1.0, 1.0, 1.0),
) -> Swim:
    """Return the path of one robot.

    Parameters
    ----------
    controller
        A function from observation and time to an action (see ``gait.Policy``), or an object with
        a method ``policy`` that returns one: an evolved or learned controller, or your own.
    morphology
        Its body, as ``Morphology.coerce`` takes it.
    fin_angles
        (3,) initial left and right pectoral angle and caudal phase, rad.
    engine
        ``"pybullet"``, ``"numba"`` (compiled, float64), or ``"auto"``: PyBullet if installed.
    seconds
        Length of the swim.
    world
        The water and the servos; None is ``WorldConfig()``.
    believed, believed_gain
        What a controller that senses its fins assumes: initial angles (3,) in rad, None for the
        true ones, and servo gains (3,).

    Raises
    ------
    InvalidArgumentError
        If an argument does not fit, or the controller returns no action.
    EngineUnavailableError
        If the engine's package is missing.
    """
    angles = finite_array("fin_angles", fin_angles, (3,), unit="rad")
    body = Morphology.coerce(morphology).to_array()
    steps = step_count(seconds)
    if isinstance(controller, Controller):
        policy = controller.policy(angles if believed is None else believed, believed_gain)
    else:
        policy = new_policy(controller)
    config = world or WorldConfig()
    found = rollout(
        [policy],
        config.edit(Scenario.fill({"body": body[None], "fin_angles": angles[None]})),
        engine=check_engine(engine),
        seconds=steps * TIMESTEP,
        interval=INTERVAL,
        record="path",
        substeps=config.substeps,
    )
    return Swim(
        found.path.time,
        found.path.position[0],
        found.path.quaternion[0],
        found.path.fin_angles[0],
        current=config.current,
        gyro=found.path.gyro[0],
        commands=found.path.commands[0],
    )


def lane_world(world: WorldConfig | None) -> WorldConfig:
    """Return a world without a lag, which batches do not have; None is the default."""
    world = world or _MODEL_WORLD
    if world.lag:
        raise InvalidArgumentError(
            f"world.lag must be 0 in a batch; got {world.lag:g} s. gait.swim has lags"
        )
    return world


def step_count(seconds: float) -> int:
    """Return the physics steps in a time, which is at most an hour."""
    time = float(finite_array("seconds", seconds, (), TIMESTEP, 3600.0, "s"))
    return round(time / TIMESTEP)
