"""Pictures show the robot where it is; bad input is refused."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from aquafish_gym.morphology import Morphology
from aquafish_gym.rendering import Camera, render_pose
from aquafish_gym.utils.validation import UnknownNameError
from tests.plans import ODD

NOMINAL = Morphology.nominal()
HERE = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
BACK = (0.0, 0.0, 0.0)
ABOVE = Camera(azimuth=0, elevation=89, distance=12)


def picture(
    morphology: Morphology = NOMINAL, pose: Any = HERE, angles: Any = BACK, camera: Any = None
) -> NDArray[np.int64]:
    frame = render_pose(morphology, pose, angles, 160, 120, camera)
    assert frame.shape == (120, 160, 3)
    assert frame.dtype == np.uint8
    return frame.astype(np.int64)


def red(frame: NDArray[np.int64]) -> NDArray[np.bool_]:
    mask: NDArray[np.bool_] = (frame[..., 0] > 130) & (frame[..., 1] < 80)
    return mask


def test_fins_are_red_and_stand_where_they_should() -> None:
    """From above, nose up: the left flipper is left, the tail below."""
    mask = red(picture(camera=ABOVE))
    assert mask[:, :74].any()
    assert mask[:, 86:].any()
    assert mask[75:, 74:86].any()
    assert not mask[:40, 74:86].any()


def test_another_fish_is_drawn_with_its_own_fins() -> None:
    """From above, nose up: a flipper to the left, a fin to the right."""
    mask = red(picture(Morphology.nominal(ODD), angles=np.zeros(5), camera=ABOVE))
    assert mask[:, :70].any()
    assert mask[:, 88:].any()
    with pytest.raises(UnknownNameError, match="skew, keel, top"):
        render_pose(Morphology.nominal(ODD), HERE, np.zeros(5), broken=("caudal",))


def test_a_missing_fin_is_not_drawn() -> None:
    body = Morphology.coerce({"left_pectoral": (0.0, 0.0, 0.0)})
    mask = red(picture(body, camera=ABOVE))
    assert not mask[:, :74].any()
    assert mask[:, 86:].any()
    assert not red(picture(Morphology.from_array(np.zeros(9)))).any()
    plate = Morphology.coerce({"left_pectoral": (0.5, 1.0, 0.0)})
    assert red(picture(plate, camera=ABOVE))[:, :74].any()


def test_bodies_and_poses_show() -> None:
    base = picture()
    assert (picture(Morphology.coerce({"caudal": (0.5, 2.0, 1.0)})) != base).any()
    assert (picture(angles=(1.0, 0.0, 0.0)) != base).any()
    assert (picture(pose=((0.0, 0.5, 0.0), HERE[1])) != base).any(), "the floor must pass by"
    assert (picture() == base).all()


def test_broken_fins_are_marked() -> None:
    """A broken flipper is not red, and its break is black; the others stay red."""
    frame = render_pose(NOMINAL, HERE, BACK, 160, 120, ABOVE, broken=("left_pectoral",))
    mask = red(frame.astype(np.int64))
    assert not mask[:, :74].any()
    assert mask[:, 86:].any()
    assert (frame[:, :74].max(axis=-1) < 90).any()
    assert (picture(camera=ABOVE)[:, :74].max(axis=-1) > 90).all()


def test_the_robot_casts_a_shadow_on_the_floor_below_it() -> None:
    deep, high = ((0.0, 0.0, -1.0), HERE[1]), ((0.0, 0.0, 100.0), HERE[1])
    camera = Camera(azimuth=0, elevation=80, distance=16, target=(0.0, 0.0, -3.0))
    empty, shaded = (picture(pose=pose, camera=camera).sum(axis=-1) for pose in (high, deep))
    darker = shaded < empty - 30
    assert darker.sum() > 500
    assert not darker[:10].any(), "far from the robot the floor is as bright as without it"


@pytest.mark.parametrize(
    "camera",
    [
        Camera(distance=0.1, target=(0.0, 0.0, 0.0)),  # inside the robot
        Camera(elevation=-60.0, distance=20.0),  # under the floor
        Camera(distance=1000.0, field_of_view=1.0),
        Camera(field_of_view=120.0, distance=2.0),
    ],
)
def test_any_camera_gives_a_picture(camera: Camera) -> None:
    assert picture(camera=camera).std() > 0


def test_a_robot_far_away_is_drawn_like_one_at_the_origin() -> None:
    far = ((1e5, 1e5, 0.0), HERE[1])  # a multiple of the grid
    assert np.abs(picture(pose=far) - picture()).max() <= 2


@pytest.mark.slow
def test_a_picture_has_the_same_bytes_on_every_cpu(tmp_path: Path) -> None:
    """Compiled for this machine's CPU and for any of its architecture."""
    code = (
        "import sys; from aquafish_gym.rendering import render_pose\n"
        "from aquafish_gym.morphology import Morphology\n"
        "pose = ((0.1, 0.2, 0.3), (0.5, 0.5, -0.1, 0.7))\n"
        "frame = render_pose(Morphology.nominal(), pose, (1.0, 2.0, 3.0))\n"
        "sys.stdout.buffer.write(frame.tobytes())"
    )
    environment = {**os.environ, "NUMBA_CPU_NAME": "generic", "NUMBA_CACHE_DIR": str(tmp_path)}
    generic = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, check=True
    ).stdout
    pose = ((0.1, 0.2, 0.3), (0.5, 0.5, -0.1, 0.7))
    here = render_pose(NOMINAL, pose, (1.0, 2.0, 3.0)).tobytes()
    assert hashlib.sha256(generic).hexdigest() == hashlib.sha256(here).hexdigest()


