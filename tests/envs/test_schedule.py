"""Damage with a life of its own: what is broken in each step, and what a broken sensor says."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from aquafish_gym.damage import Damage
from aquafish_gym.engines.worlds import WORLDS, make_world
from aquafish_gym.envs.env import AquaFishEnv
from aquafish_gym.envs.vector import AquaFishVectorEnv
from aquafish_gym.morphology import Morphology
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.validation import InvalidArgumentError

NOMINAL = Morphology.nominal()
BROKEN = Damage.parse("left_pectoral:length=0.4;caudal:width=0.5").apply(NOMINAL)
COUNT = 3


def make(**kwargs: Any) -> AquaFishEnv:
    return AquaFishEnv(engine="numba", **kwargs)


def swim(env: AquaFishEnv, steps: int, seed: int = 0) -> list[tuple[Any, dict[str, Any]]]:
    """Reset, and swim with random actions; return observations and infos."""
    rng = np.random.default_rng(seed)
    found = [env.reset(seed=seed)]
    for _ in range(steps):
        observation, *_, info = env.step(rng.uniform(-1, 1, 3).astype(np.float32))
        found.append((observation, info))
    return found


def test_faults_begin_and_end_in_info() -> None:
    damage = "left_pectoral:missing@1+1;caudal:weak=0.5@1.5;gyro:noise=0.3@2"
    found = swim(make(damage=damage, frame_skip=25), 12)
    assert [int(info["faults"]) for _, info in found] == [0] * 4 + [1, 1, 2, 2] + [2] * 5
    for step, (_, info) in enumerate(found):
        assert (info["morphology"][:3] == 0.0).all() == (4 <= step < 8)
        assert info["servo_gain"].tolist() == [1.0, 1.0, 0.5 if step >= 6 else 1.0]
        assert info["sensor_noise"] == (0.3 if step >= 8 else 0.0)
    whole = swim(make(frame_skip=25), 12)
    same = [bool((a[0] == b[0]).all()) for a, b in zip(found, whole, strict=True)]
    assert same == [True] * 5 + [False] * 8


def path(engine: str, *bodies: Morphology) -> Any:
    """Swim with one body, and from the middle on with others, in an instant one after another."""
    rng = np.random.default_rng(0)
    commands = rng.uniform([-0.5, -0.5, 0.0], [0.5, 0.5, 1.0], (20, 3)).tolist()
    fields = {"fin_angles": (0.3, -1.0, 2.0), "current": (0.1, 0.0, 0.0)}
    world, states = make_world(engine, Scenario.create(NOMINAL, **fields)), []
    for i, (left, right, caudal) in enumerate(commands):
        for body in bodies if i == 10 else ():
            before = world.state()
            world.update(Scenario.create(body, **fields))
            for old, new in zip(before, world.state(), strict=True):
                np.testing.assert_allclose(new, old, rtol=0, atol=1e-12)
        world.advance((left, right, caudal), 5)
        state = world.state()
        states.append([*state.position, *state.orientation, *state.spin, *world.fin_angles])
    world.close()
    return np.array(states)


@pytest.mark.parametrize("engine", WORLDS)
def test_update_keeps_pose_and_velocity(engine: str) -> None:
    untouched = path(engine)
    np.testing.assert_allclose(path(engine, NOMINAL), untouched, rtol=0, atol=1e-12)
    np.testing.assert_allclose(path(engine, BROKEN, NOMINAL), untouched, rtol=0, atol=1e-12)
    other = path(engine, BROKEN)
    assert (other[:10] == untouched[:10]).all()
    assert np.abs(other[10:] - untouched[10:]).max() > 1e-3
    if engine == "pybullet":
        np.testing.assert_allclose(other, path("numba", BROKEN), rtol=0, atol=1e-9)


def test_seized_servo_keeps_its_angle() -> None:
    found = swim(make(damage="left_pectoral:seized=1.0;right_pectoral:seized@1", frame_skip=25), 8)
    angles = np.array([info["fin_angles"] for _, info in found])
    np.testing.assert_allclose(angles[:, 0], 1.0, rtol=0, atol=1e-12)
    np.testing.assert_allclose(angles[4:, 1], angles[4, 1], rtol=0, atol=1e-12)
    assert len(np.unique(angles[:5, 1].round(6))) == 5
    assert len(np.unique(angles[:, 2].round(6))) == 9


def test_dead_servo_has_a_random_angle_in_each_episode() -> None:
    env = make(damage="caudal:dead", frame_skip=100)
    phases = [{round(float(i["fin_angles"][2]), 9) for _, i in swim(env, 3, s)} for s in range(5)]
    assert [len(phase) for phase in phases] == [1] * 5
    assert len(set.union(*phases)) == 5


def test_noise_affects_only_the_gyroscope() -> None:
    truth = np.array([seen for seen, _ in swim(make(frame_skip=1), 1000)])
    env = make(damage="gyro:noise=0.1", frame_skip=1)
    said = np.array([seen for seen, _ in swim(env, 1000)])
    assert (said[:, :6] == truth[:, :6]).all()
    away = said[:, 6:] - truth[:, 6:]
    assert away.std(axis=0) == pytest.approx(0.1, rel=0.1)
    assert np.abs(away.mean(axis=0)).max() < 0.015
    assert (said == [seen for seen, _ in swim(env, 1000)]).all()


def test_each_robot_of_a_batch_may_begin_with_fin_angles_of_its_own() -> None:
    poses: list[Any] = ["zero", (0.1, 0.2, 0.3), "random"]
    envs = AquaFishVectorEnv(3, fin_angles=poses, dtype="float64")
    _, info = envs.reset(seed=4)
    np.testing.assert_allclose(info["fin_angles"][:2], [[0.0] * 3, [0.1, 0.2, 0.3]])
    _, alone = make(fin_angles="random").reset(seed=6)
    assert (alone["fin_angles"] == info["fin_angles"][2]).all()
    options = {"damage": ["caudal:missing", "none", "none"], "reset_mask": np.array([1, 0, 1]) > 0}
    _, info = envs.reset(options=options)
    assert info["faults"].tolist() == [1, 0, 0]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("damage", ["none", "caudal:missing"]),
        ("damage", []),
        ("fin_angles", np.zeros((4, 3))),
        ("morphology", [None, None]),
    ],
)
def test_list_is_one_for_each_robot(name: str, value: Any) -> None:
    wanted = f"{name} must be one for all robots or num_envs = 3 of them; got {len(value)}"
    with pytest.raises(InvalidArgumentError, match=wanted):
        AquaFishVectorEnv(3, **{name: value})
    envs = AquaFishVectorEnv(3)
    with pytest.raises(InvalidArgumentError, match=wanted):
        envs.reset(options={name: value})


@pytest.mark.parametrize("task", ["station", "waypoint"])
def test_damage_does_not_change_the_task_of_a_seed(task: str) -> None:
    """Else what damage costs would be what chance costs, too."""

    def asked(damage: str) -> Any:
        envs = AquaFishVectorEnv(COUNT, task=task, damage=damage)
        envs.reset(seed=5)
        ways = [envs.step(np.zeros((COUNT, 3), np.float32))[0][:, -3:]]
        env = make(task=task, damage=damage)
        env.reset(seed=5)
        assert env.step(np.zeros(3, np.float32))[0][-3:] == pytest.approx(ways[0][0], abs=1e-5)
        return ways

    # Of what breaks later, so that all have moved alike.
    for damage in ("random:severe@1-2", "caudal:dead@1", "caudal:missing@1-2"):
        assert (np.array(asked(damage)) == np.array(asked("none"))).all()


def test_a_list_of_faults_is_the_damage_of_every_robot() -> None:
    envs = AquaFishVectorEnv(2, damage=Damage.parse("caudal:missing;up_x:stuck").to_list())
    assert envs.reset()[1]["faults"].tolist() == [2, 2]
