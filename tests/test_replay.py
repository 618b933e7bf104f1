"""A replay shows the swims that it was given, in a browser, by itself."""

from __future__ import annotations

import base64
import gzip
import json
import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aquafish.cli import main
from aquafish.online.gaits import load_library
from aquafish_gym.damage import Damage
from aquafish_gym.morphology import Morphology
from aquafish_gym.rendering import scene
from aquafish_gym.rendering.films import FilmedSwim, Stage
from aquafish_gym.rendering.replay import write_replay
from aquafish_gym.utils.validation import InvalidArgumentError
from gait.film import filmed
from gait.rollout import swim
from tests.browser import Page, browser

HEALTHY = Morphology.nominal()
DAMAGED = Damage.parse("left_pectoral:length=0.5").apply(HEALTHY)
SECONDS = 6.0
BUTTON = ".replay button"
SLIDER = ".replay input"
CLOCK = "document.querySelector('.replay output').textContent"
TIME = f"parseFloat({CLOCK})"
LABELS = "[...document.querySelectorAll('.replay .label')].map(e => e.textContent)"
PLACES = "[...document.querySelectorAll('.replay .label')].map(e => e.style.transform)"
READY = "document.querySelector('.replay')?.dataset.ready === 'yes'"
VISIBLE = """
[...document.querySelectorAll('.replay .label, .replay .mark')]
  .filter(e => e.style.visibility === 'visible')
  .map(e => e.getBoundingClientRect()).map(b => [b.left, b.top, b.right, b.bottom])
"""


def fish(seconds: float = SECONDS) -> list[FilmedSwim]:
    gait = load_library()[0]
    stages = (
        ("healthy", (Stage(0.0, HEALTHY),)),
        ("breaks", (Stage(0.0, HEALTHY), Stage(2.0, DAMAGED, ("left_pectoral",)))),
    )
    return [
        filmed(label, body, swim(gait, body[0].morphology, engine="numba", seconds=seconds))
        for label, body in stages
    ]


