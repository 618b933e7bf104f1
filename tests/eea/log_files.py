"""Small logs, written with the libraries that recorders' own tools use."""

from __future__ import annotations

import json
import struct

import numpy as np

RATES = np.random.default_rng(0).uniform(-1.0, 1.0, (120, 3)).round(4)
TIME = 0.01 * np.arange(len(RATES))
PULSE_TIME = 0.1 * np.arange(12)
PULSES = np.repeat([[1500.0, 1700.0, 1600.0], [1300.0, 1500.0, 1900.0]], 6, axis=0)
#: The commands of the pulses at TIME, rev/s, rev/s and Hz.
COMMANDS = np.repeat((PULSES - [1500.0, 1500.0, 1500.0]) / [800.0, 800.0, 400.0], 10, axis=0)
SCALED = {
    "left_pectoral": "0.00125*{}-1.875",
    "right_pectoral": "0.00125*{}-1.875",
    "caudal": "0.0025*{}-3.75",
}


def scaled(*columns):
    """Return a map of three columns of pulse widths."""
    return {
        key: text.format(name) for (key, text), name in zip(SCALED.items(), columns, strict=True)
    }


def write_csv(path):
    """Write a table in degrees/s and ms, separated by semicolons; return its map."""
    heading = ["t [ms]", *(f"gyro_{axis} [deg/s]" for axis in "xyz")]
    pulses = np.repeat(PULSES, 10, axis=0)
    table = np.column_stack([1e3 * TIME, np.rad2deg(RATES), pulses])
    np.savetxt(
        path, table, "%.12g", ";", header=";".join([*heading, "s1", "s2", "s3"]), comments=""
    )
    return {"time": heading[0], "gyro": ",".join(heading[1:]), **scaled("s1", "s2", "s3")}


def write_parquet(path):
    """Write a table with dates and an array in a cell, as LeRobot does; return its map."""
    import pyarrow as pa
    from pyarrow import parquet

    pulses = np.repeat(PULSES, 10, axis=0).tolist()
    stamps = (1_700_000_000_000_000 + (1e6 * TIME).round()).astype("datetime64[us]")
    table = pa.table({
        "when": pa.array(stamps),
        "gyro": pa.array(RATES.tolist()),
        "pulse": pa.array([dict(zip("abc", row, strict=True)) for row in pulses]),
        "note": pa.array(["swims"] * len(TIME)),
    })  # fmt: skip
    parquet.write_table(table, path)
    return {
        "time": "when", "gyro": "gyro[0],gyro[1],gyro[2]",
        **scaled("pulse.a", "pulse.b", "pulse.c"),
    }  # fmt: skip


