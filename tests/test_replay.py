"""A replay shows the swims that it was given, in a browser, by itself."""

from __future__ import annotations

import base64
import gzip
import hashlib
import html
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
from aquafish_gym.rendering.course import FilmedSwim
from aquafish_gym.rendering.replay import write_replay
from aquafish_gym.utils.validation import InvalidArgumentError
from gait.film import filmed
from gait.swims.swim import swim
from tests.browser import Page, browser

HEALTHY = Morphology.nominal()
BREAKS = Damage.parse("left_pectoral:length=0.5@2")
SECONDS = 6.0
BUTTON = ".replay button"
SLIDER = ".replay input"
CLOCK = "document.querySelector('.replay output').textContent"
TIME = f"parseFloat({CLOCK})"
LABELS = "[...document.querySelectorAll('.replay .label')].map(e => e.textContent)"
PLACES = "[...document.querySelectorAll('.replay .mark')].map(e => e.style.transform)"
READY = "document.querySelector('.replay')?.dataset.ready === 'yes'"
TEXTS = """
[...document.querySelectorAll('.replay .label, .replay .mark')]
  .map(e => e.getBoundingClientRect()).map(b => [b.left, b.top, b.right, b.bottom])
"""


def fish(seconds: float = SECONDS) -> list[FilmedSwim]:
    path = swim(load_library()[0], HEALTHY, engine="numba", seconds=seconds)
    return [filmed("healthy", path, HEALTHY), filmed("breaks", path, HEALTHY, BREAKS)]


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


def seek(page: Page, seconds: float) -> None:
    """Move the slider as a user does, which pauses."""
    page.value(
        f"(s => {{s.value = {seconds}; s.dispatchEvent(new Event('input'))}})"
        f"(document.querySelector('{SLIDER}'))"
    )
    page.wait(f"{TIME} === {seconds}")


def choose(page: Page, name: str, number: int) -> None:
    page.value(
        f"(s => {{s.selectedIndex = {number}; s.dispatchEvent(new Event('change'))}})"
        f"(document.querySelector('[name={name}]'))"
    )


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
        body, parts = table[:, None, :7], table[:, 7:].reshape(len(table), 9, 13)
        local = parts[..., :7]
        places = body[..., :3] + scene._rotate(body[..., 3:], local[..., :3])
        turn = np.broadcast_to(body[..., 3:], local[..., 3:].shape)
        found = np.concatenate([places, scene._multiply(turn, local[..., 3:])], axis=-1)
        wanted = scene.place_robots(
            one.bodies, one.broken, table[:, :3], one.quaternion, one.fin_angles
        )
        np.testing.assert_allclose(found, wanted.poses, atol=1e-5)
        np.testing.assert_allclose(parts[..., 7:10], wanted.sizes, atol=1e-6)
        np.testing.assert_allclose(255 * parts[..., 10:], wanted.colours, atol=1e-4)
        np.testing.assert_allclose(table[:, 1:3], one.position[:, 1:], atol=1e-5)


def test_a_replay_is_one_small_file_of_the_same_bytes(replay: Path, tmp_path: Path) -> None:
    again = write_replay(fish(), tmp_path / "again.html", "<Two> fish")
    assert again.read_bytes() == replay.read_bytes()
    assert len(again.read_bytes()) < 500_000
    text = again.read_text()
    assert "<title>&lt;Two&gt; fish</title>" in text
    assert "three.js authors, MIT" in text
    assert not re.search(r'(src|href)="(?!data:)', text)


@pytest.mark.parametrize("text", ["<b>&amp;\"'</script><!--", "ψ é \u2028 $data ${library}"])
def test_labels_and_titles_are_shown_as_they_are(tmp_path: Path, text: str) -> None:
    one = fish(seconds=1.0)[0]._replace(label=text)
    path = write_replay([one], tmp_path / "a.html", text)
    page = path.read_text("utf-8")
    assert read_data(path)["swimmers"][0]["label"] == text
    assert page.count(html.escape(text)) == 2  # the title, and the summary
    assert f"<title>{html.escape(text)}</title>" in page


