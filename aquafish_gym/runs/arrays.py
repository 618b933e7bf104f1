"""Arrays of numbers in npz files, without pickles."""

from __future__ import annotations

import math
import os
import zipfile
from collections.abc import Collection, Mapping
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.utils.storage import DamagedFileError, open_regular, write_bytes
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    Shape,
    brief,
    file_path,
    fits,
    spelled,
)

MOST_BYTES = 256 * 2**20  # of all arrays of an archive together
_NUMBERS = "fiub"  # kinds of dtype: floats, integers and booleans


def write_arrays(path: str | os.PathLike[str], arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays of numbers as a compressed npz archive, whole or not at all."""
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
    """Return the arrays of an npz archive, which must have exactly the arrays of ``shapes``.

    Arrays named in ``optional`` may be missing. Neither the file nor the arrays may exceed
    ``most_bytes``. Raises as ``storage.read_document``.
    """
    name = f"{argument}: {file_path(argument, path)}"
    try:
        with open_regular(path, argument, most_bytes) as file, zipfile.ZipFile(file) as archive:
            members = archive.infolist()
            if sum(member.file_size for member in members) > most_bytes:
                raise DamagedFileError(f"{name} must hold at most {most_bytes} bytes of arrays")
            found = sorted(member.filename.removesuffix(".npy") for member in members)
            if len(set(found)) < len(found) or sorted({*found, *optional}) != sorted(shapes):
                raise DamagedFileError(
                    f"{name} must hold the arrays {', '.join(sorted(shapes))} and no others; "
                    f"it holds {brief(', '.join(found))}"
                )
            for member in members:  # checked before any array takes memory
                one = member.filename.removesuffix(".npy")
                _check_header(archive, member, shapes[one], name)
            # Reading checks the CRC-32 of each array.
            return {one: _read_array(archive, f"{one}.npy") for one in found}
    except InvalidArgumentError:
        raise
    except Exception:  # zipfile and numpy's reader of headers raise a dozen kinds of errors
        raise DamagedFileError(f"{name} is not a whole archive of arrays") from None


def _check_header(
    archive: zipfile.ZipFile, member: zipfile.ZipInfo, shape: Shape, name: str
) -> None:
    """Raise DamagedFileError unless a member is an array of numbers of a shape, by its header."""
    with archive.open(member) as content:
        version = np.lib.format.read_magic(content)
        if version != (1, 0):
            raise ValueError(f"an array of version {version}")
        found, _, dtype = np.lib.format.read_array_header_1_0(content)
        size = member.file_size - content.tell()
    if dtype.kind not in _NUMBERS:
        one = member.filename.removesuffix(".npy")
        raise DamagedFileError(f"{name} has {one} of {dtype}, which are no numbers")
    if not fits(found, shape):
        one = member.filename.removesuffix(".npy")
        raise DamagedFileError(f"{name} must have {one} of shape {spelled(shape)}; it is {found}")
    if math.prod(found) * dtype.itemsize != size:
        raise ValueError("an array of another size than its header says")


def _read_array(archive: zipfile.ZipFile, member: str) -> NDArray[Any]:
    with archive.open(member) as content:
        array: NDArray[Any] = np.lib.format.read_array(content, allow_pickle=False)
        if content.read(1):  # reads to the end, where the CRC-32 is checked
            raise ValueError("bytes after the array")
    return array
