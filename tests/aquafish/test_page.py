"""The page opens by itself, and its fish swims, breaks, works out what it is, and swims on."""

from __future__ import annotations

import base64
import hashlib
import re
import statistics
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from aquafish.cli import main
from aquafish.online.gaits import LIBRARY_SCHEMA
from aquafish.page import live_page, write_live_page
from aquafish_gym.utils.storage import write_document
from tests.aquafish.test_page_agent import some_gaits
from tests.browser import Page, browser
from tests.plans import ODD

READY = "document.querySelector('.live')?.dataset.ready === 'yes'"
STATE = "document.querySelector('.live').dataset"
NORTHING = "parseFloat(document.querySelector('.live .controls output').textContent.split(',')[1])"
STOPWATCH = "[...document.querySelectorAll('dd')].map(e => e.textContent)"
FINS = ("left_pectoral", "right_pectoral", "caudal")
LARGEST_PAGE = 700_000  # bytes
# What is done to a fin one after another, by the names of the buttons.
BREAKS = (
    ("left_pectoral", "half", "length"),
    ("caudal", "missing", "missing"),
    ("right_pectoral", "seized", "seized"),
    ("left_pectoral", "reversed", "reversed"),
    ("right_pectoral", "weak", "weak"),
)


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_live_page(tmp_path_factory.mktemp("page") / "fish.html")


@pytest.fixture(scope="module")
def tab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    with browser(tmp_path_factory.mktemp("browser")) as page:
        yield page


@pytest.fixture
def page(tab: Page, path: Path) -> Page:
    tab.errors.clear()
    tab.requests.clear()
    tab.open(path.as_uri(), 480, 360)
    tab.wait(READY)
    return tab


def break_fin(page: Page, fin: str, name: str) -> None:
    """Choose a fin, and press a button."""
    page.value(
        f"(s => {{s.value = {FINS.index(fin)}; s.dispatchEvent(new Event('change'))}})"
        "(document.querySelector('[name=fin]'))"
    )
    page.value(
        "[...document.querySelectorAll('.words button')]"
        f".find(button => button.textContent === '{name}').click()"
    )


def wait_for_belief(page: Page, words: str) -> None:
    """Wait until the fish is so, and believes it."""
    page.wait(f"{STATE}.truth === '{words}' && {STATE}.belief === '{words}'")


def test_the_page_is_one_small_file_of_the_same_bytes(path: Path, tmp_path: Path) -> None:
    assert write_live_page(tmp_path / "again.html").read_bytes() == path.read_bytes()
    assert len(path.read_bytes()) < LARGEST_PAGE
    text = path.read_text()
    assert "three.js authors, MIT" in text
    assert not re.search(r'(src|href)="(?!data:)', text)
    assert not re.search(r"https?://(?!www\.w3\.org)", text.partition("<script")[0])


def test_the_page_allows_its_own_scripts_and_worker_alone() -> None:
    text = live_page()
    found = re.search(r'Content-Security-Policy" content="(.*?)"', text)
    assert found
    policy = dict(part.strip().split(" ", 1) for part in found[1].split(";"))
    assert policy["default-src"] == "'none'"
    assert policy["worker-src"] == "blob:"
    assert "unsafe" not in found[1]
    scripts = re.findall(r'<script(?: id="live-program")?>(.*?)</script>', text, re.S)
    assert len(scripts) == 2
    for script in scripts:
        digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
        assert f"'sha256-{digest}'" in policy["script-src"].split()
    assert not re.search(r"<[^>]* (style|on\w+)=", text.partition("<script")[0])


def test_the_command_writes_the_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "new" / "fish.html"
    assert main(["page", "--html", str(path)]) == 0
    assert path.read_text() == live_page()
    assert str(path) in capsys.readouterr().out
    assert main(["page", "--html", str(tmp_path)]) == 2


