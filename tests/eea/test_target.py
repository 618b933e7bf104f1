"""The fish as target and simulator: what it hides, how it breaks, how its world differs."""

from __future__ import annotations

import json

import numpy as np
import pytest

from aquafish_gym import Damage, Morphology, simulate
from aquafish_gym.engines.compiled.lanes import LaneBatch
from aquafish_gym.envs.env import AquaFishEnv
from aquafish_gym.plans import AQUAFISH
from aquafish_gym.utils.validation import InvalidArgumentError
from eea import (
    EngineSimulator,
    EngineTarget,
    JointConfig,
    PaperConfig,
    RealityGap,
    RecordedLog,
    TargetError,
    Trials,
    estimate_morphology,
    estimate_morphology_of,
)
from eea.core.config import EstimationConfig, ExplorationConfig
from eea.core.experiment import Simulator
from eea.core.model_evaluator import DIVERGED_SIMILARITY, ModelEvaluator
from eea.fish import fish_problem
from eea.fish.spectral import SpectralComparer
from instruments.verification.trials import random_trials

QUICK = PaperConfig(
    condition="none",
    steps=32,
    rounds=2,
    exploration=ExplorationConfig(6, 3),
    estimation=EstimationConfig(population=8, generations=5),
)
DAMAGE = "left_pectoral:length=0.5"


def test_every_genome_is_a_body_and_a_command_the_fish_accepts():
    rng = np.random.default_rng(0)
    models, actions = fish_problem().models, fish_problem().actions
    assert models.names == tuple(d.name for d in AQUAFISH.dimensions)
    assert models.high.tolist() == [d.maximum for d in AQUAFISH.dimensions]
    assert (models.bits, actions.bits) == (45, 18)
    assert actions.low.tolist() == [-0.5, -0.5, 0.0]
    assert actions.high.tolist() == [0.5, 0.5, 1.0]
    bodies, commands = (
        layout.decode(np.concatenate([layout.random(30, rng), layout.encode([layout.high])]))
        for layout in (models, actions)
    )
    log = EngineSimulator(8).simulate(Trials(bodies, commands, np.zeros((31, 3))))
    assert log.rpy.shape == log.gyro.shape == (31, 8, 3)


COMMAND = np.array([0.4, -0.3, 0.8])
STEPS = 60


def fish(damage, seed=3, steps=STEPS, **options):
    engine = options.pop("engine", "numba")
    return EngineTarget(None, damage, np.random.default_rng(seed), steps, engine, **options)


def simulated(target, steps=STEPS, **options):
    """Return the log of the target's last trial, simulated otherwise."""
    body = options.pop("body", target.morphology)
    return simulate(body, COMMAND, target.start_angles, steps, dtype="float64", **options)


@pytest.mark.parametrize("engine", ["pybullet", "numba"])
def test_the_target_hides_new_angles_before_every_command(engine):
    target = EngineTarget(None, DAMAGE, np.random.default_rng(5), 32, engine)
    assert target.morphology.left_pectoral == (0.4, 0.8, 0.1)
    hidden = []
    for _ in range(3):
        log = target.perform(np.array([0.3, -0.2, 0.5]))
        assert np.shape(log.gyro) == (1, 32, 3)
        hidden.append(target.start_angles)
    again = np.random.default_rng(5).uniform(-np.pi, np.pi, (3, 3))
    assert np.array_equal(hidden, again)


@pytest.mark.pybullet
def test_the_default_target_swims_in_pybullet_and_the_result_is_nearly_the_same():
    bullet = estimate_morphology(None, DAMAGE, QUICK, 1)
    lanes = estimate_morphology(None, DAMAGE, QUICK, 1, target_engine="numba")
    assert lanes.truth[1] == 0.8
    assert lanes.chance == pytest.approx(0.694, abs=0.001)
    assert bullet.rounds[0].command == lanes.rounds[0].command
    assert bullet.rounds[0].true_angles == lanes.rounds[0].true_angles
    assert bullet.rounds[0].model_fitness == pytest.approx(lanes.rounds[0].model_fitness, abs=1e-4)


