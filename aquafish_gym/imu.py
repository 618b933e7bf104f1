"""The log of an inertial measurement unit: roll, pitch and yaw, and the gyro (Sec. 3.1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.utils.array_types import Reals


@dataclass(frozen=True, repr=False)
class ImuLog:
    """B robots' samples at T steps, taken after each step.

    Attributes
    ----------
    rpy
        (B, T, 3) roll, pitch, yaw in rad, continuous; None if not recorded.
    gyro
        (B, T, 3) angular velocity in body axes, rad/s; None if not recorded.
    position, quaternion, fin_angles
        Ground truth, only with ``record="pose"``: (B, T, 3) of the capsule's centre in the world,
        units of 5 cm; (B, T, 4) from body to world, (x, y, z, w); (B, T, F) of each fin its angle,
        or the phase of one that sweeps, in (-pi, pi].
    diverged
        (B,) whether a robot left the finite numbers; its samples are then NaN from there on.

    Examples
    --------
    >>> from aquafish_gym import simulate
    >>> log = simulate(None, [(0.4, 0.4, 0.5), (0.1, 0.2, 0.3)], steps=64, record="pose")
    >>> log
    ImuLog(B=2, T=64: rpy, gyro, pose)
    """

    rpy: Reals | None
    gyro: Reals | None
    position: Reals | None
    quaternion: Reals | None
    fin_angles: Reals | None
    diverged: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.diverged)

    def __repr__(self) -> str:
        recorded = {"rpy": self.rpy, "gyro": self.gyro, "pose": self.position}
        names = [name for name, samples in recorded.items() if samples is not None]
        steps = max((x.shape[1] for x in recorded.values() if x is not None), default=0)
        lost = f"; {self.diverged.sum()} diverged" if self.diverged.any() else ""
        return f"ImuLog(B={len(self)}, T={steps}: {', '.join(names) or 'nothing'}{lost})"


def join_logs(logs: Sequence[ImuLog]) -> ImuLog:
    """Return the logs of consecutive stretches of the same robots' swims as one."""
    if len(logs) == 1:
        return logs[0]
    parts = {name: [vars(log)[name] for log in logs] for name in vars(logs[0])}
    diverged = parts.pop("diverged")[-1]
    joined = {
        name: None if those[0] is None else np.concatenate(those, axis=1)
        for name, those in parts.items()
    }
    return ImuLog(**joined, diverged=diverged)
