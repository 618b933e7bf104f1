"""The score of controllers in an environment's task, for a whole population at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.bodies import MorphologiesLike, body_array
from aquafish_gym.envs.episode import begin_episodes, check_episode
from aquafish_gym.envs.tasks import TASKS, check_task
from aquafish_gym.rollout import rollout
from aquafish_gym.scenario import TIMESTEP
from aquafish_gym.utils.validation import InvalidArgumentError, finite_array, integer
from aquafish_gym.world_config import WorldConfig
from gait.controller import MAXIMUM_SEED, Controller, program_of
from gait.fitness import Swims, penalize_diverged
from gait.rollout import SECONDS, swim_all


def swim_scores(
    controllers: Sequence[Controller],
    swims: Swims,
    task: str = "forward",
    *,
    seconds: float = SECONDS,
    damage: object = None,
    world: WorldConfig | None = None,
    seed: int = 0,
    threads: int | None = None,
) -> NDArray[np.float64]:
    """Return the score (P, Q) of each controller in each of Q swims; finite if a robot diverges.

    The score is the distance swum in ``seconds`` and ``world``; for another task than "forward", or
    with ``damage``, it is that of :func:`perform`.
    """
    if task == "forward" and not damage:
        found = swim_all(controllers, *swims, seconds, threads=threads, world=world)
    else:
        found = perform(controllers, *swims, task=task, damage=damage, seed=seed, threads=threads)
        seconds = TASKS[task].seconds
    return penalize_diverged(found, seconds)


def perform(
    controllers: Sequence[Controller],
    morphologies: MorphologiesLike = None,
    fin_angles: ArrayLike = ((0.0, 0.0, 0.0),),
    *,
    task: object = "forward",
    damage: object = None,
    seed: int = 0,
    dtype: type[np.floating] = np.float32,
    threads: int | None = None,
) -> NDArray[np.float64]:
    """Return the score of each controller's episode of a task from each pose.

    Parameters
    ----------
    controllers
        P of them, of one ``Controller.kind``.
    morphologies, fin_angles
        As of :func:`gait.rollout.swim_all`: Q swims, of the i-th body from the i-th pose.
    task, damage
        As of the environment.
    seed
        Of the task's and the damage's random choices, which are the same for all controllers: swim
        q is the episode of an environment that was seeded with ``seed + q``.
    dtype, threads
        As of :func:`aquafish_gym.rollout.rollout`.

    Returns
    -------
    ndarray
        (P, Q) the sums of the rewards times the time step: of "forward" units along the world's +y,
        whatever the interval. NaN where a robot diverged.

    Raises
    ------
    InvalidArgumentError
        If an argument does not fit.
    """
    poses = finite_array("fin_angles", fin_angles, (None, 3), unit="rad")
    bodies = body_array(morphologies)
    swims = len(bodies) if len(poses) == 1 else len(poses)
    if len(bodies) not in (1, swims):
        raise InvalidArgumentError(
            "morphologies and fin_angles must be equally many, or one for all; "
            f"got {len(bodies)} and {len(poses)}"
        )
    first, judged = integer("seed", seed, 0, MAXIMUM_SEED), check_task(task)
    program = program_of(controllers, swims)
    dt = program.interval * TIMESTEP
    bodies, poses = np.broadcast_to(bodies, (swims, 9)), np.broadcast_to(poses, (swims, 3))
    rngs = [np.random.default_rng(first + q) for q in range(swims)]
    config = check_episode(None, damage, (0.0, 0.0, 0.0), "zero", judged.seconds)
    configs = [
        config.with_options({"morphology": body, "fin_angles": pose})
        for body, pose in zip(bodies, poses, strict=True)
    ]
    scenario, memory = begin_episodes(configs, rngs, judged.begin, program.interval)
    found = rollout(
        program,
        scenario.take(np.tile(np.arange(swims), len(controllers))),
        judged,
        memory=np.tile(memory, (len(controllers), 1)),
        rngs=rngs * len(controllers),  # each controller's swims observe the same noise
        dtype=dtype,
        threads=threads,
    )
    scores = np.where(found.diverged, np.nan, found.returns * dt)
    return scores.reshape(len(controllers), swims)
