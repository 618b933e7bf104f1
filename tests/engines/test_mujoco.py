"""The engine "mujoco": our robot and the motion of its joints, MuJoCo's mechanics and water."""

from __future__ import annotations

import math
import pickle
import sys
from collections.abc import Callable
from itertools import pairwise

import gymnasium as gym
import numpy as np
import pytest

from aquafish_gym import ImuLog, simulate
from aquafish_gym.engines.base import TIMESTEP
from aquafish_gym.engines.packages import check_engine, resolve_engine
from aquafish_gym.engines.worlds import make_world
from aquafish_gym.morphology import MAXIMA, Morphology
from aquafish_gym.physics.kinematics import SWEEP, rotation
from aquafish_gym.physics.layout import start_rows
from aquafish_gym.utils.validation import EngineUnavailableError, InvalidArgumentError
from eea.fish.target import EngineTarget
from gait import swim
from gait.transfer import TransferConfig, transfer
from tests.verification.convergence import attitude_gap
from tests.verification.harness import POSITION, QUATERNION, march
from tests.verification.mechanics import extrapolate
from tests.verification.trials import random_trials

mujoco = pytest.importorskip("mujoco")

from aquafish_gym.engines.mujoco.robot import mujoco_model  # noqa: E402
from aquafish_gym.engines.mujoco.world import MujocoWorld  # noqa: E402

TRIALS = random_trials(6, seed=1)
NOMINAL = Morphology.nominal().to_array()
STILL = (0.0, 0.0, 0.0)


def there(bodies: object = None, commands: object = STILL, angles: object = STILL,
          steps: int = 100, **settings: object) -> ImuLog:  # fmt: skip
    return simulate(bodies, commands, angles, steps, engine="mujoco", record="pose", **settings)  # type: ignore[arg-type]


def dry_end(trial: int, seconds: float, substeps: int) -> tuple[np.ndarray, np.ndarray]:
    """Return where a trial's robot ends without water, and how it lies there."""
    world = MujocoWorld(substeps=substeps)
    world.reset(TRIALS.morphologies[trial], tuple(TRIALS.fin_angles[trial]), STILL)
    world.model.opt.density = world.model.opt.viscosity = 0.0
    world.advance(tuple(TRIALS.commands[trial]), round(seconds / TIMESTEP))
    return np.array(world.state().position), np.array(world.state().orientation)


def test_the_joints_turn_as_they_are_told() -> None:
    """Also fins of no mass, and after the jump to speed at the start, and in a strong current."""
    bodies = [NOMINAL, MAXIMA, np.zeros(9), [1, 2, 0, 0, 2, 0.5, 0.5, 2, 0]]
    command, angles = np.array((0.5, -0.5, 1.0)), np.array((3.0, -2.0, 1.0))
    for body in bodies:
        world = MujocoWorld()
        world.reset(np.array(body), tuple(angles), (0.0, -20.0, 0.0))
        for step in range(1, 101):
            world.advance(tuple(command))
            left, right, phase = angles + 2 * math.pi * command * step * TIMESTEP
            wanted = (left, right, SWEEP * math.sin(phase))
            np.testing.assert_allclose(world.data.qpos[7:], wanted, atol=1e-5)


def test_its_joints_are_the_other_engines() -> None:
    settings = {"servo_gain": (0.9, 1.0, 1.1), "lag": 0.033}
    log = there(TRIALS.morphologies, TRIALS.commands, TRIALS.fin_angles, **settings)
    ours = simulate(TRIALS.morphologies, TRIALS.commands, TRIALS.fin_angles, 100,
                    dtype="float64", record="pose", **settings)  # fmt: skip
    assert log.fin_angles is not None
    assert ours.fin_angles is not None
    np.testing.assert_allclose(np.cos(log.fin_angles - ours.fin_angles), 1.0, atol=1e-12)


