"""A robot that is a line of arithmetic, for fast tests of joint inference around it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from eea.core.config import JointConfig
from eea.core.experiment import RecordedLog
from eea.core.genome import action_layout, model_layout
from eea.core.problem import Problem
from eea.infer.robot import Robot
from eea.infer.session import JointInference
from eea.infer.statement import Hypothesis, Number, Part

STEPS = 64
TRUTH = np.array([1.3, 0.4])
BIAS, SIGMA = 0.02, 0.01
CONFIG = JointConfig(
    steps=STEPS, rounds=2, noise=SIGMA, bodies=16, poses=16, descents=4, polished=2, restarts=0
)


def simulate(values, commands):
    """Return an axis that swings as the motor does, and one that it drags along."""
    time = 0.01 * np.arange(1, STEPS + 1)
    length, friction, bias, motor, angle = (
        values[name][:, None] for name in ("arm.length", "arm.friction", "bias", "motor", "angle")
    )
    phase = 2 * np.pi * (1.0 + commands[:, :1] * motor) * time + angle
    rate = np.stack([length * np.sin(phase), friction * np.cos(2 * phase)], axis=-1)
    return rate + bias[:, :, None]


PROBLEM = Problem(
    model_layout([("arm.length", 2.0, 6), ("arm.friction", 1.0, 5)]),
    action_layout([("speed", -1.0, 1.0)]),
    ("angle",),
    axes=2,
)
SWING = Robot(
    simulate,
    {
        "arm.length": Number(0.0, 2.0),
        "arm.friction": Number(0.0, 1.0),
        "bias": Number(-0.1, 0.1, mean=0.0, sd=0.05),
        "motor": Number(0.0, 1.0, mean=1.0, switch=True),
        "angle": Number.angle(),
    },
    {"arm": "rad/s", "dragged": "rad/s"},
    hypotheses=(Hypothesis("the motor is dead", {"motor": 0.0}),),
    parts={"arm": Part({"arm.length": "length", "arm.friction": "friction"}, hint="go faster")},
)


class Swinging:
    """The robot itself: it tells nothing but its log."""

    def __init__(self, seed=0, motor=1.0, sigma=SIGMA):
        self._rng = np.random.default_rng(seed)
        self._sigma = sigma
        names = ("arm.length", "arm.friction", "bias", "motor")
        numbers = (*TRUTH, BIAS, motor)
        self._values = {name: np.array([v]) for name, v in zip(names, numbers, strict=True)}

    def perform(self, command):
        angle = self._rng.uniform(-np.pi, np.pi, 1)
        felt = simulate({**self._values, "angle": angle}, command[None])[0]
        return RecordedLog(gyro=felt + self._sigma * self._rng.normal(size=felt.shape))


def infer(seed=0, motor=1.0, robot=SWING, **settings):
    """Return the result of a small run; ``settings`` are of ``JointConfig``."""
    config = replace(CONFIG, **settings)
    return JointInference(Swinging(seed, motor), robot, PROBLEM, config, seed, TRUTH).run()
