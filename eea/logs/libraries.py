"""What pymavlink, pyulog and mcap do not do by themselves with a damaged file."""

from __future__ import annotations

from typing import Any, BinaryIO

BIN_HEADER_BYTES = 3  # of a row
ULOG_HEADER_BYTES = 16
ULOG_DEFINITIONS = frozenset(b"BFIMPQ")  # messages before the first row
ULOG_ROWS = frozenset(b"ACL")  # messages that end the definitions
ULOG_MOST_BYTES = 10_000  # of a message that pyulog does not know, and takes for one


def open_dataflash(path: str) -> Any:
    """Return pymavlink's reader of a BIN file, a context that closes it.

    A damaged file raises any error of pymavlink, after it has been closed.
    """
    from pymavlink.DFReader import DFReader_binary

    class Layouts(dict[int, Any]):
        """Layouts of rows; pymavlink would read one without bytes forever."""

        def __setitem__(self, kind: int, layout: Any) -> None:
            if layout.len < BIN_HEADER_BYTES:
                raise ValueError(f"rows of {layout.name} have {layout.len} bytes")
            super().__setitem__(kind, layout)

    class Reader(DFReader_binary):  # type: ignore[misc]
        # The index that is made in C prints on damage past Python's own standard error.
        init_arrays_fast = DFReader_binary.init_arrays

        @property
        def formats(self) -> Layouts:
            return self.layouts

        @formats.setter
        def formats(self, layouts: dict[int, Any]) -> None:
            self.layouts = Layouts(layouts)

        def __init__(self) -> None:
            try:
                super().__init__(path, zero_time_base=True)
            except Exception:
                if hasattr(self, "data_map"):
                    self.data_map.close()
                self.filehandle.close()
                raise

    return Reader()


def ends_within_message(content: bytes) -> bool:
    """Return whether a ULog file ends in the middle of a message.

    Raises
    ------
    ValueError
        If a definition is damaged, on which pyulog would search forever.
    """
    at = ULOG_HEADER_BYTES
    defining = True
    while at + 3 <= len(content):
        size = int.from_bytes(content[at : at + 2], "little")
        kind = content[at + 2]
        defining = defining and kind not in ULOG_ROWS
        strange = kind == 0 or not 0 < size <= ULOG_MOST_BYTES
        if defining and kind not in ULOG_DEFINITIONS and strange:
            raise ValueError(f"no definition at byte {at}")
        at += 3 + size
    return at != len(content)


class WholeReads:
    """A file for mcap, which would take the short part at a cut file's end for a whole one.

    Parameters
    ----------
    file
        The file, at its start.
    size
        Its bytes.
    """

    def __init__(self, file: BinaryIO, size: int) -> None:
        self._file = file
        self._left = size

    def read(self, count: int) -> bytes:
        """Return ``count`` bytes; EndOfFile is raised if there are fewer, before they take memory.

        ``count`` may be damaged, too.
        """
        from mcap.exceptions import EndOfFile

        if not 0 <= count <= self._left:
            raise EndOfFile
        self._left -= count
        return self._file.read(count)
