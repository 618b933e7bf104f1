"""Films from frames."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.runs.storage import write_bytes
from aquafish_gym.utils.validation import InvalidArgumentError, finite_array

Frame = NDArray[np.uint8]


def write_gif(frames: Iterable[Frame], path: str | os.PathLike[str], fps: float = 20.0) -> Path:
    """Write frames (H, W, 3) as a GIF that repeats for ever; returns its path.

    GIF counts hundredths of a second, so that only fps of 100 / n come out exactly.

    Raises
    ------
    InvalidArgumentError
        If there are no frames, they differ in size, or fps is out of range.
    """
    import imageio.v3 as iio

    finite_array("fps", fps, (), 0.1, 240.0)
    pictures = [np.asarray(frame) for frame in frames]
    if not pictures:
        raise InvalidArgumentError("frames must hold at least one picture; got none")
    for picture in pictures:
        if picture.dtype != np.uint8 or picture.ndim != 3 or picture.shape[2] != 3:
            raise InvalidArgumentError(
                "frames must be (height, width, 3) pictures of uint8; "
                f"got {picture.shape} of {picture.dtype}"
            )
        if picture.shape != pictures[0].shape:
            raise InvalidArgumentError(
                f"frames must all be of one size; got {pictures[0].shape} and {picture.shape}"
            )
    pause = 10 * max(2, round(100 / fps))  # ms; viewers slow down anything shorter than 20
    data = iio.imwrite("<bytes>", np.stack(pictures), extension=".gif", duration=pause, loop=0)
    write_bytes(path, bytes(data))
    return Path(path)
