"""Arrays of numbers in npz files, without pickles."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Collection, Mapping
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.runs.storage import DamagedFileError, read_bytes, write_bytes
from aquafish_gym.utils.validation import Shape, brief, fits, spelled

MOST_BYTES = 256 * 2**20  # of an archive's arrays together
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
    """Return the arrays of an npz archive, which must be those of ``shapes`` and no others.

    Those named in ``optional`` may be missing. The file has at most ``most_bytes``, and so have the
    arrays. Raises as ``storage.read_document``.
    """
    name = f"{argument}: {path}"
    content = BytesIO(read_bytes(path, argument, most_bytes))
    try:
        with zipfile.ZipFile(content) as archive:  # checks the CRC-32 of each member
            size = sum(member.file_size for member in archive.infolist())
        with np.load(content, allow_pickle=False) as loaded:
            arrays = dict(loaded) if size <= most_bytes else {}
    except Exception:  # zipfile and numpy's reader of headers raise a dozen kinds
        raise DamagedFileError(f"{name} is not a whole archive of arrays") from None
    if size > most_bytes:
        raise DamagedFileError(f"{name} must hold at most {most_bytes} bytes of arrays")
    if sorted({*arrays, *optional}) != sorted(shapes):
        raise DamagedFileError(
            f"{name} must hold the arrays {', '.join(sorted(shapes))} and no others; "
            f"it holds {brief(', '.join(sorted(arrays)))}"
        )
    for one, array in arrays.items():
        if array.dtype.kind not in _NUMBERS:
            raise DamagedFileError(f"{name} has {one} of {array.dtype}, which are no numbers")
        if not fits(array.shape, shapes[one]):
            raise DamagedFileError(
                f"{name} must have {one} of shape {spelled(shapes[one])}; it is {array.shape}"
            )
    return arrays
