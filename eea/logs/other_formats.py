"""Formats that people hand in for a log, and how to make a log of them."""

from __future__ import annotations

from aquafish_gym.utils.storage import DamagedFileError

PACKED = "it is packed: unpack it first"
TABLE = "write the columns as CSV or Parquet"
#: The first bytes of a file -> what it is, and what to do.
BEGINNINGS = {
    b"#ROSBAG": "it is a ROS 1 bag: convert it by `mcap convert swim.bag swim.mcap`",
    b"SQLite format 3": (
        "it is a ROS 2 bag in SQLite: convert it by `mcap convert swim.db3 swim.mcap`"
    ),
    b"version https://git-lfs": "it is a pointer of Git LFS: get the file by `git lfs pull`",
    b"PK\x03\x04": PACKED,
    b"\x1f\x8b": PACKED,
    b"\x28\xb5\x2f\xfd": PACKED,
    b"BZh": PACKED,
    b"\x89HDF": f"it is an HDF5 file: {TABLE}",
    b"MATLAB 5": f"it is a MATLAB file: {TABLE}",
    b"FMT, 128": "it is an ArduPilot log as text: download the BIN of the same flight",
    b"H Product:Blackbox": "it is a Blackbox log: convert it by `blackbox_decode`, to CSV",
}
TLOG_MAGIC = (0xFD, 0xFE)  # the first byte of a MAVLink packet, after 8 bytes of time


def refuse_other(begin: bytes) -> None:
    """Raise DamagedFileError if the first bytes of a file are those of a known other format."""
    for beginning, advice in BEGINNINGS.items():
        if begin.startswith(beginning):
            raise DamagedFileError(advice)
    if len(begin) > 8 and begin[0] == 0 and begin[8] in TLOG_MAGIC:
        raise DamagedFileError(
            "it is a telemetry log of MAVLink: take the BIN of the vehicle, whose rates are higher,"
            " or convert it by `mavlogdump.py --format csv --types RAW_IMU swim.tlog`"
        )
