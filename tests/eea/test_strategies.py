"""Every way to choose a command, under every condition, on the fake robot."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import get_args

import numpy as np
import pytest

from eea.core.algorithm import EEA
from eea.core.checks import ConfigurationError
from eea.core.conditions import OutOfBandConfig
from eea.core.config import CONDITIONS, EEAConfig, JointConfig
from eea.core.design import corners
from eea.core.estimation import EstimationConfig
from eea.core.exploration import ExplorationConfig, Strategy
from eea.joint.inference import JointInference
from eea.joint.problem import JointProblem, Nuisance
from fake_fish import (
    ACTIONS,
    MODELS,
    PROBLEM,
    TRUTH,
    FakeRevealingTarget,
    FakeSimulator,
    FakeTarget,
    Trials,
    fake_eea,
)

STRATEGIES = tuple(get_args(Strategy))
SMALL = EEAConfig(
    steps=64,
    rounds=3,
    exploration=ExplorationConfig(6, 3),
    estimation=EstimationConfig(population=10, generations=10),
    out_of_band=OutOfBandConfig(period=10, inner_population=4, inner_generations=2),
    joint=JointConfig(bodies=12, poses=16, descents=4, polished=1, restarts=0),
)


def joint_problem() -> JointProblem:
    """The fake robot, whose gyroscope may have a bias and a gain, the gain in each trial."""

    def simulate(bodies, nuisances, commands, angles, _):
        gyro = FakeSimulator().simulate(Trials(bodies, commands, angles)).gyro
        return nuisances[:, 1:, None] * gyro + nuisances[:, :1, None]

    nuisances = (
        Nuisance("bias", -0.1, 0.1, 0.0, sd=0.05),
        Nuisance("gain", 0.8, 1.2, 1.0, sd=0.05),
    )
    return JointProblem(PROBLEM, simulate, nuisances)


class NoisyTarget(FakeTarget):
    def perform(self, command):
        log = super().perform(command)
        log.gyro = log.gyro + 0.01 * self._rng.standard_normal(log.gyro.shape)
        return log


def fins(bodies):
    """How far gaits of one fin each swim: as the area of the fin."""
    return (bodies[:, 0::3] * bodies[:, 1::3]).T


def method(condition: str, strategy: str, seed: int = 0, **joint):
    config = replace(
        SMALL,
        condition=condition,
        exploration=replace(SMALL.exploration, strategy=strategy),
        joint=replace(SMALL.joint, noise=0.01, per_trial=("gain",), **joint),
    )
    if condition == "joint":
        return JointInference(NoisyTarget(seed), joint_problem(), config, seed, TRUTH, fins)
    target = FakeRevealingTarget(seed)
    return EEA(target, FakeSimulator(), PROBLEM, config, seed, TRUTH, fins)


@cache
def rounds_of(condition: str, strategy: str):
    """What a strategy did in two rounds, but for the clock."""
    run = iter(method(condition, strategy))
    return [replace(next(run), seconds=0.0) for _ in range(2)]


@pytest.mark.parametrize("strategy", STRATEGIES)
@pytest.mark.parametrize("condition", [*CONDITIONS, "joint"])
def test_every_strategy_runs_under_every_condition_the_same_again(condition, strategy):
    rounds = rounds_of(condition, strategy)
    assert rounds == rounds_of.__wrapped__(condition, strategy)
    commands = np.array([record.command for record in rounds])
    assert (commands >= ACTIONS.low).all()
    assert (commands <= ACTIONS.high).all()
    fast = corners(ACTIONS, np.random.default_rng(0)).tolist()
    first, second = (record.action_fitness for record in rounds)
    assert first is None
    if strategy in ("random", "fast"):
        assert second is None
    else:
        assert second >= 0.0
    if strategy not in ("random", "disagreement"):
        assert commands[0].tolist() in fast
    if strategy == "fast":
        assert commands[1].tolist() in fast
        assert (commands[1] != commands[0]).any()


@pytest.mark.parametrize("condition", [*CONDITIONS, "joint"])
def test_strategies_choose_differently(condition):
    told = {s: tuple(record.command for record in rounds_of(condition, s)) for s in STRATEGIES}
    assert len(set(told.values())) >= 4
    assert told["fast"][0] == told["a-optimal"][0] != told["random"][0]


@pytest.mark.parametrize("condition", [*CONDITIONS, "joint"])
def test_auto_is_the_papers_for_an_eea_and_fast_for_joint_inference(condition):
    usual = "fast" if condition == "joint" else "disagreement"
    assert rounds_of(condition, "auto") == rounds_of(condition, usual)


def test_a_round_that_was_broken_off_is_chosen_again():
    class Flaky(FakeRevealingTarget):
        broken = False

        def perform(self, command):
            if len(self.commands) == 2 and not self.broken:
                self.broken = True
                raise OSError("the tank is empty")
            return super().perform(command)

    config = replace(SMALL, exploration=replace(SMALL.exploration, strategy="information"))
    eea = EEA(Flaky(), FakeSimulator(), PROBLEM, config, 0, TRUTH)
    with pytest.raises(OSError, match="empty"):
        eea.run()
    whole = EEA(FakeRevealingTarget(), FakeSimulator(), PROBLEM, config, 0, TRUTH).run()
    again = eea.run()
    assert [r.command for r in again.rounds] == [r.command for r in whole.rounds]


@pytest.mark.parametrize("condition", ["out-of-band", "joint"])
def test_a_gait_without_a_utility_is_refused_at_the_door(condition):
    config = replace(
        SMALL, condition=condition, exploration=replace(SMALL.exploration, strategy="gait")
    )
    target = FakeTarget()
    kind, robot = EEA, (FakeSimulator(), PROBLEM)
    if condition == "joint":
        kind, robot = JointInference, (joint_problem(),)
    with pytest.raises(ConfigurationError, match=r"strategy = gait needs a utility.*\(N, 9\)"):
        kind(target, *robot, config)
    assert not target.commands


def test_robust_without_a_utility_is_refused_where_it_has_a_say():
    config = replace(SMALL, joint=replace(SMALL.joint, robust=0.9))
    fake_eea(config)
    with pytest.raises(ConfigurationError, match=r"joint\.robust needs a utility"):
        JointInference(FakeTarget(), joint_problem(), replace(config, condition="joint"))


def test_bad_names_are_refused_with_the_nearest():
    with pytest.raises(ConfigurationError, match="did you mean 'a-optimal'"):
        ExplorationConfig(strategy="a-optimum")
    with pytest.raises(ConfigurationError, match=r"joint.robust must be .* in \[0, 1\]; got 2"):
        JointConfig(robust=2)


def test_it_stops_once_every_interval_is_narrow():
    run = method("joint", "fast")
    widths = []
    for _ in run:
        low, high = run.result.interval(0.9)
        widths.append(float(((high - low) / MODELS.span).max()))
    assert run.result.stopped == "rounds"
    assert widths[0] > widths[-1]
    between = 0.5 * (widths[0] + widths[1])
    stopped = method("joint", "fast", narrow=between).run()
    assert (stopped.stopped, len(stopped.rounds)) == ("narrow", 2)


def test_it_stops_once_the_gait_is_robust():
    stopped = method("joint", "fast", robust=0.5).run()
    assert (stopped.stopped, len(stopped.rounds)) == ("robust", 1)
