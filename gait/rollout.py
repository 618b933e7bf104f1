"""Swimming under a controller: whole populations in the lanes, or one robot in any engine."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.command import scale_action
from aquafish_gym.engines.base import TIMESTEP, check_engine
from aquafish_gym.engines.worlds import make_world
from aquafish_gym.morphology import Morphology, MorphologyLike
from aquafish_gym.physics.kinematics import State, rotation
from aquafish_gym.utils.validation import finite_array, integer, one_of
from gait import network
from gait.controller import Controller

SECONDS = 20.0  # Sec. 5: "as far forward as possible in 20 seconds"
INTERVAL = 5  # physics steps a command is held for, as in AquaFish-v0
ZERO_POSE = (0.0, 0.0, 0.0)  # both flippers arms-back, the tail straight

# "gait" in ASCII. The environments' and the estimation's sources of chance follow from the bare
# seed, and one seed often serves them all: without this, a run's random poses would be the very
# angles that the target hides, or that a baseline was trained from.
_GAIT = 0x67616974


class Scorer(Protocol):
    """Whatever says how far controllers swim."""

    def __call__(
        self, controllers: Sequence[Controller], fin_angles: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return distances (P, Q) for P controllers from Q initial fin angles (Q, 3)."""


@dataclass(frozen=True)
class Swim:
    """One swim, sampled at its start and after each command of 0.05 s.

    Attributes
    ----------
    time
        (T,) in s.
    position
        (T, 3) of the capsule's centre in the world, units of 5 cm; it starts at the origin.
    quaternion
        (T, 4) from body to world, (x, y, z, w).
    fin_angles
        (T, 3) left and right pectoral angle and caudal phase, in rad.
    """

    time: NDArray[np.float64]
    position: NDArray[np.float64]
    quaternion: NDArray[np.float64]
    fin_angles: NDArray[np.float64]

    @property
    def distance(self) -> float:
        """Progress forward, along the world's +y, in units; NaN if the robot diverged."""
        return float(self.position[-1, 1])


def stream(seed: int, *key: int) -> np.random.SeedSequence:
    """Return the source of chance that goes by ``key`` in this package, for a seed.

    Raises
    ------
    InvalidArgumentError
        If the seed is not a whole number of at least 0.
    """
    return np.random.SeedSequence([_GAIT, integer("seed", seed, 0)], spawn_key=key)


def random_poses(count: int, seed: int | np.random.SeedSequence) -> NDArray[np.float64]:
    """Return ``count`` random fin angles (count, 3), uniform over whole turns, in rad.

    Raises
    ------
    InvalidArgumentError
        If ``count`` or ``seed`` is not a whole number of at least 0.
    """
    source = seed if isinstance(seed, np.random.SeedSequence) else stream(seed)
    size = (integer("count", count, 0), 3)
    return np.random.default_rng(source).uniform(-np.pi, np.pi, size)


