"""Comparison of a gait on its own body and on another (Sec. 5, Fig. 12)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.engines.packages import AUTO, NAMES, check_engine
from aquafish_gym.morphology import Morphology, MorphologyLike
from aquafish_gym.plans import plan_of
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    finite_array,
    instance,
    integer,
    one_of,
)
from aquafish_gym.world_config import WorldConfig, each_fin
from gait.controllers.agents import beliefs_of, refuse_unused
from gait.controllers.controller import MAXIMUM_SEED, Controller
from gait.swims.poses import MAXIMUM_POSES, random_poses
from gait.swims.scores import scores
from gait.swims.swim import SECONDS, Swim, check_world, step_count, swim


@dataclass(frozen=True, kw_only=True)
class TransferConfig:
    """Settings of a comparison of two bodies under one controller."""

    poses: int = 16
    """Random initial fin poses besides the zero pose."""
    seed: int = 0
    """Seed of the poses."""
    seconds: float = SECONDS
    """Length of a swim, in s."""
    native_engine: str = "numba"
    """Engine of the controller's own body: numba, pybullet or auto."""
    target_engine: str = "auto"
    """Engine of the target: auto (PyBullet if installed, else numba), pybullet or numba."""
    angle_error: tuple[float, ...] = (0.0,)
    """Error of the initial fin angles that the controller, which senses them, assumes on the
    target, in rad: one for all fins, or one for each."""
    believed_gain: tuple[float, ...] = (1.0,)
    """Servo gains that the controller, which senses its fins, assumes on the target: one for all,
    or one for each."""

    def __post_init__(self) -> None:
        integer("poses", self.poses, 1, MAXIMUM_POSES)
        integer("seed", self.seed, 0, MAXIMUM_SEED)
        step_count(self.seconds)
        for name in ("native_engine", "target_engine"):
            one_of(name, getattr(self, name), (AUTO, *NAMES))
        for name, unit in (("angle_error", "rad"), ("believed_gain", "")):
            if not len(finite_array(name, getattr(self, name), (None,), unit=unit)):
                raise InvalidArgumentError(f"{name} must be one number or more; got none")


@dataclass(frozen=True)
class Scored:
    """A controller's swims on one body. Distances are in units of 5 cm, NaN where it diverged."""

    swim: Swim  #: From the zero pose.
    random_distances: NDArray[np.float64] = field(repr=False)  #: (poses,) from each random pose.

    @property
    def distance(self) -> float:
        """The distance from the zero pose."""
        return self.swim.distance

    @property
    def random_distance(self) -> float:
        """The mean over the random poses."""
        return float(self.random_distances.mean())

    def to_dict(self) -> dict[str, Any]:
        """Return the distances, ready for JSON; None where the robot diverged."""
        distances = [self.distance, self.random_distance, *self.random_distances.tolist()]
        first, mean, *several = (d if np.isfinite(d) else None for d in distances)
        return {"distance": first, "random_distance": mean, "random_distances": several}


