"""The law of any body plan: engines and languages agree, and no frame is special."""

from __future__ import annotations

import math
import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from aquafish_gym import Damage, WorldConfig, simulate
from aquafish_gym.damage import edit_each
from aquafish_gym.engines.worlds import World
from aquafish_gym.morphology import Morphology
from aquafish_gym.physics import dynamics, reactive
from aquafish_gym.physics.kinematics import State, at_rest, rotation
from aquafish_gym.physics.law import law
from aquafish_gym.physics.layout import layout, robot_of, state_numbers
from aquafish_gym.plans import (
    AQUAFISH,
    FOUR_FINS,
    TAIL_FISH,
    BodyPlan,
    check_plan,
    plan_document,
)
from aquafish_gym.rollout import Program, rollout
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.validation import InvalidArgumentError, UnknownNameError
from tests.plans import ODD, PLANS, plans, turned

Numbers = tuple[float, ...]


def swim(plan: BodyPlan, command: Numbers, angles: Numbers, steps: int, added: bool) -> State:
    """Return where the whole fish of a plan is, by its law on plain floats."""
    of = law(plan)
    robot = tuple(layout(plan).robots(plan.nominal[None])[:, 0].tolist())
    step = of.step_reactive if added else of.step
    by = of.driven((1.0,) * len(plan.fins), command, 0.01)
    state = at_rest(angles)
    for _ in range(steps):
        state = step(robot, state, by, (0.05, 0.1, -0.02), 0.01)
    return state


def a_command(plan: BodyPlan, seed: int) -> tuple[Numbers, Numbers]:
    rng = np.random.default_rng(seed)
    command = rng.uniform(plan.command_low, plan.command_high)
    return tuple(command.tolist()), tuple(rng.uniform(-3, 3, len(plan.fins)).tolist())


@pytest.mark.parametrize("added", [False, True])
@given(plan=st.sampled_from(PLANS) | plans(), seed=st.integers(0, 99))
@settings(max_examples=10)
def test_what_is_printed_is_what_is_stated(added: bool, plan: BodyPlan, seed: int) -> None:
    """To the bit, but for the sign of a zero."""
    command, angles = a_command(plan, seed)
    now = swim(plan, command, angles, 10, added)
    robot = tuple(layout(plan).robots(plan.nominal[None])[:, 0].tolist())
    by = law(plan).driven((0.9,) * len(plan.fins), command, 0.01)
    rest = now, by, (0.1, 0.0, 0.2), 0.01
    stated = reactive.step_reactive if added else dynamics.step
    printed = law(plan).step_reactive if added else law(plan).step
    assert printed(robot, *rest) == stated(plan, robot_of(robot), *rest)


@pytest.mark.pybullet
@pytest.mark.parametrize("added", [False, True])
@given(plan=st.sampled_from(PLANS) | plans(), seed=st.integers(0, 99))
@settings(max_examples=8)
def test_bullets_mechanics_are_the_laws(added: bool, plan: BodyPlan, seed: int) -> None:
    """Bullet knows the fins' masses, hinges and axes from the plan; the water alone is ours."""
    from aquafish_gym.engines.bullet.world import BulletWorld

    command, angles = a_command(plan, seed)
    robot = Scenario.create(
        plan=plan, fin_angles=angles, current=(0.05, 0.1, -0.02), reactive=added
    )
    world: World = BulletWorld()
    try:
        world.start(robot)
        world._push = world._push.py_func  # type: ignore[attr-defined]  # not compiled: at once
        world.advance(command, 50)
        found = state_numbers(world.state())
    finally:
        world.close()
    assert_allclose(found, state_numbers(swim(plan, command, angles, 50, added)), atol=1e-9)


@pytest.mark.parametrize(
    ("plan", "added"),
    [
        (FOUR_FINS, False),
        (TAIL_FISH, True),
        pytest.param(ODD, True, marks=pytest.mark.slow),
    ],
    ids=str,
)
def test_lanes_are_plain_floats_to_the_bit(plan: BodyPlan, added: bool) -> None:
    commands, angles = zip(*(a_command(plan, seed) for seed in range(5)), strict=True)
    log = simulate(
        plan.nominal, commands, angles, steps=60, dtype="float64", record="pose",
        current=(0.05, 0.1, -0.02), reactive=added, plan=plan,
    )  # fmt: skip
    assert log.position is not None
    assert log.fin_angles is not None
    for i in range(5):
        state = swim(plan, commands[i], angles[i], 60, added)
        assert_array_equal(log.position[i, -1], state.position)
        assert_array_equal(log.fin_angles[i, -1], law(plan).joint_angles(state.joints))


