"""What the robot feels: roll, pitch and yaw, and its gyro (Sec. 3.1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.physics.attitude import continue_attitude

if TYPE_CHECKING:
    pass

Floats = NDArray[np.floating]


@dataclass(frozen=True)
class ImuLog:
    """B robots' samples at T steps, taken after each step.

    Attributes
    ----------
    rpy
        (B, T, 3) roll, pitch, yaw in rad, continuous.
    gyro
        (B, T, 3) angular velocity in body axes, rad/s; None if it was not recorded.
    position
        (B, T, 3) of the capsule's centre in the world, units of 5 cm; only with
        ``record="pose"``.
    quaternion
        (B, T, 4) from body to world, (x, y, z, w); only with ``record="pose"``.
    fin_angles
        (B, T, 3) left and right pectoral angle and caudal phase in (-pi, pi]: the truth, which
        no IMU knows; only with ``record="pose"``.
    diverged
        (B,) whether a robot left the finite numbers; its samples are then NaN from there on.
    """

    rpy: Floats
    gyro: Floats | None
    position: Floats | None
    quaternion: Floats | None
    fin_angles: Floats | None
    diverged: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.rpy)


def unwrap_rpy(rpy: NDArray[np.floating]) -> NDArray[np.float64]:
    """Make a log of attitudes (T, 3), in rad, continuous; the first sample is kept.

    The engines' logs are so already. This is for a physical robot's, before it is compared with
    theirs.
    """
    out = np.array(rpy, dtype=np.float64)
    for t in range(1, len(out)):
        out[t] = continue_attitude(tuple(out[t - 1]), tuple(out[t]))
    return out
