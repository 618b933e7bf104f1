"""Films: swims side by side from one start line, in one fixed frame.

Each fish draws a trail. Fins that are broken are marked, see ``robot_parts``.
"""

from __future__ import annotations

import itertools
import os
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from aquafish_gym.morphology import Morphology
from aquafish_gym.rendering import scene
from aquafish_gym.rendering.camera import Camera, Frame, View
from aquafish_gym.rendering.scene import Colour, Floats
from aquafish_gym.runs.storage import write_bytes
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    MissingExtraError,
    finite_array,
    integer,
    one_of,
)

SUFFIXES = (".mp4", ".webp", ".gif")
CM_PER_UNIT = 5
_LANE = 3.5  # least distance between the paths of two fish, units
_FISH = 2.4  # room for a fish around its centre
_HOLD = 1.5  # s, of the last frame
# Blue, vermilion, green, purple, orange: distinct for the colour-blind (Okabe and Ito).
_TRAILS = ((0, 114, 178), (213, 94, 0), (0, 130, 95), (150, 60, 120), (180, 120, 0))


class Motion(Protocol):
    """A recorded swim, as ``rollout`` and ``gait.swim`` return it."""

    @property
    def time(self) -> Floats: ...
    @property
    def position(self) -> Floats: ...
    @property
    def quaternion(self) -> Floats: ...
    @property
    def fin_angles(self) -> Floats: ...


class Stage(NamedTuple):
    """The body from a time on, in s, and which of its fins are broken."""

    begin: float
    morphology: Morphology
    broken: tuple[str, ...] = ()


@dataclass(frozen=True)
class FilmedSwim:
    """A swim in a film.

    Attributes
    ----------
    label
        A few words.
    motion
        Where the robot was; the film ends with the last sample before it diverged.
    stages
        Its body, in the order of time; the first begins at 0.
    """

    label: str
    motion: Motion
    stages: tuple[Stage, ...]


def film(
    swims: Sequence[FilmedSwim],
    path: str | os.PathLike[str],
    width: int = 960,
    height: int = 540,
    fps: float = 20.0,
    speed: float = 1.0,
) -> Path:
    """Write a film of swims side by side as .mp4, .webp or .gif; return its path.

    ``speed`` is that of the film relative to the swim. An .mp4 needs the extra ``film``, without
    which MissingExtraError is raised.
    """
    integer("width", width, 64, 4096)
    integer("height", height, 64, 4096)
    finite_array("speed", speed, (), 0.01, 100.0)
    finite_array("fps", fps, (), 0.1, 240.0)
    if not swims:
        raise InvalidArgumentError("swims must be at least one; got none")
    return write_film(film_frames(swims, width, height, fps, speed), path, fps)


class _Lane(NamedTuple):
    """A swim in a lane of its own, until it diverged."""

    swim: FilmedSwim
    colour: Colour
    time: Floats
    path: Floats
    quaternion: Floats
    fin_angles: Floats

    def sample_at(self, moment: float) -> int:
        """Return which sample is the last until a moment."""
        return max(0, int(np.searchsorted(self.time, moment + 1e-9)) - 1)

    def solid_at(self, i: int) -> Floats:
        """Return the robot of sample i."""
        from aquafish_gym.rendering.caster import solid_parts

        stages = self.swim.stages
        now = next(one for one in reversed(stages) if one.begin <= self.time[i] + 1e-9)
        pose = (self.path[[i]], self.quaternion[[i]], self.fin_angles[[i]])
        poses = scene.part_poses(now.morphology, *pose, now.broken)[0]
        return solid_parts(scene.robot_parts(now.morphology, now.broken), poses)


def _lanes(swims: Sequence[FilmedSwim]) -> list[_Lane]:
    """Return swims side by side, the first the farthest from the camera."""
    lanes, x = [], 0.0
    for swim, colour in zip(swims, itertools.cycle(_TRAILS), strict=False):
        motion = swim.motion
        good = np.logical_and.accumulate(np.isfinite(motion.position).all(axis=1))
        rows = (motion.time, motion.position, motion.quaternion, motion.fin_angles)
        time, position, quaternion, angles = (row[good] for row in rows)
        path = position + np.array([x - position[:, 0].min(), 0, 0])
        lanes.append(_Lane(swim, colour, time, path, quaternion, angles))
        x = path[:, 0].max() + _LANE
    return lanes


