"""What the single and the batched environment share: arguments, senses, start, information."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.damage import Damage
from aquafish_gym.engines.base import MAXIMUM_CURRENT, TIMESTEP
from aquafish_gym.morphology import Morphology
from aquafish_gym.validation import InvalidArgumentError, finite_array, integer, one_of

Floats = NDArray[np.float64]
Triple = tuple[float, float, float]

EPISODE_SECONDS = 20.0
EPISODE_STEPS = round(EPISODE_SECONDS / TIMESTEP)
# Micro-electromechanical gyros saturate at 2000 degrees/s, and an observation must be bounded.
GYRO_RANGE = math.radians(2000.0)
OPTIONS = ("fin_angles", "morphology", "damage")


@dataclass(frozen=True)
class Conditions:
    """The robot, its water and how its fins stand at first; from :func:`check_conditions`.

    ``fin_angles`` is ``"random"`` or three angles in rad.
    """

    morphology: Morphology
    damage: Damage
    fin_angles: str | Triple
    current: Triple

    @property
    def body(self) -> Morphology:
        """The damaged body."""
        return self.damage.apply(self.morphology)

    def with_options(
        self, options: Mapping[str, Any] | None, also: tuple[str, ...] = ()
    ) -> Conditions:
        """Return the conditions of one episode, with the options given to ``reset``.

        ``also`` names options that are allowed but not read here.

        Raises
        ------
        InvalidArgumentError, UnknownNameError
            If an option is unknown or bad.
        """
        if options is None:
            return self
        if not isinstance(options, Mapping):
            raise InvalidArgumentError(f"options must be a dictionary; got {options!r}")
        for name in options:
            one_of("options", name, OPTIONS + also)
        found = replace(
            self,
            morphology=Morphology.coerce(options.get("morphology", self.morphology)),
            damage=Damage.coerce(options.get("damage", self.damage)),
            fin_angles=check_fin_angles(options.get("fin_angles", self.fin_angles)),
        )
        found.body  # noqa: B018  # raises if the damage does not fit the body
        return found

    def draw_fin_angles(self, count: int, rng: np.random.Generator) -> Floats:
        """Return initial angles (count, 3) in rad."""
        if isinstance(self.fin_angles, str):
            return rng.uniform(-math.pi, math.pi, (count, 3))
        return np.tile(np.array(self.fin_angles), (count, 1))


def check_conditions(
    morphology: object, damage: object, current: ArrayLike, fin_angles: object
) -> Conditions:
    """Return conditions from an environment's arguments.

    Raises
    ------
    InvalidArgumentError, UnknownNameError
        The message names the argument, what was expected and what came.
    """
    water = finite_array("current", current, (3,), -MAXIMUM_CURRENT, MAXIMUM_CURRENT, "units/s")
    whole = Conditions(
        Morphology.nominal(),
        Damage(),
        (0.0, 0.0, 0.0),
        (water[0].item(), water[1].item(), water[2].item()),
    )
    return whole.with_options(
        {"morphology": morphology, "damage": damage, "fin_angles": fin_angles}
    )


def check_fin_angles(value: object) -> str | Triple:
    """Return ``"random"`` or three angles in rad from ``"zero"``, ``"random"`` or three angles."""
    if isinstance(value, str):
        name = one_of("fin_angles", value, ("zero", "random"))
        return name if name == "random" else (0.0, 0.0, 0.0)
    angles = finite_array("fin_angles", value, (3,), unit="rad")  # type: ignore[arg-type]
    return (float(angles[0]), float(angles[1]), float(angles[2]))


def check_frame_skip(value: object) -> int:
    """Return the physics steps in each control step.

    Raises
    ------
    InvalidArgumentError
        If an episode, which lasts 20 s for everybody, is not a whole number of control steps.
    """
    skip = integer("frame_skip", value, 1, EPISODE_STEPS)
    if EPISODE_STEPS % skip:
        low = next(n for n in range(skip, 0, -1) if EPISODE_STEPS % n == 0)
        high = next(n for n in range(skip, EPISODE_STEPS + 1) if EPISODE_STEPS % n == 0)
        raise InvalidArgumentError(
            f"frame_skip must divide {EPISODE_STEPS}, the physics steps of an episode of "
            f"{EPISODE_SECONDS:g} s; got {skip}; the nearest are {low} and {high}"
        )
    return skip


def episode_length(frame_skip: int) -> int:
    """Return the control steps of an episode of 20 s."""
    return EPISODE_STEPS // frame_skip


def check_action(action: object, shape: tuple[int, ...]) -> Floats:
    """Return an action as float64 of this shape, clipped to [-1, 1].

    Raises
    ------
    InvalidArgumentError
        If it has another shape or is not finite.
    """
    if isinstance(action, np.ndarray) and action.shape == shape and action.dtype.kind == "f":
        wish = action.astype(np.float64)
        if np.isfinite(wish).all():
            return wish.clip(-1.0, 1.0)
    return finite_array("action", action, shape).clip(-1.0, 1.0)  # type: ignore[arg-type]


def action_space() -> Box[np.float32]:
    """Return the space of actions: three servos in [-1, 1]."""
    return Box(-1.0, 1.0, (3,), np.float32)


def observation_space(observe_fins: bool) -> Box[np.float32]:
    """Return the space of observations; see ``AquaFishEnv``."""
    high = np.ones(15 if observe_fins else 9, np.float32)
    high[6:9] = GYRO_RANGE
    return Box(-high, high, dtype=np.float32)


def observe(
    quaternion: Floats, gyro: Floats, fin_angles: Floats | None, space: Box[np.float32]
) -> NDArray[np.float32]:
    """Return what the IMU says, shape (..., 9), or (..., 15) with the fins' angles.

    Parameters
    ----------
    quaternion
        (..., 4) from body to world, (x, y, z, w).
    gyro
        (..., 3) angular velocity in body axes, rad/s.
    fin_angles
        (..., 3) the servos' angles in rad, or None to hide them.
    space
        Of one observation; what leaves it saturates.
    """
    x, y, z, w = (quaternion[..., i] for i in range(4))
    senses = np.empty((*gyro.shape[:-1], *space.shape), np.float32)
    # The world's z, then its y, in body axes: rows of the rotation matrix.
    senses[..., 0] = 2 * (x * z - w * y)
    senses[..., 1] = 2 * (y * z + w * x)
    senses[..., 2] = 1 - 2 * (x * x + y * y)
    senses[..., 3] = 2 * (x * y + w * z)
    senses[..., 4] = 1 - 2 * (x * x + z * z)
    senses[..., 5] = 2 * (y * z - w * x)
    senses[..., 6:9] = gyro
    if fin_angles is not None:
        senses[..., 9:12] = np.sin(fin_angles)
        senses[..., 12:15] = np.cos(fin_angles)
    return np.minimum(np.maximum(senses, space.low), space.high)


def motion_info(before: Floats, after: Floats, dt: float) -> dict[str, Any]:
    """Return where the robot is and how fast it got there, from positions (..., 3).

    Nothing returned shares memory with the positions.
    """
    speed = (after - before) / dt
    return {
        **{f"{axis}_position": after[..., i].copy() for i, axis in enumerate("xyz")},
        **{f"{axis}_velocity": speed[..., i] for i, axis in enumerate("xyz")},
        "distance_from_origin": np.sqrt((after * after).sum(axis=-1)),
    }
