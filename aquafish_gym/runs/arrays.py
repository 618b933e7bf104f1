"""Arrays in files: npz archives that are checked before anything is allocated for them.

An archive's own checksums (CRC-32 of each member) find what a disk has changed.
"""

from __future__ import annotations

import os
import zipfile
import zlib
from collections.abc import Collection, Mapping
from io import BytesIO
from math import prod
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from aquafish_gym.runs.storage import DamagedFileError, read_bytes, write_bytes
from aquafish_gym.utils.validation import Shape, brief, fits, spelled

MOST_BYTES = 256 * 2**20  # of an archive's arrays together
_HEADERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
_NUMBERS = "fiub"  # kinds of dtype: floats, integers and truths, which are no pickles


def write_arrays(path: str | os.PathLike[str], arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays, of numbers alone, as a compressed npz archive, at once or not at all."""
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
    optional: Collection[str] = (),
) -> dict[str, NDArray[Any]]:
    """Return the arrays of an npz archive, which must be these and no others.

    Those that are ``optional`` may be missing. In messages ``argument`` names the file, which has
    at most ``most_bytes``, as have its arrays.

    Raises
    ------
    InvalidArgumentError, DamagedFileError
        If the file cannot be read or is too large; if it is no archive of just these arrays,
        whole; before any of them is allocated.
    """
    name = f"{argument}: {path}"
    content = BytesIO(read_bytes(path, argument, most_bytes))
    try:
        with zipfile.ZipFile(content) as archive:
            sizes = {member.filename: member.file_size for member in archive.infolist()}
            held = sorted(member.removesuffix(".npy") for member in archive.namelist())
            if sorted({*held, *optional}) != sorted(shapes) or len(set(held)) < len(held):
                wanted = ", ".join(sorted(shapes))
                raise DamagedFileError(
                    f"{name} must hold the arrays {wanted} and no others; "
                    f"it holds {brief(', '.join(held))}"
                )
            if sum(sizes.values()) > most_bytes:
                raise DamagedFileError(f"{name} must hold at most {most_bytes} bytes of arrays")
            return {
                array: _read_member(archive, array, shape, name)
                for array, shape in shapes.items()
                if array in held
            }
    except DamagedFileError:
        raise
    except (zipfile.BadZipFile, zlib.error, RuntimeError, NotImplementedError) as error:
        raise DamagedFileError(f"{name} is not a whole archive of arrays: {error}") from None
    except (OSError, EOFError, ValueError, SyntaxError, TypeError, AttributeError, KeyError):
        # What the modules for archives and headers raise on bytes that make no sense to them.
        raise DamagedFileError(f"{name} is not a whole archive of arrays") from None


def _read_member(archive: zipfile.ZipFile, name: str, wanted: Shape, file: str) -> NDArray[Any]:
    size = archive.getinfo(f"{name}.npy").file_size
    with archive.open(f"{name}.npy") as stream:
        version = npy.read_magic(stream)
        if version not in _HEADERS:
            raise DamagedFileError(f"{file} has {name} in a format that is not known")
        shape, columns_first, dtype = _HEADERS[version](stream)
        if dtype.kind not in _NUMBERS:
            raise DamagedFileError(f"{file} has {name} of {dtype}, which are no numbers")
        if not fits(shape, wanted):
            raise DamagedFileError(
                f"{file} must have {name} of shape {spelled(wanted)}; it is {shape}"
            )
        if prod(shape) * dtype.itemsize != size - stream.tell():
            raise DamagedFileError(
                f"{file} has {name} with as many numbers as its shape {shape} does not say"
            )
        content = stream.read()
    array: NDArray[Any] = np.frombuffer(content, dtype)
    return array.reshape(shape, order="F" if columns_first else "C").copy()