def film_frames(
    swims: Sequence[FilmedSwim], width: int, height: int, fps: float, speed: float
) -> Iterator[Frame]:
    """Yield the frames of :func:`film`; the last, at the end of the longest swim, is held."""
    from aquafish_gym.rendering import caster

    lanes = _lanes(swims)
    everywhere = np.concatenate([lane.path for lane in lanes])
    low, high = everywhere.min(axis=0), everywhere.max(axis=0)
    view = fitting_view(everywhere, width / height)
    floor = min(scene.FLOOR, low[2] - scene.CLEARANCE)
    marks = np.arange(0.0, high[1] + _FISH, scene.MAIN_GRID_SPACING)
    ends = np.array([[(x, y, 0.0) for x in (low[0] - _FISH, high[0] + _FISH)] for y in marks])
    rulers = [(line, scene.INK if line[0, 1] == 0 else scene.GRID) for line in ends]
    at = [view.project(lane.path[0] - (1.7, 0.0, 0.0), width, height)[1] for lane in lanes]
    end = max(float(lane.time[-1]) for lane in lanes)
    moments = [*np.arange(0.0, end - 1e-9, speed / fps), *[end] * (1 + round(_HOLD * fps))]
    pace = "" if speed == 1 else f"  (x {speed:g})"
    for moment in moments:
        samples = [lane.sample_at(moment) for lane in lanes]
        robots = [lane.solid_at(i) for lane, i in zip(lanes, samples, strict=True)]
        trails = [(lane.path[: i + 1], lane.colour) for lane, i in zip(lanes, samples, strict=True)]
        picture = caster.draw_water(view, floor, robots, width, height)
        picture = _draw_lines(picture, view, rulers + trails)
        caster.draw_robots(picture, view, robots)
        words = [
            (f"{lane.swim.label}  {lane.path[i, 1] * CM_PER_UNIT:+.0f} cm", lane.colour, row)
            for lane, i, row in zip(lanes, samples, at, strict=True)
        ]
        feet = view.project(ends[:, 1], width, height)
        yield _write(picture, words, f"{moment:.1f} s{pace}", feet)


def fitting_view(points: Floats, aspect: float) -> View:
    """Return a view from the right and above in which fish at all points (n, 3) are seen."""
    camera = Camera(azimuth=90.0, elevation=42.0, field_of_view=24.0)
    view = camera.look(np.zeros(3))
    around = np.array(list(itertools.product((-_FISH, _FISH), repeat=3)))
    x, y, z = ((points[:, None] + around).reshape(-1, 3) @ np.array(view[1:4]).T).T
    centre, far = [], []
    for across, slope in ((x, view.slope * aspect), (y, view.slope)):
        # Points are in the frame where |across - centre| <= slope (z + distance).
        high, low = (across / slope - z).max(), (-across / slope - z).max()
        centre.append(slope * (high - low) / 2)
        far.append((high + low) / 2)
    eye = centre[0] * view.right + centre[1] * view.up - max(far) * view.forward
    return view._replace(eye=eye, distance=float(max(far)))


