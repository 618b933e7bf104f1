"""Whatever a user may pass that is wrong is refused with a sentence, and nothing else happens.

``DOORS`` is the whole test: where values come in, what each argument must not be, and what the
sentence must say. pytest turns warnings into errors, so a warning is a failure here.
"""

from __future__ import annotations

import functools
import inspect
import json
import re
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import pytest
from bad_values import (
    CALM,
    STRANGERS,
    Text,
    Values,
    beyond,
    near,
    no_array,
    no_flag,
    no_name,
    no_whole,
    spoiled,
    strangers,
)
from gymnasium.vector import AutoresetMode
from hypothesis import given, settings
from hypothesis import strategies as st

import aquafish_gym
from aquafish_gym.damage import Damage, FinMissing, FinScaled
from aquafish_gym.engines.worlds import make_world
from aquafish_gym.envs.aquafish import AquaFishEnv
from aquafish_gym.envs.tasks import TASKS, HoldStation, ReachWaypoints, SwimForward
from aquafish_gym.envs.vector import AquaFishVectorEnv
from aquafish_gym.morphology import FINS, Morphology
from aquafish_gym.runs.storage import ensure_writable_directory
from aquafish_gym.utils.validation import EngineUnavailableError, InvalidArgumentError

COUNT = 2  # robots in the vector environment


class Bad(NamedTuple):
    """What an argument must not be, and a pattern of the sentence that refuses it."""

    values: Values
    sentence: str


class Door(NamedTuple):
    """Where values come in: ``enter(argument, value)``."""

    enter: Callable[[str, Any], object]
    arguments: Mapping[str, Bad]


def array(
    name: str,
    shape: tuple[int, ...] = (),
    low: float = -np.inf,
    high: float = np.inf,
    span: str = "",
    rows: str = "",
    good: float = 0.0,
) -> Bad:
    """An array of numbers; ``rows`` is how its shape is written where many rows would do."""
    wanted = re.escape(rows or str(shape))
    inside = f"|lie in {re.escape(span)}[^;]*" if span else ""
    return Bad(
        no_array(shape, low, high, good, rows_too=bool(rows)),
        rf"^{name}(\[[\d, ]+\])? must (be numbers of shape {wanted}|have shape {wanted}"
        rf"|be finite{inside}); got ",
    )


def whole(name: str, low: int, high: int | None = None, *valid: object) -> Bad:
    most = "" if high is None else f" and at most {high}"
    return Bad(
        no_whole(low, high, valid), f"^{name} must be a whole number of at least {low}{most}; got "
    )


def names(name: str, known: tuple[str, ...], *valid: object) -> Bad:
    return Bad(no_name(known, valid), f"^{name} must be one of {', '.join(known)}; got ")


def flag(name: str) -> Bad:
    return Bad(no_flag(), f"^{name} must be True or False; got ")


SIZE = {
    fin: array(rf"morphology\.{fin}", (3,), 0.0, 2.0, "[0, ", good=0.1) for fin in FINS
}  # the maxima differ from axis to axis: 0.5, 1 and 2

WRONG_BODIES = st.one_of(
    array("", (9,), 0.0, 2.0, good=0.1).values,
    near(FINS).map(lambda fin: {fin: (0.1, 0.1, 0.1)}),
    st.sampled_from([None, 0, b"caudal", ("caudal",)]).map(lambda fin: {fin: (0.1, 0.1, 0.1)}),
    no_array((3,), 0.0, 2.0, good=0.1).map(lambda size: {"caudal": size}),
).filter(lambda body: body is not None and not (isinstance(body, dict) and not body))
BODY = Bad(
    WRONG_BODIES,
    r"^morphology(\.\w+(\[\d\])? | fin | )must (have shape|be numbers of shape|be finite"
    r"|lie in \[0, |be one of left_pectoral, right_pectoral, caudal)",
)