def swim_all(
    controllers: Sequence[Controller],
    morphology: MorphologyLike,
    fin_angles: ArrayLike = (ZERO_POSE,),
    seconds: float = SECONDS,
    dtype: str = "float32",
    threads: int | None = None,
) -> NDArray[np.float64]:
    """Return how far each controller swims from each pose, all at once in the lanes.

    Parameters
    ----------
    controllers
        P of them.
    morphology
        The body they all steer; whatever ``Morphology.coerce`` takes.
    fin_angles
        (Q, 3) initial left and right pectoral angle and caudal phase, rad.
    seconds
        How long each swim lasts.
    dtype
        ``"float32"`` or ``"float64"``.
    threads
        None takes every core; no result depends on it.

    Returns
    -------
    ndarray
        (P, Q) progress along the world's +y, in units of 5 cm; NaN where a robot diverged.

    Raises
    ------
    InvalidArgumentError
        If the body is none, the angles are not (Q, 3), ``seconds`` is not positive or
        ``threads`` is not at least 1.
    """
    # numba comes with its engine: importing this package stays quick.
    from aquafish_gym.engines.compiled.lanes import LaneBatch, pack_rows

    _register_network()
    body = Morphology.coerce(morphology).to_array()
    if threads is not None:
        integer("threads", threads, 1)
    poses = finite_array("fin_angles", fin_angles, (None, 3), unit="rad")
    steps = step_count(seconds)
    kind = np.float32 if one_of("dtype", dtype, ("float32", "float64")) == "float32" else np.float64
    batch = len(controllers) * len(poses)
    if batch == 0:
        return np.zeros((len(controllers), len(poses)))
    nodes = max(c.nodes for c in controllers)
    genes = np.stack([c.genes(nodes) for c in controllers], axis=1)
    lanes = LaneBatch(
        np.broadcast_to(body, (batch, 9)),
        np.tile(poses, (len(controllers), 1)),
        dtype=kind,
        threads=threads,
    )
    log = lanes.run(
        network.steer,
        pack_rows(np.repeat(genes, len(poses), axis=1), kind, lanes.width),
        np.array([nodes], dtype=np.int64),
        network.INPUT_COUNT + nodes,
        steps,
        INTERVAL,
    )
    distances = np.where(log.diverged, np.nan, lanes.state()["position"][:, 1])
    return distances.reshape(len(controllers), len(poses))


def swim(
    controller: Controller,
    morphology: MorphologyLike,
    fin_angles: ArrayLike = ZERO_POSE,
    engine: str = "pybullet",
    seconds: float = SECONDS,
) -> Swim:
    """Swim one robot and return its path.

    Parameters
    ----------
    controller
        It may have been evolved on another body.
    morphology
        The body it steers here; whatever ``Morphology.coerce`` takes.
    fin_angles
        (3,) initial left and right pectoral angle and caudal phase, rad.
    engine
        ``"pybullet"``, or ``"numba"`` for the same robot in the lanes, in float64.
    seconds
        How long.

    Raises
    ------
    InvalidArgumentError, UnknownNameError
        If an argument does not fit.
    EngineUnavailableError
        If the engine's package is missing.
    """
    angles = finite_array("fin_angles", fin_angles, (3,), unit="rad")
    body = Morphology.coerce(morphology).to_array()
    steps, policy = step_count(seconds), controller.policy()
    world = make_world(check_engine(engine))
    samples: list[tuple[float, ...]] = []
    try:
        left, right, phase = angles.tolist()
        world.reset(body, (left, right, phase), (0.0, 0.0, 0.0))
        for t in range(0, steps, INTERVAL):
            state = world.state()
            samples.append(_sample(t, state))
            turn = rotation(state.orientation)
            action = policy((*turn[2], *turn[1], *state.spin), t * TIMESTEP)
            left, right, caudal = scale_action(action).tolist()
            world.advance((left, right, caudal), min(INTERVAL, steps - t))
            if world.diverged:
                samples.append((steps * TIMESTEP,) + (math.nan,) * 10)
                break
        else:
            samples.append(_sample(steps, world.state()))
    finally:
        world.close()
    table = np.array(samples)
    return Swim(table[:, 0], table[:, 1:4], table[:, 4:8], table[:, 8:11])


def step_count(seconds: float) -> int:
    """Return how many physics steps a time is.

    Raises
    ------
    InvalidArgumentError
        If it is not at least one step, or over an hour.
    """
    time = float(finite_array("seconds", seconds, (), TIMESTEP, 3600.0, "s"))
    return round(time / TIMESTEP)


def _sample(step: int, state: State) -> tuple[float, ...]:
    pairs = (state.left, state.right, state.phase)
    angles = [math.atan2(sine, cosine) for cosine, sine in pairs]
    return (step * TIMESTEP, *state.position, *state.orientation, *angles)


@functools.cache
def _register_network() -> None:
    """Let the lanes compile the network: the very functions that plain Python runs."""
    from aquafish_gym.physics import compiling

    compiling.register_module(network)
