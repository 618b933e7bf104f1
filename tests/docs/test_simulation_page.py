"""A step function becomes a page: it runs in a browser as it does in Python."""

from __future__ import annotations

import html
import json
import math
import re
import runpy
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from aquafish_gym.physics.arithmetic import where_less
from aquafish_gym.physics.printing import JAVASCRIPT, printed
from aquafish_gym.utils.validation import InvalidArgumentError
from tests.browser import Page, browser

NODE = shutil.which("node")
ANSWER = runpy.run_path(str(Path(__file__).parents[2] / "examples" / "answers" / "browser"))
Circle, Line, Slider = (ANSWER[name] for name in ("Circle", "Line", "Slider"))
SIMULATIONS: dict[str, Any] = {
    "cart-pole": (ANSWER["balance"], ANSWER["CART_START"], ANSWER["CART_SLIDERS"]),
    "fish": (ANSWER["swim"], ANSWER["fish_at_rest"](), ANSWER["FISH_SLIDERS"]),
}
SLIDERS = {"stiffness": Slider(0.0, 50.0, 10.0)}
VIEW = (-1.5, 1.5, -0.5, 0.5)


def step(state: Any, sliders: Any) -> Any:
    place, speed = state
    speed = speed - 0.01 * sliders[0] * place
    return place + 0.01 * speed, speed


def draw(state: Any, _: Any) -> Any:
    return [Line(0.0, 0.0, state[0], 0.0, 0.02), Circle(state[0], 0.0, 0.1, "#db1f1a")]


def page_of(**changed: Any) -> str:
    usual: dict[str, Any] = {
        "step": step, "draw": draw, "start": (1.0, 0.0), "sliders": SLIDERS, "timestep": 0.01,
        "view": VIEW,
    }  # fmt: skip
    with TemporaryDirectory() as folder:
        path = ANSWER["write_simulation"](Path(folder) / "page.html", **(usual | changed))
        return path.read_text(encoding="utf-8")


@pytest.mark.skipif(NODE is None, reason="node is not installed")
@pytest.mark.parametrize("name", SIMULATIONS)
def test_javascript_steps_as_python_does(name: str) -> None:
    step, start, sliders = SIMULATIONS[name]
    values = [slider.value for slider in sliders.values()]
    state = list(start)
    for _ in range(500):
        state = list(step(tuple(state), tuple(values)))
    source = printed("step", ANSWER["trace_step"](step, len(start), len(sliders)), JAVASCRIPT)
    source += f"const state = {json.dumps(list(start))}, sliders = {json.dumps(values)};\n"
    source += "for (let i = 0; i < 500; i++) step(state, sliders);\n"
    source += "console.log(JSON.stringify(state));"
    assert NODE is not None
    found = subprocess.run([NODE, "-e", source], capture_output=True, check=True, text=True)
    assert np.allclose(json.loads(found.stdout), state, rtol=0.0, atol=1e-9)


@pytest.mark.skipif(NODE is None, reason="node is not installed")
def test_a_fish_without_a_flipper_swims_on() -> None:
    step, start, sliders = SIMULATIONS["fish"]
    values = [slider.value for slider in sliders.values()]
    values[3] = 0.0
    state = list(start)
    for _ in range(100):
        state = list(step(tuple(state), tuple(values)))
    assert np.isfinite(state).all()


def test_the_same_simulation_gives_the_same_bytes() -> None:
    assert page_of() == page_of()


@given(st.text(st.characters(codec="utf-8", exclude_categories=["Cc"]), min_size=1))
@example("<b>&amp;\"'</script><!-- é $title")
def test_texts_are_shown_as_they_are(text: str) -> None:
    shown = page_of(title=text, note=text, sliders={text: SLIDERS["stiffness"]})
    assert re.search("<title>(.*?)</title>", shown, re.S)[1] == html.escape(text)  # type: ignore[index]
    read = HTMLTexts()
    read.feed(shown)
    assert read.texts.count(text) == 4  # in the title, the heading, the note and the slider


