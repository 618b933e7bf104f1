"""The page's program does in node what the library does: physics, gaits, words, recognition."""

from __future__ import annotations

import functools
import json
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from aquafish.online import AgentConfig, SelfModelAgent
from aquafish.online.gaits import imagine, load_library
from aquafish.online.hypotheses import FIRST_NUMBERS, NUMBERED
from aquafish.online.self_model import error_size, moved, state_errors
from aquafish.page.facts import GAIT_SENSES, GYRO_NOISE, effects
from aquafish.page.program import move, place_fish, program, state_error
from aquafish.viewer.live import GAIT_HORIZON_SECONDS
from aquafish_gym.damage import Damage, Fault
from aquafish_gym.morphology import Morphology
from aquafish_gym.physics.law import law
from aquafish_gym.physics.layout import layout, state_numbers, state_of
from aquafish_gym.plans import AQUAFISH, FOUR_FINS, TAIL_FISH, BodyPlan, check_plan
from aquafish_gym.rendering.scene import PART_NUMBERS, drawn_parts, place_robots
from aquafish_gym.scenario import Scenario
from gait.controllers.controller import Controller
from gait.search.templates import Template
from tests.plans import EACH_PLAN, ODD, PLANS

EPISODES = Path(__file__).with_name("page_episodes.js")
ONSET_SECONDS = 20.0
SECONDS = 60.0
INTERVAL = 0.2  # s, of an action
IN_A_ROW = (
    Fault("left_pectoral", "length", 0.5),
    Fault("caudal", "missing"),
    Fault("right_pectoral", "seized"),
    Fault("left_pectoral", "reversed"),
    Fault("right_pectoral", "weak", 0.4),
)


@functools.cache
def some_gaits(plan: BodyPlan) -> list[Controller]:
    """Return the packaged gaits of AquaFish, or two random ones of another plan."""
    if plan == AQUAFISH:
        return load_library()
    template = Template.of_class("recurrent", GAIT_SENSES, 4, plan=plan)
    vectors = 0.7 * np.random.default_rng(0).standard_normal((2, template.size))
    return [
        replace(template.controller(one, 0.7, Morphology.nominal(plan), 0), interval=20)
        for one in vectors
    ]


@functools.cache
def program_of(plan: BodyPlan, seconds: float, reactive: bool) -> str:
    return program(some_gaits(plan), seconds, reactive)


def run_node(
    code: str,
    given: object,
    seconds: float = GAIT_HORIZON_SECONDS,
    plan: BodyPlan = AQUAFISH,
    reactive: bool = False,
) -> Any:
    """Return what a program prints that follows the page's, which looks so far ahead, as JSON."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("there is no JavaScript engine, node")
    text = f"{program_of(plan, seconds, reactive)}\n{code}"
    done = subprocess.run(
        [node, "-"], input=text, env={"GIVEN": json.dumps(given)}, capture_output=True, text=True
    )
    assert not done.stderr, done.stderr[-2000:]
    return json.loads(done.stdout)


def swim_episodes(episodes: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return what the page's agent did in episodes."""
    return list(run_node(EPISODES.read_text(), episodes))


def random_state(rng: np.random.Generator, plan: BodyPlan) -> np.ndarray[Any, Any]:
    """Return a state (R,) in motion."""
    state = layout(plan).start(rng.uniform(-3, 3, (1, len(plan.fins))))[:, 0]
    state[:4] = rng.standard_normal(4)
    state[:4] /= np.linalg.norm(state[:4])
    state[4:13] = rng.standard_normal(9)
    return state


