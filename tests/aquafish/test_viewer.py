"""The live viewer: what it does to the physics, what it draws, and its page in a browser."""

from __future__ import annotations

import importlib.util
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from aquafish.cli import main
from aquafish.online import AgentConfig, SelfModelAgent, choosing
from aquafish.online.gaits import imagine_gaits, load_library
from aquafish.viewer.command import View
from aquafish.viewer.live import (
    BELIEF_SAMPLES,
    GAIT_HORIZON_SECONDS,
    LiveSwim,
    ViewerPilot,
    gait_pilot,
    imagine_ghost,
    part_forces,
    pilot_of,
    random_pilot,
)
from aquafish.viewer.page import FAULT_WORDS, Viewer
from aquafish.viewer.shapes import robots_in
from aquafish_gym.envs import AquaFishEnv
from aquafish_gym.morphology import Morphology
from aquafish_gym.physics.dynamics import wrench
from aquafish_gym.physics.hydrodynamics import body_drag, fin_drag
from aquafish_gym.physics.layout import FIELDS, layout, robot_of
from aquafish_gym.plans import AQUAFISH, FOUR_FINS, BodyPlan
from aquafish_gym.rendering import scene
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.validation import InvalidArgumentError
from gait.controllers.agents import ControllerAgent
from gait.swims.swim import swim as swim_alone
from tests.plans import ODD

POSITION, QUATERNION = FIELDS["position"], FIELDS["orientation"]
VISER = importlib.util.find_spec("viser") is not None
BOXES = scene.drawn_parts()[1:]
needs_viser = pytest.mark.skipif(not VISER, reason="needs the extra view")


def still(_observation: Any, _time: float) -> tuple[float, float, float]:
    return (0.0, 0.0, -1.0)


def gait_swim(count: int = 1, **options: Any) -> LiveSwim:
    return LiveSwim(gait_pilot(load_library()[0]), count, **options)


def test_a_strike_in_mid_swim_equals_damage_with_that_onset() -> None:
    live, gait = gait_swim(), load_library()[0]
    damage = "caudal:missing@4; left_pectoral:weak=0.5@4+2"
    env = AquaFishEnv(
        damage=damage, engine="numba", fin_angles=layout(AQUAFISH).angles(live.states)[:, 0]
    )
    observation, info = env.reset(seed=0)
    agent = ControllerAgent(gait)
    agent.reset({"fin_angles": info["fin_angles"][None]})
    for k in range(50):
        if k == 20:
            live.strike("caudal:missing; left_pectoral:weak=0.5@0+2")
        live.advance(4)
        observation, _, _, _, info = env.step(agent.act(observation[None])[0])
        place = [info[f"{axis}_position"] for axis in "xyz"]
        np.testing.assert_allclose(live.states[POSITION, 0], place, atol=1e-9)
        np.testing.assert_array_equal(live.observed[0], observation)
    assert live.robots.servo_gain[0, 0] == 1.0
    assert live.broken(0) == ("caudal",)
    env.close()


def test_damage_of_one_robot_leaves_the_others_and_can_be_repaired() -> None:
    live, twin = gait_swim(4), gait_swim(4)
    for one in (live, twin):
        one.advance(20)
    before = live.states.copy()
    live.strike("right_pectoral:length=0.5", [2])
    np.testing.assert_array_equal(live.states, before)
    for one in (live, twin):
        one.advance(20)
    differs = np.abs(live.states - twin.states).max(axis=0) > 1e-6
    assert differs.tolist() == [False, False, True, False]
    assert [live.broken(i) for i in range(4)] == [(), (), ("right_pectoral",), ()]
    live.repair([2])
    live.advance()
    np.testing.assert_array_equal(live.robots.body, twin.robots.body)


def test_sizes_and_current_act_in_mid_swim() -> None:
    live = LiveSwim(pilot_of(still), 2)
    live.advance(10)
    sizes = Morphology.nominal().to_array()
    sizes[7] = 0.5
    live.strike("caudal:length=0.5", [1])
    live.set_sizes(sizes)
    live.set_current((0.0, 2.0, 0.0))
    live.advance(100)
    assert live.robots.body[:, 7].tolist() == [0.5, 0.25]
    assert (live.states[POSITION][1] > 2.0).all()
    assert live.seconds == pytest.approx(5.5)


@pytest.mark.parametrize("damage", ["caudal:length=9", "caudal:seized=0.5", "tail"])
def test_damage_that_does_not_fit_changes_nothing(damage: str) -> None:
    live = gait_swim(2)
    live.advance()
    with pytest.raises(InvalidArgumentError):
        live.strike(damage)
    assert live.faults(0) == live.faults(1) == ()


