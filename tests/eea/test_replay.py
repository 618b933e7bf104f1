"""A recorded session as a target."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eea import (
    EngineTarget,
    PaperConfig,
    RecordedLog,
    ReplayTarget,
    SwimLog,
    estimate_from_logs,
    read_log,
    write_log,
)
from eea.core.checks import ConfigurationError, TargetError
from eea.core.conditions import OutOfBandConfig
from eea.core.estimation import EstimationConfig
from eea.core.exploration import ExplorationConfig
from eea.core.session import streams
from eea.fish import estimate_morphology_of

QUICK = PaperConfig(
    steps=32,
    rounds=3,
    exploration=ExplorationConfig(6, 3),
    estimation=EstimationConfig(population=8, generations=5),
    out_of_band=OutOfBandConfig(period=2, inner_population=5, inner_generations=3),
)


class Recorder:
    """A robot in a tank: it tells nothing but its log, which somebody keeps."""

    def __init__(self, seed: int, steps: int = 32) -> None:
        damage, rng = "left_pectoral:length=0.5", streams(seed)["target"]
        self._fish = EngineTarget(None, damage, rng, steps, "numba")
        self.commands, self.logs = [], []

    def perform(self, command):
        log = self._fish.perform(command)
        self.commands.append(command)
        self.logs.append(RecordedLog(log.gyro[0]))
        return log


def without_clock(estimate):
    return [replace(record, seconds=0.0) for record in estimate.rounds]


@pytest.mark.parametrize("condition", ["none", "in-band", "out-of-band"])
def test_replayed_logs_give_the_live_runs_estimate_to_the_bit(condition, tmp_path):
    config = replace(QUICK, condition=condition)
    robot = Recorder(seed=4)
    live = estimate_morphology_of(robot, config, seed=4)
    write_log(tmp_path / "swim.csv", SwimLog.of_trials(robot.commands, robot.logs))
    sessions = [(robot.commands, robot.logs), read_log(tmp_path / "swim.csv").trials(32)]
    for commands, logs in sessions:
        again = estimate_from_logs(commands, logs, config, seed=4)
        assert without_clock(again) == without_clock(live)
        assert again.morphology == live.morphology


def test_what_another_command_would_have_done_is_not_credited_to_it():
    robot = Recorder(seed=4)
    estimate_morphology_of(robot, QUICK, seed=4)
    # With another seed other commands are asked for; those of the session are what is modelled.
    other = estimate_from_logs(robot.commands, robot.logs, QUICK, seed=5)
    assert [record.command for record in other.rounds] == [tuple(c) for c in robot.commands]
    assert [record.action_fitness for record in other.rounds] == [None] * 3


def test_rounds_and_steps_are_the_sessions_by_default():
    robot = Recorder(seed=0)
    estimate_morphology_of(robot, QUICK)
    quick = estimate_from_logs(robot.commands[:1], robot.logs[:1])
    assert (quick.config.rounds, quick.config.steps, len(quick.rounds)) == (1, 32, 1)
    assert quick.config.condition == "joint"
    with pytest.raises(
        ConfigurationError, match="rounds must be at most the number of logs, 2; got 3"
    ):
        estimate_from_logs(robot.commands[:2], robot.logs[:2], QUICK)


def test_an_exhausted_session_says_so():
    log = RecordedLog(np.zeros((32, 3)))
    target = ReplayTarget([[0.1, 0.2, 0.3]], [log])
    performed = target.perform(np.ones(3))
    assert performed.log is log
    assert performed.command.tolist() == [0.1, 0.2, 0.3]
    with pytest.raises(TargetError, match=r"holds 1 trials.*config\.rounds must be at most 1"):
        target.perform(np.ones(3))


@pytest.mark.parametrize(
    ("commands", "count", "message"),
    [
        ([[0.1, 0.2, 0.3]], 2, "equally many, and at least one; got 1 and 2"),
        (np.empty((0, 3)), 0, "at least one; got 0 and 0"),
        ([0.1, 0.2, 0.3], 3, r"commands must have shape \(any, any\)"),
        ([[0.1, np.nan, 0.3]], 1, "commands must be finite"),
        ("fast", 1, "commands must be numbers"),
    ],
)
def test_a_session_that_is_none_is_refused(commands, count, message):
    with pytest.raises(ConfigurationError, match=message):
        ReplayTarget(commands, [RecordedLog(np.zeros((32, 3)))] * count)