def test_without_water_it_moves_as_our_robot_without_water() -> None:
    """Both schemes tend to one motion as their steps shrink, and MuJoCo's does so with order one.

    That motion is the oracle's: tests/physics/test_oracles.py holds ours to it.
    """
    seconds = 1.0
    for b in range(3):
        body, command = TRIALS.morphologies[b : b + 1], TRIALS.commands[b : b + 1]
        rows = start_rows(TRIALS.fin_angles[b : b + 1])
        steps = (0.002, 0.001, 0.0005)
        ours = [
            march("float64", body, rows, command, h, round(seconds / h), wet=False)[:, 0]
            for h in steps
        ]
        limit = extrapolate(*ours)
        turned = limit[QUATERNION] / np.linalg.norm(limit[QUATERNION])
        ends = [dry_end(b, seconds, substeps) for substeps in (1, 2, 4)]
        gaps = [float(attitude_gap(q, turned)) for _, q in ends]
        assert gaps[0] < 0.01
        for coarse, fine in pairwise(gaps):
            assert 1.8 < coarse / fine < 2.2
        position, quaternion = (extrapolate(*(end[i] for end in ends)) for i in (0, 1))
        np.testing.assert_allclose(position, limit[POSITION], atol=1e-5)
        np.testing.assert_allclose(np.abs(quaternion @ turned), 1.0, atol=1e-8)


def test_still_water_and_still_servos_move_nothing() -> None:
    log = there(TRIALS.morphologies, angles=TRIALS.fin_angles)
    assert log.position is not None
    assert log.gyro is not None
    assert abs(log.position).max() < 1e-12
    assert abs(log.gyro).max() < 1e-12


def test_a_current_is_a_change_of_frame() -> None:
    """It carries the robot along, and one that drifts with it feels still water."""
    current = np.array((0.15, -0.1, 0.05))
    world, still = MujocoWorld(), MujocoWorld()
    for one, water in ((world, tuple(current)), (still, STILL)):
        one.reset(TRIALS.morphologies[0], tuple(TRIALS.fin_angles[0]), water)
    world.data.qvel[:3] = current
    for one in (world, still):
        one.advance(tuple(TRIALS.commands[0]), 200)
    drifted = np.array(world.state().position) - 2.0 * current
    np.testing.assert_allclose(drifted, still.state().position, atol=1e-9)
    log = there(NOMINAL, current=current, steps=3000)
    assert log.position is not None
    speed = (log.position[0, -1] - log.position[0, -101]) / 1.0
    np.testing.assert_allclose(speed, current, atol=0.05)


def test_a_fin_without_a_face_meets_no_water() -> None:
    """Its hinge and its trace of mass stay, and the other fins act as before."""
    for missing in (np.zeros(9), np.array([0, 2.0, 0, 1.0, 0, 0, 0, 0, 1.0])):
        log = there(missing, (0.5, -0.5, 1.0), steps=200)
        assert log.position is not None
        assert abs(log.position).max() < 1e-4
        assert abs(log.gyro).max() < 1e-4  # type: ignore[arg-type]
    flat = NOMINAL.copy()
    flat[2] = 0.0  # a plate of no thickness is pushed as a thin one is
    thin = NOMINAL.copy()
    thin[2] = 0.001
    one, other = (there(b, (0.5, 0.0, 0.0), steps=200).gyro for b in (flat, thin))
    assert one is not None
    assert other is not None
    assert np.sqrt(np.mean(one**2)) > 0.05
    np.testing.assert_allclose(one, other, atol=0.005)


def test_the_same_bytes_twice_whatever_the_batch() -> None:
    arguments = (TRIALS.morphologies, TRIALS.commands, TRIALS.fin_angles)
    log, again = there(*arguments, steps=40), there(*arguments, steps=40)
    backwards = there(*(a[::-1] for a in arguments), steps=40)
    for name in ("rpy", "gyro", "position", "quaternion", "fin_angles"):
        one = getattr(log, name)
        assert one.tobytes() == getattr(again, name).tobytes()
        assert one.tobytes() == np.ascontiguousarray(getattr(backwards, name)[::-1]).tobytes()


