"""A target has any damage of the grammar; each trial is an episode."""

from __future__ import annotations

import numpy as np
import pytest

from aquafish_gym import Damage, Morphology, simulate
from aquafish_gym.envs.env import AquaFishEnv
from aquafish_gym.utils.validation import InvalidArgumentError
from eea import (
    EngineTarget,
    JointConfig,
    RealityGap,
    RecordedLog,
    TargetError,
    estimate_morphology_of,
)

COMMAND = np.array([0.4, -0.3, 0.8])
STEPS = 60


def fish(damage: object, seed: int = 3, **options) -> EngineTarget:
    engine = options.pop("engine", "numba")
    return EngineTarget(None, damage, np.random.default_rng(seed), STEPS, engine, **options)


def simulated(target: EngineTarget, **options):
    """Return the log of the target's last trial, simulated otherwise."""
    body = options.pop("body", target.morphology)
    return simulate(body, COMMAND, target.start_angles, STEPS, dtype="float64", **options)


@pytest.mark.parametrize(
    ("damage", "gain"),
    [
        ("left_pectoral:weak=0.4", (0.4, 1.0, 1.0)),
        ("right_pectoral:seized", (1.0, 0.0, 1.0)),
        ("caudal:dead", (1.0, 1.0, 0.0)),
        ("left_pectoral:weak=0.5;left_pectoral:reversed", (-0.5, 1.0, 1.0)),
    ],
)
def test_servo_faults_scale_the_commands(damage, gain):
    target = fish(damage)
    log = target.perform(COMMAND)
    assert np.array_equal(log.gyro, simulated(target, servo_gain=gain).gyro)
    assert np.abs(log.gyro - simulated(target).gyro).max() > 1e-3
    assert target.morphology == Morphology.nominal()


def test_a_seized_servo_keeps_its_angle_and_a_dead_one_does_not():
    target = fish("left_pectoral:seized;right_pectoral:seized=1.5;caudal:dead")
    whole, found = fish(None), []
    for _ in range(3):
        target.perform(COMMAND)
        whole.perform(COMMAND)
        found.append(target.start_angles)
        assert target.start_angles[2] == whole.start_angles[2]
    left, right, phase = np.transpose(found)
    assert len(set(left)) == 1
    assert right.tolist() == [1.5] * 3
    assert len(set(phase)) == 3


@pytest.mark.parametrize("engine", ["numba", "pybullet"])
def test_a_scheduled_fault_begins_in_every_trial(engine):
    target = fish("caudal:missing@0.2+0.2;left_pectoral:dead@0.3", engine=engine)
    for _ in range(2):
        log = target.perform(COMMAND)
        whole = simulated(target, body=None, engine=engine)
        np.testing.assert_allclose(log.gyro[0, :20], whole.gyro[0, :20], rtol=0, atol=1e-12)
        assert np.abs(log.gyro[0, 20:] - whole.gyro[0, 20:]).max(axis=1).min() > 1e-6
    assert target.morphology == Damage.parse("caudal:missing").apply(Morphology.nominal())


def test_a_trial_is_an_episode_of_the_environment():
    """Of the same damage, commands and angles: sensors, body and servos break alike."""
    damage = "gyro_x:stuck@0.25;gyro_y:bias=0.2@0.1+0.3;gyro_z:dropped@0.4;caudal:width=0.5@0.3"
    damage += ";right_pectoral:weak=0.5@0.15"
    target = fish(damage)
    log = target.perform(COMMAND)
    env = AquaFishEnv(engine="numba", damage=damage, frame_skip=1, fin_angles=target.start_angles)
    env.reset(seed=0)
    action = 2 * COMMAND - [0, 0, 1]
    felt = np.array([env.step(action)[0] for _ in range(STEPS)])
    np.testing.assert_allclose(log.gyro[0], felt[:, 6:9], rtol=0, atol=1e-6)


def test_a_lag_holds_for_commands_and_not_for_faults():
    late = fish("left_pectoral:seized@0.3", gap=RealityGap(lag=0.1))
    log, whole = late.perform(COMMAND), simulated(late, lag=0.1)
    apart = np.abs(log.gyro - whole.gyro)[0].max(axis=1)
    assert apart[:30].max() < 1e-12
    assert apart[30] > 1e-6


def test_a_broken_gyroscope_observes_bias_drops_and_stuck_values():
    clear = fish(None).perform(COMMAND)
    log = fish("gyro_x:bias=0.1;gyro_y:dropped@0.3;gyro_z:stuck@0.2").perform(COMMAND)
    np.testing.assert_allclose(log.gyro[0, :, 0], clear.gyro[0, :, 0] + 0.1, rtol=0, atol=1e-15)
    assert (log.gyro[0, 29:, 1] == 0.0).all()
    assert np.array_equal(log.gyro[0, :29, 1], clear.gyro[0, :29, 1])
    assert (log.gyro[0, 19:, 2] == clear.gyro[0, 19, 2]).all()


def test_noise_differs_by_trial_and_repeats_with_the_seed():
    clear, noisy, again = fish(None), fish("gyro:noise=0.05"), fish("gyro:noise=0.05")
    found = []
    for _ in range(2):
        log = noisy.perform(COMMAND)
        assert np.array_equal(log.gyro, again.perform(COMMAND).gyro)
        found.append(log.gyro - clear.perform(COMMAND).gyro)
    assert np.std(found) == pytest.approx(0.05, rel=0.1)
    assert np.abs(found[0] - found[1]).max() > 0.05


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        ("random:mild", r"left to chance: sample it first \(Damage\.sample\)"),
        ("caudal:missing@1-2", r"leaves its onset to chance: sample it first \(Damage\.sample\)"),
        ("caudal:seized@4+2", r"within the trial, which lasts 0\.6 s; got caudal:seized@4"),
        ("caudal:weak=2;caudal:weak=2", r"servo_gain\[2\] must lie in \[-2, 2\]; got 4"),
    ],
)
def test_random_late_or_excessive_damage_is_refused(damage, said):
    with pytest.raises(InvalidArgumentError, match=said):
        fish(damage)


def test_a_target_that_logs_in_degrees_is_refused():
    """Its rates are no fish's: those would be a wrong body, or none, without a word."""

    class Degrees:
        def perform(self, command):
            return RecordedLog(gyro=57.3 * fish(None).perform(command).gyro)

    with pytest.raises(
        TargetError, match=r"at most 10 rad/s, which no such robot exceeds \(not de"
    ):
        estimate_morphology_of(Degrees(), JointConfig(steps=STEPS, rounds=1), seed=0)