@dataclass(frozen=True)
class Transfer:
    """A controller on its native body and on the target, from the same random poses (n, F) in rad.

    Examples
    --------
    >>> config = TransferConfig(poses=1, seconds=1, target_engine="numba")
    >>> sweep = lambda observation, time: (0.0, 0.0, 1.0)
    >>> both = transfer(sweep, {"caudal": (0, 0, 0)}, config, Morphology.nominal())
    >>> abs(both.target.random_distance) < 1e-9
    True
    """

    native: Scored
    target: Scored
    poses: NDArray[np.float64] = field(repr=False)

    def __str__(self) -> str:
        first = self.native
        second = self.target
        random = f"{len(self.poses)} random poses"
        return (
            f"{'units of 5 cm':20s}   native   target\n"
            f"{'zero pose':20s}{first.distance:9.2f}{second.distance:9.2f}\n"
            f"{random:20s}{first.random_distance:9.2f}{second.random_distance:9.2f}"
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the distances and poses, ready for JSON; None where a robot diverged."""
        bodies = {"native": self.native.to_dict(), "target": self.target.to_dict()}
        return {"poses": self.poses.tolist(), **bodies}


def transfer(
    controller: object,
    target: MorphologyLike,
    config: TransferConfig | None = None,
    native: MorphologyLike = None,
    world: WorldConfig | None = None,
    observe_fins: str | bool = False,
    native_world: WorldConfig | None = None,
) -> Transfer:
    """Return how a controller swims on its native body and on the target.

    Parameters
    ----------
    controller, target, observe_fins
        As controller, morphology and ``observe_fins`` of :func:`gait.swim`.
    native
        The native body; None is the controller's ``morphology``.
    world, native_world
        The water and the servos of the target, and of the native body; None is ``WorldConfig()``.

    Raises
    ------
    InvalidArgumentError
        If an argument does not fit, or the native body is not known.
    EngineUnavailableError
        If an engine's package is missing.
    """
    c = TransferConfig() if config is None else instance("config", config, TransferConfig)
    plan = plan_of(controller, native, target)
    away = Morphology.coerce(target, plan)
    home = getattr(controller, "morphology", None)
    if native is not None:
        home = Morphology.coerce(native, plan)
    if not isinstance(home, Morphology):
        raise InvalidArgumentError(
            "native must be given: the controller has no morphology; got None"
        )
    home_world = check_world(native_world, "native_world")
    engines = [check_engine(name) for name in (c.native_engine, c.target_engine)]
    poses = random_poses(c.poses, c.seed, plan)
    return Transfer(
        native=swims_on(
            controller, home, poses, engines[0], c.seconds, home_world, observe_fins=observe_fins
        ),
        target=swims_on(
            controller, away, poses, engines[1], c.seconds,
            world, c.angle_error, c.believed_gain, observe_fins,
        ),
        poses=poses,
    )  # fmt: skip


def swims_on(
    controller: object,
    morphology: MorphologyLike,
    poses: ArrayLike,
    engine: str = "auto",
    seconds: float = SECONDS,
    world: WorldConfig | None = None,
    angle_error: ArrayLike = (0.0,),
    believed_gain: ArrayLike = (1.0,),
    observe_fins: str | bool = False,
) -> Scored:
    """Return a controller's swims on one body from the zero pose and from ``poses`` (Q, F).

    ``angle_error`` and ``believed_gain`` are as in :class:`TransferConfig`, ``observe_fins`` as in
    :func:`gait.swim`, and so are the errors. A :class:`gait.Controller` swims from all poses as a
    batch by :func:`gait.scores`, anything else from one after the other.
    """
    plan = plan_of(controller, morphology)
    angles = finite_array("poses", poses, (None, len(plan.fins)), unit="rad")
    world = check_world(world)
    error = each_fin("angle_error", angle_error, plan, "rad")
    gain = each_fin("believed_gain", believed_gain, plan)
    beliefs = beliefs_of(controller, observe_fins)
    refuse_unused(beliefs.angles, "angle_error", angle_error if error.any() else None)
    refuse_unused(beliefs.gains, "believed_gain", believed_gain if (gain != 1.0).any() else None)
    known = gain if beliefs.gains else None

    def swim_from(pose: NDArray[np.float64]) -> Swim:
        fins = pose + error if beliefs.angles else None
        return swim(
            controller, morphology, pose, engine, seconds, world, fins, known,
            observe_fins=observe_fins,
        )  # fmt: skip

    if isinstance(controller, Controller):
        distances = scores(
            [controller], morphology, angles, seconds,
            world=world, engine=engine, dtype="float64",
            believed=angles + error if beliefs.angles else None, believed_gain=known,
            penalize=False,
        )[0]  # fmt: skip
    else:
        distances = np.array([swim_from(pose).distance for pose in angles])
    return Scored(swim_from(np.zeros(len(plan.fins))), distances)
