"""Swims of controllers: a population in the compiled engine, or one robot in any engine."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.bodies import MorphologiesLike, body_array
from aquafish_gym.engines.api import TIMESTEP, check_engine
from aquafish_gym.engines.packages import MAXIMUM_THREADS
from aquafish_gym.morphology import Morphology, MorphologyLike
from aquafish_gym.physics.layout import FIELDS, STATE_ROWS, angles_of_rows
from aquafish_gym.rollout import rollout
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.array_types import Floats, Triple
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    brief,
    finite_array,
    instance,
    integer,
    one_of,
)
from aquafish_gym.world_config import WorldConfig
from gait.controllers.controller import (
    INTERVAL,
    MAXIMUM_SEED,
    Controller,
    check_controllers,
    program_of,
)
from gait.controllers.pilots import (
    AgentLike,
    Beliefs,
    make_pilot,
    own_interval,
    reckoning,
    refuse_unused,
    takes_time,
)
from gait.controllers.policy import new_policy

SECONDS = 20.0  # Sec. 5: "as far forward as possible in 20 seconds"
FRAME_SKIP = 20  # steps of 0.01 s for which the environments hold an action by default
MAXIMUM_INTERVAL = 2000
MAXIMUM_POSES = 10_000
_MODEL_WORLD = WorldConfig()  # made once: its checks take as long as a short swim
GOLDEN_RATIO = 1.2207440846057596  # of three dimensions: the root of x^4 = x + 1
ZERO_POSE = (0.0, 0.0, 0.0)  # both flippers arms-back, the tail straight

# "gait" in ASCII. One seed often serves the environments and the estimation, too, whose streams
# follow from the bare seed: without this a run's poses would be the angles that the target hides.
_GAIT = 0x67616974


@dataclass(frozen=True)
class Swim:
    """One swim, sampled at its start and after each command.

    The swim of a :class:`gait.Controller` is sampled every 0.05 s, or more often if its interval is
    no multiple of that.

    Examples
    --------
    >>> still = swim(lambda observation, time: (0.0, 0.0, 0.0), None, engine="numba", seconds=1)
    >>> len(still.time)
    21
    """

    time: Floats  #: (T,) in s.
    position: Floats  #: (T, 3) of the capsule's centre in the world, from the origin, in units.
    quaternion: Floats  #: (T, 4) from body to world, (x, y, z, w).
    fin_angles: Floats  #: (T, 3) left and right pectoral angle and caudal phase, in rad.
    #: Velocity of the water in the world, in units/s.
    current: Triple = field(default=(0.0, 0.0, 0.0), kw_only=True)
    #: (N, 3) gyroscope at the end of each 0.01 s, rad/s about the body's axes, and the command
    #: until then, rev/s, rev/s and Hz; None for a swim read from a file.
    gyro: Floats | None = field(default=None, kw_only=True)
    commands: Floats | None = field(default=None, kw_only=True)

    @property
    def distance(self) -> float:
        """Distance along the world's +y relative to the water, in units; NaN if it diverged.

        A gait gains nothing from a current that carries it. ``position`` is over ground.
        """
        return float(self.position[-1, 1] - self.current[1] * self.time[-1])

    def __repr__(self) -> str:
        return f"Swim(distance {self.distance:z.2f} units in {self.time[-1]:g} s)"


def stream(seed: int, *key: int) -> np.random.SeedSequence:
    """Return this package's random stream ``key`` of a seed."""
    return np.random.SeedSequence([_GAIT, integer("seed", seed, 0, MAXIMUM_SEED)], spawn_key=key)


def random_poses(count: int, seed: int | np.random.SeedSequence) -> NDArray[np.float64]:
    """Return ``count`` random fin angles (count, 3), uniform over whole turns, in rad."""
    source = seed if isinstance(seed, np.random.SeedSequence) else stream(seed)
    size = (integer("count", count, 0, MAXIMUM_POSES), 3)
    return np.random.default_rng(source).uniform(-np.pi, np.pi, size)


def spread_poses(count: int, seed: np.random.SeedSequence) -> NDArray[np.float64]:
    """Return ``count`` fin angles (count, 3) that fill whole turns evenly, in rad.

    Steps of the golden ratio's generalisation to three dimensions (Roberts, "The unreasonable
    effectiveness of quasirandom sequences", 2018) from a random pose: each is uniform, and their
    mean distance varies less than that of independent ones.
    """
    steps = np.outer(np.arange(count), GOLDEN_RATIO ** -np.arange(1.0, 4.0))
    turns = (np.random.default_rng(seed).uniform(size=3) + steps) % 1.0
    return np.asarray(2.0 * np.pi * turns - np.pi)


