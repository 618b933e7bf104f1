"""The swims that score a gait: pairs of a body and a pose.

The variance of a controller's mean over Q swims, of m bodies and q poses, is
``between bodies / m + between poses / q + rest / Q``. For a given Q it is least if every swim has a
pose of its own, and a body of its own as far as there are enough. All controllers of a generation
swim the same pairs (common random numbers), so that an easy pair favours none of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.bodies import MorphologiesLike, body_array
from aquafish_gym.utils.validation import InvalidArgumentError, finite_array
from aquafish_gym.world_config import WorldConfig
from gait.controller import Controller
from gait.rollout import SECONDS, ZERO_POSE, swim_all

# Returns distances (P, Q) of P controllers in Q swims, of the i-th body (Q, 9) from the i-th pose
# (Q, 3).
Scorer = Callable[
    [Sequence[Controller], NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]
]

# A diverged robot scores as if it had swum backwards at this speed (units/s), faster than any does.
DIVERGED_SPEED = -5.0


class Swims(NamedTuple):
    """Bodies (Q, 9) and initial poses (Q, 3), in rad, of Q swims."""

    bodies: NDArray[np.float64]
    poses: NDArray[np.float64]


def draw_swims(
    bodies: NDArray[np.float64], poses: NDArray[np.float64], source: np.random.SeedSequence
) -> Swims:
    """Return swims from poses (Q, 3), with bodies (M, 9) dealt at random and equally often."""
    order = np.random.default_rng(source).permutation(len(bodies))
    return Swims(bodies[np.resize(order, len(poses))], poses)


def every_pair(bodies: NDArray[np.float64], poses: NDArray[np.float64]) -> Swims:
    """Return the M x Q swims of each body (M, 9) from each pose (Q, 3), body by body.

    Examples
    --------
    >>> every_pair(np.zeros((2, 9)), np.zeros((3, 3))).bodies.shape
    (6, 9)
    """
    return Swims(np.repeat(bodies, len(poses), axis=0), np.tile(poses, (len(bodies), 1)))


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

    Parameters
    ----------
    controllers
        K controllers.
    bodies
        M bodies: one as ``Morphology.coerce`` takes it, a list of such, or (M, 9) sizes.
    poses
        (Q, 3) initial left and right pectoral angle and caudal phase, rad.
    seconds, threads, world
        As of :func:`gait.swim_all`.

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
