"""How far gaits swim on the bodies that the trials allow: what a trial for the gait's sake asks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.bodies import body_array
from aquafish_gym.morphology import MAXIMA
from aquafish_gym.utils.validation import integer

if TYPE_CHECKING:
    from gait.config import EvolveConfig


@dataclass(frozen=True)
class GaitUtility:
    """Evolves gaits for the bodies that it is asked about, and swims each gait on each body.

    One gait is for all of the bodies together, as ``evolve_gait`` makes of a sample; each of the
    others is for one of them alone, those that differ most. So what a body would lose by the gait
    for all is known where it may lose most. The gaits are quick ones and compare with each other
    only: the robot's own is evolved at leisure, when all trials are done. It is a function of the
    bodies alone, as the strategy "gait" and the stop rule ``joint.robust`` need it. They swim in
    still water with servos that work.

    Raises
    ------
    InvalidArgumentError
        If a setting is out of range, or what is asked about are no bodies.

    Examples
    --------
    >>> quick = GaitUtility(gaits=2, generations=1, population=10, seconds=0.5)
    >>> quick(np.array([[0.6, 1.6, 0.4, 0.6, 1.6, 0.4, 0.4, 1.4, 0.6]] * 3)).shape
    (2, 3)
    """

    #: Of the gaits' evolution, one for all of them: luck that is shared is no difference.
    seed: int = 0
    threads: int | None = None  #: Cores to use; None for all. No result depends on it.
    gaits: int = 6  #: How many, the one for all bodies included.
    generations: int = 15  #: Of each evolution.
    population: int = 75  #: Gaits a generation.
    poses: int = 4  #: Random fin poses to swim from besides the zero pose.
    seconds: float = 10.0  #: Length of a swim.

    def __post_init__(self) -> None:
        integer("gaits", self.gaits, 2, 1000)
        self._config()

    @classmethod
    def quicker(cls, gait: EvolveConfig) -> GaitUtility:
        """Return one of shorter swims and far fewer of them than a gait's evolution at leisure.

        Examples
        --------
        >>> from gait.config import EvolveConfig
        >>> GaitUtility.quicker(EvolveConfig(search="cma")) == GaitUtility()
        True
        """
        return cls(
            gait.seed,
            gait.threads,
            generations=min(cls.generations, gait.plan.generations),
            population=min(cls.population, max(10, gait.population or cls.population)),
            poses=max(1, min(cls.poses, gait.poses)),
            seconds=gait.seconds / 2,
        )

    def __call__(self, bodies: ArrayLike) -> NDArray[np.float64]:
        """Return how far each gait swims on each body (N, 9), (K, N) in units of 5 cm.

        The mean over the poses. K is ``gaits``, or less where fewer bodies differ, at least 2.
        """
        # Loaded when first asked, as every command of this package begins by loading this room.
        from gait.evolve import evolve_gait
        from gait.fitness import distances
        from gait.rollout import ZERO_POSE, random_poses

        sizes = body_array(bodies, "bodies")
        config = self._config()
        samples = [sizes, *sizes[different(sizes / MAXIMA, self.gaits - 1)]]
        found = [evolve_gait(sample, config).controller for sample in samples]
        poses = np.vstack([ZERO_POSE, random_poses(self.poses, self.seed)])
        return distances(found, sizes, poses, self.seconds, self.threads)

    def _config(self) -> EvolveConfig:
        from gait.config import EvolveConfig

        return EvolveConfig(
            seed=self.seed,
            generations=self.generations,
            population=self.population,
            starts=1,
            polish=0,
            poses=integer("poses", self.poses, 1),
            seconds=self.seconds,
            threads=self.threads,
        )


def different(points: NDArray[np.float64], count: int) -> NDArray[np.intp]:
    """Return which of points (N, d) differ most, at most ``count``, at least one.

    The first is farthest from their median, and each next one farthest from all before it
    (T. F. Gonzalez, "Clustering to minimize the maximum intercluster distance", 1985).

    Examples
    --------
    >>> different(np.array([[0.0], [0.1], [1.0], [0.0]]), 3)
    array([2, 0, 1])
    """
    apart = np.linalg.norm(points - np.median(points, axis=0), axis=1)
    chosen = [int(apart.argmax())]
    apart = np.full(len(points), np.inf)
    while len(chosen) < count:
        apart = np.minimum(apart, np.linalg.norm(points - points[chosen[-1]], axis=1))
        if apart.max() == 0.0:
            break
        chosen.append(int(apart.argmax()))
    return np.array(chosen)
