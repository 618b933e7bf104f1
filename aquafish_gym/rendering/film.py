"""Films from frames: GIF and mp4."""

from __future__ import annotations

import os
import tempfile
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

    pictures = _check_frames(frames, fps)
    pause = 10 * max(2, round(100 / fps))  # ms; viewers slow down anything shorter than 20
    data = iio.imwrite("<bytes>", pictures, extension=".gif", duration=pause, loop=0)
    write_bytes(path, bytes(data))
    return Path(path)


def write_mp4(frames: Iterable[Frame], path: str | os.PathLike[str], fps: float = 20.0) -> Path:
    """Write frames (H, W, 3), of even size, as an H.264 film; returns its path.

    Raises
    ------
    InvalidArgumentError
        If there are no frames, they differ in size, a side is odd, or fps is out of range.
    """
    import imageio.v2 as iio

    pictures = _check_frames(frames, fps)
    if pictures.shape[1] % 2 or pictures.shape[2] % 2:
        raise InvalidArgumentError(
            f"an mp4 needs an even width and height; got {pictures.shape[2]} x {pictures.shape[1]}"
        )
    with tempfile.TemporaryDirectory() as folder:
        draft = Path(folder) / "film.mp4"
        with iio.get_writer(
            draft, format="FFMPEG", fps=fps, codec="libx264", quality=8, macro_block_size=2
        ) as film:
            for picture in pictures:
                film.append_data(picture)  # type: ignore[attr-defined]
        write_bytes(path, draft.read_bytes())
    return Path(path)


def _check_frames(frames: Iterable[Frame], fps: float) -> Frame:
    finite_array("fps", fps, (), 0.1, 240.0)
    pictures = [np.asarray(frame) for frame in frames]
    if not pictures:
        raise InvalidArgumentError("frames must hold at least one picture; got none")
    shape = pictures[0].shape
    for picture in pictures:
        if picture.dtype != np.uint8 or picture.ndim != 3 or picture.shape[2] != 3:
            raise InvalidArgumentError(
                "frames must be (height, width, 3) pictures of uint8; "
                f"got {picture.shape} of {picture.dtype}"
            )
        if picture.shape != shape:
            raise InvalidArgumentError(
                f"frames must all be of one size; got {shape} and {picture.shape}"
            )
    return np.stack(pictures)
