"""Swims of a fish in which it may become another, as logs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from aquafish_gym import Damage, Morphology
from aquafish_gym.engines.compiled.single import CompiledWorld
from aquafish_gym.scenario import Scenario
from eea.core.experiment import RecordedLog
from eea.fish.swim_log import SwimLog

NOISE = 0.01
BODY = Damage.parse("left_pectoral:length=0.6").apply(Morphology.nominal())


def swim(seed, samples, become=None, at=0, noise=NOISE):
    """Return a swim of brisk commands at 4 Hz, in which the robot may become another."""
    rng, world = np.random.default_rng(seed), CompiledWorld()
    left, right, phase = rng.uniform(-np.pi, np.pi, 3).tolist()
    scenario = Scenario.create(BODY, fin_angles=(left, right, phase))
    world.start(scenario)
    commands = np.repeat(
        rng.uniform([-0.5, -0.5, 0.5], [0.5, 0.5, 1.0], (-(-samples // 25), 3)), 25, axis=0
    )[:samples]
    gyro = []
    for t, (left, right, caudal) in enumerate(commands.tolist()):
        if become is not None and t == at:
            world.update(replace(scenario, body=become.to_array()[None]))
        world.advance((left, right, caudal))
        gyro.append(world.state().spin)
    felt = RecordedLog(np.array(gyro) + rng.normal(0.0, noise, (samples, 3)))
    return SwimLog.of_trials([commands], [felt], moving=True)


def together(*logs):
    """Return logs of a trial each as one."""
    number = np.repeat(np.arange(len(logs)), [len(log.time) for log in logs])
    return SwimLog(
        *(np.concatenate([getattr(log, n) for log in logs]) for n in ("time", "gyro", "commands")),
        number,
    )