@pytest.fixture(scope="module")
def replay(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_replay(fish(), tmp_path_factory.mktemp("replay") / "swim.html", "<Two> fish")


@pytest.fixture(scope="module")
def tab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    with browser(tmp_path_factory.mktemp("browser")) as page:
        yield page


@pytest.fixture
def page(tab: Page, replay: Path) -> Page:
    tab.errors.clear()
    tab.requests.clear()
    tab.open(replay.as_uri(), 480, 360)
    tab.wait(READY)
    return tab


def focus_and_press(page: Page, key: str) -> None:
    page.value("document.querySelector('.replay').focus()")
    page.key(key)


def settle(page: Page) -> None:
    """Wait until the page has drawn what changed."""
    page.value("new Promise(r => setTimeout(r, 300))")


def read_data(path: Path) -> dict[str, Any]:
    found = re.search(r'id="replay-data">(.*?)</script>', path.read_text())
    assert found
    return dict(json.loads(found[1]))


def test_the_page_composes_the_poses_of_the_scene(replay: Path) -> None:
    """Body pose times local pose, as three.js multiplies them, equals the scene's own poses."""
    for one, sent in zip(fish(), read_data(replay)["swimmers"], strict=True):
        content = gzip.decompress(base64.b64decode(sent["columns"]))
        table = np.frombuffer(content, "<f4").reshape(-1, sent["samples"]).T.astype(float)
        body, local = table[:, None, :7], table[:, 14:].reshape(len(table), -1, 7)
        places = body[..., :3] + scene._rotate(body[..., 3:], local[..., :3])
        turn = np.broadcast_to(body[..., 3:], local[..., 3:].shape)
        found = np.concatenate([places, scene._multiply(turn, local[..., 3:])], axis=-1)
        pose = (table[:, :3], one.quaternion, one.fin_angles)
        wanted = [scene.part_poses(s.morphology, *pose, s.broken) for s in one.stages]
        np.testing.assert_allclose(found, np.concatenate(wanted, axis=1), atol=1e-5)
        np.testing.assert_allclose(table[:, 1:3], one.position[:, 1:], atol=1e-5)
        drawn = [part for s in one.stages for part in scene.robot_parts(s.morphology, s.broken)]
        assert [tuple(part["size"]) for part in sent["parts"][1:]] == [p.size for p in drawn]


def test_a_part_shows_as_long_as_its_stage(replay: Path) -> None:
    times = [(part["begin"], part["end"]) for part in read_data(replay)["swimmers"][1]["parts"]]
    assert times == [(0.0, None), *[(0.0, 2.0)] * 6, *[(2.0, None)] * 7]


def test_a_replay_is_one_small_file_of_the_same_bytes(replay: Path, tmp_path: Path) -> None:
    again = write_replay(fish(), tmp_path / "again.html", "<Two> fish")
    assert again.read_bytes() == replay.read_bytes()
    assert len(again.read_bytes()) < 500_000
    text = again.read_text()
    assert "<title>&lt;Two&gt; fish</title>" in text
    assert "three.js authors, MIT" in text
    assert not re.search(r'(src|href)="(?!data:)', text)


def test_a_swim_that_diverged_ends_there(tmp_path: Path) -> None:
    one = fish(seconds=1.0)[0]
    one.position[10:] = np.nan
    path = write_replay([one], tmp_path / "a.html")
    assert read_data(path)["swimmers"][0]["samples"] == 10


def test_swims_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    one, faster = fish(seconds=1.0)
    faster.time[:] /= 2
    for swims, message in (([], "at least one"), ([one, faster], "the same times")):
        with pytest.raises(InvalidArgumentError, match=message):
            write_replay(swims, tmp_path / "a.html")


def test_film_writes_a_replay(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    controller, path = tmp_path / "controller.json", tmp_path / "swim.html"
    load_library()[0].save(controller)
    words = [str(controller), "--damage", "none", "caudal:missing", "--html", str(path)]
    assert main(["film", *words, "--seconds", "1"]) == 0
    assert [one["label"] for one in read_data(path)["swimmers"]] == ["undamaged", "caudal:missing"]
    assert capsys.readouterr().out.endswith(f"Replay: {path}\n")


@pytest.mark.slow
def test_a_replay_asks_for_nothing_and_plays(page: Page, replay: Path) -> None:
    page.wait(f"{TIME} > 0.3")
    assert page.errors == []
    assert page.requests == [replay.as_uri()]
    assert page.value("document.querySelector('.replay p')") is None


@pytest.mark.slow
def test_buttons_and_keys_play_and_pause(page: Page) -> None:
    for press in (lambda: page.click(BUTTON), lambda: page.key(" ")):
        page.value("document.querySelector('.replay').focus()")
        press()
        page.wait(f"document.querySelector('{BUTTON}').textContent === 'play'")
        before = page.value(CLOCK)
        assert page.value(f"new Promise(r => setTimeout(() => r({CLOCK}), 300))") == before
        press()
        page.wait(f"{CLOCK} !== '{before}'")
    focus_and_press(page, "End")
    page.wait(f"{TIME} === {SECONDS} && document.querySelector('{BUTTON}').textContent === 'again'")
    page.click(BUTTON)
    page.wait(f"{TIME} < 3")
    page.key("Home")


@pytest.mark.slow
def test_distances_follow_the_slider(page: Page) -> None:
    focus_and_press(page, "Home")
    page.wait(f"{LABELS}.every(text => text.endsWith(' 0 cm'))")
    page.key("ArrowRight")
    page.wait(f"{TIME} === 1")
    page.key("ArrowLeft")
    page.wait(f"{TIME} === 0")
    page.click(SLIDER)
    page.wait(f"Math.abs({TIME} - {SECONDS / 2}) < 0.2")
    box = page.value(f"(b => [b.right - 1, b.y + 9])(document.querySelector('{SLIDER}')"
                     ".getBoundingClientRect())")  # fmt: skip
    page.drag(page.middle(SLIDER), tuple(box))
    page.wait(f"{TIME} === {SECONDS}")
    ends = [f"{one.label} {5 * one.position[-1, 1]:.0f} cm" for one in fish()]
    assert page.value(LABELS) == ends


@pytest.mark.slow
def test_speed_changes_the_clock(page: Page) -> None:
    def passed(speed: str) -> float:
        page.value(
            f"document.querySelector('[name=speed]').value = '{speed}'; "
            f"document.querySelector('.replay').focus()"
        )
        page.key("Home")
        page.click(BUTTON)
        page.wait(f"{TIME} > 0")
        return float(
            page.value(f"(b => new Promise(r => setTimeout(() => r({TIME} - b), 700)))({TIME})")
        )

    assert passed("4") > 3 * passed("0.5")


@pytest.mark.slow
def test_views_and_the_mouse_move_the_camera(page: Page) -> None:
    focus_and_press(page, "Home")
    page.wait(f"{TIME} === 0")
    seen = set()
    for key in "123":
        page.key(key)
        settle(page)
        seen.add(str(page.value(PLACES)))
    page.value(
        "(s => {s.value = 'side'; s.dispatchEvent(new Event('change'))})"
        "(document.querySelector('[name=camera]'))"
    )
    settle(page)
    assert str(page.value(PLACES)) in seen
    x, y = page.middle(".replay canvas")
    page.drag((x, y), (x + 150, y + 40))
    settle(page)
    seen.add(str(page.value(PLACES)))
    assert len(seen) == 4


@pytest.mark.slow
@pytest.mark.parametrize("size", [(1280, 720), (390, 800)])
def test_texts_do_not_overlap(page: Page, replay: Path, size: tuple[int, int]) -> None:
    page.open(replay.as_uri(), *size)
    page.wait(READY)
    for key in "123":
        focus_and_press(page, key)
        for moment in ("Home", "End"):
            page.key(moment)
            settle(page)
            boxes = page.value(VISIBLE)
            assert len(boxes) >= 4
            for i, (left, top, right, bottom) in enumerate(boxes):
                assert not any(
                    left < r and x < right and top < b and y < bottom
                    for x, y, r, b in boxes[i + 1 :]
                )
    assert page.value("document.documentElement.scrollWidth") <= size[0]


@pytest.mark.slow
def test_without_webgl_the_page_says_so(tmp_path: Path, replay: Path) -> None:
    with browser(tmp_path, "--disable-3d-apis") as page:
        page.open(replay.as_uri())
        page.wait("document.querySelector('.replay p')?.textContent.includes('WebGL')")
        words = page.value("document.querySelector('.replay p').textContent")
    assert "needs a browser with WebGL" in words
    assert "healthy" in words


@pytest.mark.slow
def test_without_javascript_the_page_says_so(tab: Page, replay: Path) -> None:
    tab.call("Emulation.setScriptExecutionDisabled", value=True)
    try:
        tab.open(replay.as_uri())
        deadline = time.monotonic() + 30
        words: list[str] = []
        while "The replay needs JavaScript." not in words and time.monotonic() < deadline:
            words = tab.call("DOMSnapshot.captureSnapshot", computedStyles=[])["strings"]
    finally:
        tab.call("Emulation.setScriptExecutionDisabled", value=False)
    assert "The replay needs JavaScript." in words