ANYTHING_ELSE = st.one_of(
    strangers,
    st.sampled_from([True, 0, 0.5, np.nan, 10**5000, np.float32(1), np.array(["caudal:missing"])]),
)
WRONG_FAULTS = st.one_of(
    ANYTHING_ELSE,
    near(["caudal:missing"]).filter(lambda text: text.strip() != "caudal:missing"),
    st.text(max_size=20).filter(lambda text: text.strip().lower() not in ("", "none")),
    near(FINS).map(lambda fin: f"{fin.strip()}:missing").filter(lambda t: t[:-8] not in FINS),
    st.sampled_from(
        [
            "caudal:length",
            "caudal:length=",
            "caudal:length=nan",
            "caudal:length=1e999",
            "caudal:length=-0.001",
            "caudal:length=0x1",
            "caudal:length=0.5=0.5",
            "caudal:missing=1",
            "caudal:missing;",
            "caudal:missing@",
            "caudal:missing@soon",
            "caudal:missing@-1",
            "caudal:missing@1e9",
            "caudal:missing@3-2",
            "caudal:missing@1+nan",
            "caudal:missing+2",
            "caudal:weak=3",
            "caudal:entangled=1.5",
            "caudal:seized=4",
            "caudal:seized=1@2",
            "gyro:noise=-1",
            "gyro_w:stuck",
            "up_x:bias=2.5",
            "random:moderately",
            "random:mild=2",
            ";",
            "caudal:missing caudal:missing",
            "none;caudal:missing",
            "\ud800:missing",
            {},
            {"kind": "FinMissing"},
            {"kind": "FinMissing", "fin": "caudal", "size": "length"},
            {"kind": "FinScaled", "fin": "caudal", "size": "length", "factor": True},
            {"kind": "FinScaled", "fin": "caudal", "size": "length", "factro": 0.5},
            {"faults": [], "more": []},
            {"faults": "caudal:missing"},
            {"fualts": []},
            {1: 2},
            {"caudal:missing"},
        ]
    ),
)
DAMAGE = Bad(
    WRONG_FAULTS
    | WRONG_FAULTS.map(lambda fault: [fault])
    | WRONG_FAULTS.map(lambda fault: ("caudal:missing", [None, fault])),
    r"^damage( \S+:\S+)? (must|needs|takes no|(fin|kind|part|onset|latest|duration) (must|needs)"
    r"|of kind|is nested)|^(fin|channel) must be one of|^damage \w+ of ",
)
UNFIT = st.sampled_from(
    ["caudal:length=2", "left_pectoral:length=1e308", "caudal:thickness=1.2501"]
)  # there is no such body