def test_the_log_is_of_one_motion() -> None:
    """Gyro in body axes, attitude and quaternion tell the same; roll, pitch and yaw go on."""
    log = there(TRIALS.morphologies, TRIALS.commands, TRIALS.fin_angles, steps=256)
    assert log.quaternion is not None
    assert log.rpy is not None
    assert log.gyro is not None
    assert abs(np.diff(log.rpy, axis=1)).max() < 0.5
    turns = np.array([[rotation(tuple(q)) for q in path] for path in log.quaternion.tolist()])
    np.testing.assert_allclose(np.sin(log.rpy[..., 1]), turns[..., 2, 1], atol=1e-12)
    # R(t)' R(t + h) is a turn by h times the spin.
    small = np.einsum("btji,btjk->btik", turns[:, :-1], turns[:, 1:])
    spin = np.stack([small[..., 2, 1], small[..., 0, 2], small[..., 1, 0]], axis=-1) / TIMESTEP
    mean = (log.gyro[:, :-1] + log.gyro[:, 1:]) / 2
    np.testing.assert_allclose(spin, mean, atol=0.02)
    alone = there(TRIALS.morphologies[2], TRIALS.commands[2], TRIALS.fin_angles[2], steps=256)
    np.testing.assert_array_equal(alone.rpy[0], log.rpy[2])  # type: ignore[index]


def test_a_robot_that_runs_away_is_diverged_until_it_is_reset() -> None:
    world = make_world("mujoco")
    assert isinstance(world, MujocoWorld)
    world.reset(NOMINAL, STILL, STILL)
    world.data.qvel[0] = 2e6
    world.advance((0.1, 0.1, 0.1), 3)
    assert world.diverged
    assert math.isnan(world.state().position[0])
    world.advance((0.1, 0.1, 0.1))
    assert world.diverged
    world.reset(NOMINAL, STILL, STILL)
    world.advance((0.1, 0.1, 0.1))
    assert not world.diverged
    assert math.isfinite(world.state().position[0])


def test_the_strongest_currents_and_all_sizes_stay_finite() -> None:
    rng = np.random.default_rng(3)
    bodies = MAXIMA * rng.uniform(0, 1, (12, 9)) * (rng.uniform(size=(12, 9)) < 0.7)
    currents = rng.choice([-20.0, 0.0, 20.0], (12, 3))
    log = there(bodies, (0.5, -0.5, 1.0), rng.uniform(-3, 3, (12, 3)), current=currents)
    assert log.gyro is not None
    assert not log.diverged.any()
    assert abs(log.gyro).max() < 50


def test_its_water_is_another_of_the_same_order_of_magnitude() -> None:
    """No inverse crime: not near our water. But the same robot, as strong a water."""
    trials = random_trials(20, seed=0)
    arguments = (trials.morphologies, trials.commands, trials.fin_angles)
    foreign = there(*arguments, steps=256).gyro
    ours = simulate(*arguments, 256, dtype="float64").gyro
    assert foreign is not None
    assert ours is not None
    rms = [np.sqrt(np.mean(gyro**2, axis=(1, 2))) for gyro in (foreign, ours)]
    assert 1 / 3 < np.median(rms[0] / rms[1]) < 3
    gap = np.sqrt(np.mean((foreign - ours) ** 2, axis=(1, 2))) / rms[1]
    assert 0.2 < np.median(gap) < 2


def rower(ahead: bool) -> Callable[[object, float], tuple[float, float, float]]:
    """Return a policy whose flippers turn four times as fast in one half of the turn."""
    turned = 0.0

    def row(_observation: object, _time: float) -> tuple[float, float, float]:
        nonlocal turned
        speed = 1.0 if (math.cos(turned) > 0) == ahead else 0.25
        turned += math.pi * speed * 0.05
        return (speed, speed, -1.0)

    return row


def test_its_flippers_row() -> None:
    ahead, astern = (swim(rower(way), None, engine="mujoco").distance for way in (True, False))
    assert 0.5 < ahead < 10
    assert -10 < astern < -0.5


def test_its_tail_drives_it_on_but_for_the_half_of_added_mass_that_mujoco_has() -> None:
    """Water that turns with a fin pulls it outward, and here that is all the momentum it has."""
    far = []
    for mass in (1.0, 0.0):
        world = MujocoWorld()
        world.reset(NOMINAL, STILL, STILL)
        world.model.geom_fluid[:, 6:12] *= mass
        world.advance((0.0, 0.0, 1.0), 1000)
        far.append(world.state().position[1])
    assert -2.0 < far[0] < -0.2
    assert 1.0 < far[1] < 10.0


