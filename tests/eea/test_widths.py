"""The core at every width: commands, hidden angles and axes of the signal need not be three."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from eea.core.algorithm import EEA
from eea.core.checks import ConfigurationError, TargetError
from eea.core.config import (
    CONDITIONS,
    EstimationConfig,
    ExplorationConfig,
    OutOfBandConfig,
    PaperConfig,
)
from eea.core.experiment import Performed, RecordedLog, Simulator, Trials
from eea.core.genome import action_layout, model_layout
from eea.core.problem import Problem
from fake_fish import ACTIONS, MODELS

STEPS, TIME = 16, 0.1 * np.arange(16)
TRUTH = np.array([0.3, 0.8])
WIDTHS = list(itertools.product((1, 4), (1, 3), (1, 2)))
QUICK = PaperConfig(
    steps=STEPS,
    rounds=2,
    exploration=ExplorationConfig(5, 3),
    estimation=EstimationConfig(population=6, generations=5),
    out_of_band=OutOfBandConfig(2, 4, 3, revisit=1),
)


def problem(commands: int, hidden: int, axes: int) -> Problem:
    return Problem(
        models=model_layout([("gain", 1.0, 5), ("tone", 1.0, 5)]),
        actions=action_layout([(f"motor {i}", -1.0, 1.0) for i in range(commands)]),
        hidden=tuple(f"angle {i}" for i in range(hidden)),
        axes=axes,
    )


class Machine(Simulator):
    """Every motor and every hidden angle has a say in every axis."""

    def __init__(self, axes: int) -> None:
        self._axes = axes
        self.shapes: set[tuple[int, ...]] = set()

    def simulate(self, trials: Trials) -> RecordedLog:
        b = len(trials)
        assert trials.models.shape[0] == trials.commands.shape[0] == trials.angles.shape[0] == b
        self.shapes.add((trials.models.shape[1], trials.commands.shape[1], trials.angles.shape[1]))
        axis = 1.0 + np.arange(self._axes)
        drive = (trials.commands * (1.0 + np.arange(trials.commands.shape[1]))).sum(axis=1)
        phase = (trials.angles * (1.0 + np.arange(trials.angles.shape[1]))).sum(axis=1)
        turn = drive[:, None, None] * TIME[:, None] * axis + phase[:, None, None]
        gain, tone = trials.models.T[:, :, None, None]
        return RecordedLog(gyro=gain * np.sin(turn) + tone * np.cos(2.0 * turn))


class Robot:
    def __init__(self, hidden: int, axes: int) -> None:
        self._rng, self._hidden, self._machine = np.random.default_rng(0), hidden, Machine(axes)
        self.commands: list[np.ndarray] = []
        self.start_angles = np.zeros(hidden)

    def perform(self, command: np.ndarray) -> RecordedLog:
        self.commands.append(command)
        self.start_angles = self._rng.uniform(-np.pi, np.pi, self._hidden)
        trial = Trials(TRUTH[None], command[None], self.start_angles[None])
        return self._machine.simulate(trial)


@pytest.mark.parametrize("condition", CONDITIONS)
@pytest.mark.parametrize(("commands", "hidden", "axes"), WIDTHS)
def test_every_width_runs_under_every_condition(commands, hidden, axes, condition):
    machine, robot = Machine(axes), Robot(hidden, axes)
    config = QUICK.under(condition)
    eea = EEA(robot, machine, problem(commands, hidden, axes), config, 1, TRUTH)
    rounds = eea.run().rounds
    assert len(rounds) == 2
    assert machine.shapes == {(2, commands, hidden)}
    for record, performed in zip(rounds, robot.commands, strict=True):
        assert len(record.command) == commands
        assert record.command == tuple(performed)
        assert len(record.min_angle) == len(record.true_angles) == hidden
        assert len(record.morphology) == len(record.spread) == 2
        assert np.isfinite(record.model_fitness)
    # Coefficients of every axis, and no others, were compared.
    assert len(eea._kept[0].experiments[0].behavior) == axes * (STEPS // 2 + 1)


@pytest.mark.parametrize(
    ("commands", "hidden", "axes"), [(1, 1, 1), (1, 3, 1), (3, 1, 2), (2, 2, 3)]
)
def test_at_any_width_the_body_is_found_if_the_angles_are_known(commands, hidden, axes):
    config = replace(QUICK.under("ideal"), estimation=EstimationConfig(20, 40), rounds=3)
    eea = EEA(Robot(hidden, axes), Machine(axes), problem(commands, hidden, axes), config, 0, TRUTH)
    assert eea.run().objective_fitness > 0.95


def test_a_log_with_other_axes_than_the_problem_says_is_refused():
    with pytest.raises(TargetError, match=r"\(B, T, 2\) .* got \(1, 16, 1\) from the target"):
        EEA(Robot(1, 1), Machine(2), problem(1, 1, 2), QUICK).run()
    with pytest.raises(TargetError, match=r"\(B, T, 1\) .* got \(\d+, 16, 2\) from the simulator"):
        EEA(Robot(1, 1), Machine(2), problem(1, 1, 1), QUICK).run()


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"models": None}, "models must be of type BitLayout; got None"),
        ({"hidden": ()}, "number of hidden angles must be a whole number of at least 1"),
        ({"hidden": "angle"}, "hidden must be a tuple of the hidden angles' names"),
        ({"axes": 0}, "axes must be a whole number of at least 1"),
    ],
)
def test_a_description_that_is_none_is_refused(changed, message):
    given = {"models": MODELS, "actions": ACTIONS, "hidden": ("a",), "axes": 1, **changed}
    with pytest.raises(ConfigurationError, match=message):
        Problem(**given)
    with pytest.raises(ConfigurationError, match="problem must be of type Problem"):
        EEA(Robot(1, 1), Machine(1), given, QUICK)


class Stubborn(Robot):
    """Executes half of what it is asked for, and says so."""

    def perform(self, command):
        return Performed(super().perform(0.5 * command), 0.5 * command)


def test_log_is_credited_to_the_executed_command():
    robot = Stubborn(1, 1)
    eea = EEA(robot, Machine(1), problem(2, 1, 1), QUICK, 0)
    rounds = eea.run().rounds
    first = EEA(Robot(1, 1), Machine(1), problem(2, 1, 1), QUICK, 0).run().rounds[0]
    assert np.array_equal(rounds[0].command, 0.5 * np.array(first.command))
    assert [record.command for record in rounds] == [tuple(c) for c in robot.commands]
    assert all(record.action_fitness is None for record in rounds)  # it is the requested one's


@pytest.mark.parametrize("executed", [[0.1], [0.1, np.nan]])
def test_an_executed_command_that_is_none_is_refused(executed):
    class Confused(Robot):
        def perform(self, command):
            return Performed(super().perform(command), executed)

    with pytest.raises(TargetError, match="the target's executed command must"):
        EEA(Confused(1, 1), Machine(1), problem(2, 1, 1), QUICK).run()
