"""The algorithm bound to the fish itself, in its engines."""

from __future__ import annotations

import numpy as np
import pytest

import eea
from aquafish_gym.morphology import DIMENSIONS, Morphology
from aquafish_gym.utils.validation import InvalidArgumentError, UnknownNameError
from eea import EngineSimulator, EngineTarget, PaperConfig, RecordedLog, Trials, estimate_morphology
from eea.core.config import EstimationConfig, ExplorationConfig
from eea.fish import estimate_morphology_of, fish_problem

QUICK = PaperConfig(
    condition="none",
    steps=32,
    rounds=2,
    exploration=ExplorationConfig(6, 3),
    estimation=EstimationConfig(population=8, generations=5),
)
DAMAGE = "left_pectoral:length=0.5"


def test_the_genomes_are_the_fishs():
    models, actions = fish_problem().models, fish_problem().actions
    assert models.names == tuple(d.name for d in DIMENSIONS)
    assert models.high.tolist() == [d.maximum for d in DIMENSIONS]
    assert (models.bits, actions.bits) == (45, 18)
    assert actions.low.tolist() == [-0.5, -0.5, 0.0]
    assert actions.high.tolist() == [0.5, 0.5, 1.0]


def test_every_genome_is_a_body_and_a_command_the_fish_accepts():
    rng = np.random.default_rng(0)
    models, actions = fish_problem().models, fish_problem().actions
    bodies = models.decode(np.concatenate([models.random(30, rng), models.encode([models.high])]))
    commands = actions.decode(
        np.concatenate([actions.random(30, rng), actions.encode([actions.high])])
    )
    trials = Trials(bodies, commands, np.zeros((31, 3)))
    log = EngineSimulator(8).simulate(trials)
    assert log.rpy.shape == log.gyro.shape == (31, 8, 3)


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


def test_the_target_swims_as_its_body_does_from_its_hidden_angles():
    target = EngineTarget(None, DAMAGE, np.random.default_rng(5), 64, "numba")
    command = np.array([0.3, -0.2, 0.5])
    seen = target.perform(command)
    trials = Trials(target.morphology.to_array()[None], command[None], target.start_angles[None])
    modelled = EngineSimulator(64, dtype="float64").simulate(trials)
    assert np.allclose(seen.gyro, modelled.gyro, atol=1e-9)


@pytest.mark.parametrize("condition", eea.CONDITIONS)
def test_every_condition_runs_on_the_fish(condition):
    seen = []
    result = estimate_morphology(
        None, DAMAGE, QUICK.under(condition), 1, seen.append, target_engine="numba"
    )
    assert isinstance(result.morphology, Morphology)
    assert seen == result.rounds
    assert len(seen) == 2
    assert result.truth is not None
    assert result.truth[1] == 0.8
    assert result.chance == pytest.approx(0.694, abs=0.001)


@pytest.mark.pybullet
def test_the_default_target_swims_in_pybullet_and_the_result_is_nearly_the_same():
    bullet = estimate_morphology(None, DAMAGE, QUICK, 1)
    lanes = estimate_morphology(None, DAMAGE, QUICK, 1, target_engine="numba")
    assert bullet.rounds[0].command == lanes.rounds[0].command
    assert bullet.rounds[0].true_angles == lanes.rounds[0].true_angles
    assert bullet.rounds[0].model_fitness == pytest.approx(lanes.rounds[0].model_fitness, abs=1e-4)


def test_a_target_needs_only_perform():

    class Tank:
        def __init__(self):
            self.fish = EngineTarget(None, DAMAGE, np.random.default_rng(0), 32, "numba")

        def perform(self, command):
            return RecordedLog(self.fish.perform(command).gyro[0])

    result = estimate_morphology_of(Tank(), QUICK, 0)
    assert isinstance(result.morphology, Morphology)
    assert result.rounds[0].objective_fitness is None
    assert result.rounds[0].true_angles is None
    with pytest.raises(eea.TargetError, match="Tank has none"):
        estimate_morphology_of(Tank(), QUICK.under("ideal"))


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"damage": "left_pectral:length=0.5"}, UnknownNameError, "did you mean 'left_pectoral'"),
        ({"target_morphology": [0.1] * 8}, InvalidArgumentError, "morphology"),
        ({"engine": "nunba"}, UnknownNameError, "did you mean 'numba'"),
        ({"target_engine": "bullet"}, UnknownNameError, "did you mean 'pybullet'"),
        ({"current": (0, np.nan, 0)}, InvalidArgumentError, "current must be finite"),
    ],
)
def test_bad_arguments_are_refused_before_anything_swims(arguments, error, message):
    with pytest.raises(error, match=message):
        estimate_morphology(**{"config": QUICK, "target_engine": "numba", **arguments})
