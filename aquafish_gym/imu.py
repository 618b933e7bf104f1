"""What the robot feels: roll, pitch and yaw, and its gyro (Sec. 3.1)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.physics.attitude import continue_attitude
from aquafish_gym.utils.validation import integer

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Floats = NDArray[np.floating]

# Micro-electromechanical gyros saturate at 2000 degrees/s, and an observation must be bounded.
GYRO_RANGE = math.radians(2000.0)
GOAL_RANGE = 100.0  # units, beyond which a goal is observed at this distance along each axis

_AXES = {
    "rpy": ("rad", ("roll", "pitch", "yaw")),
    "gyro": ("rad/s", ("spin about x", "spin about y", "spin about z")),
}


@dataclass(frozen=True, repr=False)
class ImuLog:
    """B robots' samples at T steps, taken after each step.

    Attributes
    ----------
    rpy
        (B, T, 3) roll, pitch, yaw in rad, continuous; None if they were not recorded.
    gyro
        (B, T, 3) angular velocity in body axes, rad/s; None if it was not recorded.
    position, quaternion, fin_angles
        The truth, which no IMU knows; only with ``record="pose"``: (B, T, 3) of the capsule's
        centre in the world, units of 5 cm; (B, T, 4) from body to world, (x, y, z, w); (B, T, 3)
        left and right pectoral angle and caudal phase in (-pi, pi].
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

    rpy: Floats | None
    gyro: Floats | None
    position: Floats | None
    quaternion: Floats | None
    fin_angles: Floats | None
    diverged: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.diverged)

    def _felt(self) -> dict[str, Floats]:
        """Return what was recorded of what the IMU feels."""
        return {n: x for n, x in (("rpy", self.rpy), ("gyro", self.gyro)) if x is not None}

    def __repr__(self) -> str:
        names = [*self._felt(), *(["pose"] if self.position is not None else [])]
        steps = max((samples.shape[1] for samples in self._felt().values()), default=0)
        lost = f"; {self.diverged.sum()} diverged" if self.diverged.any() else ""
        return f"ImuLog(B={len(self)}, T={steps}: {', '.join(names) or 'nothing'}{lost})"

    def _repr_html_(self) -> str:
        """Return the least and the greatest of each signal over all robots, as a table."""
        rows = ""
        for signal, samples in self._felt().items():
            for name, felt in zip(_AXES[signal][1], samples.T, strict=True):
                known = felt[np.isfinite(felt)]
                ends = f"{known.min():.3f}</td><td>{known.max():.3f}" if known.size else "</td><td>"
                rows += f"<tr><td>{name}</td><td>{ends}</td></tr>"
        head = "<tr><th>rad, rad/s</th><th>least</th><th>greatest</th></tr>"
        return f"<p>{self!r}</p><table>{head}{rows}</table>"

    def plot(self, robot: int = 0) -> Figure:
        """Return a picture of what one robot felt: roll, pitch and yaw, and the gyro."""
        from matplotlib.figure import Figure  # no pyplot, no window system, no global state

        which = integer("robot", robot, 0, len(self) - 1)
        felt = self._felt()
        figure = Figure(figsize=(6, 2.2 * len(felt)), layout="constrained")
        axes = np.ravel(figure.subplots(len(felt), sharex=True))
        for ax, (signal, samples) in zip(axes, felt.items(), strict=True):
            unit, names = _AXES[signal]
            ax.plot(0.01 * np.arange(1, samples.shape[1] + 1), samples[which], label=names)
            ax.set_ylabel(unit)
            ax.legend(loc="upper left", fontsize="small")
        axes[-1].set_xlabel("s")
        return figure


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


def unwrap_rpy(rpy: NDArray[np.floating]) -> NDArray[np.float64]:
    """Make a physical robot's attitudes (T, 3), in rad, continuous, as the engines' logs are."""
    out = np.array(rpy, dtype=np.float64)
    for t in range(1, len(out)):
        out[t] = continue_attitude(tuple(out[t - 1]), tuple(out[t]))
    return out
