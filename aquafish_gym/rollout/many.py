"""The rollout of many robots at once, in the compiled loop."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np

from aquafish_gym.engines.worlds import batch_class
from aquafish_gym.envs.tasks import Task, compiled_task
from aquafish_gym.physics.arithmetic import TAU
from aquafish_gym.rollout.plan import Plan, Program, Trajectories
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.array_types import Floats


def swim_many(
    program: Program,
    plan: Plan,
    fins: Floats,
    gains: Floats,
    dtype: type[np.floating],
    threads: int | None,
    start: Floats | None = None,
    engine: str = "numba",
) -> Trajectories:
    """Swim all robots in the compiled loop, which stops where some of them change."""
    # numba comes with its engine: importing this module stays quick.
    from aquafish_gym.engines.compiled.closed_loop import ClosedLoop
    from aquafish_gym.engines.compiled.lanes import pack_rows

    scenario = plan.scenario
    lanes = batch_class(engine)(scenario, dtype, plan.substeps, threads, states=start)
    loop = ClosedLoop(lanes.batch, len(scenario.plan.fins), lanes.width, dtype, program.scratch)
    loop["fins"], loop["gain"] = fins.T / TAU, gains.T
    compiled = compiled_task(plan.task)
    if compiled is not None:
        loop.functions, loop.task = compiled
        loop.set_memory(plan.memory.T)
    loop.broken = scenario.has("gyro_noise", "sensor_bias", "sensor_stuck", "sensor_dropped")
    if loop.broken:
        if scenario.has("gyro_noise"):
            loop.set_noise(_drawn_noise(plan))
        _set_sensors(loop, slice(None), scenario.beginning)
    flows = plan.task is not None and type(plan.task).current is not Task.current
    weights = pack_rows(program.weights, dtype, lanes.width)
    for begin, end, robots, to in scenario.segments(plan.steps):
        if to is not None:
            lanes.update(to, robots, keep_current=flows)
            if loop.broken:
                _set_sensors(loop, robots, to)
        lanes.run(program.function, weights, program.layout, end - begin, program.interval, loop)
        if loop.broken and any(t % plan.interval == 0 for t in range(begin, end)):
            loop["fresh"] = 0.0  # they are observed
    diverged = lanes.diverged | (loop["alive"][0] == 0.0)
    reached = np.where(diverged[:, None], np.nan, np.transpose(lanes.state().position))
    return Trajectories(loop["total"][0], diverged, reached)


def _set_sensors(loop: Any, rows: Any, robots: Scenario) -> None:
    """Let the sensors of the robots ``rows`` be as a scenario of theirs says."""
    stuck = loop["stuck"][:, rows]
    for name, value in (
        ("bias", robots.sensor_bias),
        ("fresh", robots.sensor_stuck & ~stuck.astype(np.bool_).T),
        ("stuck", robots.sensor_stuck),
        ("dropped", robots.sensor_dropped),
    ):
        table = loop[name]
        table[:, rows] = value.T
        loop[name] = table


def _drawn_noise(plan: Plan) -> Floats:
    """Return the gyroscopes' noise in each observation (K, 3, B), drawn as ``Side`` does."""
    batch, begins = len(plan.scenario), np.arange(0, plan.steps, plan.interval)
    deviation = np.tile(plan.scenario.beginning.gyro_noise, (len(begins), 1))
    for step, _, robots, to in plan.scenario.segments(plan.steps):
        if to is not None:
            deviation[np.ix_(begins >= step, robots)] = to.gyro_noise
    noise, streams = np.zeros((len(begins), 3, batch)), dict[int, Floats]()
    for b in np.flatnonzero(deviation.any(axis=0)).tolist():
        rng, noisy = plan.rngs[b], deviation[:, b] > 0.0
        if id(rng) not in streams:
            streams[id(rng)] = copy.deepcopy(rng).standard_normal((len(begins), 3))
        drawn = streams[id(rng)][: np.count_nonzero(noisy)]
        noise[noisy, :, b] = drawn * deviation[noisy, b, None]
    return noise
