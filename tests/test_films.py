"""Films show the swims in one fixed frame, to their last instant."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from aquafish_gym.morphology import Morphology
from aquafish_gym.plans import AQUAFISH, BodyPlan
from aquafish_gym.rendering import FilmedSwim, film
from aquafish_gym.rendering.films import film_frames, fitting_view
from aquafish_gym.runs.progress import show_share
from tests.plans import ODD

SIZE = (160, 96)


def straight(speed: float, seconds: float = 1.0, plan: BodyPlan = AQUAFISH) -> FilmedSwim:
    """Return a swim along y."""
    time = np.linspace(0.0, seconds, round(seconds / 0.05) + 1)
    position = np.outer(time * speed, (0.0, 1.0, 0.0))
    turn = np.tile((0.0, 0.0, 0.0, 1.0), (len(time), 1))
    bodies = np.tile(Morphology.nominal(plan).to_array(), (len(time), 1))
    angles = np.zeros((len(time), len(plan.fins)))
    return FilmedSwim("fish", time, bodies, angles > 0, position, turn, angles, plan)


def frames(*swims: FilmedSwim, fps: float = 10.0, speed: float = 1.0) -> NDArray[np.int64]:
    return np.array(list(film_frames(swims, *SIZE, fps, speed, "")), np.int64)


def reddest_columns(frame: NDArray[np.int64]) -> NDArray[np.intp]:
    return np.flatnonzero(((frame[..., 0] > 130) & (frame[..., 1] < 80)).any(axis=0))


def test_a_faster_fish_is_further_to_the_right_and_the_water_stays() -> None:
    slow, fast = straight(1.0), straight(8.0)
    shot = frames(slow, fast)
    assert reddest_columns(shot[0]).max() + 20 < reddest_columns(shot[-1]).max()
    assert (shot[0][-4:] == shot[-1][-4:]).mean() > 0.9, "the camera does not move"
    half = SIZE[1] // 2  # the second fish is nearer, below the first one
    assert reddest_columns(shot[-1][half:]).max() > reddest_columns(shot[-1][:half]).max() + 20


def test_the_film_ends_at_the_last_instant_and_holds_it() -> None:
    """At 10 frames a second, 0.95 s is between two frames."""
    swim = straight(4.0, 0.95)
    shot = frames(swim)
    assert len(shot) == 10 + 1 + 15
    assert (shot[-16:] == shot[-1]).all()
    assert (shot[-17] != shot[-1]).any()
    assert len(frames(swim, speed=2.0)) == 5 + 1 + 15


def test_a_fin_is_marked_from_the_moment_it_breaks() -> None:
    swim = straight(0.0)
    broken = np.outer(swim.time > 0.49, [False, False, True])
    whole, breaks = frames(swim), frames(swim._replace(broken=broken))
    assert (whole[:5] == breaks[:5]).all()
    assert (whole[5:] != breaks[5:]).any(axis=(1, 2, 3)).all()


def test_fish_of_different_plans_swim_side_by_side() -> None:
    both = frames(straight(1.0), straight(8.0, plan=ODD))
    alone = frames(straight(1.0))
    half = SIZE[1] // 2
    assert reddest_columns(both[-1][half:]).max() > reddest_columns(both[0][half:]).max() + 20
    assert len(both) == len(alone)


def test_a_robot_that_diverges_stays_where_it_was_last() -> None:
    swim = straight(4.0)
    swim.position[11:] = np.nan
    shot = frames(swim, straight(1.0))
    assert len(shot) == 10 + 1 + 15
    assert np.isfinite(shot).all()


def test_every_fish_is_in_the_frame() -> None:
    rng = np.random.default_rng(0)
    for aspect in (0.5, 1.0, 2.0):
        points = rng.normal(size=(50, 3)) * (9.0, 30.0, 4.0)
        view = fitting_view(points, aspect, 2.4)
        x, y, depth = view.project(points, round(1000 * aspect), 1000).T
        assert (depth > 0).all()
        assert ((x > 0) & (x < 1000 * aspect) & (y > 0) & (y < 1000)).all()
        filled = max(np.ptp(x) / (1000 * aspect), np.ptp(y) / 1000)
        assert filled > 0.7, "it is no larger than it must be"


@pytest.mark.parametrize("suffix", [".webp", ".gif", ".GIF"])
def test_films_are_readable_and_move(tmp_path: Path, suffix: str) -> None:
    path = film([straight(4.0)], tmp_path / f"a{suffix}", *SIZE, fps=10)
    with Image.open(path) as found:
        assert found.size == SIZE
        assert found.n_frames >= 10
        first = np.asarray(found.convert("RGB"), np.int64)
        found.seek(found.n_frames - 1)
        last = np.asarray(found.convert("RGB"), np.int64)
    assert np.abs(last - first).max() > 100
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


def test_an_mp4_is_readable(tmp_path: Path) -> None:
    encoder = pytest.importorskip("imageio_ffmpeg")
    path = film([straight(4.0)], tmp_path / "a.mp4", *SIZE, fps=10)
    count, seconds = encoder.count_frames_and_secs(str(path))
    assert count == 26
    assert seconds == pytest.approx(2.6, abs=0.1)


def test_a_film_tells_how_far_it_is(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    told: list[tuple[int, int]] = []
    film([straight(1.0)], tmp_path / "a.webp", *SIZE, fps=10, progress=lambda *x: told.append(x))
    assert told == [(i, 26) for i in range(1, 27)]
    with show_share("film", "frames") as show:
        for done, total in told:
            show(done, total)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 10
    assert lines[-1] == "100/100  film: 26 of 26 frames"