def test_start_again_restores_the_damage_of_the_start() -> None:
    live = gait_swim(2, damage="caudal:dead; gyro:noise=0.1; up_x:dropped@1")
    live.strike("random:severe")
    live.advance(30)
    assert (live.observed[:, 0] == 0).all()
    live.reset()
    assert live.seconds == 0
    assert [str(fault) for fault in live.faults(0)] == ["caudal:dead", "gyro:noise=0.1"]
    assert np.isfinite(live.states).all()


def test_the_forces_are_those_of_the_drag_law() -> None:
    """Each fin's by the law in its own frame, turned by the pose that is drawn."""
    live = LiveSwim(random_pilot(0))
    live.strike("left_pectoral:length=0.5")
    live.set_current((0.5, -0.3, 0.2))
    live.advance(50)
    state = live.states[:, 0]
    found = part_forces(live.robots, state)
    robot = robot_of(layout(AQUAFISH).robots(live.robots.body)[:, 0].tolist())
    now, current = layout(AQUAFISH).state(state), live.robots.current[0]
    np.testing.assert_allclose(found.sum(axis=0), wrench(AQUAFISH, robot, now, tuple(current))[0])

    body = Rotation.from_quat(state[QUATERNION])
    flow = body.inv().apply(np.array(now.velocity) - current)
    force = body_drag(AQUAFISH, tuple(flow), now.spin)[0]
    np.testing.assert_allclose(found[3], body.apply(force), atol=1e-12)
    poses = robots_in(AQUAFISH, live.states, live.robots.body).poses[0, scene.fin_parts()]
    hinges = [(-0.75, 1.0, 0.0), (0.75, 1.0, 0.0), (0.0, -2.0, 0.0)]
    to_part = Rotation.from_matrix([np.eye(3), np.eye(3), [[0, 0, -1], [0, 1, 0], [1, 0, 0]]])
    for k, (place, hinge) in enumerate(zip(poses, hinges, strict=True)):
        fin = Rotation.from_quat(place[3:]) * to_part[k]  # axes width, length, normal
        velocity = body.apply(flow + np.cross(now.spin, hinge))
        joint = fin.apply((now.rates[k], 0.0, 0.0))
        spin = fin.inv().apply(body.apply(now.spin) + joint)
        force = fin_drag(robot.fins[k], tuple(fin.inv().apply(velocity)), tuple(spin))[0]
        np.testing.assert_allclose(found[k], fin.apply(force), atol=1e-9)


def test_the_ghost_is_the_self_model_with_its_uncertainty() -> None:
    config = AgentConfig(GAIT_HORIZON_SECONDS, gyro_noise=0.02, gyro_only=True, refinements=0)
    agent = SelfModelAgent(config=config, teachers=())
    live = LiveSwim(ViewerPilot(agent, agent.hold), gyro_noise=0.02, seed=1)
    live.advance(402)
    bodies, states = imagine_ghost(agent, live.actions, live.held)
    assert bodies.shape == (1 + BELIEF_SAMPLES, 9)
    np.testing.assert_allclose(
        layout(AQUAFISH).angles(states)[:, 0], layout(AQUAFISH).angles(live.states)[:, 0], atol=0.1
    )
    spread = np.std(states[QUATERNION, 1:], axis=1).max()
    assert 1e-4 < spread < 0.2
    live.strike("left_pectoral:missing")
    for _ in range(1000):
        live.advance()
        if agent.recognised is not None:
            break
    assert agent.recognised is not None
    weights = [one.weight for one in agent.recognised.alternatives]
    assert sum(weights) == pytest.approx(1.0)
    assert weights == sorted(weights, reverse=True)
    bodies, states = imagine_ghost(agent, live.actions, live.held)
    sampled = {body.tobytes() for body in bodies[1:]}
    assert sampled <= {one.robot.body[0].tobytes() for one in agent.recognised.alternatives}


