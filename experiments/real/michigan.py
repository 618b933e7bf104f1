"""The robotic fish of Michigan State: runs of a tail, tracked by a camera.

The logs are in the folder ``trainingData`` of
github.com/giorgosmamakoukas/dataDrivenControlOfRoboticFish (Mamakoukas, Castaño, Tan and Murphey,
RSS 2019). Each run has one command from rest on: the tail beats with an amplitude about a bias.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.utils.storage import DamagedFileError
from aquafish_gym.utils.validation import InvalidArgumentError
from experiments.real.planar_fish import FRAME
from instruments.verification.fish_data import SPEED_SECONDS

Floats = NDArray[np.float64]
Command = tuple[int, int]  # amplitude and bias of the tail, degrees

COLUMNS = ("time", "surge", "sway", "yaw rate", "heading", "x", "y")
FRAME_TOLERANCE = 1e-3  # s; times are written to a microsecond
STRIDE = 6  # frames between the samples of a run at 5 Hz
FEWEST_FRAMES = 40
FIRST_START = 4  # samples that precede the first start: a beat
STARTS_APART = 5  # samples between starts
AFTER_LAST_START = 11  # samples that follow every start, but for the first
FOLDS = 6


@dataclass(frozen=True, eq=False)
class Run:
    """One log."""

    name: str  #: Its folder and file.
    command: Command
    time: Floats  #: (T,), s
    pose: Floats  #: (T, 3) x and y in m and the unwrapped heading in rad, a row a frame.
    rates: Floats  #: (T, 3) surge and sway in m/s and yaw rate in rad/s, as published.

    @property
    def tail(self) -> Floats:
        """The commanded amplitude and bias, rad."""
        return np.deg2rad(np.array(self.command, np.float64))

    @property
    def samples(self) -> int:
        """The number of samples at 5 Hz, before the last frame."""
        return len(np.arange(self.time[0], self.time[-1], STRIDE * FRAME))

    @property
    def starts(self) -> range:
        """The samples at 5 Hz from which the rest of the run is predicted."""
        last = max(FIRST_START + 1, self.samples - AFTER_LAST_START)
        return range(FIRST_START, last, STARTS_APART)


def read(data: Path) -> list[Run]:
    """Return the runs in a folder, or in its ``trainingData``, by command and then by name.

    Raises
    ------
    InvalidArgumentError
        If there is no run in ``data``.
    DamagedFileError
        If a run has other columns, is too short, or lacks frames.
    """
    inner = data / "trainingData"
    folder = inner if inner.is_dir() else data
    found = sorted(folder.glob("Amp*Bias*/STATES*.txt"))
    if not found:
        raise InvalidArgumentError(
            "data must be the folder trainingData of giorgosmamakoukas/"
            f"dataDrivenControlOfRoboticFish, with files Amp*Bias*/STATES*.txt; {data} has none"
        )
    runs = [_read_run(path) for path in found]
    return sorted(runs, key=lambda run: (run.command, run.name))


def _read_run(path: Path) -> Run:
    name = f"{path.parent.name}/{path.name}"
    stated = re.fullmatch(r"Amp(\d+)Bias(-?\d+)", path.parent.name)
    if stated is None:
        raise DamagedFileError(f"the folder of {name} must be named AmpNNBiasNN, in degrees")
    try:
        table = np.loadtxt(path, ndmin=2)
    except ValueError as error:
        raise DamagedFileError(f"{name} is no table of numbers: {error}") from error
    if table.shape[1] != len(COLUMNS):
        raise DamagedFileError(
            f"{name} must have the {len(COLUMNS)} columns {', '.join(COLUMNS)}; "
            f"got {table.shape[1]}"
        )
    if len(table) < FEWEST_FRAMES or not np.isfinite(table).all():
        raise DamagedFileError(
            f"{name} must have {FEWEST_FRAMES} or more rows of finite numbers; got {len(table)}"
        )
    if np.abs(np.diff(table[:, 0]) - FRAME).max() > FRAME_TOLERANCE:
        raise DamagedFileError(f"{name} must have 30 rows a second, none missing")
    pose = np.column_stack([table[:, 5], table[:, 6], np.unwrap(table[:, 4])])
    command = (int(stated[1]), int(stated[2]))
    return Run(name, command, table[:, 0], pose, table[:, 1:4])


def straight_speeds(data: Path) -> list[tuple[int, list[float]]]:
    """Return amplitude (degrees) and mean speeds (m/s) of each run without bias, by name.

    The speeds are those in the second about each of ``SPEED_SECONDS`` after the run began, of the
    authors' filtered runs, ASTATES1 to ASTATES3, whose speeds are in m per 0.1 s. Two beats are a
    second of the files' clock.

    Raises
    ------
    InvalidArgumentError
        If ``data`` has no such run.
    DamagedFileError
        If a run is no table, or too short.
    """
    inner = data / "trainingData"
    found = sorted((inner if inner.is_dir() else data).glob("Amp*Bias0/ASTATES*.txt"))
    if not found:
        raise InvalidArgumentError(
            f"data must have filtered runs without bias, Amp*Bias0/ASTATES*.txt; {data} has none"
        )
    speeds = []
    for path in found:
        try:
            time, forward = np.loadtxt(path, usecols=(0, 1), ndmin=2).T
        except ValueError as error:
            raise DamagedFileError(f"{path} is no table of numbers: {error}") from error
        windows = [np.abs(time - at) <= 0.5 + FRAME_TOLERANCE for at in SPEED_SECONDS]
        if time[-1] < SPEED_SECONDS[-1] + 0.5 or time[0] > SPEED_SECONDS[0] - 0.5:
            raise DamagedFileError(
                f"{path} must last until {SPEED_SECONDS[-1] + 0.5:g} s; it ends at {time[-1]:g} s"
            )
        amplitude = int(path.parent.name.removeprefix("Amp").removesuffix("Bias0"))
        speeds.append((amplitude, [float(10.0 * forward[one].mean()) for one in windows]))
    return speeds


def folds(runs: Sequence[Run]) -> list[list[Command]]:
    """Return six sets of commands to hold out; all runs of a command are in one."""
    commands = sorted({run.command for run in runs})
    order = np.random.default_rng(0).permutation(len(commands))
    return [[commands[i] for i in order[fold::FOLDS]] for fold in range(FOLDS)]
