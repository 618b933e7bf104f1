"""CrazyPAD: flights of two real drones, some with propellers cut short.

Masalimov, Muslimov, Kozlov and Munasypov, "CrazyPAD: a dataset for assessing the impact of
structural defects on nano-quadcopter performance", Data 2024, 9, 79. The logs are in the folder
``data`` of github.com/AerialRoboticsUUST/CrazyPAD, as a Crazyflie writes them on its memory card.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.utils.storage import DamagedFileError, read_bytes
from aquafish_gym.utils.validation import InvalidArgumentError

Floats = NDArray[np.float64]
Four = tuple[float, float, float, float]

MOTORS = ("M1", "M2", "M3", "M4")
WHOLE_LENGTH_MM = 47.0  # of a propeller, tip to tip
SESSIONS = ("E8, 9 April", "E8, 16 April", "E9, 9 April", "E9, May")  # of 2022
RECORDERS = ("motor_data", "controller_data")  # folders, by what their logs hold
MAGIC = 0xBC
CHECKSUM_BYTES = 4
MOST_BYTES = 2**25
REGULAR_EVENT = "fixedFrequency"  # whose rows are samples; other events are rare and left out
STAMPS = {1: ("<HI", 1e-3), 2: ("<HQ", 1e-6)}  # version -> layout of key and time, s a tick
FIELD_TYPES = "bBhHiIqQfd"
LONGEST_BLADE_CUT_MM = 30.0  # in a folder's name, a greater length is what is left


@dataclass(frozen=True)
class Flight:
    """One log, and what the name of its folder says was done to the drone."""

    path: Path
    drone: str  #: E8 or E9
    healthy: bool
    #: How much shorter each propeller is, both blades together, mm; None if the name does not say.
    cuts: Four | None = None

    @property
    def recorder(self) -> str:
        """The kind of log: one of ``RECORDERS``."""
        return self.path.parent.parent.name

    @property
    def number(self) -> int:
        """The number in the log's name."""
        return int(self.path.name.rpartition("log")[2])


class _Event(NamedTuple):
    name: str
    fields: tuple[str, ...]
    row: struct.Struct


def read_log(path: Path) -> dict[str, Floats]:
    """Return the columns of a log (T,), and ``t``, the time in s.

    Raises
    ------
    DamagedFileError
        If the file is no such log, is cut short, or has another checksum than it says.
    InvalidArgumentError
        If it cannot be read.
    """
    content = read_bytes(path, "log", MOST_BYTES)
    if not content or content[0] != MAGIC:
        raise DamagedFileError(f"{path} is no log of a Crazyflie: it does not begin with 0xBC")
    body = content[:-CHECKSUM_BYTES]
    if crc32(body) != int.from_bytes(content[-CHECKSUM_BYTES:], "little"):
        raise DamagedFileError(f"{path} is cut short or damaged: its checksum is wrong")
    try:
        return _columns(body)
    except (struct.error, KeyError, ValueError) as error:
        raise DamagedFileError(f"{path} is no log that can be read: {error}") from None


def _columns(body: bytes) -> dict[str, Floats]:
    version, kinds = struct.unpack_from("<HH", body, 1)
    if version not in STAMPS:
        raise ValueError(f"its version must be 1 or 2; got {version}")
    layout, seconds = STAMPS[version]
    stamp = struct.Struct(layout)
    at = 5
    events: dict[int, _Event] = {}
    for _ in range(kinds):
        (key,) = struct.unpack_from("<H", body, at)
        events[key], at = _event(body, at + 2)
    times = []
    rows = []
    fields: tuple[str, ...] = ()
    while at < len(body):
        key, time = stamp.unpack_from(body, at)
        at += stamp.size
        if key not in events:
            raise ValueError(f"it has an event {key} that it does not describe")
        event = events[key]
        if event.name == REGULAR_EVENT:
            times.append(time * seconds)
            rows.append(event.row.unpack_from(body, at))
            fields = event.fields
        at += event.row.size
    if not rows:
        raise ValueError("it holds no samples")
    table = np.array(rows, dtype=np.float64)
    return {"t": np.array(times), **dict(zip(fields, table.T, strict=True))}


