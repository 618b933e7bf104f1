"""Pictures show the robot where it is; films are readable; bad input is refused."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from aquafish_gym.morphology import Morphology
from aquafish_gym.rendering import (
    Camera,
    render_motion,
    render_pose,
    write_gif,
)
from aquafish_gym.rendering.robot_mesh import fin_poses
from aquafish_gym.utils.validation import InvalidArgumentError

pytest.importorskip("pybullet")

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


def test_fins_hang_from_their_hinges() -> None:
    turn = np.array([0.0, 0.0, math.sin(math.pi / 4), math.cos(math.pi / 4)])  # yaw 90 degrees
    (left, _), (right, _), (tail, _) = fin_poses(
        NOMINAL, np.array([1.0, 2.0, 3.0]), turn, (0.0, math.pi / 2, math.pi / 2)
    )
    np.testing.assert_allclose(left, (1 - 1.0 + 0.8, 2 - 0.75, 3.0), atol=1e-12)
    np.testing.assert_allclose(right, (1 - 1.0, 2 + 0.75, 3.0 - 0.8), atol=1e-12)
    # The tail's phase of 90 degrees is its full sweep of 30.
    s, c = math.sin(math.pi / 6), math.cos(math.pi / 6)
    np.testing.assert_allclose(tail, (1 + 2 + 0.7 * c, 2 + 0.7 * s, 3.0), atol=1e-12)


def test_films_hold_their_frames(tmp_path: Path) -> None:
    poses = np.zeros((5, 3))
    poses[:, 1] = np.linspace(0, 1, 5)
    frames = render_motion(
        NOMINAL, poses, np.tile((0.0, 0.0, 0.0, 1.0), (5, 1)), np.zeros((5, 3)), 64, 48
    )
    gif = write_gif(frames, tmp_path / "a.gif", fps=10)
    with Image.open(gif) as film:
        assert (film.n_frames, film.size, film.info["duration"]) == (5, (64, 48), 100)
    assert [p.name for p in tmp_path.iterdir()] == ["a.gif"]


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"pose": ((0, 0, math.nan), (0, 0, 0, 1))}, "pose position must be finite"),
        ({"pose": ((0, 0, 0), (0, 0, 0, 2))}, "length 1"),
        ({"pose": 3}, "position and a quaternion"),
        ({"width": 0}, "width must be"),
    ],
)
def test_bad_pictures_are_refused(change: dict[str, Any], sentence: str) -> None:
    with pytest.raises(InvalidArgumentError, match=sentence):
        render_pose(**{"morphology": NOMINAL, "pose": HERE, "fin_angles": BACK, **change})


@pytest.mark.parametrize("display", [":99", "nowhere.invalid:0", ""])
def test_a_display_that_does_not_answer_is_a_sentence(display: str) -> None:
    """Bullet's window code would end the process."""
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
    assert f"there is no display here ({why})" in sentence
    assert modes == "['rgb_array']"