@pytest.mark.parametrize("display", [":99", "nowhere.invalid:0", ""])
def test_a_display_that_does_not_answer_is_a_sentence(display: str) -> None:
    """Neither a dead display nor none ends the process."""
    code = (
        "import gymnasium, aquafish_gym\n"
        "try: gymnasium.make('AquaFish-v0', engine='numba', render_mode='human')\n"
        "except ImportError as error: print(error)\n"
        "env = gymnasium.make('AquaFish-v0', engine='numba', render_mode='rgb_array')\n"
        "print(env.metadata['render_modes'])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "DISPLAY": display},
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    sentence, modes = done.stdout.splitlines()
    why = f"no X server answers at DISPLAY={display}" if display else "DISPLAY is not set"
    assert f"not possible here ({why})" in sentence
    assert modes == "['rgb_array']"


@pytest.fixture
def screen() -> Iterator[str]:
    """Yield the name of an X display of 800 x 600 that only this test has."""
    server = shutil.which("Xvfb")
    if server is None:
        pytest.skip("Xvfb is not installed")
    reader, writer = os.pipe()
    command = [server, "-displayfd", str(writer), "-screen", "0", "800x600x24"]
    with subprocess.Popen(command, pass_fds=[writer], stderr=subprocess.DEVNULL) as process:
        os.close(writer)
        with os.fdopen(reader) as answer:
            yield f":{answer.readline().strip()}"
        process.terminate()


def test_the_window_shows_the_frame_and_may_be_closed(screen: str, tmp_path: Path) -> None:
    pytest.importorskip("tkinter", reason="needs tkinter")
    code = (
        "import sys, gymnasium, aquafish_gym; from PIL import ImageGrab, Image\n"
        "env = gymnasium.make('AquaFish-v0', engine='numba', fin_angles='zero',\n"
        "                     render_mode='human')\n"
        "assert env.metadata['render_modes'] == ['human', 'rgb_array']\n"
        "env.reset(seed=0); env.step([0.0, 0.0, 1.0]); env.step([0.0, 0.0, 1.0])\n"
        "ImageGrab.grab(xdisplay=sys.argv[1]).save(sys.argv[2])\n"
        "env.unwrapped._window.close(); env.step([0.0, 0.0, 1.0])\n"
        "twin = gymnasium.make('AquaFish-v0', engine='numba', fin_angles='zero',\n"
        "                      render_mode='rgb_array')\n"
        "twin.reset(seed=0); twin.step([0.0, 0.0, 1.0]); twin.step([0.0, 0.0, 1.0])\n"
        "Image.fromarray(twin.render()).save(sys.argv[3]); env.close()"
    )
    shot, frame = tmp_path / "shot.png", tmp_path / "frame.png"
    done = subprocess.run(
        [sys.executable, "-c", code, screen, str(shot), str(frame)],
        env={**os.environ, "DISPLAY": screen}, capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    seen, drawn = (np.asarray(Image.open(file).convert("RGB")) for file in (shot, frame))
    places = np.argwhere((seen[: 600 - 479, : 800 - 639] == drawn[0, 0]).all(axis=-1))
    assert any((seen[y : y + 480, x : x + 640] == drawn).all() for y, x in places)