def write_bin(path, sensors=1, unit="E"):
    """Write the log of an ArduSub with FMT, UNIT and FMTU messages; return its map.

    Its gyroscope's axes are forward, right and down. Unit "E" is rad/s, and "k" is deg/s.
    """
    from pymavlink.DFReader import DFFormat

    define = DFFormat(0x80, "FMT", 89, "BBnNZ", "Type,Length,Name,Format,Columns")
    kinds: dict[str, DFFormat] = {}
    content = []

    def write(layout, *values):
        head = bytes([0xA3, 0x95, layout.type])
        content.append(head + struct.pack(layout.msg_struct, *values))

    def kind(number, name, types, columns):
        layout = DFFormat(number, name, 0, types, columns)
        size = 3 + struct.calcsize(layout.msg_struct)
        write(define, number, size, name.encode(), types.encode(), columns.encode())
        kinds[name] = layout

    write(define, 0x80, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns")
    kind(1, "UNIT", "QbZ", "TimeUS,Id,Label")
    kind(2, "FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds")
    kind(3, "IMU", "QBfff", "TimeUS,I,GyrX,GyrY,GyrZ")
    kind(4, "RCOU", "QHHH", "TimeUS,C1,C2,C3")
    kind(5, "MSG", "QZ", "TimeUS,Message")
    for letter, label in (
        ("s", "s"),
        ("#", "instance"),
        ("E", "rad/s"),
        ("k", "deg/s"),
        ("Y", "us"),
    ):
        write(kinds["UNIT"], 0, ord(letter), label.encode())
    write(kinds["FMTU"], 0, 3, f"s#{3 * unit}".encode(), b"F----")
    write(kinds["FMTU"], 0, 4, b"sYYY", b"F---")
    write(kinds["MSG"], 0, b"ArduSub V4.5.0")
    for row, (x, y, z) in enumerate(RATES):
        stamp = 5_000_000 + round(1e6 * TIME[row])
        if row % 10 == 0:
            write(kinds["RCOU"], stamp, *PULSES[row // 10].astype(int).tolist())
        for sensor in range(sensors):
            write(kinds["IMU"], stamp, sensor, y, x, -z)
    path.write_bytes(b"".join(content))
    name = "IMU" if sensors == 1 else "IMU[0]"
    return {
        "gyro": f"{name}.GyrY,{name}.GyrX,-{name}.GyrZ",
        **scaled("RCOU.C1", "RCOU.C2", "RCOU.C3"),
    }


def write_ulog(path):
    """Write the log of a PX4; return its map."""
    from pyulog import ULog

    log = ULog(None)
    topics = {
        "sensor_gyro": ("float x;float y;float z;", 1e6 * TIME, RATES),
        "actuator_outputs": ("float[3] output;", 1e6 * PULSE_TIME, PULSES),
    }
    for number, (name, (fields, stamps, rows)) in enumerate(topics.items()):
        text = f"{name}:uint64_t timestamp;{fields}".encode()
        log._message_formats[name] = ULog.MessageFormat(text, None)
        head = struct.pack("<BH", 0, number) + name.encode()
        added = ULog._MessageAddLogged(head, None, log._message_formats)
        for stamp, row in zip(stamps, rows, strict=True):
            added.buffer += struct.pack("<Qfff", 7_000_000 + round(stamp), *row)
        log._data_list.append(ULog.Data(added))
    log.write_ulog(str(path))
    return {
        "gyro": "sensor_gyro.x,sensor_gyro.y,sensor_gyro.z",
        **scaled(*(f"actuator_outputs.output[{i}]" for i in range(3))),
    }


def write_mcap(path, behind=0.0, compression="zstd"):
    """Write JSON messages with stamps; those of the servos are ``behind`` s; return the map."""
    from mcap.writer import CompressionType, Writer

    with path.open("wb") as file:
        log = Writer(file, chunk_size=2000, compression=CompressionType[compression.upper()])
        log.start()
        schema = log.register_schema("any", "jsonschema", b"{}")
        imu, servos, picture = (
            log.register_channel(topic, encoding, schema)
            for topic, encoding in (("/imu", "json"), ("/servos", "json"), ("/camera", "jpeg"))
        )

        def write(channel, stamp, late, **message):
            sec, nanosec = divmod(stamp - round(1e9 * late), 10**9)
            header = {"stamp": {"sec": sec, "nanosec": nanosec}}
            data = json.dumps({"header": header, **message}).encode()
            log.add_message(channel, stamp + 1_000_000, data, stamp)

        for row, rates in enumerate(RATES.tolist()):
            stamp = 1_700_000_000 * 10**9 + round(1e9 * TIME[row])
            if row % 10 == 0:
                write(servos, stamp, behind, data=PULSES[row // 10].tolist())
            write(imu, stamp, 0.0, turn=dict(zip("xyz", rates, strict=True)))
        log.add_message(picture, stamp, b"\xff\xd8", stamp)
        log.finish()
    return {
        "gyro": "/imu.turn.x,/imu.turn.y,/imu.turn.z",
        **scaled(*(f"/servos.data[{i}]" for i in range(3))),
    }


WRITERS = {
    "csv": write_csv, "parquet": write_parquet, "BIN": write_bin, "ulg": write_ulog,
    "mcap": write_mcap,
}  # fmt: skip


def small_mcap(path, messages, **options):
    """Write messages of one topic, by default in JSON."""
    from mcap.writer import Writer

    kind, encoding = options.pop("kind", b"{}"), options.pop("encoding", "json")
    with path.open("wb") as file:
        log = Writer(file, **options)
        log.start()
        schema = log.register_schema("p/A", "ros1msg" if encoding == "ros1" else "jsonschema", kind)
        channel = log.register_channel("/a", encoding, schema)
        for number, message in enumerate(messages):
            log.add_message(channel, 10**7 * number, message, 10**7 * number)
        log.finish()