def test_the_command_writes_the_page_of_another_fish(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan, library, path = (tmp_path / name for name in ("odd.json", "gaits.json", "odd.html"))
    plan.write_text(ODD.to_json())
    document = {"gaits": [gait.to_dict() for gait in some_gaits(ODD)]}
    write_document(library, document, LIBRARY_SCHEMA)
    words = ["page", "--html", str(path), "--plan", str(plan)]
    assert main(words) == 0
    assert path.read_text().count('"genes":[') == 1  # full speed
    assert main([*words, "--library", str(library), "--reactive"]) == 0
    text = path.read_text()
    assert all(f'<option value="{i}">{fin.word}</option>' in text for i, fin in enumerate(ODD.fins))
    assert "const step = step_reactive;" in text
    assert main(["page", "--html", str(path), "--library", str(library)]) == 2
    assert "library must be of the plan aquafish" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("size", [(1280, 720), (390, 844)])
def test_the_page_asks_for_nothing_and_swims(page: Page, path: Path, size: tuple[int, int]) -> None:
    page.requests.clear()
    page.open(path.as_uri(), *size)
    page.wait(READY)
    page.wait("document.querySelectorAll('.gaits .swum').length === 1")
    page.wait(f"{NORTHING} >= 3")
    assert page.errors == []
    assert page.requests == [path.as_uri()]
    assert page.value("document.querySelector('.problem')") is None
    assert page.value("document.querySelector('.thought').textContent").startswith("I am whole")
    assert page.value("document.documentElement.scrollWidth") <= size[0]


@pytest.mark.slow
def test_five_fins_break_one_after_another_and_the_fish_swims_on(page: Page) -> None:
    page.wait(f"{NORTHING} >= 2")
    knew = []
    for fin, name, word in BREAKS:
        break_fin(page, fin, name)
        wait_for_belief(page, f"{fin}:{word}")
        page.wait(f"!isNaN(parseFloat({STOPWATCH}[1]))")
        knew.append(float(page.value(STOPWATCH)[1].removesuffix(" s")))
        before = page.value(NORTHING)
        page.wait(f"{NORTHING} >= {before} + 2")
        break_fin(page, fin, "whole")
        wait_for_belief(page, "")
    assert statistics.median(knew) <= 2.0
    assert page.errors == []


@pytest.mark.slow
def test_a_click_on_a_fin_offers_to_break_it(page: Page) -> None:
    page.open(page.value("location.href"), 1280, 720)
    page.wait(READY)
    page.click("[name=play]")
    x, y = page.middle(".stage canvas")
    places = [(x + dx, y + dy) for dx in range(-150, 151, 25) for dy in range(-75, 76, 25)]
    for place in places:
        page.drag(place, place)
        if not page.value("document.querySelector('.menu').hidden"):
            break
    name = page.value("document.querySelector('.menu b').textContent")
    assert name in ("left flipper", "right flipper", "tail")
    page.click(".menu button")
    page.click("[name=play]")
    page.wait(f"{STATE}.truth.endsWith(':missing') && {STATE}.belief === {STATE}.truth")


@pytest.mark.slow
def test_sliders_change_sizes_and_the_current(page: Page) -> None:
    def drag(name: str, value: float) -> None:
        page.value(
            f"(s => {{s.value = {value}; s.dispatchEvent(new Event('input')); "
            "s.dispatchEvent(new Event('change'))})"
            f"(document.querySelector('[name={name}]'))"
        )

    page.wait(f"{NORTHING} >= 1")
    drag("y", -5)
    page.wait(f"{NORTHING} < 0")
    assert page.value(f"{STATE}.belief") == ""  # the current is known, and nothing broke
    drag("width", 40)
    wait_for_belief(page, "left_pectoral:width")
    assert "40%" in page.value("document.querySelector('.thought').textContent")
    page.click("[name=again]")
    page.wait(f"{STATE}.truth === ''")


@pytest.mark.slow
def test_without_webgl_the_page_says_so(tmp_path: Path, path: Path) -> None:
    with browser(tmp_path, "--disable-3d-apis") as page:
        page.open(path.as_uri())
        page.wait("document.querySelector('.problem')?.textContent.includes('WebGL')")


@pytest.mark.slow
def test_without_javascript_the_page_says_so(tab: Page, path: Path) -> None:
    tab.call("Emulation.setScriptExecutionDisabled", value=True)
    try:
        tab.open(path.as_uri())
        deadline = time.monotonic() + 30
        words: list[str] = []
        while "This page needs JavaScript." not in words and time.monotonic() < deadline:
            words = tab.call("DOMSnapshot.captureSnapshot", computedStyles=[])["strings"]
    finally:
        tab.call("Emulation.setScriptExecutionDisabled", value=False)
    assert "This page needs JavaScript." in words
