"""``simulate`` on PyBullet: one robot after another."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.engines.bullet.push import compiled_follow
from aquafish_gym.engines.bullet.world import BulletWorld
from aquafish_gym.imu import ImuLog
from aquafish_gym.scenario import Scenario


def simulate_bullet(
    scenario: Scenario,
    commands: NDArray[np.float64],
    steps: int,
    substeps: int = 1,
    record: str = "attitude",
    interval: int = 1,
) -> ImuLog:
    """Simulate a scenario with PyBullet, in double precision; see :func:`aquafish_gym.simulate`."""
    batch = len(scenario)
    rpy, gyro = np.empty((batch, steps, 3)), np.empty((batch, steps, 3))
    position, quaternion = np.empty((batch, steps, 3)), np.empty((batch, steps, 4))
    fins = len(scenario.plan.fins)
    fin_angles = np.empty((batch, steps, fins))
    spins = np.empty((steps, 3))
    diverged = np.zeros(batch, dtype=np.bool_)
    fill = compiled_follow()
    for i in range(batch):
        one = scenario.take(i)
        world = BulletWorld(substeps)
        try:
            world.start(one)
            series = [tuple(command) for command in commands[i].reshape(-1, fins).tolist()]
            for begin, end, _, to in one.segments(steps):
                if to is not None:
                    world.update(to)
                for t in range(begin, end):
                    world.advance(series[min(t // interval, len(series) - 1)])
                    position[i, t] = world.position
                    quaternion[i, t] = world.orientation
                    spins[t] = world.world_spin
                    fin_angles[i, t] = world.fin_angles
            diverged[i] = world.diverged
        finally:
            world.close()
        good = steps
        if diverged[i]:
            good = int(np.isfinite(quaternion[i]).all(axis=1).sum())
            rpy[i, good:] = gyro[i, good:] = math.nan
        fill(quaternion[i, :good], spins[:good], rpy[i, :good], gyro[i, :good])
    pose = record == "pose"
    return ImuLog(
        rpy=None if record == "gyro" else rpy,
        gyro=None if record == "rpy" else gyro,
        position=position if pose else None,
        quaternion=quaternion if pose else None,
        fin_angles=fin_angles if pose else None,
        diverged=diverged,
    )
