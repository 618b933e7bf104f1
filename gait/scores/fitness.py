"""The swims that score a gait, pairs of a body and a pose, and the scores in a task.

The variance of a controller's mean over Q swims, of m bodies and q poses, is
``between bodies / m + between poses / q + rest / Q``. For a given Q it is least if every swim has a
pose of its own, and a body of its own as far as there are enough. All controllers of a generation
swim the same pairs (common random numbers), so that an easy pair favours none of them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.bodies import MorphologiesLike, body_array
from aquafish_gym.damage import Damage
from aquafish_gym.engines.packages import MAXIMUM_THREADS
from aquafish_gym.envs.episode import begin_episodes, check_episode
from aquafish_gym.envs.tasks import check_task
from aquafish_gym.rollout import rollout
from aquafish_gym.scenario import TIMESTEP
from aquafish_gym.utils.validation import InvalidArgumentError, finite_array, integer
from aquafish_gym.world_config import WorldConfig
from gait.controllers.controller import MAXIMUM_SEED, Controller, check_controllers, program_of
from gait.scores.rollout import SECONDS, ZERO_POSE, pair_swims, swim_all

# A diverged robot scores as if it had swum backwards at this speed (units/s), faster than any does.
DIVERGED_SPEED = -5.0


# Bodies (Q, 9) and initial poses (Q, 3), in rad, of Q swims.
Swims = tuple[NDArray[np.float64], NDArray[np.float64]]


def draw_swims(
    bodies: NDArray[np.float64], poses: NDArray[np.float64], source: np.random.SeedSequence
) -> Swims:
    """Return swims from poses (Q, 3), with bodies (M, 9) dealt at random and equally often."""
    order = np.random.default_rng(source).permutation(len(bodies))
    return bodies[np.resize(order, len(poses))], poses


def every_pair(bodies: NDArray[np.float64], poses: NDArray[np.float64]) -> Swims:
    """Return the M x Q swims of each body (M, 9) from each pose (Q, 3), body by body."""
    return np.repeat(bodies, len(poses), axis=0), np.tile(poses, (len(bodies), 1))


def penalize_diverged(distances: NDArray[np.float64], seconds: float) -> NDArray[np.float64]:
    """Return distances swum in ``seconds``, with ``DIVERGED_SPEED`` for robots that diverged."""
    return np.where(np.isfinite(distances), distances, DIVERGED_SPEED * seconds)


def distances(
    controllers: Sequence[Controller],
    bodies: MorphologiesLike,
    poses: ArrayLike = (ZERO_POSE,),
    seconds: float = SECONDS,
    threads: int | None = None,
    world: WorldConfig | None = None,
) -> NDArray[np.float64]:
    """Return the mean distance of each controller on each body over some poses, in float32.

    Each of the M bodies swims from each of the poses (Q, 3); otherwise as :func:`gait.swim_all`.

    Returns
    -------
    ndarray
        (K, M) in units of 5 cm. A diverged robot counts as one that swam backwards at 5 units/s.

    Raises
    ------
    InvalidArgumentError
        If an argument does not fit, or there is no pose.

    Examples
    --------
    >>> from aquafish_gym import Morphology
    >>> body, still = Morphology.nominal(), [0.0, 0.0, -9.0]
    >>> silent = Controller(np.zeros((3, 14)), still, np.ones(3), 0.7, body, seed=0)
    >>> distances([silent], [body, {"caudal": (0, 0, 0)}], seconds=1).round(3).tolist()
    [[0.0, 0.0]]
    """
    sizes = body_array(bodies, "bodies")
    angles = finite_array("poses", poses, (None, 3), unit="rad")
    if not len(angles):
        raise InvalidArgumentError("poses must be one or more; got none")
    swims = every_pair(sizes, angles)
    found = swim_all(controllers, *swims, seconds, threads=threads, world=world)
    far = penalize_diverged(found, seconds)
    return np.asarray(far.reshape(len(controllers), len(sizes), len(angles)).mean(axis=2))


def swim_scores(
    controllers: Sequence[Controller],
    morphologies: MorphologiesLike,
    fin_angles: ArrayLike = (ZERO_POSE,),
    task: object = "forward",
    *,
    seconds: float = SECONDS,
    damage: object = None,
    world: WorldConfig | None = None,
    seed: int = 0,
    threads: int | None = None,
    start: ArrayLike | None = None,
) -> NDArray[np.float64]:
    """Return the score of each controller in each swim; finite if a robot diverges.

    The score is the distance swum in ``seconds`` and ``world``. For another task than "forward", or
    with ``damage``, it is the return of the task's episode times the time step: of swimming forward
    units along the world's +y, whatever the interval.

    Parameters
    ----------
    controllers
        P of them; of one ``Controller.kind`` for an episode.
    morphologies, fin_angles, seconds, world, threads, start
        As of :func:`gait.swim_all`: Q swims, of the i-th body from the i-th pose. Episodes have
        ``seconds``, ``world`` and ``start`` of their own, and refuse others.
    task, damage
        As of the environment.
    seed
        Of the task's and the damage's random choices, which are the same for all controllers: swim
        q is the episode of an environment that was seeded with ``seed + q``.

    Returns
    -------
    ndarray
        (P, Q).

    Raises
    ------
    InvalidArgumentError
        If an argument does not fit.
    """
    controllers = check_controllers(controllers)
    broken = Damage.coerce(damage)
    integer("seed", seed, 0, MAXIMUM_SEED)
    judged = check_task(task)
    if isinstance(task, str) and task == "forward" and not broken:
        far = swim_all(
            controllers, morphologies, fin_angles, seconds,
            threads=threads, world=world, start=start,
        )  # fmt: skip
        return penalize_diverged(far, seconds)
    for name, given in (
        ("seconds", seconds != SECONDS),
        ("world", world is not None and world != WorldConfig()),
        ("start", start is not None),
    ):
        if given:
            raise InvalidArgumentError(f"{name} has no effect on an episode, which has its own")
    if threads is not None:
        integer("threads", threads, 1, MAXIMUM_THREADS)
    sizes = body_array(morphologies)
    angles = finite_array("fin_angles", fin_angles, (None, 3), unit="rad")
    bodies, poses = pair_swims(sizes, angles)
    swims = len(poses)
    program = program_of(controllers, swims)
    rngs = [np.random.default_rng(seed + q) for q in range(swims)]
    config = check_episode(judged, damage=broken)
    configs = [
        config.with_options({"morphology": body, "fin_angles": pose})
        for body, pose in zip(bodies, poses, strict=True)
    ]
    scenario, memory = begin_episodes(configs, rngs, program.interval)
    found = rollout(
        program,
        scenario.take(np.tile(np.arange(swims), len(controllers))),
        judged,
        memory=np.tile(memory, (len(controllers), 1)),
        rngs=rngs * len(controllers),  # each controller's swims observe the same noise
        dtype=np.float32,
        threads=threads,
    )
    scores = np.where(found.diverged, np.nan, found.returns * (program.interval * TIMESTEP))
    return penalize_diverged(scores.reshape(len(controllers), swims), judged.seconds)
