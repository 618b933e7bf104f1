"""Haizhe: swims of a real AUV, healthy or with one of four faults, and their sessions.

The logs are in the folder ``Dataset`` of github.com/sunyrain/MLTask, also published as Mendeley
Data 7rp2pmr6mx. In each swim the robot floats at the surface, then its four thrusters push it down
for ten seconds with one and the same PWM.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from aquafish_gym.utils.storage import DamagedFileError
from aquafish_gym.utils.validation import InvalidArgumentError
from eea.logs.streams import Stream
from eea.logs.tables import read_recording

Floats = NDArray[np.float64]

HEALTHY = "Normal"
CONDITIONS = {  # folder -> what was done to the robot
    HEALTHY: "healthy",
    "AddWeight": "weight added",
    "PressureGain_constant": "depth sensor off",
    "PropellerDamage_slight": "propeller slightly damaged",
    "PropellerDamage_bad": "propeller badly damaged",
}
SPLITS = ("train", "test")  # the publishers' folders, read as one
RATE_HZ = 20.0
IDLE_PWM = 1100.0  # of a thruster that does not turn
LONGEST_SECONDS = 9.2  # of thrust that is read; the samples that a shorter swim lacks are NaN
SAMPLES = round(LONGEST_SECONDS * RATE_HZ)
FEWEST_SAMPLES = 100
COLUMNS = (  # those that are read
    "time", "pwm1", "depth", "press", "voltage", "roll", "pitch", "yaw", "w_yaw"
)  # fmt: skip
TURN_DEG = 45.0  # a swim that has turned so far tells the gyroscope's unit

# What a session keeps, each with how much it scatters from swim to swim.
VOLTAGE_SCATTER = 0.025
PRESSURE_SCATTER = 3.0
ROLL_SCATTER_DEG = 0.25
PITCH_SCATTER_DEG = 0.2
DISCHARGE_VOLTS_PER_HOUR = 0.30
METRES_PER_PRESSURE = 0.00945  # unit of the column ``press``
SHORTEST_PAUSE = 25.0  # s from the start of a swim to that of the session's next
LONGEST_PAUSE = 1500.0
USUAL_PAUSE = 600.0
NEW_SESSION_COST = 12.0  # in squared scatters
FEWEST_SWIMS = 6  # of a session
APART = 2.0  # mean squared scatters between sessions


@dataclass(frozen=True)
class Swim:
    """One log, from the first sample with thrust."""

    path: Path
    condition: str  #: one of ``CONDITIONS``
    clock: float  #: when it starts, s since midnight; the logs have no date
    surface_depth_m: float  #: mean reading until the robot moves
    rest: dict[str, float]  #: column -> median of the last samples before thrust
    thrust: dict[str, Floats]  #: column -> (SAMPLES,), with NaN after its end; ``w_yaw`` in rad/s


def read_swims(data: Path) -> list[Swim]:
    """Return all swims in a download, condition by condition.

    Parameters
    ----------
    data
        The clone or the unpacked archive, or its folder ``Dataset``.

    Raises
    ------
    InvalidArgumentError
        If it holds no such folder.
    DamagedFileError
        If a log lacks a column, has no thrust or another unit; see ``read_swim``.
    """
    roots = [root for root in (data / "Dataset", data) if (root / SPLITS[0] / HEALTHY).is_dir()]
    if not roots:
        raise InvalidArgumentError(
            f"{data} holds no Dataset/{SPLITS[0]}/{HEALTHY}; "
            "give the folder into which github.com/sunyrain/MLTask was downloaded"
        )
    return [
        read_swim(path, condition)
        for condition in CONDITIONS
        for split in SPLITS
        for path in sorted((roots[0] / split / condition).glob("*.csv"), key=_number)
    ]


def read_swim(path: Path, condition: str = HEALTHY) -> Swim:
    """Return one log; a line that was cut off at its end is left out.

    Raises
    ------
    DamagedFileError
        If it lacks a column, holds fewer than ``FEWEST_SAMPLES`` samples of thrust, or the yaw rate
        is not that of the heading in deg/s.
    """
    (table,) = read_recording(path).streams
    missing = [name for name in COLUMNS if name not in table.columns]
    if missing:
        has = ",".join(table.columns)
        raise DamagedFileError(f"{path} lacks the columns {', '.join(missing)}; it has {has!r}")
    column = {name: _numbers(path, table, name) for name in COLUMNS} if len(table) else {}
    driven = np.flatnonzero(column["pwm1"] > IDLE_PWM) if column else np.empty(0, dtype=int)
    if len(driven) == 0 or len(table) - driven[0] < FEWEST_SAMPLES:
        raise DamagedFileError(f"{path} holds less than {FEWEST_SAMPLES / RATE_HZ:g} s of thrust")
    first = max(int(driven[0]), 1)
    _check_gyroscope(path, column["yaw"][first:], column["w_yaw"][first:])
    column["w_yaw"] = np.deg2rad(column["w_yaw"])
    resting = slice(max(first - 3, 0), first)
    thrust = {name: np.full(SAMPLES, np.nan) for name in COLUMNS}
    for name, series in column.items():
        kept = series[first : first + SAMPLES]
        thrust[name][: len(kept)] = kept
    stamp = int(column["time"][0])
    return Swim(
        path,
        condition,
        clock=stamp // 10000 * 3600.0 + stamp // 100 % 100 * 60.0 + stamp % 100,
        surface_depth_m=float(column["depth"][: first + 2].mean()),  # it has not moved in 0.1 s
        rest={name: float(np.median(series[resting])) for name, series in column.items()},
        thrust=thrust,
    )


def _numbers(path: Path, table: Stream, name: str) -> Floats:
    try:
        return table.numbers(name)
    except InvalidArgumentError as error:
        raise DamagedFileError(f"{path} holds a cell that is no number: {error}") from None


def _number(path: Path) -> int:
    found = re.findall(r"\d+", path.stem)
    return int(found[-1]) if found else 0


def _check_gyroscope(path: Path, heading_deg: Floats, rate: Floats) -> None:
    """Refuse a yaw rate whose integral is not the turn of the heading."""
    turned = np.unwrap(heading_deg, period=360.0)
    turn = float(turned[-1] - turned[0])
    integral = float(rate.sum()) / RATE_HZ
    if abs(turn) > TURN_DEG and not 0.5 < integral / turn < 2.0:
        raise DamagedFileError(
            f"{path}: the heading turns by {turn:.0f} deg while w_yaw adds up to {integral:.2g}; "
            "w_yaw must be in deg/s"
        )


def sessions(swims: list[Swim]) -> NDArray[np.int64]:
    """Return the session of each swim (N,), from 0; a session holds swims of one condition.

    The logs name no session and no date. Within one the battery discharges steadily, and the
    pressure at the surface and the attitude at rest drift slowly. So the swims of a condition are
    linked, in the order of the clock, into the chains that cost least in squared scatters of these
    traits. Chains that the traits do not tell apart count as one session: better one too few than
    one that is split.
    """
    labels = np.full(len(swims), -1, dtype=np.int64)
    conditions = np.array([swim.condition for swim in swims])
    traits = np.array([_traits(swim) for swim in swims])
    clock = np.array([swim.clock for swim in swims])
    for condition in dict.fromkeys(conditions.tolist()):
        rows = np.flatnonzero(conditions == condition)
        rows = rows[np.argsort(clock[rows], kind="stable")]
        chains = _joined(_chains(traits[rows], clock[rows]), traits[rows])
        labels[rows] = chains + labels.max() + 1
    return labels


def _traits(swim: Swim) -> list[float]:
    """Return what a session keeps, in scatters."""
    hours = swim.clock / 3600.0
    surface = np.nanmedian(swim.thrust["press"] - swim.thrust["depth"] / METRES_PER_PRESSURE)
    return [
        (swim.rest["voltage"] + DISCHARGE_VOLTS_PER_HOUR * hours) / VOLTAGE_SCATTER,
        float(surface) / PRESSURE_SCATTER,
        swim.rest["roll"] / ROLL_SCATTER_DEG,
        swim.rest["pitch"] / PITCH_SCATTER_DEG,
    ]


def _chains(traits: Floats, clock: Floats) -> NDArray[np.int64]:
    """Return the chain of each swim (N,) in order of the clock: a path cover of least cost."""
    count = len(clock)
    pause = clock[None, :] - clock[:, None]
    cost = ((traits[:, None] - traits[None]) ** 2).sum(axis=2) / 2.0 + (pause / USUAL_PAUSE) ** 2
    possible = (pause >= SHORTEST_PAUSE) & (pause <= LONGEST_PAUSE)
    # Each swim has a successor or ends its chain, at the cost of a new one.
    cost = np.hstack([np.where(possible, cost, np.inf), np.full((count, count), np.inf)])
    cost[np.arange(count), count + np.arange(count)] = NEW_SESSION_COST
    _, successors = linear_sum_assignment(cost)
    chain = np.full(count, -1, dtype=np.int64)
    for i, successor in enumerate(successors):
        if chain[i] < 0:
            chain[i] = chain.max() + 1
        if successor < count:
            chain[successor] = chain[i]
    return chain


def _joined(chain: NDArray[np.int64], traits: Floats) -> NDArray[np.int64]:
    """Return chains, from 0, that are long enough and that the traits tell apart."""
    while True:
        labels, chain, counts = np.unique(chain, return_inverse=True, return_counts=True)
        if len(labels) == 1:
            return chain
        means = np.array([traits[chain == label].mean(axis=0) for label in range(len(labels))])
        apart = ((means[:, None] - means[None]) ** 2).mean(axis=2)
        np.fill_diagonal(apart, np.inf)
        shortest = int(counts.argmin())
        one = shortest if counts[shortest] < FEWEST_SWIMS else int(apart.min(axis=1).argmin())
        other = int(apart[one].argmin())
        if counts[one] >= FEWEST_SWIMS and apart[one, other] > APART:
            return chain
        chain = np.where(chain == one, other, chain)