def test_the_self_model_chooses_gaits_for_20_s_however_long_it_swims(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    compared: list[float] = []

    def compare(gaits: Any, robot: Any, state: Any, seconds: float, previous: Any) -> Any:
        compared.append(seconds)
        return imagine_gaits(gaits, robot, state, seconds, previous)

    monkeypatch.setattr(choosing, "imagine_gaits", compare)
    quick = AgentConfig(GAIT_HORIZON_SECONDS, quick_generations=1, generations=1, refinements=1)
    agent = SelfModelAgent(config=quick, teachers=())
    live = LiveSwim(ViewerPilot(agent, agent.hold))
    live.advance(500)
    live.strike("caudal:missing")
    live.advance(40)
    late = [event.what for event in agent.events if event.seconds > 25]
    assert {"inferred", "chose", "refined"} <= set(late)
    live.reset()
    live.advance(201)
    assert compared == pytest.approx(
        [GAIT_HORIZON_SECONDS] * 3
    )  # at 10 s, at the strike, and at 10 s again


class Seen:
    """What predicts, as a model of stable-baselines3."""

    def predict(self, observation: Any, *_: Any, **__: Any) -> tuple[Any, None]:
        return observation[:, :3], None


@pytest.mark.parametrize("steers", [lambda observations: observations[:, :3], Seen()])
def test_what_acts_in_an_environment_steers_as_well(steers: Any) -> None:
    pilot = pilot_of(steers)
    live = LiveSwim(pilot, 2)
    assert pilot.interval == 20
    expected = np.clip(live.observed[:, :3], -1.0, 1.0)
    live.advance()
    np.testing.assert_array_equal(live.actions, expected)


@pytest.mark.parametrize("action", [(np.nan, 0.0, 0.0), (0.0, 0.0), (0.0,) * 4])
def test_a_policy_that_returns_no_action_is_refused(action: Any) -> None:
    live = LiveSwim(pilot_of(lambda _observation, _time: action))
    with pytest.raises(InvalidArgumentError, match="actions must"):
        live.advance()


def test_a_policy_swims_as_it_does_alone() -> None:
    def policy(_observation: Any, time: float) -> tuple[float, float, float]:
        return (np.sin(time), 0.5, 1.0)

    live = LiveSwim(pilot_of(policy))
    start = layout(AQUAFISH).angles(live.states)[:, 0]
    alone = swim_alone(
        policy, Scenario.create().body[0], engine="numba", seconds=2, fin_angles=start
    )
    live.advance(40)
    np.testing.assert_allclose(live.states[POSITION, 0], alone.position[-1], atol=1e-9)


def test_without_viser_the_extra_is_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "viser", None)
    assert main(["view"]) == 2
    assert 'pip install "aquafish-gym[view]"' in capsys.readouterr().err


@contextmanager
def view_of(robots: int) -> Iterator[Viewer]:
    if not VISER:
        pytest.skip("needs the extra view")
    pilots = View(robots=robots).pilots()
    with closing(Viewer(LiveSwim(pilots["gait"], robots), pilots, 8320)) as view:
        view.update()
        yield view


@pytest.fixture
def viewer() -> Iterator[Viewer]:
    with view_of(1) as view:
        yield view


def test_the_self_model_steers_first_if_an_option_is_of_it_alone() -> None:
    assert next(iter(View().pilots())) == "gait"
    assert next(iter(View(gyro_only=True).pilots())) == "self-model"


def press(button: Any) -> None:
    button.value = True


def test_the_page_is_served_to_this_machine_alone(viewer: Viewer) -> None:
    assert viewer.server.get_host() == "127.0.0.1"
    assert viewer.url.startswith("http://127.0.0.1:")


def test_controls_break_and_change_the_swim(viewer: Viewer) -> None:
    live = viewer.swim
    viewer.fin.value, viewer.fault.value, viewer.amount.value = "caudal", "length", 0.25
    press(viewer.break_it)
    viewer.update()
    assert live.robots.body[0, 7] == pytest.approx(0.35)
    box = BOXES.index("caudal")
    assert viewer.robots.boxes.batched_scales[box, 1] == pytest.approx(0.35)
    assert tuple(viewer.robots.boxes.batched_colors[box]) == scene.BROKEN_FIN
    viewer.text.value = "left_pectoral:missing; gyro:noise=0.1"
    press(viewer.break_text)
    viewer.sizes[7].value = 6.0
    viewer.current[1].value = 10.0
    viewer.update()
    assert live.robots.body[0, [1, 7]] == pytest.approx([0.0, 0.3])
    assert live.robots.current[0].tolist() == [0.0, 2.0, 0.0]
    viewer._updates = 0
    viewer.draw()
    assert "left_pectoral:missing" in viewer.damage.content
    viewer.text.value = "left_pectoral:mising"
    press(viewer.break_text)
    viewer._updates = 0
    viewer.update()
    assert "did you mean" in viewer.damage.content
    viewer.fault.value, viewer.amount.value = "hold", 0.0
    press(viewer.break_it)
    viewer._updates = 0
    viewer.update()
    assert "must lie in [0.001, 100] s; got 0" in viewer.damage.content
    viewer.amount.value = 0.25
    press(viewer.repair)
    viewer.update()
    assert live.broken(0) == ()
    for fault in FAULT_WORDS:
        viewer.fault.value = fault
        press(viewer.break_it)
        viewer.update()
    assert [fault.word for fault in live.faults(0)] == FAULT_WORDS


