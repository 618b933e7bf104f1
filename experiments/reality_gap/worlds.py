"""The worlds of the reality-gap suite, one line each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from aquafish_gym import Damage
from aquafish_gym.damage import Fault
from aquafish_gym.plans import AQUAFISH
from eea.fish import RealityGap

USUAL_NOISE = 0.01  # rad/s in each sample: what a cheap gyroscope has
_GAP = 0x676170  # "gap" in ASCII: the suite's own random streams


class Drawn(NamedTuple):
    """A replicate's random parameters, the same in every world that uses them."""

    drag: tuple[float, float]  #: Of fins and body, 0.8 to 1.2 each.
    servo_gain: float  #: Of all three, 0.9 to 1.1.
    current: tuple[float, float, float]  #: Up to 0.2 units/s, in any direction.
    gyro_bias: tuple[float, float, float]  #: Up to 0.05 rad/s on each axis.
    seized: str  #: A fin.
    seized_angle: float  #: Any.


@dataclass(frozen=True)
class World:
    """How the target's world differs from the models'."""

    difference: str  #: The difference, in words.
    gap: Callable[[Drawn], dict[str, Any]]  #: Fields of ``RealityGap``.
    engine: str = "numba"


def _servo(drawn: Drawn) -> tuple[float, float, float]:
    return (drawn.servo_gain,) * 3


def _noisy(sd: float) -> World:
    return World(f"gyro noise of {sd:g} rad/s", lambda _: {"gyro_noise": sd})


WORLDS: dict[str, World] = {
    "plain": World("no difference, not even noise", lambda _: {"gyro_noise": 0.0}),
    **{f"noise-{sd:g}": _noisy(sd) for sd in (0.001, 0.01, 0.03, 0.1)},
    "bias": World("gyro bias within 0.05 rad/s", lambda d: {"gyro_bias": d.gyro_bias}),
    "drag": World("drag of fins and body within 20%", lambda d: {"drag": d.drag}),
    "servo": World("servo gain 0.9 to 1.1", lambda d: {"servo_gain": _servo(d)}),
    "lag": World("servos move 0.05 s late", lambda _: {"lag": 0.05}),
    "current": World("a current of up to 0.2 units/s", lambda d: {"current": d.current}),
    "everything": World(
        "drag, servo gain, current and bias together",
        lambda d: {
            "drag": d.drag,
            "servo_gain": _servo(d),
            "current": d.current,
            "gyro_bias": d.gyro_bias,
        },
    ),
    "seized": World(
        "one servo is stuck",
        lambda d: {"servo_gain": tuple(0.0 if fin == d.seized else 1.0 for fin in AQUAFISH.names)},
    ),
    "reactive": World("the water resists acceleration, too", lambda _: {"reactive": True}),
    "substeps-8": World("8 physics steps for each of the models'", lambda _: {"substeps": 8}),
    "pybullet": World("PyBullet's mechanics", lambda _: {}, engine="pybullet"),
}


def draw(seed: int) -> Drawn:
    """Draw a replicate's parameters."""
    rng = np.random.default_rng([_GAP, seed])
    drag = rng.uniform(0.8, 1.2, 2)
    gain = rng.uniform(0.9, 1.1)
    direction = rng.standard_normal(3)
    speed = rng.uniform(0.0, 0.2)
    current = speed * direction / np.linalg.norm(direction)
    bias = rng.uniform(-0.05, 0.05, 3)
    return Drawn(
        (float(drag[0]), float(drag[1])),
        float(gain),
        (float(current[0]), float(current[1]), float(current[2])),
        (float(bias[0]), float(bias[1]), float(bias[2])),
        AQUAFISH.names[rng.integers(len(AQUAFISH.names))],
        float(rng.uniform(-np.pi, np.pi)),
    )


def gap_of(world: str, seed: int) -> RealityGap:
    """Return the reality gap of a world in a replicate; the gyro noise is 0.01 if not given.

    Examples
    --------
    >>> print(gap_of("lag", seed=0))
    lag 0.05, gyro_noise 0.01
    """
    return RealityGap(**{"gyro_noise": USUAL_NOISE, **WORLDS[world].gap(draw(seed))})


def seized_of(world: str, seed: int) -> Damage:
    """Return the seized servo of a world in a replicate, whose angle a gap lacks.

    Examples
    --------
    >>> print(seized_of("seized", seed=0))
    caudal:seized=1.5508348617349466
    """
    drawn = draw(seed)
    if world != "seized":
        return Damage()
    return Damage((Fault(drawn.seized, "seized", drawn.seized_angle),))