@pytest.mark.parametrize("added", [False, True])
@given(
    plan=st.sampled_from(PLANS) | plans(),
    angle=st.floats(0.0, 2 * math.pi) | st.sampled_from([math.pi / 2, math.pi]),
    seed=st.integers(0, 99),
)
@settings(max_examples=10)
def test_a_fish_that_is_built_on_its_side_swims_the_same(
    added: bool, plan: BodyPlan, angle: float, seed: int
) -> None:
    """The hull is round, so nothing but the fins says which way is up: every frame is turned."""
    command, angles = a_command(plan, seed)
    upright, sideways = (
        still_water(one, command, angles, added) for one in (plan, turned(plan, angle))
    )
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    for found, expected in (
        (sideways.position, upright.position),
        (sideways.velocity, upright.velocity),
        (sideways.spin, upright.spin),
    ):
        assert_allclose(found, turn @ expected, atol=1e-9)
    before, after = (np.array(rotation(one.orientation)) for one in (upright, sideways))
    assert_allclose(after, turn @ before @ turn.T, atol=1e-9)


def still_water(plan: BodyPlan, command: Numbers, angles: Numbers, added: bool) -> State:
    of = law(plan)
    robot = tuple(layout(plan).robots(plan.nominal[None])[:, 0].tolist())
    step = of.step_reactive if added else of.step
    by = of.driven((1.0,) * len(plan.fins), command, 0.01)
    state = at_rest(angles)
    for _ in range(40):
        state = step(robot, state, by, (0.0, 0.0, 0.0), 0.01)
    return state


def test_hinges_along_the_axes_cost_no_multiplication() -> None:
    """Of AquaFish as many as when its three fins stood in the law one by one."""
    from aquafish_gym.code_generation import robot_code

    code = robot_code(AQUAFISH)
    assert code.traced(code.step).operations.total() <= 973
    on_side = robot_code(turned(AQUAFISH, math.pi / 2))
    assert on_side.traced(on_side.step).operations.total() <= 1.02 * 973


def test_a_body_is_of_its_plan() -> None:
    body = Morphology.nominal(FOUR_FINS)
    assert body.fore_left == (0.4, 1.4, 0.1)
    assert repr(body).startswith("Morphology(fore_left=(0.4, 1.4, 0.1), ")
    assert Morphology.from_json(body.to_json(), FOUR_FINS) == body
    assert (
        Morphology.coerce({"hind_left": (0, 0, 0)}, FOUR_FINS).to_array()[6:9].tolist() == [0] * 3
    )


def test_damage_names_the_fins_of_every_plan() -> None:
    damage = Damage.parse("fore_left:length=0.5; hind_right:seized=0.3; gyro:noise=0.1")
    assert damage.said("my ").startswith("my fore left flipper has 50% of its length")
    robot = damage.edit(Scenario.create(plan=FOUR_FINS))
    whole = FOUR_FINS.nominal
    assert robot.body[0].tolist() == [whole[0], 0.5 * whole[1], *whole[2:]]
    assert robot.servo_gain.tolist() == [[1.0, 1.0, 1.0, 0.0]]
    assert robot.fin_angles.tolist() == [[0.0, 0.0, 0.0, 0.3]]
    assert damage.certain.body(Morphology.nominal(FOUR_FINS)).fore_left[1] == 0.5 * whole[1]


def test_damage_of_another_plan_is_refused() -> None:
    with pytest.raises(
        UnknownNameError, match=r"damage part must be one of tail, left_fin.*caudal"
    ):
        Damage.parse("caudal:missing").edit(Scenario.create(plan=TAIL_FISH))
    with pytest.raises(UnknownNameError, match=r"damage part must be one of left_pectoral.*tail"):
        Damage.parse("tail:missing").apply(Morphology.nominal())
    with pytest.raises(UnknownNameError, match="got 'dorsal'"):
        Damage.parse("dorsal:missing")


def test_random_damage_is_of_the_plans_own_fins() -> None:
    damages = [Damage.parse("random:severe")] * 40
    rngs = [np.random.default_rng(i) for i in range(40)]
    broken = edit_each(
        Scenario.fill({"body": np.tile(FOUR_FINS.nominal, (40, 1))}, plan=FOUR_FINS),
        damages,
        rngs=rngs,
    )
    lost = (broken.body != FOUR_FINS.nominal).reshape(40, 4, 3).any(axis=2)
    assert (lost | (broken.servo_gain != 1.0)).any(axis=0).all()


def test_damage_names_the_fins_of_a_plan_of_ones_own_once_it_was_given(tmp_path: Path) -> None:
    fin = replace(ODD.fins[1], name="bow_plane", word="plane at the bow")
    path = tmp_path / "own.json"
    path.write_text(BodyPlan("own", ODD.hull, (fin,)).to_json())
    with pytest.raises(UnknownNameError, match="got 'bow_plane'"):
        Damage.parse("bow_plane:missing")
    plan = check_plan(str(path))
    damage = Damage.parse("bow_plane:missing")
    assert damage.said() == "the plane at the bow is missing"
    assert damage.edit(Scenario.create(plan=plan)).body.tolist() == [[0.0, 0.0, 0.0]]
    assert plan_document(plan) == plan.to_dict()  # other processes read it