def random_faults(count: int, seed: int = 38) -> list[Fault]:
    """Return single faults of fins that the agent has words for."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(count):
        word = list(FIRST_NUMBERS)[rng.integers(len(FIRST_NUMBERS))]
        number = round(float(rng.uniform(0.1, 0.9)), 3) if word in NUMBERED else None
        found.append(Fault(AQUAFISH.names[rng.integers(len(AQUAFISH.names))], word, number))
    return found


def as_facts(fault: Fault) -> list[dict[str, Any]]:
    """Return a fault as ``page_episodes.js`` reads it."""
    return [{"fin": fault.part, "word": fault.word, "number": fault.number or 0.0}]


def episode(
    number: int, breaks: list[tuple[Fault | None, float]], seconds: float = SECONDS
) -> dict[str, Any]:
    """Return an episode in which a fin breaks, or all are mended, at some times, s."""
    return {
        "finAngles": np.random.default_rng(number).uniform(-np.pi, np.pi, 3).tolist(),
        "breaks": [
            {"faults": as_facts(fault) if fault else [], "at": round(at / INTERVAL)}
            for fault, at in breaks
        ],
        "actions": round(seconds / INTERVAL),
        "seed": number,
    }


@pytest.mark.parametrize("word", FIRST_NUMBERS)
@pytest.mark.parametrize(
    ("plan", "fin"), [(check_plan(plan), fin) for plan in PLANS for fin in plan.names], ids=str
)
def test_a_word_does_to_a_robot_what_the_grammar_says(plan: BodyPlan, fin: str, word: str) -> None:
    number = 0.37 if word in NUMBERED else None
    robot = Damage((Fault(fin, word, number),)).edit(Scenario.create(plan=plan))
    values = np.concatenate([plan.nominal, np.ones(len(plan.fins))])
    for i, a, b, c, d in effects(plan, fin, word):
        x = number or 0.0
        values[int(i)] = a + b * x + (c + d * x) * values[int(i)]
    np.testing.assert_allclose(values, np.concatenate([robot.body[0], robot.servo_gain[0]]))


@pytest.mark.parametrize("plan", EACH_PLAN)
def test_the_filter_moves_states_as_the_library_does(plan: BodyPlan) -> None:
    rng = np.random.default_rng(0)
    size, rows = error_size(plan), layout(plan).state_numbers
    for _ in range(20):
        state = random_state(rng, plan)
        error = 0.1 * rng.standard_normal(size)
        found = [0.0] * rows
        move(state[:rows].tolist(), error.tolist(), found)
        wanted = moved(plan, state, error[None])[:, 0]
        np.testing.assert_allclose(found, wanted[:rows], atol=1e-12)
        back = [0.0] * size
        state_error(found, state[:rows].tolist(), back)
        np.testing.assert_allclose(back, state_errors(plan, wanted[:, None], state)[0], atol=1e-12)


@pytest.mark.parametrize("plan", EACH_PLAN)
def test_a_fish_is_placed_as_everywhere_else(plan: BodyPlan) -> None:
    rng = np.random.default_rng(1)
    body = rng.uniform(0.1, 0.5, len(plan.dimensions))
    state = random_state(rng, plan)
    count = len(drawn_parts(plan))
    parts = [0.0] * (count * PART_NUMBERS)
    broken = [float(i == 1) for i in range(len(plan.fins))]
    rows = layout(plan).state_numbers
    place_fish(plan, body.tolist(), broken, state[:rows].tolist(), parts)
    wanted = place_robots(
        body[None],
        [np.array(broken) > 0],
        np.zeros((1, 3)),
        [[0.0, 0.0, 0.0, 1.0]],
        layout(plan).angles(state)[None],
        plan,
    )
    table = np.reshape(parts, (count, PART_NUMBERS))
    np.testing.assert_allclose(table[:, :7], wanted.poses[0], atol=1e-12)
    np.testing.assert_allclose(table[:, 7:10], wanted.sizes[0], atol=1e-12)
    np.testing.assert_allclose(table[:, 10:], wanted.colours[0] / 255, atol=1e-12)


@pytest.mark.parametrize(
    ("plan", "reactive"),
    [
        (AQUAFISH, False),
        pytest.param(FOUR_FINS, False, marks=pytest.mark.slow),
        pytest.param(TAIL_FISH, True, marks=pytest.mark.slow),
        pytest.param(ODD, False, marks=pytest.mark.slow),
    ],
)
def test_gaits_swim_as_far_as_in_the_library(plan: BodyPlan, reactive: bool) -> None:
    fault = Fault(plan.names[0], "length", 0.5)
    angles = (0.5, -1.0, 2.0, 0.3, -0.7)[: len(plan.fins)]
    given = {"angles": angles, "faults": as_facts(fault)}
    far = run_node(
        "const { angles, faults } = JSON.parse(process.env.GIVEN);"
        "const swum = imagine(broken(WHOLE, faults), atRest(angles), begin(0), [0, 0, 0]);"
        "process.stdout.write(JSON.stringify(swum));",
        given,
        5.0,
        plan,
        reactive,
    )
    robot = Damage((fault,)).edit(Scenario.create(plan=plan, reactive=reactive))
    state = layout(plan).start(np.array([angles]))[:, 0]
    wanted = imagine(some_gaits(plan), robot, state, 5.0)  # in float32
    np.testing.assert_allclose(far, [*wanted, wanted[0]], atol=0.005)


@pytest.mark.parametrize(("plan", "reactive"), [(FOUR_FINS, False), (TAIL_FISH, True), (ODD, True)])
def test_the_page_of_another_fish_swims_as_the_law_says(plan: BodyPlan, reactive: bool) -> None:
    rng = np.random.default_rng(3)
    state = random_state(rng, plan)[: layout(plan).state_numbers]
    command = rng.uniform(plan.command_low, plan.command_high).tolist()
    current = (0.1, -0.2, 0.05)
    found = run_node(
        "const { state, current, command } = JSON.parse(process.env.GIVEN);"
        "const now = Float64Array.from(state);"
        "for (let i = 0; i < 50; i += 1) step(now, WHOLE.rows, current, command);"
        "process.stdout.write(JSON.stringify(Array.from(now)));",
        {"state": state.tolist(), "current": current, "command": command},
        plan=plan,
        reactive=reactive,
    )
    of = law(plan)
    robot = tuple(layout(plan).robots(plan.nominal[None])[:, 0].tolist())
    by = of.driven((1.0,) * len(plan.fins), tuple(command), 0.01)
    now = state_of(state.tolist())
    for _ in range(50):
        now = (of.step_reactive if reactive else of.step)(robot, now, by, current, 0.01)
    np.testing.assert_allclose(found, state_numbers(now), atol=1e-12)


def test_fins_that_break_and_mend_in_a_row_are_named() -> None:
    breaks: list[tuple[Fault | None, float]] = []
    for i, fault in enumerate(IN_A_ROW):
        breaks += [(fault, 5.0 + 4.0 * i), (None, 7.0 + 4.0 * i)]
    (found,) = swim_episodes([episode(0, breaks, 27.0)])
    assert [one["truth"] for one in found["happened"] if one["knew"] is None] == []
    assert all(one["knew"] < 2.0 for one in found["happened"])


@pytest.mark.slow
def test_the_agent_is_as_good_as_the_librarys_without_refinement() -> None:
    """Of 100 single faults it names 95, and it swims as far within 5%."""
    faults = random_faults(100)
    episodes = [episode(i, [(fault, ONSET_SECONDS)]) for i, fault in enumerate(faults)]
    found = [one["happened"][0] for one in swim_episodes(episodes)]
    right = sum(one["words"] == one["truth"] for one in found)
    ways = [way_of_self_model(*pair) for pair in zip(faults, episodes, strict=True)]
    ratio = np.mean([one["way"] for one in found]) / np.mean(ways)
    knew = np.median([np.inf if one["knew"] is None else one["knew"] for one in found])
    print(f"right words {right}, way {ratio:.3f} of the library's, words after {knew:.1f} s")
    assert right >= 95
    assert ratio >= 0.95
    assert knew <= 2.0


def way_of_self_model(fault: Fault, one: dict[str, Any]) -> float:
    """Return how far ``SelfModelAgent`` swims after a fault, units, without refining its gaits."""
    damage = f"gyro:noise={GYRO_NOISE}; {Damage((fault,))}@{ONSET_SECONDS}"
    env = gym.make("AquaFishRecovery-v0", damage=damage, engine="numba")
    observation, info = env.reset(seed=one["seed"], options={"fin_angles": one["finAngles"]})
    agent = SelfModelAgent(config=AgentConfig(gyro_noise=GYRO_NOISE, refinements=0), teachers=())
    agent.begin(info["fin_angles"])
    way = [0.0]
    for _ in range(one["actions"]):
        observation, _, _, _, info = env.step(agent.act(observation))
        way.append(float(info["y_position"]))
    return way[-1] - way[round(ONSET_SECONDS / INTERVAL)]
