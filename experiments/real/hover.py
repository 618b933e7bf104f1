"""From a log of a flight to the commands that keep a drone hovering."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from aquafish_gym.utils.validation import InvalidArgumentError
from experiments.real.crazypad import Flight, Floats, read_log

FULL_COMMAND = 65535.0
SAMPLE_RATE_HZ = 100
WINDOW_SAMPLES = SAMPLE_RATE_HZ  # 1 s
GROUND_SAMPLES = 2 * SAMPLE_RATE_HZ  # a longer gap is the landing between the two legs
SMOOTHED_SAMPLES = SAMPLE_RATE_HZ // 4
FASTEST_CLIMB_M_S = 0.08
LOWEST_HOVER_M = 0.4
LEAST_FLYING_COMMAND = 0.15
#: Rows: the parts of the four motors' commands that lift, roll, pitch and turn a drone.
MIX = np.array([[1, 1, 1, 1], [-1, -1, 1, 1], [1, -1, -1, 1], [1, -1, 1, -1]]) / 4.0
AXES = ("thrust", "roll", "pitch", "yaw")


@dataclass(frozen=True, eq=False)
class Hover:
    """What the hover of a flight tells."""

    flight: Flight
    #: (W, 4), the logarithms of the motors' commands in windows of 1 s, as ``AXES``
    signal: Floats
    speed: Floats  #: (W,), forward, m/s

    @property
    def mean(self) -> Floats:
        """The mean of all windows (4,)."""
        found: Floats = self.signal.mean(axis=0)
        return found


def commands(log: dict[str, Floats]) -> Floats:
    """Return the motors' commands (T, 4), as shares of the greatest.

    Logs of the controller hold thrust, roll, pitch and yaw, which the firmware mixes.
    """
    if "motor.m1" in log:
        rows = np.array([log[f"motor.m{motor}"] for motor in (1, 2, 3, 4)])
    else:
        roll, pitch = (np.trunc(log[f"controller.cmd_{axis}"] / 2.0) for axis in ("roll", "pitch"))
        axes = [log["controller.cmd_thrust"], roll, pitch, log["controller.cmd_yaw"]]
        rows = np.sign(MIX).T @ np.array(axes)
    shares: Floats = np.clip(rows.T, 0.0, FULL_COMMAND) / FULL_COMMAND
    return shares


def legs(log: dict[str, Floats]) -> Iterator[np.ndarray]:
    """Yield the samples, out and back, in which the drone neither climbs nor sinks."""
    height = log["stateEstimate.z"]
    smoothing = np.full(SMOOTHED_SAMPLES, 1.0 / SMOOTHED_SAMPLES)
    climb = np.convolve(np.gradient(height, log["t"]), smoothing, "same")
    flying = commands(log).max(axis=1) > LEAST_FLYING_COMMAND
    steady = np.flatnonzero(
        flying & (np.abs(climb) < FASTEST_CLIMB_M_S) & (height > LOWEST_HOVER_M)
    )
    gaps = np.flatnonzero(np.diff(steady) > GROUND_SAMPLES)
    yield from np.split(steady, gaps + 1)


def hover(flight: Flight) -> Hover:
    """Return the hover of a flight.

    A window's command is the mean, before its logarithm: thrust goes nearly with the command, and
    the mean thrust carries the drone, however much a damaged propeller makes the command tremble.

    Raises
    ------
    InvalidArgumentError
        If the log lacks a column, or the drone does not hover for a second.
    """
    log = read_log(flight.path)
    try:
        shares = commands(log)
        speed = np.gradient(log["stateEstimate.x"], log["t"])
        windows = [leg[: len(leg) // WINDOW_SAMPLES * WINDOW_SAMPLES] for leg in legs(log)]
    except KeyError as error:
        raise InvalidArgumentError(f"{flight.path} has no column {error}") from None
    rows = np.concatenate(windows).reshape(-1, WINDOW_SAMPLES)
    if not len(rows):
        raise InvalidArgumentError(f"the drone in {flight.path} does not hover for a second")
    signal = np.log(np.maximum(shares[rows].mean(axis=1), 1e-3)) @ MIX.T
    return Hover(flight, signal, speed[rows].mean(axis=1))