def test_what_is_of_another_plan_is_refused() -> None:
    """Also where both fish have three fins, so that every shape fits."""
    fish = Scenario.create(plan=TAIL_FISH)
    function: Any = lambda *_: (0.0, 0.0, 0.0)  # noqa: E731
    program = Program(function, np.zeros((1, 1)), np.zeros(1, np.int64), 0, 20)
    asked: list[Callable[[], object]] = [
        lambda: rollout(program, fish, seconds=1.0),
        lambda: Scenario.create(Morphology.nominal(), plan=TAIL_FISH),
    ]
    for ask in asked:
        with pytest.raises(InvalidArgumentError, match=r"must be of the plan (tail-fish|aquafish)"):
            ask()


def test_a_fin_has_no_name_of_something_else() -> None:
    """Of a body's attributes, of the numbers that inference fits, or of what is drawn."""
    from aquafish_gym.rendering.scene import drawn_parts
    from eea.fish.joint import fish_numbers
    from eea.fish.swim_log import log_columns

    body = Morphology.nominal()
    theirs = {*dir(body), *fish_numbers(AQUAFISH), *drawn_parts(AQUAFISH), *log_columns(AQUAFISH)}
    for name in {*theirs, "Tail", "_tail", "fl\xfcgel", "\ufb01n", ""} - set(AQUAFISH.names):
        with pytest.raises(InvalidArgumentError, match="a fin's name must"):
            replace(AQUAFISH.fins[0], name=name)


@pytest.mark.parametrize("word", ["a\nb", "<b>", "$x$", "50%"])
def test_a_fins_word_is_words(word: str) -> None:
    with pytest.raises(InvalidArgumentError, match="word must be letters"):
        replace(AQUAFISH.fins[0], word=word)
    assert replace(AQUAFISH.fins[0], word=" fl\xfcgel ").word == "fl\xfcgel"


def test_a_world_is_for_any_plan() -> None:
    fish = Scenario.create(plan=FOUR_FINS)
    weak = WorldConfig(servo_gain=(1.0, 0.5, 1.0, 0.0))
    assert weak.edit(fish).servo_gain.tolist() == [[1.0, 0.5, 1.0, 0.0]]
    assert WorldConfig.of(weak.edit(fish)) == weak
    assert WorldConfig(servo_gain=0.5).edit(fish).servo_gain.tolist() == [[0.5] * 4]
    assert WorldConfig.of(fish) == WorldConfig(servo_gain=(1.0, 1.0)) == WorldConfig()
    with pytest.raises(InvalidArgumentError, match=r"one number, or 4 for fore_left, .*got \(1"):
        WorldConfig(servo_gain=(1.0, 0.5, 1.0)).edit(fish)


def test_a_plan_of_another_process_is_found_among_ones_own() -> None:
    code = (
        "import pickle, sys; from aquafish_gym.plans import FOUR_FINS; hash(FOUR_FINS); "
        "sys.stdout.buffer.write(pickle.dumps(FOUR_FINS))"
    )
    environment = os.environ | {"PYTHONHASHSEED": "1"}
    pickled = subprocess.run(
        [sys.executable, "-c", code], env=environment, check=True, capture_output=True
    ).stdout
    assert pickle.loads(pickled) in set(PLANS)
    assert check_plan(pickle.loads(pickled)) is check_plan("four-fins")


def test_a_plan_is_asked_for_by_name_or_file(tmp_path: Path) -> None:
    path = tmp_path / "odd.json"
    path.write_text(ODD.to_json())
    assert check_plan(str(path)) == check_plan(ODD.to_dict()) == check_plan(ODD)
    assert check_plan(plan_document(FOUR_FINS)) is FOUR_FINS
    assert plan_document(FOUR_FINS) == "four-fins"
    assert plan_document(ODD) == ODD.to_dict()
    four = Morphology.nominal("four-fins")
    for of in ({"plan": "four-fins"}, {"morphologies": four}, {"morphologies": [four, four]}):
        log = simulate(**{"morphologies": None, "commands": np.zeros(4), "steps": 1} | of)
        assert log.rpy.shape[1:] == (1, 3)
    assert Scenario.create([four]).plan == FOUR_FINS
    assert Morphology.nominal("four-fins").plan == FOUR_FINS
    with pytest.raises(InvalidArgumentError, match="did you mean 'tail-fish'"):
        Scenario.create(plan="tail fish")