def test_a_target_needs_only_perform():
    class Tank:
        def __init__(self, scale=1.0):
            self.fish = fish(DAMAGE, steps=32)
            self.scale = scale

        def perform(self, command):
            return RecordedLog(self.scale * self.fish.perform(command).gyro[0])

    result = estimate_morphology_of(Tank(), QUICK, 0)
    assert isinstance(result.morphology, Morphology)
    assert result.rounds[0].objective_fitness is None
    assert result.rounds[0].true_angles is None
    with pytest.raises(TargetError, match="Tank has none"):
        estimate_morphology_of(Tank(), QUICK.under("ideal"))
    # Rates in degrees/s are no fish's: they would give a wrong body, or none, without a word.
    with pytest.raises(TargetError, match="at most 10 rad/s"):
        estimate_morphology_of(Tank(57.3), JointConfig(steps=32, rounds=1), seed=0)


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
        ("random:mild", "sample it first"),
        ("caudal:missing@1-2", "onset .* sample it first"),
        ("caudal:seized@4+2", "lasts 0.6 s; got caudal:seized@4"),
        ("caudal:weak=2;caudal:weak=2", r"servo_gain\[2\] .* got 4"),
    ],
)
def test_random_late_or_excessive_damage_is_refused(damage, said):
    with pytest.raises(InvalidArgumentError, match=said):
        fish(damage)


def differing(gap, **options):
    return fish(DAMAGE, steps=128, gap=gap, **options)


@pytest.mark.parametrize(
    "world",
    [
        {"drag": (0.8, 1.2)},
        {"servo_gain": (0.9, 1.0, 1.1)},
        {"lag": 0.05},
        {"reactive": True},
        {"current": (0.1, -0.2, 0.0)},
        {"substeps": 8},
    ],
    ids=str,
)
def test_the_target_swims_in_the_world_that_the_gap_says(world):
    target = differing(RealityGap(**world))
    log = target.perform(COMMAND)
    assert np.array_equal(log.gyro, simulated(target, 128, **world).gyro)
    assert np.abs(log.gyro - simulated(target, 128).gyro).max() > 1e-4
    assert target.morphology == differing(RealityGap()).morphology


def test_a_gap_is_relative_to_what_target_and_models_share():
    gap = RealityGap(current=(0.1, 0.0, 0.0), substeps=4)
    ours = differing(gap, current=(0.2, 0, 0), substeps=2)
    same = differing(RealityGap(), current=(0.1 + 0.2, 0, 0), substeps=8)
    assert np.array_equal(ours.perform(COMMAND).gyro, same.perform(COMMAND).gyro)
    with pytest.raises(InvalidArgumentError, match="substeps must be"):
        differing(RealityGap(substeps=64), substeps=2)


def test_noise_and_bias_are_the_gyroscopes_alone():
    clear = differing(RealityGap()).perform(COMMAND)
    gap = RealityGap(gyro_noise=0.02, gyro_bias=(0.5, 0.0, -0.5))
    apart = differing(gap).perform(COMMAND).gyro - clear.gyro
    assert apart.mean(axis=(0, 1)) == pytest.approx([0.5, 0.0, -0.5], abs=0.01)
    assert apart.std(axis=(0, 1)) == pytest.approx(0.02, rel=0.25)
    lagged = apart[0, 1:] * apart[0, :-1]  # white: what was tells nothing of what comes
    assert (lagged[:, 1]).mean() == pytest.approx(0.0, abs=1.5e-4)


def test_all_gaps_hide_the_same_angles_and_make_the_same_noise():
    found = []
    for lag in (0.0, 0.02):
        noisy, clear = (differing(RealityGap(gyro_noise=sd, lag=lag)) for sd in (0.01, 0.0))
        noise = [noisy.perform(COMMAND).gyro - clear.perform(COMMAND).gyro for _ in range(2)]
        found.append((noisy.start_angles, *noise))
    for one, other in zip(*found, strict=True):
        assert one == pytest.approx(other, abs=1e-12)
    assert np.abs(found[0][1] - found[0][2]).max() > 0.01  # it differs by trial


