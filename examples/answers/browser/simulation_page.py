"""A simulation as one HTML file with sliders, which runs in a browser without a server.

The time step and the drawing are functions on numbers. Here they run once on symbols, and what they
did is printed in JavaScript (``physics/printing.py``).
"""

from __future__ import annotations

import html
import json
import math
import os
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from string import Template
from typing import Any, NamedTuple

from aquafish_gym.physics.arithmetic import Number, put
from aquafish_gym.physics.printing import JAVASCRIPT, Traced, printed, trace
from aquafish_gym.physics.symbols import Symbol
from aquafish_gym.rendering.replay import whole_page
from aquafish_gym.utils.storage import write_bytes
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    brief,
    callback,
    file_path,
    positive,
    real_array,
    utf8_text,
)

_COLOUR = re.compile(r"#[0-9a-f]{6}")
_ADVICE = (
    "it runs on symbols, so it computes with + - * / abs and the functions of "
    "aquafish_gym.physics.arithmetic, such as cosine_sine and where_less, and has no branch"
)


class Line(NamedTuple):
    """A straight line with round ends; lengths are in the unit of the view."""

    x: Number
    y: Number
    to_x: Number
    to_y: Number
    width: Number
    colour: str = "#1c3c54"  #: As ``#rrggbb``.


class Circle(NamedTuple):
    """A filled circle; lengths are in the unit of the view."""

    x: Number
    y: Number
    radius: Number
    colour: str = "#1c3c54"  #: As ``#rrggbb``.


class Slider(NamedTuple):
    """A number that the reader of the page sets."""

    low: float
    high: float
    value: float  #: At first.


#: Takes the state and the sliders' values, and returns the state a time step later.
Step = Callable[[tuple[Number, ...], tuple[Number, ...]], Sequence[Number]]
#: Takes the same, and returns what is drawn, from back to front.
Draw = Callable[[tuple[Number, ...], tuple[Number, ...]], Sequence[Line | Circle]]


def write_simulation(
    path: str | os.PathLike[str],
    step: Step,
    draw: Draw,
    start: Sequence[float],
    sliders: Mapping[str, Slider],
    timestep: float,
    view: Sequence[float],
    title: str = "Simulation",
    note: str = "",
) -> Path:
    """Write a simulation as one HTML file and return its path.

    Parameters
    ----------
    path
        The file.
    step
        Takes the state (n numbers) and the sliders' values, in their order, and returns the state
        after a time step. It is straight-line code: it runs on plain numbers, and here on symbols.
    draw
        Takes the same, and returns lines and circles, always as many, of the same colours.
    start
        The state at first, n finite numbers.
    sliders
        The numbers that the reader sets, by name: the ends of the range and the value at first.
    timestep
        What ``step`` advances, s.
    view
        What the picture shows at least: (lowest x, highest x, lowest y, highest y), y up.
    title, note
        Text.

    Raises
    ------
    InvalidArgumentError
        If an argument has another form, or ``step`` or ``draw`` does what symbols cannot.
    """
    file_path("path", path)
    first = real_array("start", start, (None,)).tolist()
    _check_finite("start", first)
    left, right, bottom, top = real_array("view", view, (4,)).tolist()
    _check_finite("view", [left, right, bottom, top])
    if not (left < right and bottom < top):
        raise InvalidArgumentError(
            f"view must be (lowest x, highest x, lowest y, highest y); got {brief(view)}"
        )
    _check_sliders(sliders)
    stepped = trace_step(step, len(first), len(sliders))
    shapes, drawn = _trace_drawing(draw, len(first), len(sliders))
    data = {
        "timestep": positive("timestep", timestep),
        "start": first,
        "sliders": [list(map(float, slider)) for slider in sliders.values()],
        "view": [left, right, bottom, top],
        "shapes": [[isinstance(shape, Line), shape.colour] for shape in shapes],
        "numbers": sum(map(len, shapes)) - len(shapes),
    }
    controls = "\n".join(
        f"<label>{html.escape(utf8_text('the name of a slider', name))}"
        '<input type="range" step="any"><output></output></label>'
        for name in sliders
    )
    body = Template(_beside("simulation.html")).substitute(
        title=html.escape(utf8_text("title", title)),
        note=html.escape(utf8_text("note", note)),
        sliders=controls,
        data=json.dumps(data, separators=(",", ":"), allow_nan=False),
        script=(script := _script(stepped, drawn)),
    )
    page = whole_page(title, body, _beside("simulation.css"), (script,))
    write_bytes(path, page.encode())
    return Path(path)


