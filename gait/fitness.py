"""What a gait is worth: over several bodies and poses, of which each swim has its own pair.

Of Q swims of a controller, each from one of q poses on one of m bodies, with variances of the
distance between bodies, between poses, and of what is left, the variance of the mean is
``between bodies / m + between poses / q + rest / Q``. At Q swims, whatever they cost, it is least
where m and q are as large as can be: no body swims twice while another has not swum, and no two
swims share a pose. So swims are pairs, and not every pose on every body. All controllers of a
generation swim the same pairs (common random numbers), so that what an easy body or a good pose
gives, it gives to all of them, and does not count among them.
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

# How far P controllers swim, the i-th time on the i-th of bodies (Q, 9) from the i-th of poses
# (Q, 3): distances (P, Q).
Scorer = Callable[
    [Sequence[Controller], NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]
]

# A robot that left the finite numbers is worse than any that swam, backwards or not: it scores
# as if it had swum backwards at this speed (units/s), faster than any body does.
DIVERGED_SPEED = -5.0


class Swims(NamedTuple):
    """Q swims that each of some controllers takes: bodies (Q, 9), and poses (Q, 3) in rad."""

    bodies: NDArray[np.float64]
    poses: NDArray[np.float64]


def draw_swims(
    bodies: NDArray[np.float64], poses: NDArray[np.float64], source: np.random.SeedSequence
) -> Swims:
    """Give each of poses (Q, 3) one of bodies (M, 9), at random, none more often than needed."""
    order = np.random.default_rng(source).permutation(len(bodies))
    return Swims(bodies[np.resize(order, len(poses))], poses)


def every_pair(bodies: NDArray[np.float64], poses: NDArray[np.float64]) -> Swims:
    """Return the M x Q swims of bodies (M, 9) from each of poses (Q, 3), those of a body in a row.

    Examples
    --------
    >>> every_pair(np.zeros((2, 9)), np.zeros((3, 3))).bodies.shape
    (6, 9)
    """
    return Swims(np.repeat(bodies, len(poses), axis=0), np.tile(poses, (len(bodies), 1)))


def worth(distances: NDArray[np.float64], seconds: float) -> NDArray[np.float64]:
    """Return distances of swims of so many seconds, with what a diverged robot's counts as."""
    return np.where(np.isfinite(distances), distances, DIVERGED_SPEED * seconds)


def distances(
    controllers: Sequence[Controller],
    bodies: MorphologiesLike,
    poses: ArrayLike = (ZERO_POSE,),
    seconds: float = SECONDS,
    threads: int | None = None,
    world: WorldConfig | None = None,
) -> NDArray[np.float64]:
    """Return how far each controller swims on each body, in the mean over some poses.

    All swims are one batch of the lanes, in float32: what a choice of trials asks that shall tell
    which of several gaits is the one for the robot.

    Parameters
    ----------
    controllers
        K of them.
    bodies
        M of them: one as ``Morphology.coerce`` takes it, a list of such, or (M, 9) sizes.
    poses
        (Q, 3) initial left and right pectoral angle and caudal phase, rad, the same for all.
    seconds
        How long a swim lasts, in s.
    threads
        None takes every core; no result depends on it.
    world
        The water and the servos, without a lag; None is ``WorldConfig()``.

    Returns
    -------
    ndarray
        (K, M) in units of 5 cm, as :func:`gait.swim_all` measures them. A robot that diverged
        counts as one that swam backwards at 5 units/s.

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
    far = worth(swim_all(controllers, *swims, seconds, threads=threads, world=world), seconds)
    return np.asarray(far.reshape(len(controllers), len(sizes), len(angles)).mean(axis=2))
