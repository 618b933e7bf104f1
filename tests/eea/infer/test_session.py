"""Joint inference online and offline."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eea.core.checks import ConfigurationError
from eea.core.session import streams
from eea.infer.fit import fit
from eea.infer.session import JointInference
from eea.infer.trials import Observed
from swing import CONFIG, PROBLEM, SWING, TRUTH, Swinging, infer


class Recorded(Swinging):
    """Keeps its trials, and fails once in one of them."""

    def __init__(self, fails_in: int = 0) -> None:
        super().__init__()
        self.fails_in, self.commands, self.logs = fails_in, [], []

    def perform(self, command):
        if len(self.commands) + 1 == self.fails_in:
            self.fails_in = 0
            raise KeyboardInterrupt
        log = super().perform(command)
        self.commands.append(command)
        self.logs.append(log.gyro)
        return log


def test_offline_fits_equal_the_session():
    robot = Recorded()
    session = JointInference(robot, SWING, PROBLEM, CONFIG, 0, TRUTH)
    rng, earlier = streams(0)["estimation"], None
    for count, record in enumerate(session, 1):
        trials = Observed(np.array(robot.commands[:count]), np.array(robot.logs[:count]))
        earlier = fit(trials, SWING, CONFIG, rng, earlier)
        assert earlier.to_dict() == session.result.belief.to_dict()
        assert record.morphology == tuple(earlier.model)
        assert record.trials == earlier.warm_start.robots > 0


def test_interrupted_round_leaves_no_trace():
    expected = JointInference(Recorded(), SWING, PROBLEM, CONFIG, 0, TRUTH).run()
    session = JointInference(Recorded(fails_in=2), SWING, PROBLEM, CONFIG, 0, TRUTH)
    with pytest.raises(KeyboardInterrupt):
        session.run()
    assert len(session.result.rounds) == 1
    result = session.run()
    assert result.belief.to_dict() == expected.belief.to_dict()
    assert [replace(r, seconds=0.0) for r in result.rounds] == [
        replace(r, seconds=0.0) for r in expected.rounds
    ]


def test_session_stops_once_intervals_are_narrow():
    assert infer(max_interval_width=0.9, rounds=5).stopped == "narrow"
    assert infer(max_interval_width=0.0).stopped == "rounds"


def test_unknown_nuisances_are_refused():
    with pytest.raises(ConfigurationError, match="nuisances must be one of bias; got 'bios'"):
        infer(nuisances=("bios",))


def test_signal_must_be_finite():
    trials = Observed(np.zeros((1, 1)), np.full((1, 64, 2), np.nan))
    with pytest.raises(ConfigurationError, match="signal must be finite"):
        fit(trials, SWING, CONFIG, np.random.default_rng(0))