SPINE = array("fin_angles", (3,))
FIN_ANGLES = Bad(
    st.one_of(SPINE.values.filter(lambda v: not isinstance(v, str)), no_name(("zero", "random"))),
    SPINE.sentence + "|^fin_angles must be one of zero, random; got ",
)
CURRENT = array("current", (3,), -20.0, 20.0, "[-20, 20] units/s")
FRAME_SKIP = Bad(
    no_whole(1, 2000) | st.integers(1, 2000).filter(lambda n: 2000 % n),
    "^frame_skip must (be a whole number of at least 1 and at most 2000|divide 2000, .*nearest)",
)
DTYPE = names("dtype", ("float32", "float64"))
ENVIRONMENT = {
    "morphology": BODY,
    "damage": Bad(DAMAGE.values | UNFIT, DAMAGE.sentence + r"|would make .*must lie in \[0, "),
    "engine": names("engine", ("auto", "numba", "pybullet")),
    "current": CURRENT,
    "fin_angles": FIN_ANGLES,
    "observe_fins": Bad(no_flag(), '^observe_fins must be True, False or "reckoned"; got '),
    "frame_skip": FRAME_SKIP,
    "render_mode": names("render_mode", ("human", "rgb_array"), None),
    "task": Bad(
        no_name(tuple(TASKS)),
        "^task must be (a Task or )?one of forward, station, waypoint, recovery",
    ),
    "reactive": flag("reactive"),
}
NUMBER_OF_BODIES = st.sampled_from([1, 3]).map(lambda n: np.full((n, 9), 0.1))
VECTOR_BODY = Bad(
    WRONG_BODIES
    | NUMBER_OF_BODIES
    | NUMBER_OF_BODIES.map(np.ndarray.tolist)
    | WRONG_BODIES.map(lambda body: [Morphology.nominal(), body]),
    BODY.sentence + "|^morphology must be one for all robots or num_envs = 2 of them; got ",
)
MODES = tuple(mode.value for mode in AutoresetMode)
VECTOR = {
    **ENVIRONMENT,
    "num_envs": whole("num_envs", 1, 1_000_000),
    "morphology": VECTOR_BODY,
    "damage": Bad(
        ENVIRONMENT["damage"].values,
        ENVIRONMENT["damage"].sentence + "|^damage must be one for all robots or num_envs = 2",
    ),
    "fin_angles": Bad(
        FIN_ANGLES.values,
        FIN_ANGLES.sentence + "|^fin_angles must be one for all robots or num_envs = 2",
    ),
    "max_episode_steps": whole("max_episode_steps", 1, None, None),
    "engine": Bad(
        ENVIRONMENT["engine"].values | st.just("pybullet"),
        ENVIRONMENT["engine"].sentence + '|^the batched environment runs on engine="numba" alone',
    ),
    "render_mode": Bad(
        ENVIRONMENT["render_mode"].values | st.just("human"),
        ENVIRONMENT["render_mode"].sentence + '|^render_mode="human" shows one robot',
    ),
    "dtype": DTYPE,
    "threads": whole("threads", 1, 1024, None),
    "autoreset_mode": names("autoreset_mode", MODES, *AutoresetMode),
}
SIMULATE = {
    "morphologies": Bad(
        no_array((9,), 0.0, 2.0, 0.1, rows_too=True).filter(lambda value: value is not None),
        r"^morpholog(ies(\[\d, \d\])?|y( fin)?) must (have shape \((any, )?9\)|be numbers of shape "
        r"\(any, 9\)|be finite|lie in \[0, |be one of left_pectoral, right_pectoral, caudal)",
    ),
    "commands": Bad(
        array("commands", (3,), -0.5, 1.0, "[", "(any, 3)").values,
        r"^commands(\[[\d, ]+\])? must (be numbers of shape \(any, 3\)|be finite|lie in \[[^;]*"
        r"|have shape \(any, (any, )?3\)|hold a command at least); got ",
    ),
    "fin_angles": array("fin_angles", (3,), rows="(any, 3)"),
    "interval": whole("interval", 1, 1_000_000),
    "begun": whole("begun", 0, 1_000_000),
    "velocity": array("velocity", (3,), -20.0, 20.0, "[-20, 20] units/s", "(any, 3)"),
    "spin": array("spin", (3,), -100.0, 100.0, "[-100, 100] rad/s", "(any, 3)"),
    "steps": whole("steps", 1, 1_000_000),
    "engine": ENVIRONMENT["engine"],
    "dtype": DTYPE,
    "current": array("current", (3,), -20.0, 20.0, "[-20, 20] units/s", "(any, 3)"),
    "substeps": whole("substeps", 1, 64),
    "threads": whole("threads", 1, 1024, None),
    "record": names("record", ("rpy", "gyro", "attitude", "pose")),
    "reactive": flag("reactive"),
    "drag": array("drag", (2,), 0.0, 10.0, "[0, 10]", "(any, 2)"),
    "servo_gain": array("servo_gain", (3,), -2.0, 2.0, "[-2, 2]", "(any, 3)"),
    "lag": Bad(
        no_array((), 0.0, 1.0).filter(lambda value: not isinstance(value, np.ndarray | list))
        | no_array((2, 3), 0.0, 1.0).filter(lambda v: not isinstance(v, np.ndarray) or v.ndim > 1)
        | spoiled((3,), beyond(0.0, 1.0)),
        r"^lag(\[\d\])? must (be numbers of shape \(any,\)|have shape \(any,\)|be finite"
        r"|lie in \[0, 1\] s); got ",
    ),
}
MAKE_WORLD = {
    "reactive": flag("reactive"),
    "drag": array("drag", (2,), 0.0, 10.0, "[0, 10]"),
    "servo_gain": array("servo_gain", (3,), -2.0, 2.0, "[-2, 2]"),
    "lag": array("lag", (), 0.0, 1.0, "[0, 1] s"),
    "substeps": whole("substeps", 1, 64),
}
OPTIONS = {name: ENVIRONMENT[name] for name in ("morphology", "damage", "fin_angles")}
WRONG_OPTIONS = Bad(
    st.one_of(
        strangers,
        st.sampled_from(["zero", 1, True, [("damage", None)], 10**5000]),
        near([*OPTIONS, "reset_mask"]).map(lambda name: {name: None}),
        st.sampled_from([None, 1, ("damage",), b"damage"]).map(lambda name: {name: None}),
    ),
    "^options must be (a dictionary; got|one of fin_angles, morphology, damage)",
)
WRONG_MASKS = st.one_of(
    strangers,
    st.sampled_from(
        [True, None, "11", [1, 0], [True], [True] * 3, [False] * 2, [[True, False]], [True, "x"]]
    ),
    st.sampled_from([np.zeros(2, bool), np.ones((2, 1), bool), np.ones(2), np.array(True)]),
    st.just([[True], [True, False]]),
)
VECTOR_SEED = Bad(
    no_whole(0, None, (None,)).filter(lambda v: not isinstance(v, list | tuple))
    | no_whole(0, None, (None,)).map(lambda seed: [1, seed])
    | st.sampled_from([[], [1], [1, 2, 3], (0,), b"ab", "ab", np.array([0.0, 1.0])]),
    r"^seed(\[\d\])? must be (a whole number of at least 0|one number or 2 of them); got ",
)


