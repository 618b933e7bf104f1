"""A robot that is a few lines of arithmetic, for fast tests of the search around it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eea.core.algorithm import EEA
from eea.core.experiment import RecordedLog, Simulator, Trials
from eea.core.genome import action_layout, model_layout
from eea.core.problem import Problem

STEPS = 64
TABLE = [
    ("left.width", 1.0, 5),
    ("left.length", 2.0, 6),
    ("left.thickness", 0.5, 4),
    ("right.width", 1.0, 5),
    ("right.length", 2.0, 6),
    ("right.thickness", 0.5, 4),
    ("tail.thickness", 0.5, 4),
    ("tail.length", 2.0, 6),
    ("tail.width", 1.0, 5),
]
MODELS = model_layout(TABLE)
ACTIONS = action_layout([("left", -0.5, 0.5), ("right", -0.5, 0.5), ("tail", 0.0, 1.0)])
PROBLEM = Problem(MODELS, ACTIONS, ("left", "right", "tail"), axes=3)
TRUTH = np.array([0.4, 0.8, 0.1, 0.4, 1.6, 0.1, 0.4, 1.4, 0.6])


class FakeSimulator(Simulator):
    """Each fin makes one axis's rate swing, by its sizes and from its angle."""

    def __init__(self, steps=STEPS):
        self.steps = steps
        self.calls = 0
        self.sizes: list[int] = []

    def simulate(self, trials):
        self.calls += 1
        self.sizes.append(len(trials))
        sizes = trials.models.reshape(-1, 3, 3, 1) / np.array([1.0, 2.0, 1.0])[:, None]
        time = 0.01 * np.arange(1, self.steps + 1)
        phase = 2 * np.pi * 3.0 * trials.commands[..., None] * time + trials.angles[..., None]
        swing = sizes[:, :, 0] * np.sin(phase) + sizes[:, :, 1] * (1 - np.cos(phase))
        swing = swing + sizes[:, :, 2] * np.sin(2 * phase)
        return RecordedLog(np.ascontiguousarray(swing.transpose(0, 2, 1)))


class FakeTarget:
    """The fake robot with a body and angles of its own; it tells only what its IMU felt."""

    def __init__(self, seed=0, steps=STEPS):
        self._rng = np.random.default_rng(seed)
        self._simulator = FakeSimulator(steps)
        self.commands: list[NDArray[np.float64]] = []
        self._last = np.zeros(3)

    def perform(self, command):
        self.commands.append(command)
        self._last = self._rng.uniform(-np.pi, np.pi, size=3)
        return self._simulator.simulate(Trials(TRUTH[None], command[None], self._last[None]))


class FakeRevealingTarget(FakeTarget):
    @property
    def start_angles(self):
        return self._last


def fake_eea(config, seed=0, truth=True):
    """The algorithm bound to the fake robot, whose trials are as long as ``config.steps``."""
    return EEA(
        FakeRevealingTarget(seed, config.steps),
        FakeSimulator(config.steps),
        PROBLEM,
        config,
        seed,
        TRUTH if truth else None,
    )
