"""How a gait does on another body than the one it was evolved on (Sec. 5, Fig. 12)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.engines.base import ENGINES, check_engine, resolve_engine
from aquafish_gym.engines.packages import AUTO
from aquafish_gym.engines.worlds import WorldConfig
from aquafish_gym.morphology import Morphology, MorphologyLike
from aquafish_gym.utils.validation import InvalidArgumentError, finite_array, integer, one_of
from gait.controller import MAXIMUM_SEED, Controller
from gait.policy import ControllerLike
from gait.rollout import MAXIMUM_POSES, SECONDS, Swim, random_poses, step_count, swim, swim_all

if TYPE_CHECKING:
    from matplotlib.axes import Axes


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
    """Where the controller's own body swims: numba, pybullet or auto."""
    target_engine: str = "auto"
    """Where the target swims: auto (PyBullet where it is installed, else numba), pybullet or
    numba."""
    angle_error: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """How wrong on the target a controller that feels its fins is told where they stand, in rad."""
    believed_gain: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """What it is told there of the servos' gains."""

    def __post_init__(self) -> None:
        integer("poses", self.poses, 1, MAXIMUM_POSES)
        integer("seed", self.seed, 0, MAXIMUM_SEED)
        step_count(self.seconds)
        for name in ("native_engine", "target_engine"):
            one_of(name, getattr(self, name), (AUTO, *ENGINES))
        finite_array("angle_error", self.angle_error, (3,), unit="rad")
        finite_array("believed_gain", self.believed_gain, (3,))


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

    def __repr__(self) -> str:
        return (
            f"Scored({self.distance:.2f} units from the zero pose, {self.random_distance:.2f} on "
            f"average over {len(self.random_distances)} random poses)"
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the distances, ready for JSON; None where the robot diverged."""
        return {
            "distance": _finite(self.distance),
            "random_distance": _finite(self.random_distance),
            "random_distances": [_finite(d) for d in self.random_distances.tolist()],
        }


@dataclass(frozen=True)
class Transfer:
    """A controller on its native body and on the target.

    Attributes
    ----------
    poses
        (poses, 3) the random fin angles, the same for both bodies, in rad.

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

    def rows(self) -> list[list[str]]:
        """Return a table: what was measured, on the native body, on the target."""
        both = (self.native, self.target)
        return [
            ["units of 5 cm", "native", "target"],
            ["zero pose", *(f"{one.distance:.2f}" for one in both)],
            [f"{len(self.poses)} random poses", *(f"{one.random_distance:.2f}" for one in both)],
        ]

    def __str__(self) -> str:
        return "\n".join(f"{name:20s}{one:>9s}{other:>9s}" for name, one, other in self.rows())

    def _repr_html_(self) -> str:
        head, *body = self.rows()
        lines = [f"<tr><th>{'</th><th>'.join(head)}</th></tr>"]
        lines += [f"<tr><td>{'</td><td>'.join(row)}</td></tr>" for row in body]
        return f"<table>{''.join(lines)}</table>"

    def plot(self, axes: Axes | None = None) -> Axes:
        """Draw both paths from the zero pose, on matplotlib's present figure or the axes given."""
        from gait.plots import draw_trajectories

        return draw_trajectories({"native": self.native.swim, "target": self.target.swim}, axes)

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers, without the paths, ready for JSON; None where a robot diverged."""
        return {
            "poses": self.poses.tolist(),
            "native": self.native.to_dict(),
            "target": self.target.to_dict(),
        }


def transfer(
    controller: ControllerLike,
    target: MorphologyLike,
    config: TransferConfig | None = None,
    native: MorphologyLike = None,
    world: WorldConfig | None = None,
) -> Transfer:
    """Swim a controller on the body it was made for, and on the target.

    Parameters
    ----------
    controller, target
        As controller and morphology of :func:`gait.swim`.
    config
        How; None is ``TransferConfig()``.
    native
        The body it was made for; None is the controller's own ``morphology``, if it has one: of a
        controller that was evolved on a sample, the median body.
    world
        The target's water and servos; None is ``WorldConfig()``, as the native body has it.

    Raises
    ------
    InvalidArgumentError
        If a body is none, or the native one is not known.
    EngineUnavailableError
        If an engine's package is missing.
    """
    c = config or TransferConfig()
    away = Morphology.coerce(target)
    home = getattr(controller, "morphology", None) if native is None else Morphology.coerce(native)
    if not isinstance(home, Morphology):
        raise InvalidArgumentError(
            "native, the body that the controller was made for, must be given: "
            "the controller has no morphology"
        )
    engines = [check_engine(name) for name in (c.native_engine, c.target_engine)]
    poses = random_poses(c.poses, c.seed)
    return Transfer(
        native=score(controller, home, poses, engines[0], c.seconds),
        target=score(
            controller, away, poses, engines[1], c.seconds, world, c.angle_error, c.believed_gain
        ),
        poses=poses,
    )


def score(
    controller: ControllerLike,
    morphology: MorphologyLike,
    poses: ArrayLike,
    engine: str = "auto",
    seconds: float = SECONDS,
    world: WorldConfig | None = None,
    angle_error: ArrayLike = (0.0, 0.0, 0.0),
    believed_gain: ArrayLike = (1.0, 1.0, 1.0),
) -> Scored:
    """Swim a controller on one body, from the zero pose and from each of ``poses`` (Q, 3).

    Evolved networks swim side by side in the compiled engine; any other controller, any in
    PyBullet, and any in a ``world`` with a lag, one pose after the other. ``angle_error`` and
    ``believed_gain`` are as in :class:`TransferConfig`. Raises as :func:`gait.swim`.
    """
    angles = finite_array("poses", poses, (None, 3), unit="rad")
    world, gain = world or WorldConfig(), believed_gain
    off = finite_array("angle_error", angle_error, (3,), unit="rad")
    at_once = resolve_engine("engine", engine) == "numba" and not world.lag
    if isinstance(controller, Controller) and at_once:
        distances = swim_all(
            [controller], morphology, angles, seconds, "float64",
            world=world, believed=angles + off, believed_gain=gain,
        )[0]  # fmt: skip
    else:
        swims = (
            swim(controller, morphology, pose, engine, seconds, world, pose + off, gain)
            for pose in angles
        )
        distances = np.array([one.distance for one in swims])
    zero = swim(
        controller, morphology, engine=engine, seconds=seconds, world=world, believed=off,
        believed_gain=gain,
    )  # fmt: skip
    return Scored(zero, distances)


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