def body_json(written: Any) -> str:
    return json.dumps({**Morphology.nominal().to_dict(), **written})


WRONG_JSON = st.one_of(
    strangers,
    st.text(max_size=20),
    st.sampled_from(["", "{", "[]", "null", "3", '"caudal"', "[" * 100_000, "9" * 5000, b"\xff"]),
    st.sampled_from(['{"caudal": [0, 0, 0]}', "{}", '[{"kind": "FinMissing"}]', "[3]", "[[]]"]),
    st.sampled_from(["true", "3", '"0.1"', "null", "[0.1]", "NaN", "Infinity", "1e999", "-0.1"])
    .map(lambda number: f"[0.1, {number}, 0.1]")
    .map(lambda size: body_json({"caudal": 5}).replace(": 5", f": {size}")),
    st.just(body_json({}).replace("{", '{"caudal": [0, 0, 0], ', 1)),  # caudal twice
    st.just(body_json({"tail": [0, 0, 0]})),
)


@functools.cache
def standing_env() -> AquaFishEnv:
    return AquaFishEnv(engine="numba")


@functools.cache
def standing_vector() -> AquaFishVectorEnv:
    return AquaFishVectorEnv(COUNT, threads=1)


def step(env: Any, action: object) -> None:
    env.reset()
    env.step(action)


