"""The page as one HTML file."""

from __future__ import annotations

import html
import json
import os
from collections.abc import Sequence
from pathlib import Path
from string import Template

from aquafish.online.gaits import gaits_of
from aquafish.page.program import page_file, program
from aquafish.viewer.live import GAIT_HORIZON_SECONDS
from aquafish_gym.damage.words import PHRASES
from aquafish_gym.physics.layout import FIELDS
from aquafish_gym.plans import AQUAFISH, PlanLike, check_plan
from aquafish_gym.rendering import scene
from aquafish_gym.rendering.course import TRAILS
from aquafish_gym.rendering.replay import css, packed_library, web_file, whole_page
from aquafish_gym.scenario import TIMESTEP
from aquafish_gym.utils.storage import write_bytes
from aquafish_gym.utils.validation import file_path, flag

TITLE = "Break the fish"
MUTED = "#5b7485"  # of what is less important
FEWEST_FRAMES = 34  # a second; with fewer, the page draws without shadows, then coarser
FASTEST_CURRENT = 1.0  # units/s: faster than the fish
#: What a button does to a fin: its name, a word of damage, and its number.
BREAKS: Sequence[tuple[str, str, float]] = (
    ("missing", "missing", 0.0),
    ("half", "length", 0.5),
    ("seized", "seized", 0.0),
    ("weak", "weak", 0.4),
    ("reversed", "reversed", 0.0),
)


def write_live_page(
    path: str | os.PathLike[str],
    plan: PlanLike = AQUAFISH,
    library: Path | None = None,
    reactive: bool = False,
) -> Path:
    """Write the page as one HTML file, and return its path.

    Parameters
    ----------
    path
        Of the file.
    plan
        Of the fish.
    library
        A file of its gaits. None is the packaged library of the plan, or all servos at full speed.
    reactive
        Whether the water has added mass.

    Raises
    ------
    InvalidArgumentError
        If ``path`` cannot be the path of a file, or the library is of another plan.

    Examples
    --------
    >>> write_live_page("fish.html").stat().st_size < 700_000
    True
    """
    file_path("path", path)
    write_bytes(path, live_page(plan, library, reactive).encode())
    return Path(path)


def live_page(
    plan: PlanLike = AQUAFISH, library: Path | None = None, reactive: bool = False
) -> str:
    """Return the page in which a fish swims, breaks and swims on, as HTML."""
    plan = check_plan(plan)
    gaits = gaits_of(plan, library)
    code = program(gaits, reactive=flag("reactive", reactive))
    colours = {
        "water": css(scene.WATER_ABOVE),
        "sand": css(scene.SAND),
        "grid": css(scene.GRID),
        "ink": css(scene.INK),
        "fish": css(TRAILS[0]),
        "belief": css(scene.BELIEF),
        "broken": css(scene.BROKEN_FIN),
        "muted": MUTED,
    }
    room = scene.fish_room(plan)
    data = {
        "timestep": TIMESTEP,
        "cmPerUnit": scene.CM_PER_UNIT,
        "horizon": GAIT_HORIZON_SECONDS,
        "partNumbers": scene.PART_NUMBERS,
        "rows": {name: FIELDS[name].start for name in ("orientation", "position")},
        "floor": -scene.FLOOR_DEPTH * room,
        "slowFrame": 1000 / FEWEST_FRAMES,
        "clearance": scene.CLEARANCE * room,
        "grid": (scene.GRID_SPACING, scene.MAIN_GRID_SPACING),
        "room": room,
        "parts": len(scene.drawn_parts(plan)),
        "firstFin": scene.fin_parts(plan).start,
        "lengthAxes": [fin.order.index("length") for fin in plan.fins],
        "capsule": (2 * plan.hull.radius, plan.hull.length),
        "colours": colours,
        "finWords": plan.words,
        "phrases": {word: phrase.replace(" at #", "") for word, phrase in PHRASES.items()},
        "breaks": BREAKS,
    }
    fins = "\n".join(
        f'<option value="{i}">{html.escape(fin.word)}</option>' for i, fin in enumerate(plan.fins)
    )
    view = web_file("scene.js") + page_file("panel.js") + page_file("view.js")
    body = Template(page_file("page.html")).substitute(
        title=TITLE,
        fins=fins,
        seconds=f"{GAIT_HORIZON_SECONDS:g}",
        current=f"{scene.CM_PER_UNIT * FASTEST_CURRENT:g}",
        data=json.dumps(data, separators=(",", ":")).replace("<", r"\u003c"),
        library=packed_library(),
        program=code,
        view=view,
    )
    style = Template(page_file("page.css")).substitute(colours)
    return whole_page(TITLE, body, style, (code, view), worker=True)