def trace_step(step: Step, numbers: int, sliders: int) -> Traced:
    """Return a step as it runs on symbols: of a state of some numbers, and some sliders.

    Raises
    ------
    InvalidArgumentError
        If it does what symbols cannot, or returns another number of numbers.
    """
    callback("step", step)

    def stepped(state: Any, sliders: Any) -> None:
        after = list(step(tuple(state), tuple(sliders)))
        if len(after) != numbers or not all(isinstance(x, Symbol | float | int) for x in after):
            raise InvalidArgumentError(
                f"step must return the {numbers} numbers of a state; got {brief(after)}"
            )
        for i, number in enumerate(after):
            put(state, i, number)

    return _traced("step", stepped, state=numbers, sliders=sliders)


def _trace_drawing(
    draw: Draw, numbers: int, sliders: int
) -> tuple[Sequence[Line | Circle], Traced]:
    """Return what is drawn, on symbols, and the function that sets its numbers."""
    callback("draw", draw)
    shapes: list[Line | Circle] = []

    def look(state: Any, sliders: Any) -> None:
        shapes.extend(draw(tuple(state), tuple(sliders)))

    _traced("draw", look, state=numbers, sliders=sliders)
    for shape in shapes:
        if not isinstance(shape, Line | Circle):
            raise InvalidArgumentError(f"draw must return lines and circles; got {brief(shape)}")
        if not (isinstance(shape.colour, str) and _COLOUR.fullmatch(shape.colour)):
            raise InvalidArgumentError(
                f"a colour of draw must be like #1c3c54; got {brief(shape.colour)}"
            )

    def drawn(state: Any, sliders: Any, shapes: Any) -> None:
        flat = [x for shape in draw(tuple(state), tuple(sliders)) for x in shape[:-1]]
        for i, number in enumerate(flat):
            put(shapes, i, number)

    count = sum(len(shape) - 1 for shape in shapes)
    return shapes, _traced("draw", drawn, state=numbers, sliders=sliders, shapes=count)


def _traced(name: str, function: Callable[..., None], **sizes: int) -> Traced:
    try:
        return trace(function, **sizes)
    except InvalidArgumentError:
        raise
    except TypeError as error:  # a function, a power or a branch that symbols do not have
        message = f"{name} must be straight-line code: {_ADVICE}; {error}"
        raise InvalidArgumentError(message) from error


def _script(stepped: Traced, drawn: Traced) -> str:
    functions = printed("step", stepped, JAVASCRIPT) + printed("draw", drawn, JAVASCRIPT)
    return '"use strict";\n' + functions + _beside("simulation.js")


def _beside(name: str) -> str:
    return Path(__file__).with_name(name).read_text(encoding="utf-8")


def _check_finite(argument: str, numbers: Sequence[float]) -> None:
    if not all(map(math.isfinite, numbers)):
        raise InvalidArgumentError(f"{argument} must be finite numbers; got {brief(numbers)}")


def _check_sliders(sliders: object) -> None:
    if not isinstance(sliders, Mapping):
        raise InvalidArgumentError(
            f"sliders must be Slider(low, high, value) by name; got {brief(sliders)}"
        )
    for name, slider in sliders.items():
        low, high, value = real_array(f"the slider {name!r}", slider, (3,)).tolist()
        if not -math.inf < low <= value <= high < math.inf or low == high:
            raise InvalidArgumentError(
                f"the slider {name!r} must be Slider(low, high, value) with a value within the "
                f"range; got {brief(slider)}"
            )
