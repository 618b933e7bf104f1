"""How a gait does on another body than the one it was evolved on (Sec. 5, Fig. 12)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.engines.base import ENGINES, check_engine
from aquafish_gym.morphology import Morphology, MorphologyLike
from aquafish_gym.utils.validation import finite_array, integer, one_of
from gait.controller import Controller
from gait.rollout import SECONDS, Swim, random_poses, step_count, swim, swim_all


@dataclass(frozen=True, kw_only=True)
class TransferConfig:
    """How to compare two bodies under one controller."""

    poses: int = 16
    """Random fin poses to swim from besides the zero pose."""
    seed: int = 0
    """The poses follow from it alone."""
    seconds: float = SECONDS
    """How long a swim lasts, in s."""
    native_engine: str = "numba"
    """Where the controller's own body swims: numba or pybullet."""
    target_engine: str = "pybullet"
    """Where the target swims: numba or pybullet."""

    def __post_init__(self) -> None:
        integer("poses", self.poses, 1, 10_000)
        integer("seed", self.seed, 0)
        step_count(self.seconds)
        one_of("native_engine", self.native_engine, ENGINES)
        one_of("target_engine", self.target_engine, ENGINES)


@dataclass(frozen=True)
class Scored:
    """What one body does under a controller. Distances are in units of 5 cm.

    Attributes
    ----------
    swim
        The swim from the zero pose.
    random_distances
        (poses,) distance from each random pose; NaN where the robot diverged.
    """

    swim: Swim
    random_distances: NDArray[np.float64]

    @property
    def distance(self) -> float:
        """From the zero pose."""
        return self.swim.distance

    @property
    def random_distance(self) -> float:
        """The mean over the random poses."""
        return float(self.random_distances.mean())


@dataclass(frozen=True)
class Transfer:
    """A controller on its native body and on the target.

    Attributes
    ----------
    poses
        (poses, 3) the random fin angles, the same for both bodies, in rad.
    """

    native: Scored
    target: Scored
    poses: NDArray[np.float64]

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers, without the paths, ready for JSON; None where a robot diverged."""
        both = {"native": self.native, "target": self.target}
        return {
            "poses": self.poses.tolist(),
            **{
                name: {
                    "distance": _finite(scored.distance),
                    "random_distance": _finite(scored.random_distance),
                    "random_distances": [_finite(d) for d in scored.random_distances.tolist()],
                }
                for name, scored in both.items()
            },
        }


def transfer(
    controller: Controller, target: MorphologyLike, config: TransferConfig | None = None
) -> Transfer:
    """Swim a controller on the body it was evolved on, and on the target.

    ``target`` is whatever ``Morphology.coerce`` takes.

    Raises
    ------
    InvalidArgumentError
        If the target is no body.
    EngineUnavailableError
        If an engine's package is missing.
    """
    c = config or TransferConfig()
    body = Morphology.coerce(target)
    check_engine(c.native_engine)
    check_engine(c.target_engine)
    poses = random_poses(c.poses, c.seed)
    return Transfer(
        native=score(controller, controller.morphology, poses, c.native_engine, c.seconds),
        target=score(controller, body, poses, c.target_engine, c.seconds),
        poses=poses,
    )


def score(
    controller: Controller,
    morphology: MorphologyLike,
    poses: ArrayLike,
    engine: str = "pybullet",
    seconds: float = SECONDS,
) -> Scored:
    """Swim a controller on one body, from the zero pose and from each of ``poses`` (Q, 3).

    Raises
    ------
    InvalidArgumentError, UnknownNameError
        If an argument does not fit.
    EngineUnavailableError
        If the engine's package is missing.
    """
    angles = finite_array("poses", poses, (None, 3), unit="rad")
    if engine == "numba":
        distances = swim_all([controller], morphology, angles, seconds, "float64")[0]
    else:
        swims = (swim(controller, morphology, pose, engine, seconds) for pose in angles)
        distances = np.array([one.distance for one in swims])
    return Scored(swim(controller, morphology, engine=engine, seconds=seconds), distances)


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
