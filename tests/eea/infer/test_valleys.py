"""Joint inference where two valleys explain the trial, and the lower one is by far the narrower."""

from __future__ import annotations

import numpy as np

from eea.core.config import JointConfig
from eea.core.experiment import RecordedLog
from eea.core.genome import action_layout, model_layout
from eea.core.problem import Problem
from eea.infer.robot import Robot
from eea.infer.session import JointInference
from eea.infer.statement import Number

SIGMA, NARROW, WIDE, MISSED = 0.01, 0.15, 0.8, 0.003
PROBLEM = Problem(
    model_layout([("radius", 1.0, 6)]), action_layout([("speed", 0.0, 2.0)]), ("angle",), 1
)


def wheel(values, commands):
    """A wheel that fits at radius 0.15 alone, and but for a small wobble all about radius 0.8."""
    bodies = values["radius"][:, None]
    near = bodies < 0.6
    swing = 1.0 + np.where(near, 0.4 * (bodies - NARROW), 0.03 * (bodies - WIDE))
    turned = 0.1 * commands * np.arange(64) + values["angle"][:, None]
    wobble = np.where(near, 0.0, MISSED) * np.cos(3.0 * turned)
    return (swing * np.sin(turned) + wobble)[:, :, None]


class Target:
    def perform(self, command):
        values = {"radius": np.array([NARROW]), "angle": np.array([0.5])}
        felt = wheel(values, command[None])
        noise = np.random.default_rng(0).normal(0.0, SIGMA, felt.shape)
        return RecordedLog(gyro=felt + noise)


def test_what_comes_to_the_lower_valley_does_not_crowd_out_the_likelier_one() -> None:
    config = JointConfig(steps=64, rounds=1, noise=SIGMA, bodies=24)
    robot = Robot(wheel, {"radius": Number(0.0, 1.0), "angle": Number.angle()}, {"gyro": "rad/s"})
    result = JointInference(Target(), robot, PROBLEM, config).run()
    sample = result.sample(1000)
    assert 0.5 < (sample > 0.6).mean() < 1.0
    modes = result.to_dict()["belief"]["modes"]["nothing is broken"]["values"]
    assert abs(modes[0][0] - NARROW) < 0.01  # the lowest, and yet the less probable
