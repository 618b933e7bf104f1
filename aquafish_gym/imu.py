"""What the robot feels: roll, pitch and yaw, and its gyro (Sec. 3.1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.physics.attitude import continue_attitude
from aquafish_gym.utils.validation import integer

if TYPE_CHECKING:
    pass

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Floats = NDArray[np.floating]


@dataclass(frozen=True, repr=False)
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

    Examples
    --------
    >>> from aquafish_gym import simulate
    >>> log = simulate(None, [(0.4, 0.4, 0.5), (0.1, 0.2, 0.3)], steps=64, record="pose")
    >>> log
    ImuLog(B=2, T=64: rpy, gyro, pose)
    >>> len(log.plot(robot=1).axes)
    2
    """

    rpy: Floats
    gyro: Floats | None
    position: Floats | None
    quaternion: Floats | None
    fin_angles: Floats | None
    diverged: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.rpy)

    def __repr__(self) -> str:
        recorded = ["rpy", "gyro" if self.gyro is not None else "",
                    "pose" if self.position is not None else ""]  # fmt: skip
        lost = int(np.sum(self.diverged))
        return (
            f"ImuLog(B={len(self)}, T={self.rpy.shape[1]}: {', '.join(filter(None, recorded))}"
            f"{f'; {lost} diverged' if lost else ''})"
        )

    def plot(self, robot: int = 0) -> Figure:
        """Return a picture of what one robot felt: roll, pitch, yaw and, if recorded, the gyro.

        Raises
        ------
        InvalidArgumentError
            If there is no such robot.
        """
        # The object interface: no pyplot, no window system, no global state.
        from matplotlib.figure import Figure

        which = integer("robot", robot, 0, len(self) - 1)
        parts = [("rad", self.rpy, ("roll", "pitch", "yaw"))]
        if self.gyro is not None:
            parts.append(("rad/s", self.gyro, ("spin about x", "y", "z")))
        figure = Figure(figsize=(6, 2.2 * len(parts)), layout="constrained")
        axes = np.ravel(figure.subplots(len(parts), sharex=True))
        for ax, (unit, signals, names) in zip(axes, parts, strict=True):
            ax.plot(0.01 * np.arange(1, signals.shape[1] + 1), signals[which], label=names)
            ax.set_ylabel(unit)
            ax.legend(loc="upper left", fontsize="small")
        axes[-1].set_xlabel("s")
        return figure


def unwrap_rpy(rpy: NDArray[np.floating]) -> NDArray[np.float64]:
    """Make a log of attitudes (T, 3), in rad, continuous; the first sample is kept.

    The engines' logs are so already. This is for a physical robot's, before it is compared with
    theirs.
    """
    out = np.array(rpy, dtype=np.float64)
    for t in range(1, len(out)):
        out[t] = continue_attitude(tuple(out[t - 1]), tuple(out[t]))
    return out
