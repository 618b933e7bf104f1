"""The page's program: functions of the library in JavaScript, what the agent knows, the agent."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from functools import cache, partial
from importlib.resources import files
from typing import Any

from aquafish.online.self_model import error_size
from aquafish.page.facts import GAIT_SENSES, agent_facts
from aquafish.viewer.live import GAIT_HORIZON_SECONDS
from aquafish_gym.code_generation import robot_code
from aquafish_gym.physics.arithmetic import (
    TAU,
    add,
    arctangent2,
    cosine_sine,
    cross,
    dot,
    fma,
    put,
    scale,
    square_root,
    subtract,
    where_less,
)
from aquafish_gym.physics.kinematics import joint_angles, pairs, turn, turned
from aquafish_gym.physics.layout import fetch_vector, layout, put_vector, state_numbers, state_of
from aquafish_gym.physics.printing import JAVASCRIPT, printed, trace
from aquafish_gym.plans import BodyPlan
from aquafish_gym.rendering.scene import PART_NUMBERS, drawn_parts, place_parts
from aquafish_gym.sense import up_and_north
from gait.controllers.controller import Controller
from gait.controllers.network import put_inputs


def place_fish(plan: BodyPlan, sizes: Any, broken: Any, state: Any, parts: Any) -> None:
    """Set what is drawn of a fish: of each part centre, turn, size and colour, in body axes."""
    angles = joint_angles(state_of(list(state)).joints)
    placed = place_parts(sizes, broken, angles, plan)
    numbers = [x for part in placed for field in part for x in field]
    for i, number in enumerate(numbers):
        is_colour = i % PART_NUMBERS >= PART_NUMBERS - 3
        put(parts, i, number * (1 / 255) if is_colour else number)


def sense_inputs(state: Any, turns: Any, values: Any) -> None:
    """Set the inputs of a gait's network in a state, after its clock has made ``turns`` (1,)."""
    now = state_of(list(state))
    up, north = up_and_north(now.orientation)
    fins = tuple((1 / TAU) * angle for angle in joint_angles(now.joints))
    way = (0.0, 0.0, 0.0)
    put_inputs(values, GAIT_SENSES.layout, turns[0], up, north, now.spin, fins, way)


def move(state: Any, error: Any, found: Any) -> None:
    """Set the state that differs from one by an error (E,): ``self_model.moved``."""
    before = state_of(list(state))
    rotation, velocity, spin = (fetch_vector(error, 3 * i, 0, 1, 0.0) for i in range(3))
    joints = [
        turned(pair, cosine_sine(angle))
        for pair, angle in zip(pairs(before.joints), error[9:], strict=True)
    ]
    after = before._replace(
        orientation=turn(before.orientation, rotation, 1.0),
        velocity=add(before.velocity, velocity),
        spin=add(before.spin, spin),
        joints=tuple(x for pair in joints for x in pair),
    )
    for row, number in enumerate(state_numbers(after)):
        put(found, row, number)


def state_error(state: Any, other: Any, error: Any) -> None:
    """Set the error (E,) by which a state differs from another: ``self_model.state_errors``.

    Their attitudes differ by less than half a turn, and their quaternions have the same sign.
    """
    now, then = (state_of(list(one)) for one in (state, other))
    a = now.orientation
    b = then.orientation
    real = fma(a[3], b[3], dot(a[:3], b[:3]))
    axis = subtract(subtract(scale(b[3], a[:3]), scale(a[3], b[:3])), cross(b[:3], a[:3]))
    sine = square_root(dot(axis, axis))
    angle = 2.0 * arctangent2(sine, real)
    put_vector(error, 0, 0, 1, scale(where_less(sine, 1e-12, 2.0, angle / (sine + 1e-30)), axis))
    put_vector(error, 3, 0, 1, subtract(now.velocity, then.velocity))
    put_vector(error, 6, 0, 1, subtract(now.spin, then.spin))
    both = zip(pairs(now.joints), pairs(then.joints), strict=True)
    for i, ((c, s), (c0, s0)) in enumerate(both):
        put(error, 9 + i, arctangent2(fma(s, c0, -(c * s0)), fma(c, c0, s * s0)))


@cache
def _printed_functions(plan: BodyPlan, reactive: bool) -> str:
    """Return the JavaScript of a plan's physics, and of what the agent and the page call."""
    code = robot_code(plan)
    fins = len(plan.fins)
    state = layout(plan).state_numbers
    error = error_size(plan)
    parts = PART_NUMBERS * len(drawn_parts(plan))
    functions: list[tuple[str, Callable[..., None], dict[str, int]]] = [
        (
            "place_fish",
            partial(place_fish, plan),
            {"sizes": 3 * fins, "broken": fins, "state": state, "parts": parts},
        ),
        (
            "sense_inputs",
            sense_inputs,
            {"state": state, "turns": 1, "values": len(GAIT_SENSES.names(plan))},
        ),
        ("move", move, {"state": state, "error": error, "found": state}),
        ("state_error", state_error, {"state": state, "other": state, "error": error}),
    ]
    step = code.step_reactive if reactive else code.step
    physics = code.javascript(code.robot_rows, code.start, step, code.sense)
    own = [printed(name, trace(f, **sizes), JAVASCRIPT) for name, f, sizes in functions]
    return "\n".join([physics, *(["const step = step_reactive;"] if reactive else []), *own])


def program(
    gaits: Sequence[Controller], seconds: float = GAIT_HORIZON_SECONDS, reactive: bool = False
) -> str:
    """Return the JavaScript of a fish and its agent, which compares gaits for some seconds.

    It defines ``FACTS``, the printed functions, and what ``agent.js`` does. The page and its worker
    run it, and so does node. The fish is of the gaits' plan, and ``reactive`` water has added mass.
    """
    facts = json.dumps(agent_facts(gaits, seconds), separators=(",", ":"), allow_nan=False)
    begin = f'"use strict";\nconst FACTS = {facts};'
    printed_code = _printed_functions(gaits[0].plan, reactive)
    return "\n".join([begin, printed_code, page_file("agent.js"), page_file("words.js")])


def page_file(name: str) -> str:
    """Return a file of this package."""
    return files("aquafish.page").joinpath(name).read_text(encoding="utf-8")
