"""Controllers that do an environment's task: what an episode brings them, by the batch."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.bodies import MorphologiesLike, body_array
from aquafish_gym.envs.vector import AquaFishVectorEnv
from aquafish_gym.utils.validation import InvalidArgumentError, finite_array, integer
from gait import network
from gait.controller import MAXIMUM_SEED, Controller, scratch_size
from gait.rollout import gene_rows


def answer_all(genes: Any, layout: Any, scratch: Any, times: Any, felt: Any, actions: Any) -> None:
    """Have B controllers answer what they feel; ``network.respond``, one after another.

    Parameters
    ----------
    genes
        (rows B,) flat, see ``network.respond``.
    scratch
        (B, n), which lives through an episode.
    times
        (B,) s since each one's episode began.
    felt
        (B, 12) up, north and gyro, and the way to the goal.
    actions
        (B, 3), which are set.
    """
    count = len(times)
    for i in range(count):
        up = (felt[i, 0], felt[i, 1], felt[i, 2])
        north = (felt[i, 3], felt[i, 4], felt[i, 5])
        gyro = (felt[i, 6], felt[i, 7], felt[i, 8])
        way = (felt[i, 9], felt[i, 10], felt[i, 11])
        left, right, caudal = network.respond(
            genes, layout, scratch[i], i, count, times[i], up, north, gyro, way
        )
        actions[i, 0], actions[i, 1], actions[i, 2] = left, right, caudal


@cache
def _compiled() -> Any:
    from aquafish_gym.physics.compiling import compiled_function, register_module

    register_module(network)
    return compiled_function(answer_all, seconds=10, nogil=True)


class Crew:
    """Controllers of one kind, each of which steers Q robots of a batch.

    Parameters
    ----------
    controllers
        P of them, of one ``Controller.kind``.
    fin_angles
        (Q, 3) where each robot's fins stand at first, rad, as far as its controller knows.

    Raises
    ------
    InvalidArgumentError
        If there are none, or they are of several kinds.
    """

    def __init__(self, controllers: Sequence[Controller], fin_angles: ArrayLike) -> None:
        if len({c.kind for c in controllers}) != 1:
            raise InvalidArgumentError("controllers must be one or more of one kind")
        told = finite_array("fin_angles", fin_angles, (None, 3), unit="rad")
        nodes, memory = max(c.nodes for c in controllers), any(c.memory for c in controllers)
        rows = gene_rows(controllers, nodes, memory, told, np.ones_like(told))
        self._genes = np.ascontiguousarray(rows).reshape(-1)
        self._layout = controllers[0].layout(nodes, memory)
        self._count = len(controllers) * len(told)
        self._scratch = np.zeros((self._count, scratch_size(controllers[0], nodes)))
        self._goal = controllers[0].senses.goal

    def act(self, observations: NDArray[np.float32], times: NDArray[np.float64]) -> Any:
        """Return actions (P Q, 3) float32 for observations (P Q, k) at so many s of an episode."""
        felt = np.zeros((self._count, 12))
        felt[:, :9] = observations[:, :9]
        if self._goal:
            felt[:, 9:] = observations[:, -3:]
        actions = np.empty((self._count, 3))
        _compiled()(self._genes, self._layout, self._scratch, times, felt, actions)
        return actions.astype(np.float32)


def perform(
    controllers: Sequence[Controller],
    morphologies: MorphologiesLike = None,
    fin_angles: ArrayLike = ((0.0, 0.0, 0.0),),
    *,
    task: object = "forward",
    damage: object = None,
    seed: int = 0,
    threads: int | None = None,
) -> NDArray[np.float64]:
    """Return what an episode of a task brings each controller from each pose.

    Parameters
    ----------
    controllers
        P of them, of one ``Controller.kind``, whose ``interval`` is the environment's frame_skip.
    morphologies, fin_angles
        As of :func:`gait.rollout.swim_all`: Q swims, of the i-th body from the i-th pose.
    task, damage
        As of the environment.
    seed
        What the task and the damage leave to chance is the same for all controllers.

    Returns
    -------
    ndarray
        (P, Q) the sums of the rewards times the time that each was for: of "forward" units along
        the world's +y, whatever the interval. NaN where a robot diverged.

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
    first = integer("seed", seed, 0, MAXIMUM_SEED)
    poses, count = np.broadcast_to(poses, (swims, 3)), len(controllers) * swims
    crew = Crew(controllers, poses)
    envs = AquaFishVectorEnv(
        count,
        morphology=np.tile(np.broadcast_to(bodies, (swims, 9)), (len(controllers), 1)),
        damage=damage,
        fin_angles=np.tile(poses, (len(controllers), 1)),
        frame_skip=controllers[0].interval,
        task=task,
        threads=threads,
    )
    observations, _ = envs.reset(seed=[first + i for i in range(swims)] * len(controllers))
    earned, lost = np.zeros(count), np.zeros(count, np.bool_)
    for step in range(round(envs.task.seconds / envs.dt)):
        times = np.full(count, step * envs.dt)
        observations, rewards, terminated, *_ = envs.step(crew.act(observations, times))
        lost |= terminated  # and begin anew, which counts for nothing
        earned += rewards * envs.dt
    earned[lost] = np.nan
    return earned.reshape(len(controllers), swims)
