"""The two general optimisers: they find the likeliest body, keep to their budget, and repeat."""

from __future__ import annotations

import random

import numpy as np
import pytest

from eea.core.bits import action_layout, model_layout
from eea.core.checks import ConfigurationError, TargetError
from eea.core.config import EEAConfig, JointConfig
from eea.core.problem import Problem
from eea.core.replay import RecordedLog
from eea.joint.problem import JointProblem, Nuisance

pytest.importorskip("cma", reason="CMA-ES comes with the extras named compare and test")
pytest.importorskip("deap", reason="DEAP comes with the extras named compare and test")
from aquafish.gap.rivals import RIVALS, Rival

LENGTH, BIAS = 1.3, 0.04
TIME = 0.01 * np.arange(1, 65)


def swing(bodies, nuisances, commands, angles, fine):  # noqa: ARG001
    rate = bodies[:, :1] * np.sin(3.0 * commands[:, :1] * TIME + angles)
    return (rate + nuisances[:, :1])[:, :, None]


PENDULUM = JointProblem(
    Problem(
        models=model_layout([("length", 2.0, 6)]),
        actions=action_layout([("torque", -1.0, 1.0)]),
        hidden=("angle",),
        axes=1,
    ),
    swing,
    (Nuisance("bias", -0.1, 0.1, 0.0, sd=0.05),),
)


class Pendulum:
    def __init__(self, noise: float) -> None:
        self._rng, self._noise, self.start_angles = np.random.default_rng(1), noise, np.zeros(1)

    def perform(self, command):
        self.start_angles = self._rng.uniform(-np.pi, np.pi, 1)
        told = (np.array([[v]]) for v in (LENGTH, BIAS))
        gyro = swing(*told, command[None], self.start_angles[None], True)
        return RecordedLog(gyro=gyro + self._noise * self._rng.standard_normal(gyro.shape))


def rival(name: str, *, sd: float = 0.0, budget: int = 4000, seed: int = 0, **joint) -> Rival:
    config = EEAConfig(condition="joint", steps=64, rounds=3, joint=JointConfig(**joint))
    truth = np.array([LENGTH])
    search = RIVALS[name]
    return Rival(Pendulum(sd), PENDULUM, config, seed, truth, search=search, budget=budget)


@pytest.mark.parametrize("name", RIVALS)
@pytest.mark.parametrize("told", [{}, {"noise": 0.01}], ids=["noise unknown", "noise known"])
def test_they_find_body_nuisance_and_angles_together(name, told):
    result = rival(name, sd=0.01, budget=20_000, **told).run()
    assert result.objective_fitness > 0.98
    assert result.rounds[-1].angle_error[0] < 0.1
    assert result.rounds[-1].model_fitness > 0.95


@pytest.mark.parametrize("name", RIVALS)
def test_they_keep_to_their_budget_and_repeat_and_leave_the_global_streams_alone(name):
    random.seed(5)
    np.random.seed(5)  # noqa: NPY002
    before = random.getstate(), np.random.get_state()[1].tolist()  # noqa: NPY002
    first, again, other = (rival(name, seed=seed).run() for seed in (0, 0, 1))
    assert random.getstate() == before[0]
    assert np.random.get_state()[1].tolist() == before[1]  # noqa: NPY002
    rows = [
        [(r.morphology, r.command, r.trials, r.min_angle) for r in run.rounds]
        for run in (first, again, other)
    ]
    assert rows[0] == rows[1]
    assert rows[0] != rows[2]
    for record in first.rounds:
        assert 4000 <= record.trials / record.round < 4000 + 1000


@pytest.mark.parametrize("name", RIVALS)
def test_later_rounds_begin_from_what_was_found(name):
    """With a budget that no search from nothing could live on."""
    run = rival(name, sd=0.001, budget=6000)
    rounds = iter(run)
    next(rounds)
    run._budget = 600
    for record in rounds:
        assert record.objective_fitness > 0.97


def test_nuisances_that_are_not_inferred_are_nominal():
    result = rival("cma-es", budget=20_000, nuisances=()).run()
    with_bias = rival("cma-es", budget=20_000).run()
    assert with_bias.objective_fitness > result.objective_fitness


def test_a_round_that_is_broken_off_leaves_no_trace():
    run = rival("ga")
    rounds = iter(run)
    first = next(rounds)
    perform, run._target.perform = (
        run._target.perform,
        lambda _: RecordedLog(gyro=np.zeros((1, 3, 1))),
    )
    with pytest.raises(TargetError):
        next(rounds)
    run._target.perform = perform
    assert [record.round for record in run] == [2, 3]
    assert run.result.rounds[0] is first
    assert len(run._observed) == 3


def test_a_budget_of_nothing_is_refused():
    with pytest.raises(ConfigurationError, match="budget must be a whole number of at least 1"):
        rival("ga", budget=0)
