"""Write a flight of a drone as PX4 and as ArduPilot record it: flight.ulg and 00000001.BIN.

    python examples/recorded_flight.py --out out/flight
    aquafish logs out/flight/flight.ulg

A drone rolls for 20 s as its controller commands. Its motors take 0.05 s to follow, its roll
command of 1 makes 60 rad/s^2, and its roll rate decays by 2 1/s. PX4 records the rate at 200 Hz
and the command at 50 Hz, with a gap of 0.1 s where its card was busy. ArduPilot records both at
50 Hz, in degrees/s. This needs the extra logs.
"""

from __future__ import annotations

import struct
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.runs.command_line import Out, run_command_line
from aquafish_gym.utils.storage import ensure_writable_directory

SECONDS = 20.0
STEP = 0.005  # s, of the simulation and of PX4's gyroscope
EACH = 4  # steps between two commands
HELD = 60  # steps for which a command is held, on average
GAIN, LAG, DAMPING = 60.0, 0.05, 2.0  # rad/s^2, s, 1/s
NOISE = 0.02  # rad/s
STARTED = 90_000_000  # us since the computer started
Floats = NDArray[np.float64]


def fly(seed: int = 0) -> tuple[Floats, Floats]:
    """Return the roll rates (T,) that a gyroscope measures, rad/s, and the commands (T,)."""
    rng = np.random.default_rng(seed)
    count = round(SECONDS / STEP)
    changes = np.cumsum(rng.random(count // EACH) < EACH / HELD).repeat(EACH)
    command = rng.uniform(-0.1, 0.1, count)[changes]
    rate = np.zeros(count)
    moment = 0.0
    for step in range(1, count):
        moment += -np.expm1(-STEP / LAG) * (GAIN * command[step - 1] - moment)
        rate[step] = rate[step - 1] + STEP * (moment - DAMPING * rate[step - 1])
    return rate + rng.normal(0.0, NOISE, count), command


def write_ulog(path: Path, rate: Floats, command: Floats) -> None:
    """Write the log of a PX4."""
    from pyulog import ULog

    log: Any = ULog(None)
    stamps = STARTED + np.round(1e6 * STEP * np.arange(len(rate))).astype(int)
    busy = (stamps > STARTED + 9.0e6) & (stamps < STARTED + 9.1e6)
    topics = {
        "vehicle_angular_velocity": (rate, np.flatnonzero(~busy)),
        "vehicle_torque_setpoint": (
            command,
            np.flatnonzero(~busy & (np.arange(len(rate)) % EACH == 0)),
        ),
    }
    for number, (name, (values, rows)) in enumerate(topics.items()):
        layout = f"{name}:uint64_t timestamp;float[3] xyz;".encode()
        log._message_formats[name] = ULog.MessageFormat(layout, None)
        head = struct.pack("<BH", 0, number) + name.encode()
        added = ULog._MessageAddLogged(head, None, log._message_formats)
        for row in rows:
            added.buffer += struct.pack("<Qfff", int(stamps[row]), values[row], 0.0, 0.0)
        log._data_list.append(ULog.Data(added))
    log.write_ulog(str(path))


def write_dataflash(path: Path, rate: Floats, command: Floats) -> None:
    """Write the log of an ArduPilot."""
    from pymavlink.DFReader import DFFormat

    define: Any = DFFormat(0x80, "FMT", 89, "BBnNZ", "Type,Length,Name,Format,Columns")
    layouts = [
        define,
        DFFormat(1, "UNIT", 0, "QbZ", "TimeUS,Id,Label"),
        DFFormat(2, "FMTU", 0, "QBNN", "TimeUS,FmtType,UnitIds,MultIds"),
        DFFormat(3, "RATE", 0, "Qff", "TimeUS,R,ROut"),
    ]
    content: list[bytes] = []

    def write(layout: Any, *values: Any) -> None:
        content.append(bytes([0xA3, 0x95, layout.type]) + struct.pack(layout.msg_struct, *values))

    for one in layouts:
        size = 3 + struct.calcsize(one.msg_struct)
        words = (one.name, one.format, ",".join(one.columns))
        write(define, one.type, size, *(word.encode() for word in words))
    _, unit, units, row = layouts
    write(unit, 0, ord("s"), b"s")
    write(unit, 0, ord("k"), b"deg/s")
    write(units, 0, row.type, b"sk-", b"F--")
    for step in range(0, len(rate), EACH):
        stamp = STARTED + round(1e6 * STEP * step)
        write(row, stamp, np.rad2deg(rate[step]), command[step])
    path.write_bytes(b"".join(content))


@dataclass(frozen=True)
class RecordedFlight:
    """Write a flight of a drone as PX4 and ArduPilot record it."""

    example: ClassVar[str] = "--out out/flight"

    out: Out
    seed: int = 0  #: Seed of the flight.

    def execute(self) -> None:
        """Write both files."""
        folder = ensure_writable_directory(self.out)
        flight = fly(self.seed)
        write_ulog(folder / "flight.ulg", *flight)
        write_dataflash(folder / "00000001.BIN", *flight)


if __name__ == "__main__":
    sys.exit(run_command_line("recorded_flight.py", RecordedFlight))