def test_the_page_allows_its_own_style_and_scripts_alone(replay: Path) -> None:
    text = replay.read_text()
    found = re.search(r'Content-Security-Policy" content="(.*?)"', text)
    assert found
    policy = dict(part.strip().split(" ", 1) for part in found[1].split(";"))
    assert policy["default-src"] == "'none'"
    assert "unsafe" not in found[1]

    def digest(content: str) -> str:
        return f"'sha256-{base64.b64encode(hashlib.sha256(content.encode()).digest()).decode()}'"

    script, style = (
        re.search("<script>(.*?)</script>", text, re.S),
        re.search("<style>(.*?)</style>", text, re.S),
    )
    assert script
    assert style
    assert digest(script[1]) in policy["script-src"].split()
    assert policy["style-src"] == digest(style[1])
    assert not re.search(r"<[^>]* (style|on\w+)=", text)


def test_a_swim_that_diverged_ends_there(tmp_path: Path) -> None:
    one = fish(seconds=1.0)[0]
    one.position[10:] = np.nan
    path = write_replay([one], tmp_path / "a.html")
    assert read_data(path)["swimmers"][0]["samples"] == 10


def test_swims_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    one = fish(seconds=1.0)[0]
    faster = one._replace(time=one.time / 2)
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
def test_the_button_plays_pauses_and_starts_again(page: Page) -> None:
    for press in (lambda: page.click(BUTTON), lambda: page.key(" ")):
        page.value(f"document.querySelector('{BUTTON}').focus()")
        press()
        page.wait(f"document.querySelector('{BUTTON}').textContent === 'play'")
        before = page.value(CLOCK)
        assert page.value(f"new Promise(r => setTimeout(() => r({CLOCK}), 300))") == before
        press()
        page.wait(f"{CLOCK} !== '{before}'")
    seek(page, SECONDS)
    page.wait(f"document.querySelector('{BUTTON}').textContent === 'again'")
    page.click(BUTTON)
    page.wait(f"{TIME} < 3")


@pytest.mark.slow
def test_distances_follow_the_slider(page: Page) -> None:
    page.value(f"document.querySelector('{SLIDER}').focus()")
    page.key("Home")
    page.wait(f"{TIME} === 0 && {LABELS}.every(text => text.endsWith(' 0 cm'))")
    page.key("ArrowRight")
    page.wait(f"{TIME} > 0")
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
    def passed(number: int) -> float:
        choose(page, "speed", number)
        seek(page, 0)
        page.click(BUTTON)
        page.wait(f"{TIME} > 0")
        return float(
            page.value(f"(b => new Promise(r => setTimeout(() => r({TIME} - b), 700)))({TIME})")
        )

    assert passed(3) > 3 * passed(0)


@pytest.mark.slow
def test_views_and_the_mouse_move_the_camera(page: Page) -> None:
    seek(page, 0)
    seen = set()
    for view in range(3):
        choose(page, "camera", view)
        settle(page)
        seen.add(str(page.value(PLACES)))
    x, y = page.middle(".replay canvas")
    page.drag((x, y), (x + 150, y + 40))
    settle(page)
    seen.add(str(page.value(PLACES)))
    assert len(seen) == 4


@pytest.mark.slow
@pytest.mark.parametrize("size", [(1280, 720), (390, 800)])
def test_texts_are_in_the_frame_and_do_not_overlap(
    page: Page, replay: Path, size: tuple[int, int]
) -> None:
    page.open(replay.as_uri(), *size)
    page.wait(READY)
    seek(page, SECONDS)
    for view in range(3):
        choose(page, "camera", view)
        settle(page)
        boxes = page.value(TEXTS)
        assert len(boxes) >= 4
        for i, (left, top, right, bottom) in enumerate(boxes):
            assert 0 <= left < right <= size[0]
            assert 0 <= top < bottom <= size[1]
            assert not any(
                left < r and x < right and top < b and y < bottom for x, y, r, b in boxes[i + 1 :]
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