def swim_all(
    controllers: Sequence[Controller],
    morphologies: MorphologiesLike,
    fin_angles: ArrayLike = (ZERO_POSE,),
    seconds: float = SECONDS,
    dtype: str = "float32",
    threads: int | None = None,
    world: WorldConfig | None = None,
    believed: ArrayLike | None = None,
    believed_gain: ArrayLike | None = None,
    start: ArrayLike | None = None,
) -> NDArray[np.float64]:
    """Return how far each controller swims in each swim, in one batch of the compiled engine.

    Parameters
    ----------
    controllers
        P of :class:`gait.Controller`, which are compiled; for others see :func:`swim`.
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
        The water and the servos; None is ``WorldConfig()``.
    believed, believed_gain
        What controllers that sense their fins assume: initial angles (Q, 3) or (1, 3) in rad, and
        servo gains (3,) or (Q, 3). None for the true ones. Refused if none senses them.
    start
        A state (25,) in which all swims begin, as the vector environment's ``states`` has it; its
        fin angles stand for ``fin_angles``, which is then left out. None begins at rest.

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
    controllers = check_controllers(controllers)
    world = check_world(world)
    if threads is not None:
        integer("threads", threads, 1, MAXIMUM_THREADS)
    state = None if start is None else check_state(start)
    sizes = body_array(morphologies)
    given = finite_array("fin_angles", fin_angles, (None, 3), unit="rad")
    bodies, poses = pair_swims(sizes, given)
    if state is not None:
        bodies, poses = pair_swims(sizes, _only_pose(state, poses))
    swims = len(poses)
    time = step_count(seconds) * TIMESTEP
    kind = np.dtype(one_of("dtype", dtype, ("float32", "float64"))).type
    angles = None if believed is None else _for_each_swim("believed", believed, swims)
    gains = None
    if believed_gain is not None:
        gains = _for_each_swim("believed_gain", believed_gain, swims)
    sensing = not controllers or any(controller.senses.fins for controller in controllers)
    refuse_unused(sensing, "believed", believed)
    refuse_unused(sensing, "believed_gain", believed_gain)
    distances = np.empty((len(controllers), swims))
    if not distances.size:
        return distances
    first_y = 0.0 if state is None else state[FIELDS["position"]][1]
    for those in _by_kind(controllers):
        all_swims = (len(those), 1)
        robots = Scenario.fill(
            {"body": np.tile(bodies, all_swims), "fin_angles": np.tile(poses, all_swims)}
        )
        found = rollout(
            program_of([controllers[i] for i in those], swims),
            world.edit(robots),
            seconds=time,
            believed=None if angles is None else np.tile(angles, all_swims),
            believed_gain=world.servo_gain if gains is None else np.tile(gains, all_swims),
            dtype=kind,
            threads=threads,
            substeps=world.substeps,
            start=None if state is None else np.repeat(state[:, None], len(robots), axis=1),
        )
        far = found.end[:, 1] - first_y - world.current[1] * time
        distances[those] = far.reshape(len(those), swims)
    return distances


def _by_kind(controllers: Sequence[Controller]) -> Collection[list[int]]:
    """Return the numbers of the controllers of each kind, which swim together."""
    kinds: dict[tuple[Any, ...], list[int]] = {}
    for i, controller in enumerate(controllers):
        kinds.setdefault(controller.kind, []).append(i)
    return kinds.values()


def check_state(start: ArrayLike) -> Floats:
    """Return a state (25,), in the order of ``aquafish_gym.physics.layout``."""
    return finite_array("start", start, (STATE_ROWS,))


def pair_swims(bodies: Floats, poses: Floats) -> tuple[Floats, Floats]:
    """Return bodies (Q, 9) and poses (Q, 3) of Q swims, where one of either was for all."""
    swims = len(bodies) if len(poses) == 1 else len(poses)
    if len(bodies) not in (1, swims):
        raise InvalidArgumentError(
            "morphologies and fin_angles must be equally many, or one for all; "
            f"got {len(bodies)} and {len(poses)}"
        )
    return np.broadcast_to(bodies, (swims, 9)), np.broadcast_to(poses, (swims, 3))


def _only_pose(start: Floats, poses: Floats) -> Floats:
    """Return the fin angles (1, 3) of a state (25,), from which ``poses`` must not differ."""
    begun = angles_of_rows(start)[None]
    if poses.any() and not (poses == begun).all():
        raise InvalidArgumentError(
            f"fin_angles must be those of start, in which all swims begin; got {brief(poses)}"
        )
    return begun


def _for_each_swim(name: str, values: ArrayLike, swims: int) -> Floats:
    """Return values (Q, 3) from one row for all swims, or one for each."""
    table = finite_array(name, values, (None, 3), flat=name == "believed_gain")
    if len(table) not in (1, swims):
        raise InvalidArgumentError(f"{name} must be one for all swims or {swims}; got {len(table)}")
    return np.broadcast_to(table, (swims, 3))


def swim(
    controller: AgentLike,
    morphology: MorphologyLike,
    fin_angles: ArrayLike = ZERO_POSE,
    engine: str = "auto",
    seconds: float = SECONDS,
    world: WorldConfig | None = None,
    believed: ArrayLike | None = None,
    believed_gain: ArrayLike | None = None,
    interval: int | None = None,
) -> Swim:
    """Return the path of one robot.

    Parameters
    ----------
    controller
        A policy: a function of an observation and the time (see ``gait.Policy``; one that can take
        the time is given it, even if it has a default), or an object
        with a method ``policy`` that returns one, such as a :class:`gait.Controller`. Or what
        acts in an environment: a function of observations, an object with ``act``, or with
        ``predict``, as a model of stable-baselines3 (see :func:`gait.evaluate`).
    morphology, fin_angles, seconds, world
        Of one swim; otherwise as of :func:`swim_all`.
    believed, believed_gain
        What a controller, agent or model that senses its fins assumes, as of :func:`swim_all`.
        Refused if it does not, or has beliefs of its own, as an agent has of its gains.
    interval
        Steps of 0.01 s for which an action is held. None: a controller's or agent's own; else 5
        for a policy, and 20, the environments' ``frame_skip``, for what acts in one.
    engine
        ``"pybullet"``, ``"numba"`` (compiled, float64), or ``"auto"``: PyBullet if installed.

    Raises
    ------
    InvalidArgumentError
        If an argument does not fit, or the controller returns no action.
    EngineUnavailableError
        If the engine's package is missing.
    """
    angles = finite_array("fin_angles", fin_angles, (3,), unit="rad")
    body = Morphology.coerce(morphology).to_array()
    time = step_count(seconds) * TIMESTEP
    config = check_world(world)
    assumed = angles if believed is None else finite_array("believed", believed, (3,), unit="rad")
    gain = config.servo_gain if believed_gain is None else believed_gain
    gain = finite_array("believed_gain", gain, (3,))
    beliefs = Beliefs.of(controller)
    refuse_unused(beliefs.angles, "believed", believed)
    refuse_unused(beliefs.gains, "believed_gain", believed_gain)
    steps = held_steps(controller, interval)
    if isinstance(controller, Controller):
        policy = controller.policy(assumed, gain)
        steps = sampling_steps(controller)
    elif takes_time(controller):
        policy = new_policy(controller)
    else:
        pilot = make_pilot(controller, steps, steps * TIMESTEP, "controller")
        policy = reckoning(pilot, controller, assumed, gain, steps)
    (path,) = rollout(
        [policy],
        config.edit(Scenario.fill({"body": body[None], "fin_angles": angles[None]})),
        engine=check_engine(engine),
        seconds=time,
        interval=steps,
        substeps=config.substeps,
    ).paths
    return Swim(**vars(path), current=config.current)


def sampling_steps(controller: Controller) -> int:
    """Return from how many to how many steps of 0.01 s the path of a controller is sampled.

    At most the 5 of an action by default, of which its own interval must be a multiple.
    """
    return math.gcd(INTERVAL, controller.interval)


def held_steps(controller: object, interval: int | None = None) -> int:
    """Return for how many steps of 0.01 s an action of a controller is held; see ``swim``."""
    own = own_interval(controller)
    if interval is None:
        usual = INTERVAL if takes_time(controller) else FRAME_SKIP
        return usual if own is None else own
    steps = integer("interval", interval, 1, MAXIMUM_INTERVAL)
    if own not in (None, steps):
        raise InvalidArgumentError(f"interval must be {own}, the controller's; got {interval}")
    return steps


def check_world(world: WorldConfig | None) -> WorldConfig:
    """Return a world; None is the default."""
    return _MODEL_WORLD if world is None else instance("world", world, WorldConfig)


def step_count(seconds: float) -> int:
    """Return the physics steps in a time, which is at most an hour."""
    time = float(finite_array("seconds", seconds, (), TIMESTEP, 3600.0, "s"))
    return round(time / TIMESTEP)