DOORS: dict[str, Door] = {
    "Morphology": Door(
        lambda fin, size: Morphology(**dict.fromkeys(FINS, (0.1, 0.1, 0.1)) | {fin: size}), SIZE
    ),
    "Morphology.coerce": Door(lambda _, value: Morphology.coerce(value), {"value": BODY}),
    "Morphology.from_array": Door(
        lambda _, value: Morphology.from_array(value),
        {"sizes": Bad(array("", (9,), 0.0, 2.0, good=0.1).values, BODY.sentence)},
    ),
    "Morphology.from_json": Door(
        lambda _, text: Morphology.from_json(text),
        {
            "text": Bad(
                WRONG_JSON,
                BODY.sentence + "|^morphology (must be text in JSON|is not JSON)"
                "|^a morphology's JSON must be an object with the keys left_pectoral, right",
            )
        },
    ),
    "Damage": Door(
        lambda _, faults: Damage(faults),
        {
            "faults": Bad(
                ANYTHING_ELSE | WRONG_FAULTS.map(lambda fault: (fault,)),
                "^damage must be (a row|made) of faults",
            )
        },
    ),
    "Damage.parse": Door(
        lambda _, text: Damage.parse(text),
        {"text": Bad(WRONG_FAULTS | st.sampled_from([None, [], ()]), DAMAGE.sentence)},
    ),
    "Damage.coerce": Door(lambda _, value: Damage.coerce(value), {"value": DAMAGE}),
    "Damage.apply": Door(
        lambda _, body: Damage().apply(body),
        {"morphology": Bad(WRONG_BODIES | st.none(), "^damage is applied to a Morphology; got ")},
    ),
    "Damage.from_json": Door(
        lambda _, text: Damage.from_json(text),
        {
            "text": Bad(
                WRONG_JSON.filter(lambda text: not isinstance(text, str) or text != "[]"),
                DAMAGE.sentence + "|^a damage's JSON must be a list of faults|^damage is not JSON",
            )
        },
    ),
    "FinScaled": Door(
        lambda name, value: FinScaled(
            **{"fin": "caudal", "size": "length", "factor": 0.5} | {name: value}
        ),
        {
            "fin": names("fin", FINS),
            "size": names("size", ("length", "width", "thickness")),
            "factor": array("damage factor of caudal:length", (), 0.0, span="[0, inf]"),
        },
    ),
    "ensure_writable_directory": Door(
        lambda _, path: ensure_writable_directory(path),
        {
            "out": Bad(
                strangers | st.sampled_from([None, 5, True, 0.5, "\0", "a\0b", "x" * 5000]),
                "^out must be a (path; got|directory that can be written; )",
            )
        },
    ),
    "FinMissing": Door(lambda _, fin: FinMissing(fin), {"fin": names("fin", FINS)}),
    "SwimForward": Door(
        lambda name, value: SwimForward(**{name: value}),
        {
            "seconds": array("seconds", (), 0.01, 3600.0, "[0.01, 3600] s"),
            "forward_weight": array("forward_weight", (), -1e6, 1e6, "[-1e+06, 1e+06]"),
            "ctrl_weight": array("ctrl_weight", (), 0.0, 1e6, "[0, 1e+06]"),
        },
    ),
    "HoldStation": Door(
        lambda name, value: HoldStation(**{name: value}),
        {
            "fastest": array("fastest", (), 0.1, 20.0, "[0.1, 20] units/s", good=0.3),
            "half": array("half", (), 1e-3, 1e6, "[0.001, 1e+06] units"),
            "turning": array("turning", (), 0.0, 1e6, "[0, 1e+06] rad/s"),
        },
    ),
    "ReachWaypoints": Door(
        lambda name, value: ReachWaypoints(**{name: value}),
        {"reached_weight": array("reached_weight", (), -1e6, 1e6, "[-1e+06, 1e+06]")},
    ),
    "AquaFishEnv": Door(
        lambda name, value: AquaFishEnv(**{"engine": "numba"} | {name: value}), ENVIRONMENT
    ),
    "AquaFishVectorEnv": Door(
        lambda name, value: AquaFishVectorEnv(**{"num_envs": COUNT} | {name: value}), VECTOR
    ),
    "simulate": Door(
        lambda name, value: aquafish_gym.simulate(
            **{"morphologies": None, "commands": (0.1, 0.1, 0.1), "steps": 1} | {name: value}
        ),
        SIMULATE,
    ),
    "make_world": Door(lambda name, value: make_world("numba", **{name: value}), MAKE_WORLD),
    "reset": Door(
        lambda name, value: standing_env().reset(**{name: value}),
        {"seed": whole("seed", 0, None, None), "options": WRONG_OPTIONS},
    ),
    "reset options": Door(lambda name, value: standing_env().reset(options={name: value}), OPTIONS),
    "step": Door(lambda _, action: step(standing_env(), action), {"action": array("action", (3,))}),
    "vector reset": Door(
        lambda name, value: standing_vector().reset(**{name: value}),
        {"seed": VECTOR_SEED, "options": WRONG_OPTIONS},
    ),
    "vector reset options": Door(
        lambda name, value: standing_vector().reset(options={name: value}),
        {
            **{name: VECTOR[name] for name in OPTIONS},
            "reset_mask": Bad(
                WRONG_MASKS, r'^options\["reset_mask"\] must be \(2,\) of bool with at least one'
            ),
        },
    ),
    "vector step": Door(
        lambda _, action: step(standing_vector(), action), {"action": array("action", (COUNT, 3))}
    ),
}
ROWS = [
    pytest.param(door.enter, argument, bad, id=f"{name}, {argument}")
    for name, door in DOORS.items()
    for argument, bad in door.arguments.items()
]


def check_refusal(enter: Callable[[str, Any], object], argument: str, bad: Bad, value: Any) -> None:
    with pytest.raises(InvalidArgumentError) as caught:
        enter(argument, value)
    sentence = str(caught.value)
    assert re.search(bad.sentence, sentence), sentence
    assert "\n" not in sentence
    assert len(sentence) < 500 or isinstance(value, str)  # a path is named in full


@pytest.mark.parametrize(("enter", "argument", "bad"), ROWS)
def test_what_is_wrong_is_refused_with_a_sentence(
    enter: Callable[[str, Any], object], argument: str, bad: Bad
) -> None:
    @CALM
    @given(bad.values)
    def refused(value: object) -> None:
        check_refusal(enter, argument, bad, value)

    refused()


@pytest.mark.parametrize(("enter", "argument", "bad"), ROWS)
def test_strangers_are_refused_at_every_door(
    enter: Callable[[str, Any], object], argument: str, bad: Bad
) -> None:
    """What is valid nowhere, without leaving it to chance."""
    for make in STRANGERS:
        check_refusal(enter, argument, bad, make())