def test_a_gap_says_what_it_is():
    assert str(RealityGap()) == "nothing"
    gap = RealityGap(reactive=True, current=(0.1, 0.0, -0.1))
    assert str(gap) == "current 0.1 0 -0.1, reactive"
    assert RealityGap(**json.loads(json.dumps(gap.changes))) == gap


POWER, MODELS = 128, 6
TRIALS = Trials(
    *(getattr(random_trials(30, 1), n) for n in ("morphologies", "commands", "fin_angles"))
)


class ByNumpy(Simulator):
    """A simulator of one's own around the engine's: nothing of that one's is inherited."""

    def __init__(self, steps=POWER):
        self._engine = EngineSimulator(steps)
        self.asked = 0

    def simulate(self, trials):
        self.asked += 1
        return self._engine.simulate(trials)


def first(count):
    return Trials(TRIALS.models[:count], TRIALS.commands[:count], TRIALS.angles[:count])


def evaluator(compiled):
    return ModelEvaluator(EngineSimulator(POWER) if compiled else ByNumpy(), POWER, 3)


def test_the_engine_compares_as_numpy_does():
    ours, theirs = (evaluator(compiled) for compiled in (True, False))
    assert isinstance(ours._comparer, SpectralComparer)
    observed = theirs.behaviors(first(4)).astype(np.complex128)
    which = np.arange(30) % 4
    sims = [one.similarities(TRIALS, observed, which) for one in (ours, theirs)]
    assert sims[1].min() < 0.995
    np.testing.assert_allclose(1 - sims[0], 1 - sims[1], rtol=1e-5, atol=1e-6)
    fits = [one.disagreements(TRIALS, MODELS) for one in (ours, theirs)]
    assert fits[0].shape == (5,)
    np.testing.assert_allclose(fits[0], fits[1], rtol=1e-5)
    assert ours.trials == 60


@pytest.mark.pybullet
def test_engine_compares_only_what_it_can_transform():
    assert EngineSimulator(2).comparer(2) is None
    assert EngineSimulator(POWER).comparer(64) is None
    assert EngineSimulator(POWER, engine="pybullet").comparer(POWER) is None


def test_a_robot_that_diverged_is_like_nothing(monkeypatch):
    lab = evaluator(compiled=True)
    spectra = LaneBatch.spectra

    def sick(self, *arguments):
        found = spectra(self, *arguments)
        found[2] = np.nan
        return found

    monkeypatch.setattr(LaneBatch, "spectra", sick)
    observed, which = np.zeros((1, 195), complex), np.zeros(30, np.intp)
    sim = lab.similarities(TRIALS, observed, which)
    assert sim[2] == DIVERGED_SIMILARITY
    assert (sim[np.arange(30) != 2] > DIVERGED_SIMILARITY).all()
    assert not np.isfinite(lab.disagreements(TRIALS, MODELS)[0])


def test_a_simulator_of_ones_own_is_asked_and_not_bypassed():
    class Noisy(EngineSimulator):
        pass

    assert Noisy(POWER).comparer(POWER) is None
    noisy = ByNumpy()
    lab = ModelEvaluator(noisy, POWER, 3)
    observed = lab.behaviors(first(1))
    lab.similarities(TRIALS, observed, np.zeros(30, np.intp))
    lab.disagreements(TRIALS, MODELS)
    assert noisy.asked == 3
    still, moving = (
        ModelEvaluator(EngineSimulator(POWER, current=current), POWER, 3)
        for current in ((0.0, 0.0, 0.0), (1.0, 0.0, 0.5))
    )
    assert (moving.disagreements(TRIALS, MODELS) != still.disagreements(TRIALS, MODELS)).all()
