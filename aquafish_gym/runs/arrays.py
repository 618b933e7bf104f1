"""Arrays in files: npz archives that are checked before anything is allocated for them.

An archive's own checksums (CRC-32 of each member) find what a disk has changed.
"""

from __future__ import annotations

import os
import zipfile
import zlib
from collections.abc import Mapping
from io import BytesIO
from math import prod
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from aquafish_gym.runs.storage import DamagedFileError, read_bytes, write_bytes

MOST_BYTES = 256 * 2**20  # of an archive's arrays together
Shape = tuple[int | None, ...]
_NUMBERS = "fiub"  # kinds of dtype: floats, integers and truths, which are no pickles


def write_arrays(path: str | os.PathLike[str], arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays of numbers as a compressed npz archive, at once or not at all.

    Raises
    ------
    TypeError
        If an array is of anything but numbers.
    CannotWriteError
        If the file cannot be written.
    """
    for name, array in arrays.items():
        if np.asarray(array).dtype.kind not in _NUMBERS:
            raise TypeError(f"{name} must be an array of numbers; it is of {array.dtype}")
    content = BytesIO()
    np.savez_compressed(content, **dict(arrays))  # type: ignore[arg-type]
    write_bytes(path, content.getvalue())


def read_arrays(
    path: str | os.PathLike[str],
    shapes: Mapping[str, Shape],
    argument: str = "file",
    most_bytes: int = MOST_BYTES,
) -> dict[str, NDArray[Any]]:
    """Return the arrays of an npz archive.

    Parameters
    ----------
    path
        The file.
    shapes
        Name to shape of all arrays that it must hold, and no others; ``None`` in a shape is any
        length.
    argument
        Which argument names the file, for messages.
    most_bytes
        Of the file, and of all arrays together.

    Raises
    ------
    InvalidArgumentError
        If the file cannot be read or is too large.
    DamagedFileError
        If it is no archive of just these arrays, whole; before any of them is allocated.
    """
    name = f"{argument}: {path}"
    content = BytesIO(read_bytes(path, argument, most_bytes))
    try:
        with zipfile.ZipFile(content) as archive:
            return _read_members(archive, shapes, most_bytes)
    except _UnfitError as error:
        raise DamagedFileError(f"{name} {error}") from None
    except (zipfile.BadZipFile, zlib.error, RuntimeError, NotImplementedError) as error:
        raise DamagedFileError(f"{name} is not a whole archive of arrays: {error}") from None
    except (OSError, EOFError, ValueError, SyntaxError, TypeError, AttributeError, KeyError):
        # What the modules for archives and headers raise on bytes that make no sense to them.
        raise DamagedFileError(f"{name} is not a whole archive of arrays") from None


class _UnfitError(Exception):
    """An archive holds something else."""


def _read_members(
    archive: zipfile.ZipFile, shapes: Mapping[str, Shape], most_bytes: int
) -> dict[str, NDArray[Any]]:
    members = archive.infolist()
    if sorted(member.filename for member in members) != sorted(f"{name}.npy" for name in shapes):
        raise _UnfitError(f"must hold the arrays {', '.join(sorted(shapes))} and no others")
    if sum(member.file_size for member in members) > most_bytes:
        raise _UnfitError(
            f"must hold at most {most_bytes} bytes of arrays; it says that it has more"
        )
    return {
        name: _read_member(archive, f"{name}.npy", name, shape) for name, shape in shapes.items()
    }


def _read_member(archive: zipfile.ZipFile, member: str, name: str, wanted: Shape) -> NDArray[Any]:
    size = archive.getinfo(member).file_size
    with archive.open(member) as stream:
        version = npy.read_magic(stream)
        if version == (1, 0):
            shape, columns_first, dtype = npy.read_array_header_1_0(stream)
        elif version == (2, 0):
            shape, columns_first, dtype = npy.read_array_header_2_0(stream)
        else:
            raise _UnfitError(f"has {name} in a format that is not known")
        if dtype.kind not in _NUMBERS:
            raise _UnfitError(f"has {name} of {dtype}, which are no numbers")
        if len(shape) != len(wanted) or any(
            there is not None and here != there for here, there in zip(shape, wanted, strict=True)
        ):
            spelled = "(" + ", ".join("any" if n is None else str(n) for n in wanted) + ")"
            raise _UnfitError(f"must have {name} of shape {spelled}; it is {shape}")
        if prod(shape) * dtype.itemsize != size - stream.tell():
            raise _UnfitError(f"has {name} with as many numbers as its shape {shape} does not say")
        content = stream.read()
    array: NDArray[Any] = np.frombuffer(content, dtype)
    whole = array.reshape(shape[::-1]).T if columns_first else array.reshape(shape)
    return whole.copy()