KEYWORDS = {
    AquaFishEnv: tuple(ENVIRONMENT),
    AquaFishVectorEnv: tuple(VECTOR),
    aquafish_gym.simulate: tuple(SIMULATE),
    Morphology: FINS,
}


@pytest.mark.parametrize("function", KEYWORDS, ids=lambda f: f.__name__)
def test_no_argument_is_forgotten_here(function: Callable[..., object]) -> None:
    assert set(inspect.signature(function).parameters) == set(KEYWORDS[function])


@pytest.mark.parametrize("function", KEYWORDS, ids=lambda f: f.__name__)
def test_a_keyword_that_is_nearly_right_is_a_type_error(function: Callable[..., object]) -> None:
    @CALM
    @given(near(KEYWORDS[function]))
    def refused(keyword: str) -> None:
        with pytest.raises(TypeError, match="unexpected keyword argument"):
            function(**{keyword: None})

    refused()


# gymnasium looks at render_mode first, in its own words.
@pytest.mark.parametrize("argument", [name for name in ENVIRONMENT if name != "render_mode"])
def test_gym_make_passes_the_sentence_on(argument: str) -> None:
    values, sentence = ENVIRONMENT[argument]

    @settings(CALM, max_examples=40)
    @given(values.filter(copies))
    def refused(value: object) -> None:
        with pytest.raises(InvalidArgumentError, match=sentence):
            gym.make("AquaFish-v0", **{"engine": "numba"} | {argument: value})  # type: ignore[arg-type]

    refused()


def copies(value: object) -> bool:
    """Return whether gymnasium can copy a value, as it does with every keyword."""
    import copy

    try:
        copy.deepcopy(value)
    except (TypeError, RecursionError, ValueError):
        return False
    return True


def test_gym_make_refuses_unknown_keywords() -> None:
    with pytest.raises(TypeError, match="unexpected keyword argument 'damages'"):
        gym.make("AquaFish-v0", engine="numba", damages="none")


def test_a_window_without_a_display_is_said_to_be_unavailable(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    for mode in ("human", Text("human"), np.str_("human")):
        with pytest.raises(EngineUnavailableError, match="no display"):
            AquaFishEnv(engine="numba", render_mode=mode)


@pytest.mark.parametrize("counts", [(2, 3, 1), (2, 1, 3), (1, 2, 3), (4, 4, 2)])
def test_trials_that_are_not_equally_many_are_refused(counts: tuple[int, int, int]) -> None:
    bodies, commands, angles = (np.zeros((n, k)) for n, k in zip(counts, (9, 3, 3), strict=True))
    with pytest.raises(InvalidArgumentError, match="equally many, or one for all; got"):
        aquafish_gym.simulate(bodies, commands, angles, steps=1)


@pytest.mark.parametrize("kind", ["single", "vector"])
def test_a_refused_call_changes_nothing(kind: str) -> None:
    """A refused action, seed or option leaves the episode, and what is drawn next, as it was."""
    bodies = [[0.4, length, 0.1, 0.4, 1.6, 0.1, 0.4, 1.4, 0.6] for length in (0.5, 1.5)]

    def make() -> Any:
        if kind == "single":
            return AquaFishEnv(bodies[1], engine="numba", fin_angles="random")
        return AquaFishVectorEnv(2, bodies, fin_angles="random", threads=1)

    spoilt, calm = make(), make()
    go = np.array([0.9, -0.2, 0.4], np.float32)
    go = go if kind == "single" else np.stack([go, go])
    for env in (spoilt, calm):
        env.reset(seed=1)
    for _ in range(5):
        for attempt in (
            lambda: spoilt.step(go * np.nan),
            lambda: spoilt.reset(seed=-1),
            # It would fit the first of the two robots.
            lambda: spoilt.reset(seed=5, options={"damage": "left_pectoral:length=2"}),
            lambda: spoilt.reset(seed=5, options={"damages": "none"}),
        ):
            with pytest.raises(InvalidArgumentError):
                attempt()
        found, expected = spoilt.step(go), calm.step(go)
        assert (found[0] == expected[0]).all()
        assert str(found[4]) == str(expected[4])
    assert str(spoilt.reset()) == str(calm.reset())