@needs_viser
@pytest.mark.parametrize("plan", [FOUR_FINS, pytest.param(ODD, marks=pytest.mark.slow)])
def test_a_fish_in_a_file_is_watched_and_broken(plan: BodyPlan, tmp_path: Path) -> None:
    """Also one that no gaits are packaged for: its servos run at full speed."""
    path = tmp_path / "own.json"
    path.write_text(plan.to_json())
    view = View(plan=str(path))
    pilots = view.pilots()
    assert list(pilots) == ["gait", "random", "self-model"]
    live = LiveSwim(pilots["gait"], plan=view.plan)
    fin = plan.names[1]
    with closing(Viewer(live, pilots, 8330)) as viewer:
        assert viewer.fin.options == plan.names
        assert len(viewer.sizes) == len(plan.dimensions)
        viewer.fin.value, viewer.fault.value = fin, "missing"
        press(viewer.break_it)
        viewer.text.value = f"{plan.names[0]}:weak=0.5; random:severe"
        press(viewer.break_text)
        for _ in range(8):
            viewer.update()
        assert viewer.damage.content.startswith(f"broken: `{fin}:missing;{plan.names[0]}:weak=0.5")
        assert all(f"{one.word} " in viewer.reading.content for one in plan.fins)
        first = 3 * plan.names.index(fin)
        assert live.robots.body[0, first : first + 3].tolist() == [0.0] * 3
        forces = part_forces(live.robots, live.states[:, 0])
        assert forces.shape == (len(plan.fins) + 1, 3)
        assert not forces[1].any()
        if plan == ODD:  # the self-model's kernels take long to compile
            assert (live.actions == 1.0).all()
            viewer.pilot.value = "self-model"
            for _ in range(8):
                viewer.update()
            assert viewer.ghost.boxes.visible


def test_play_pause_speed_and_start_again(viewer: Viewer) -> None:
    live = viewer.swim
    viewer.play.value = False
    seconds = live.seconds
    viewer.update()
    assert live.seconds == seconds
    viewer.play.value, viewer.speed.value = True, 2.5
    for _ in range(4):
        viewer.update()
    assert live.seconds == pytest.approx(seconds + 0.5)
    press(viewer.restart)
    viewer.play.value = False
    viewer.update()
    assert live.seconds == 0
    for name in ("random", "self-model"):
        viewer.play.value, viewer.pilot.value = True, name
        viewer.update()
        assert live.pilot is viewer._pilots[name]
    assert viewer.ghost.boxes.visible
    assert not np.allclose(viewer.ghost.boxes.batched_positions[0], 0)
    viewer.show_ghost.value = viewer.show_forces.value = viewer.show_trail.value = False
    viewer.update()
    for handle in (viewer.ghost.boxes, viewer.samples.capsules, viewer.arrows, viewer.trail):
        assert not handle.visible


def test_parts_and_forces_are_drawn_where_the_scene_has_them() -> None:
    with view_of(64) as batch:
        batch.number.value, batch.everyone.value = 3, False
        batch.text.value = "caudal:missing"
        press(batch.break_text)
        for _ in range(20):
            batch.update()
        live = batch.swim
        states = live.states.copy()
        states[POSITION] += batch._starts
        broken = [[fin in live.broken(i) for fin in AQUAFISH.names] for i in range(64)]
        wanted = robots_in(AQUAFISH, states, live.robots.body, broken).poses[:, 1:].reshape(-1, 7)
        boxes = batch.robots.boxes
        np.testing.assert_allclose(boxes.batched_positions, wanted[:, :3], atol=1e-5)
        np.testing.assert_allclose(
            np.roll(boxes.batched_wxyzs, -1, axis=1), wanted[:, 3:], atol=1e-5
        )
        arrows = np.diff(batch.arrows.points, axis=1)[:, 0]
        np.testing.assert_allclose(
            arrows, part_forces(live.robots.take(2), live.states[:, 2]), atol=2e-3
        )
        tail = batch.robots.boxes.batched_scales[2 * len(BOXES) + BOXES.index("caudal")]
        assert tail.max() < 1e-3


@needs_viser
@pytest.mark.parametrize(
    "number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.slow)]
)
def test_ctrl_c_and_sigterm_end_the_command(number: signal.Signals) -> None:
    words = [sys.executable, "-m", "aquafish", "view", "--port", "8340"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline().startswith("http://127.0.0.1:")
        process.send_signal(number)
        assert process.wait(60) == 0
