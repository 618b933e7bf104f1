"""Films: swims side by side from one start line, in one fixed frame.

Each fish draws a trail. Broken fins are marked; see ``place_robots``.
"""

from __future__ import annotations

import itertools
import os
import tempfile
from collections.abc import Callable, Iterator, Sequence
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from aquafish_gym.rendering import scene
from aquafish_gym.rendering.camera import Camera, CameraView, Frame
from aquafish_gym.rendering.course import FilmedSwim, lay_out
from aquafish_gym.rendering.scene import CM_PER_UNIT, fish_room
from aquafish_gym.utils.array_types import Floats
from aquafish_gym.utils.storage import existing_folder, write_bytes
from aquafish_gym.utils.validation import (
    MissingExtraError,
    callback,
    file_path,
    finite_array,
    install_advice,
    integer,
    one_of,
    utf8_text,
)

if TYPE_CHECKING:
    from PIL import Image

SUFFIXES = (".mp4", ".webp", ".gif")
_HOLD = 1.5  # s, duration of the last frame


def film(
    swims: Sequence[FilmedSwim],
    path: str | os.PathLike[str],
    width: int = 960,
    height: int = 540,
    fps: float = 20.0,
    speed: float = 1.0,
    title: str = "",
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Write a film of swims side by side as .mp4, .webp or .gif; return its path.

    ``speed`` is relative to the swim; the ``title`` is at the top. Films as .webp and .gif repeat
    forever. GIF counts hundredths of a second, so only frame rates of 100 / n are exact. An .mp4
    needs the extra ``film``; without Pillow, every film does, and raises MissingExtraError.
    ``progress`` is called with the number of drawn frames and of all frames.
    """
    suffix = film_suffix(path)
    if find_spec("PIL") is None:
        raise MissingExtraError(f"a film needs the extra film: {install_advice('film')}")
    callback("progress", progress)
    utf8_text("title", title)
    integer("width", width, 64, 4096)
    integer("height", height, 64, 4096)
    finite_array("speed", speed, (), 0.01, 100.0)
    finite_array("fps", fps, (), 0.1, 240.0)
    frames = film_frames(swims, width, height, fps, speed, title, progress)
    if suffix == ".mp4":
        content = _encode(frames, fps, existing_folder(path))
    else:
        content = _animate(frames, suffix, fps)
    write_bytes(path, content)
    return Path(path)


def film_suffix(path: str | os.PathLike[str]) -> str:
    """Return the suffix of a film's name, one of ``SUFFIXES``, in lower case."""
    return one_of("the suffix of the film's path", file_path("path", path).suffix.lower(), SUFFIXES)


def film_frames(
    swims: Sequence[FilmedSwim],
    width: int,
    height: int,
    fps: float,
    speed: float,
    title: str,
    progress: Callable[[int, int], None] | None = None,
) -> Iterator[Frame]:
    """Yield the frames of :func:`film`; the last frame, the end of the longest swim, is held."""
    from aquafish_gym.rendering import caster

    course = lay_out(swims)
    lanes = course.lanes
    everywhere = np.concatenate([lane.position for lane in lanes])
    room = max(fish_room(lane.plan) for lane in lanes)
    view = fitting_view(everywhere, width / height, room)
    rulers = [
        (np.array([(x, y, 0.0) for x in course.ends]), scene.GRID if y else scene.INK)
        for y, _ in course.marks
    ]
    end = max(float(lane.time[-1]) for lane in lanes)
    moments = [*np.arange(0.0, end - 1e-9, speed / fps), *[end] * (1 + round(_HOLD * fps))]
    pace = "" if speed == 1 else f"  (x {speed:g})"
    size = max(10, height // 24)
    from PIL import Image, ImageDraw, ImageFont  # environments do not need it

    font = ImageFont.load_default(size)
    edge = size // 2
    for number, moment in enumerate(moments, 1):
        last = [max(0, int(np.searchsorted(lane.time, moment + 1e-9)) - 1) for lane in lanes]
        robots = [_at(lane, i) for lane, i in zip(lanes, last, strict=True)]
        picture, cover = caster.draw(view, course.floor, robots, width, height)
        image = Image.fromarray(picture)
        trails = [lane.position[: i + 1] for lane, i in zip(lanes, last, strict=True)]
        for points, colour in (*rulers, *zip(trails, course.colours, strict=True)):
            image.paste(colour, mask=_line(view, points, cover))
        draw = ImageDraw.Draw(image)
        for lane, trail, colour in zip(lanes, trails, course.colours, strict=True):
            beside = (fish_room(lane.plan) - 0.7, 0.0, 0.0)
            row = view.project(lane.position[0] - beside, width, height)[1]
            at = (edge, min(max(row, 3 * size), height - size))
            text = f"{lane.label}  {trail[-1, 1] * CM_PER_UNIT:+z.0f} cm"
            draw.text(at, text, colour, font, "ls", stroke_width=2, stroke_fill=scene.WATER_ABOVE)
        for (foot, _), (_, text) in zip(rulers, course.marks, strict=True):
            x, y, _ = view.project(foot[1], width, height)
            draw.text((x, min(y + 2, height - size - 2)), text, scene.INK, font, "ma")
        draw.text((edge, edge), title, scene.INK, font)
        draw.text((width - edge, edge), f"{moment:.1f} s{pace}", scene.INK, font, "ra")
        if progress is not None:
            progress(number, len(moments))
        yield np.array(image)


def _at(lane: FilmedSwim, sample: int) -> scene.DrawnRobots:
    """Return the robot of one sample of a swim."""
    some = slice(sample, sample + 1)
    return scene.place_robots(
        lane.bodies[some], lane.broken[some], lane.position[some], lane.quaternion[some],
        lane.fin_angles[some], lane.plan,
    )  # fmt: skip


def fitting_view(points: Floats, aspect: float, room: float) -> CameraView:
    """Return a view from the right and above of fish with some room around points (n, 3)."""
    camera = Camera(azimuth=90.0, elevation=54.0, field_of_view=24.0)
    view = camera.look(np.zeros(3))
    around = np.array(list(itertools.product((-room, room), repeat=3)))
    x, y, z = ((points[:, None] + around).reshape(-1, 3) @ np.array(view[1:4]).T).T
    centre = []
    far = []
    for across, slope in ((x, view.slope * aspect), (y, view.slope)):
        # Points are in the frame where |across - centre| <= slope (z + distance).
        high = (across / slope - z).max()
        low = (-across / slope - z).max()
        centre.append(slope * (high - low) / 2)
        far.append((high + low) / 2)
    eye = centre[0] * view.right + centre[1] * view.up - max(far) * view.forward
    return view._replace(eye=eye, distance=float(max(far)))


def _line(view: CameraView, points: Floats, cover: Floats) -> Image.Image:
    """Return the mask of a line through points (n, 3), without the parts that robots cover."""
    from PIL import Image, ImageDraw

    height, width = cover.shape
    mask = Image.new("L", (2 * width, 2 * height))  # drawn larger, then averaged
    pixels = [(x, y) for x, y, _ in view.project(points, *mask.size)]
    ImageDraw.Draw(mask).line(pixels, 255, max(2, height // 90), "curve")
    return Image.fromarray((np.asarray(mask.reduce(2)) * (1 - cover)).astype(np.uint8))


def _animate(frames: Iterator[Frame], suffix: str, fps: float) -> bytes:
    """Return a film as .gif or .webp."""
    from PIL import Image

    pause = 1000 / fps
    content = BytesIO()
    if suffix == ".gif":
        pause = 10 * max(2, round(100 / fps))  # viewers slow down frames shorter than 20 ms
    pictures = map(Image.fromarray, frames)
    next(pictures).save(
        content, suffix[1:], save_all=True, append_images=pictures,
        duration=round(pause), loop=0, quality=70,
    )  # fmt: skip
    return content.getvalue()


def _encode(frames: Iterator[Frame], fps: float, place: Path) -> bytes:
    """Return a film as .mp4, encoded by ffmpeg of imageio-ffmpeg, which needs a folder in a place.

    The machine may have no folder for temporary files.
    """
    try:
        import imageio_ffmpeg
    except ImportError as error:
        raise MissingExtraError(
            f"an .mp4 needs the extra film ({error}): {install_advice('film')}; "
            "or write a .webp or a .gif"
        ) from None
    first = next(frames)
    with tempfile.TemporaryDirectory(prefix=".film-", dir=place) as folder:
        path = Path(folder) / "film.mp4"
        writer = imageio_ffmpeg.write_frames(
            str(path), first.shape[1::-1], fps=fps, macro_block_size=2, quality=7,
            output_params=["-movflags", "+faststart"],
        )  # fmt: skip
        writer.send(None)
        for frame in itertools.chain([first], frames):
            writer.send(np.ascontiguousarray(frame))
        writer.close()
        return path.read_bytes()