def _draw_lines(picture: Frame, view: View, lines: Sequence[tuple[Floats, Colour]]) -> Frame:
    """Return a picture with lines through points (n, 3), each in a colour."""
    size = 2 * picture.shape[1], 2 * picture.shape[0]  # drawn larger, then averaged
    image = Image.fromarray(picture)
    for points, colour in lines:
        mask = Image.new("L", size)
        pixels = [(x, y) for x, y, _ in view.project(points, *size)]
        ImageDraw.Draw(mask).line(pixels, 255, max(2, size[1] // 180), "curve")
        image.paste(colour, mask=mask.reduce(2))
    return np.array(image)


def _write(
    picture: Frame, captions: Sequence[tuple[str, Colour, float]], time: str, feet: Floats
) -> Frame:
    """Return a picture with captions at the left, the time, and distances below the rulers."""
    height, width = picture.shape[:2]
    image = Image.fromarray(picture)
    draw, size = ImageDraw.Draw(image), max(10, height // 24)
    font, edge = ImageFont.load_default(size), size // 2
    for text, colour, row in captions:
        at = (edge, min(max(row, 2 * size), height - size))
        draw.text(at, text, colour, font, "ls", stroke_width=2, stroke_fill=scene.WATER_ABOVE)
    for i, (x, y, _) in enumerate(feet):
        text = f"{i * scene.MAIN_GRID_SPACING * CM_PER_UNIT:.0f} cm" if i else "start"
        draw.text((x, min(y + 2, height - size - 2)), text, scene.INK, font, "ma")
    draw.text((width - edge, edge), time, scene.INK, font, "ra")
    return np.array(image)


def write_film(frames: Iterable[Frame], path: str | os.PathLike[str], fps: float = 20.0) -> Path:
    """Write frames (H, W, 3) of one size as .mp4, .webp or .gif; return the path.

    Films as .webp and .gif repeat forever. GIF counts hundredths of a second, so only frame rates
    of 100 / n are exact. An .mp4 needs the extra ``film`` and an even width and height.
    """
    suffix = one_of("the film's suffix", Path(path).suffix, SUFFIXES)
    finite_array("fps", fps, (), 0.1, 240.0)
    pictures = _checked(frames)
    first = next(pictures)
    write = _encode if suffix == ".mp4" else _animate
    write_bytes(path, write(first, pictures, suffix, fps))
    return Path(path)


def write_gif(frames: Iterable[Frame], path: str | os.PathLike[str], fps: float = 20.0) -> Path:
    """Write frames as :func:`write_film` does, as .gif."""
    one_of("the film's suffix", Path(path).suffix, (".gif",))
    return write_film(frames, path, fps)


def _checked(frames: Iterable[Frame]) -> Iterator[Frame]:
    """Yield frames; InvalidArgumentError if there are none, or one does not fit."""
    shape = None
    for frame in map(np.asarray, frames):
        if frame.dtype != np.uint8 or frame.ndim != 3 or frame.shape[2] != 3:
            found = f"{frame.shape} of {frame.dtype}"
            raise InvalidArgumentError(f"frames must be (H, W, 3) pictures of uint8; got {found}")
        if shape not in (None, frame.shape):
            sizes = f"{shape} and {frame.shape}"
            raise InvalidArgumentError(f"frames must all be of one size; got {sizes}")
        shape = frame.shape
        yield frame
    if shape is None:
        raise InvalidArgumentError("frames must hold at least one picture; got none")


def _animate(first: Frame, others: Iterator[Frame], suffix: str, fps: float) -> bytes:
    """Return a film as .gif or .webp."""
    pause, content = 1000 / fps, BytesIO()
    if suffix == ".gif":
        pause = 10 * max(2, round(100 / fps))  # viewers slow down anything shorter than 20 ms
    Image.fromarray(first).save(
        content, suffix[1:], save_all=True, append_images=map(Image.fromarray, others),
        duration=round(pause), loop=0, quality=70,
    )  # fmt: skip
    return content.getvalue()


def _encode(first: Frame, others: Iterator[Frame], _: str, fps: float) -> bytes:
    """Return a film as .mp4, by the program ffmpeg of imageio-ffmpeg."""
    try:
        import imageio_ffmpeg
    except ImportError as error:
        raise MissingExtraError(
            f"an .mp4 needs the extra film ({error}): pip install 'aquafish-gym[film]'; "
            "or write a .webp or a .gif"
        ) from None
    height, width = first.shape[:2]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "film.mp4"
        writer = imageio_ffmpeg.write_frames(
            str(path), (width, height), fps=fps, macro_block_size=2, quality=7,
            output_params=["-movflags", "+faststart"],
        )  # fmt: skip
        writer.send(None)
        for frame in itertools.chain([first], others):
            writer.send(np.ascontiguousarray(frame))
        writer.close()
        return path.read_bytes()