def test_the_water_is_mujocos_own() -> None:
    model = mujoco_model(NOMINAL, 0.002, wet=True)
    assert (model.opt.density, model.opt.viscosity) == (1.0, 4e-4)
    defaults = mujoco.MjSpec().worldbody.add_geom().fluid_coefs
    np.testing.assert_array_equal(model.geom_fluid[:, 1:6], np.tile(defaults, (model.ngeom, 1)))
    assert (model.geom_fluid[:, 0] == 1).all()
    # The capsule's added mass across is near Lamb's for an ellipsoid of 4 to 1, 0.860 of its own.
    volume = 4 / 3 * math.pi * 0.5 * 0.5 * 2.0
    np.testing.assert_allclose(model.geom_fluid[0, 6:9] / volume, (0.860, 0.860, 0.082), atol=2e-3)


def test_the_water_does_not_resist_acceleration() -> None:
    """Of added mass MuJoCo has what depends on speeds; docs/physics.md says so."""
    models = [mujoco_model(NOMINAL, 0.002, wet=wet) for wet in (True, False)]
    accelerations = []
    for model in models:
        data = mujoco.MjData(model)
        data.xfrc_applied[1] = (1.0, 2.0, 3.0, 0.1, 0.2, 0.3)
        mujoco.mj_forward(model, data)
        accelerations.append(data.qacc.copy())
    assert models[0].geom_fluid[0, 6:9].min() > 0.1
    np.testing.assert_allclose(*accelerations, rtol=1e-12)


def test_our_waters_settings_are_refused() -> None:
    with pytest.raises(
        InvalidArgumentError, match='reactive must be False for the engine "mujoco"'
    ):
        there(reactive=True)
    with pytest.raises(InvalidArgumentError, match=r"drag must be \(1, 1\) .*got \(1\.2, 1\.0\)"):
        there(drag=(1.2, 1.0))
    with pytest.raises(RuntimeError, match="reset the MuJoCo world"):
        MujocoWorld().advance((0.1, 0.1, 0.1))


def test_it_is_a_target_for_models_and_for_gaits() -> None:
    fish = EngineTarget(None, "left_pectoral:length=0.5", np.random.default_rng(0), 32, "mujoco")
    log = fish.perform(np.array((0.4, -0.3, 0.8)))
    body = fish.morphology.to_array()
    found = there(body, (0.4, -0.3, 0.8), fish.start_angles, steps=32)
    np.testing.assert_array_equal(log.gyro, found.gyro)  # type: ignore[arg-type]
    config = TransferConfig(poses=1, seconds=0.5, target_engine="mujoco")
    both = transfer(lambda *_: (1.0, 1.0, 1.0), body, config, NOMINAL)
    here = swim(lambda *_: (1.0, 1.0, 1.0), body, engine="mujoco", seconds=0.5)
    assert both.target.distance == here.distance != both.native.distance


def test_an_environment_swims_in_it() -> None:
    env = gym.make("AquaFish-v0", engine="mujoco", frame_skip=5, fin_angles="zero")
    env.reset(seed=0)
    env.step(np.ones(3, np.float32))
    again = pickle.loads(pickle.dumps(env))
    one, other = (each.step(np.ones(3, np.float32)) for each in (env, again))
    np.testing.assert_array_equal(one[0], other[0])
    log = there(commands=(0.5, 0.5, 1.0), steps=10)
    assert log.position is not None
    np.testing.assert_allclose(one[4]["y_position"], log.position[0, -1, 1], atol=1e-12)
    with pytest.raises(InvalidArgumentError, match=r"for engine='mujoco' use gym\.make_vec"):
        gym.make_vec("AquaFish-v0", num_envs=2, engine="mujoco")


def test_it_is_asked_for_by_name_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    assert check_engine("mujoco") == resolve_engine("engine", "mujoco") == "mujoco"
    assert resolve_engine("engine", "auto") != "mujoco"
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(EngineUnavailableError, match=r'pip install "aquafish-gym\[mujoco\]"'):
        there()