def _event(body: bytes, at: int) -> tuple[_Event, int]:
    """Return the kind of event that is described at a place, and the place after it."""
    name, at = _text(body, at)
    (count,) = struct.unpack_from("<H", body, at)
    at += 2
    fields = []
    layout = "<"
    for _ in range(count):
        field, at = _text(body, at)  # such as motor.m1(I)
        found = re.fullmatch(rf"(.+)\(([{FIELD_TYPES}])\)", field)
        if found is None:
            raise ValueError(f"it has a field {field!r} of no known type")
        fields.append(found[1])
        layout += found[2]
    return _Event(name, tuple(fields), struct.Struct(layout)), at


def _text(body: bytes, at: int) -> tuple[str, int]:
    """Return the text that ends with a null character, and the place after it."""
    end = body.index(0, at)
    return body[at:end].decode("ascii", "replace"), end + 1


def cuts_in_name(folder: str) -> Four | None:
    """Return how much shorter each propeller is, mm, by the name of a folder of cut propellers.

    None if the name does not say what is left of the propeller: "2 mm" may then be of one blade or
    of both.

    Raises
    ------
    InvalidArgumentError
        If the lengths in the name do not add up to a whole propeller.

    Examples
    --------
    >>> cuts_in_name("cut_propeller_M3_1mm_0.5mm_45.5mm")
    (0.0, 0.0, 1.5, 0.0)
    >>> cuts_in_name("cut_propeller_M3_2mm") is None
    True
    """
    cuts = [0.0] * len(MOTORS)
    for motor, lengths in re.findall(r"[Mm]([1-4])((?:_[\d.]+mm)+)", folder.replace("мм", "mm")):
        blades = [float(length) for length in re.findall(r"([\d.]+)mm", lengths)]
        if blades[-1] < LONGEST_BLADE_CUT_MM:
            return None
        left = blades.pop()
        if abs(sum(blades) + left - WHOLE_LENGTH_MM) > 1e-6:
            raise InvalidArgumentError(
                f"the cuts of M{motor} in {folder!r} and the {left} mm that are left must be "
                f"{WHOLE_LENGTH_MM:g} mm in all"
            )
        cuts[int(motor) - 1] = sum(blades)
    one, two, three, four = cuts
    return (one, two, three, four) if any(cuts) else None


def flights(data: Path) -> list[Flight]:
    """Return the flights of whole drones and of those with cut propellers, in order.

    Flights with weights or tape, and cuts of which the name says no length, are left out.

    Parameters
    ----------
    data
        The folder of the download, or its folder ``data``.

    Raises
    ------
    InvalidArgumentError
        If it is not that folder.
    """
    for root in (data / "data", data):
        if all((root / recorder).is_dir() for recorder in RECORDERS):
            found = list(_flights(root))
            if found:
                return found
    raise InvalidArgumentError(
        f"data must be the folder of CrazyPAD, with data/{RECORDERS[0]} and data/{RECORDERS[1]} "
        f"in it; got {data}"
    )


def _flights(root: Path) -> Iterator[Flight]:
    for recorder in RECORDERS:
        for folder in sorted((root / recorder).iterdir()):
            healthy = folder.name == "normal_flight"
            cuts = cuts_in_name(folder.name) if folder.name.startswith("cut_") else None
            if not healthy and cuts is None:
                continue
            for path in sorted(folder.glob("E[0-9]_log*")):
                yield Flight(path, path.name[:2], healthy, None if healthy else cuts)


def session(flight: Flight) -> str:
    """Return the one of ``SESSIONS`` of a flight with cut propellers, by the data's history.

    In a session the drone was flown, cut shorter, and flown again.
    """
    assert flight.cuts is not None
    if flight.drone == "E9":
        return "E9, 9 April" if flight.cuts[2] else "E9, May"
    return "E8, 9 April" if sum(flight.cuts) <= 3.0 else "E8, 16 April"


def build(flight: Flight) -> str:
    """Return the build of a healthy flight: flights between which the drone was not touched.

    The logs do not say when a propeller was touched. The commands of healthy flights do: they jump
    by up to 7% of one motor's between these builds, and agree within 1% inside them. The last of E8
    was flown a week later.
    """
    number = flight.number
    if flight.drone == "E9":
        return "E9 b" if flight.recorder == "motor_data" and number > 2 else "E9 a"
    if flight.recorder == "motor_data":
        if number < 2:
            return "E8 a"
        return "E8 b" if number < 5 else "E8 c"
    return "E8 a" if number < 3 else "E8 c"