class HTMLTexts(HTMLParser):
    """Collects the texts between tags."""

    def __init__(self) -> None:
        super().__init__()
        self.texts: list[str] = []

    def handle_data(self, data: str) -> None:
        self.texts.append(data)


@pytest.fixture
def page(tmp_path: Path) -> Any:
    path = tmp_path / "page.html"
    path.write_text(page_of(title="<b>", note="a & b"), encoding="utf-8")
    with browser(tmp_path) as page:
        page.open(path.as_uri(), 800, 500)
        page.wait("typeof time !== 'undefined' && time > 0.1")
        yield page


def test_the_page_runs_and_its_controls_work(page: Page) -> None:
    assert page.errors == []
    assert len(page.requests) == 1  # the file itself
    assert page.value("document.querySelector('h1').textContent") == "<b>"
    assert page.value("document.querySelector('p').textContent") == "a & b"
    page.click("input")  # the middle of the range
    assert page.value("sliders[0]") == pytest.approx(25.0, abs=1.0)
    page.click("[name=pause]")
    page.wait("!running")
    before = page.value("time")
    energy = page.value("12.5 * state[0] ** 2 + 0.5 * state[1] ** 2")
    assert 0.0 < energy < 20.0
    page.click("[name=restart]")
    assert page.value("[time, ...state]") == [0, 1, 0]
    assert before > 0.0
    page.click("[name=pause]")
    page.wait("time > 0.1")
    # Something is drawn.
    assert page.value(
        "canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data.some(x => x)"
    )


def test_numbers_that_are_not_finite_stop_the_page(page: Page) -> None:
    page.value("state[0] = 1e308; state[1] = 1e308; sliders[0] = -1e308; 0")
    page.wait("!document.querySelector('.stopped').hidden")
    page.value("sliders[0] = 10; 0")
    page.click("[name=restart]")
    page.wait("time > 0.1")
    assert page.value("document.querySelector('.stopped').hidden")


def branching(state: Any, _: Any) -> Any:
    return state if state[0] > 0.0 else (0.0, 0.0)


def by_math(state: Any, _: Any) -> Any:
    return math.sin(state[0]), state[1]


def by_numpy(state: Any, _: Any) -> Any:
    return np.sin(state[0]), state[1]


@pytest.mark.parametrize("wrong", [branching, by_math, by_numpy, lambda s, _: (s[0] ** 2, s[1])])
def test_what_symbols_cannot_do_is_refused_with_advice(wrong: Any) -> None:
    advice = r"step must be straight-line code: .* such as cosine_sine and where_less"
    with pytest.raises(InvalidArgumentError, match=advice):
        page_of(step=wrong)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"step": lambda s, _: s[:1]}, "step must return the 2 numbers of a state"),
        ({"step": None}, "step must be"),
        ({"draw": lambda _, __: [(0.0, 1.0)]}, "draw must return lines and circles"),
        (
            {"draw": lambda _, __: [Circle(0.0, 0.0, 1.0, "red")]},
            "a colour of draw must be like #1c3c54; got 'red'",
        ),
        ({"start": (1.0, math.nan)}, "start must be finite numbers"),
        ({"view": (1.0, -1.0, 0.0, 1.0)}, "view must be"),
        ({"sliders": {"a": (0.0, 1.0, 2.0)}}, "the slider 'a' must be Slider"),
        ({"sliders": [SLIDERS]}, "sliders must be Slider"),
        ({"timestep": 0.0}, "timestep must lie in"),
    ],
)
def test_wrong_arguments_are_refused(changed: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidArgumentError, match=message):
        page_of(**changed)


def test_a_choice_is_printed() -> None:
    page = page_of(step=lambda s, _: (where_less(s[0], 0.0, 1.0, s[0] - 0.01), s[1]))
    assert "?" in page
