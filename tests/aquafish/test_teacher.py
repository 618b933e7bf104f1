"""The teacher: its inputs, its file, and its gaits that the agent swims."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import aquafish_gym  # noqa: F401  registers the environments
from aquafish.online import AgentConfig, SelfModelAgent
from aquafish.online.belief import Event, Water, predicts
from aquafish.online.choosing import GaitChooser
from aquafish.online.gaits import (
    Ahead,
    ControllerGait,
    Effort,
    Gait,
    load_library,
    refine_gait,
    swim_ahead,
)
from aquafish.online.self_model import SelfModel, imu_readings, moved
from aquafish.online.teacher import Teacher, shapes_of
from aquafish.online.teacher_gait import TeacherGait, TeacherNetwork, number_scales
from aquafish_gym.morphology import Morphology
from aquafish_gym.physics.layout import layout
from aquafish_gym.plans import AQUAFISH, FOUR_FINS
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.array_types import Floats
from aquafish_gym.utils.validation import InvalidArgumentError
from gait.controllers.inputs import NetworkInputs
from gait.controllers.network import Senses

BROKEN = Scenario.create(0.5 * Morphology.nominal().to_array()[None], servo_gain=[(1.0, -0.5, 0.3)])
PREVIOUS = np.array([0.1, 0.2, -0.3])


def random_teacher(seed: int = 0) -> Teacher:
    rng = np.random.default_rng(seed)
    weights = {name: rng.normal(0.0, 0.2, shape) for name, shape in shapes_of(AQUAFISH).items()}
    return Teacher(weights, {"steps": 0, "seconds": 0.0})


def random_states(count: int) -> Floats:
    start = layout(AQUAFISH).start(np.array([[0.3, 1.0, 2.0]]))[:, 0]
    return moved(AQUAFISH, start, np.random.default_rng(1).normal(0.0, 0.5, (count, 12)))


def elu(x: Floats) -> Floats:
    return np.where(x > 0.0, x, np.expm1(np.minimum(x, 0.0)))


def written_out(teacher: Teacher, states: Floats, robot: Scenario) -> Floats:
    """Return the first actions (P, 3) by the inputs in the order that is documented."""
    inputs = NetworkInputs(Senses(fins=True), 0.7, 20, layout(AQUAFISH).angles(states).T)
    seen = inputs.observe(imu_readings(states))
    gait = load_library()[0]
    base = [
        gait.policy(fins)(imu, 0.0)
        for fins, imu in zip(layout(AQUAFISH).angles(states).T, imu_readings(states), strict=True)
    ]
    broken = [
        *(robot.body[0] / Morphology.nominal().to_array() - 1.0),
        *(robot.servo_gain[0] - 1.0),
    ]
    rows = np.tile([*PREVIOUS, *np.zeros(3), *broken], (len(seen), 1))
    rows[:, 3:6] = base
    w = teacher.weights
    hidden = elu(np.hstack([seen, rows]) @ w["w0"].T + w["b0"])
    return np.clip(elu(hidden @ w["w1"].T + w["b1"]) @ w["w2"].T + w["b2"], -1.0, 1.0)


@pytest.mark.parametrize("robot", [Scenario.create(), BROKEN], ids=["whole", "broken"])
def test_inputs_have_the_documented_order(robot: Scenario) -> None:
    teacher, states = random_teacher(), random_states(5)
    network = TeacherNetwork(teacher, np.zeros((5, 7)), robot, PREVIOUS)
    np.testing.assert_allclose(
        network.act(states).T, written_out(teacher, states, robot), atol=1e-4
    )


@pytest.mark.parametrize("turn", [0.4, -1.0])
def test_a_turned_course_is_the_world_turned_back(turn: float) -> None:
    """It does what the teacher does for a robot that heads elsewhere by the angle."""
    numbers = np.zeros((1, 7))
    numbers[0, 4] = turn / number_scales(AQUAFISH)[4]
    still = random_states(1)
    turned = still.copy()
    x, y, z, w = still[:4, 0]
    half = (np.sin(turn / 2), np.cos(turn / 2))  # a rotation about the world's z, then the state's
    turned[:4, 0] = (
        half[1] * x - half[0] * y,
        half[1] * y + half[0] * x,
        half[1] * z + half[0] * w,
        half[1] * w - half[0] * z,
    )
    aiming = TeacherNetwork(random_teacher(), numbers, BROKEN, PREVIOUS).act(still)
    plain = TeacherNetwork(random_teacher(), np.zeros((1, 7)), BROKEN, PREVIOUS).act(turned)
    np.testing.assert_allclose(aiming, plain, atol=1e-5)


def test_a_teachers_file_says_its_plan(tmp_path: Path) -> None:
    weights = {name: np.zeros(shape) for name, shape in shapes_of(FOUR_FINS).items()}
    teacher = Teacher(weights, {"steps": 0, "seconds": 0.0}, plan=FOUR_FINS)
    teacher.save(tmp_path / "teacher.json")
    assert Teacher.load(tmp_path / "teacher.json").plan is FOUR_FINS
    with pytest.raises(InvalidArgumentError, match="teachers must be of the plan aquafish"):
        SelfModelAgent(teachers=(teacher, teacher))


def test_a_file_keeps_half_precision(tmp_path: Path) -> None:
    teacher = replace(random_teacher(), curve=((1000, 2.5), (2000, 3.0)))
    teacher.save(tmp_path / "teacher.json")
    assert (tmp_path / "teacher.json").stat().st_size < 50_000
    found = Teacher.load(tmp_path / "teacher.json")
    for name, value in teacher.weights.items():
        np.testing.assert_array_equal(found.weights[name], value.astype(np.float16))
    assert (found.offline, found.curve) == (teacher.offline, teacher.curve)


@pytest.mark.parametrize(
    ("text", "other", "named"),
    [("w0", "w9", "w9"), ('"b2": "', '"b2": "AAAA', "b2"), ("offline", "spent", "offline")],
)
def test_another_file_is_refused(tmp_path: Path, text: str, other: str, named: str) -> None:
    path = tmp_path / "teacher.json"
    random_teacher().save(path)
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(x for x in lines if "checksum" not in x).replace(text, other))
    with pytest.raises(InvalidArgumentError, match=named):
        Teacher.load(path)


@pytest.mark.parametrize("load", [Teacher.load, Teacher.load_any_water])
def test_the_packaged_teachers_say_what_they_took(load: object) -> None:
    teacher = load()  # type: ignore[operator]
    assert teacher.offline["steps"] > 0
    assert teacher.offline["seconds"] > 0.0


def test_a_teachers_gait_goes_on_as_it_was_imagined() -> None:
    model = SelfModel(BROKEN, (0.3, 1.0, 2.0))
    gait = TeacherGait(random_teacher(), np.array([0.5, -1.0, 0.3, 1.0, -1.0, 0.5, 2.0]))
    others = [gait, *gait.phases()]
    far = TeacherGait.ahead(others, BROKEN, model.state, 8.0, PREVIOUS)
    agent = gait.begin(BROKEN, PREVIOUS)
    ahead = swim_ahead(agent, model, 0, 8.0)
    assert ahead.way == pytest.approx(far[0], abs=1e-3)
    assert swim_ahead(agent, model, 0, 8.0).way == ahead.way  # it forgets what it imagined
    np.testing.assert_array_equal(
        TeacherGait.ahead(others, BROKEN, model.state, 8.0, PREVIOUS), far
    )
    agent.act(BROKEN, model.state)
    assert swim_ahead(agent, model, 0, 8.0).way != ahead.way


def test_refining_a_teachers_gait_is_deterministic_and_no_worse() -> None:
    model = SelfModel(BROKEN, (0.3, 1.0, 2.0))
    first = TeacherGait.of(random_teacher())

    def refined() -> tuple[Gait, float]:
        begin = Ahead(model.state, PREVIOUS, 0.0, 8.0)
        return refine_gait(first, BROKEN, begin, Effort(1, 2, 0.4), np.random.default_rng(3))

    (one, far), (other, again) = refined(), refined()
    np.testing.assert_array_equal(one.numbers, other.numbers)
    assert far == again >= TeacherGait.ahead([first], BROKEN, model.state, 8.0, PREVIOUS)[0]


def test_the_agent_swims_a_teacher_that_swims_farthest(monkeypatch: pytest.MonkeyPatch) -> None:
    def favour(gaits: list[TeacherGait], *_: object) -> Floats:
        return 1000.0 + np.arange(len(gaits))

    monkeypatch.setattr(TeacherGait, "ahead", staticmethod(favour))
    env = gym.make("AquaFishRecovery-v0", damage="caudal:missing@11", engine="numba")
    observation, info = env.reset(seed=1)
    agent = SelfModelAgent(config=AgentConfig(refinements=0))
    agent.begin(info["fin_angles"])
    for _ in range(65):
        observation, *_, info = env.step(agent.act(observation))
    env.close()
    assert isinstance(agent.gait, TeacherGait)
    assert all("the teacher" in e.about for e in agent.events if e.what == "chose")


def test_it_chooses_again_where_it_gains_a_share_of_the_way(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    model = SelfModel(Scenario.create(), (0.3, 1.0, 2.0))
    teachers = (random_teacher(0), random_teacher(1))
    events: list[Event] = []
    chooser = GaitChooser(load_library(), teachers, AgentConfig(), 0.2, events)
    chooser.begin(model)
    far = {"units": 0.0}
    seen = list[object]()

    def imagined(gaits: list[TeacherGait], *rest: object) -> Floats:
        seen.extend([gaits[0].teacher, rest[2]])
        return np.full(len(gaits), far["units"])

    monkeypatch.setattr(TeacherGait, "ahead", staticmethod(imagined))
    nothing = staticmethod(lambda gaits, *_: np.zeros(len(gaits)))
    monkeypatch.setattr(ControllerGait, "ahead", nothing)
    swimmer = ControllerGait(load_library()[0]).begin(model.robot, np.zeros(3))
    going_on = swim_ahead(swimmer, model, 0, 10.0).way
    for step, factor, taught in ((150, 1.02, False), (151, 2.0, False), (165, 1.1, True)):
        far["units"] = factor * going_on
        chooser.choose_again(model, step)
        assert isinstance(chooser.gait, TeacherGait) == taught
    assert seen == [teachers[1], 10.0] * 2
    assert [event.what for event in events] == ["chose"]


def test_both_kinds_of_gaits_are_refined_at_first() -> None:
    model = SelfModel(BROKEN, (0.3, 1.0, 2.0))
    config = AgentConfig(
        generations=1, teacher_generations=1, quick_generations=1, quick_teacher_generations=1
    )
    events: list[Event] = []
    teachers = (random_teacher(0), random_teacher(1))
    chooser = GaitChooser(load_library(), teachers, config, 0.2, events)
    chooser.begin(model)
    chooser.change(model, 200, Water(), soon=True)
    for step in range(200, 230):
        chooser.use_refined(model, step)
    refined = [event.seconds for event in events if event.what == "refined"]
    assert refined == pytest.approx([40.0, 40.4, 41.8, 43.0])  # quick, both, and twice one
    assert {type(gait) for gait in chooser.refined} == {ControllerGait, TeacherGait}


def test_a_library_of_ones_own_has_no_teachers() -> None:
    assert SelfModelAgent(load_library()).teachers == ()
    assert len(SelfModelAgent().teachers) == 2
    with pytest.raises(InvalidArgumentError, match="teachers must be two"):
        SelfModelAgent(teachers=[random_teacher()])


def test_the_guard_compares_the_models_error_with_what_it_reads() -> None:
    readings = np.random.default_rng(0).normal(0.0, 1.0, (40, 3))
    readings[3] = np.nan
    assert predicts(np.full(3, 0.2), readings)
    assert not predicts(np.full(3, 0.4), readings)
    assert not predicts(np.full(3, 0.1), np.full((40, 3), np.nan))
