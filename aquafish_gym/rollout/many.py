"""The rollout of many robots at once, in the compiled loop."""

from __future__ import annotations

import copy
from itertools import pairwise
from typing import Any

import numpy as np

from aquafish_gym.engines.worlds import RUNAWAY
from aquafish_gym.envs.tasks import REMEMBERED, Memory, Step, Task, compiled_task
from aquafish_gym.physics.arithmetic import TAU
from aquafish_gym.physics.layout import FIELDS
from aquafish_gym.rollout.plan import Floats, Path, Plan, Program, Trajectories, is_noisy
from aquafish_gym.scenario import TIMESTEP, Scenario
from aquafish_gym.utils.validation import InvalidArgumentError


def swim_all(
    program: Program,
    plan: Plan,
    fins: Floats,
    gains: Floats,
    dtype: type[np.floating],
    threads: int | None,
) -> Trajectories:
    """Swim all robots in the compiled loop, which stops where some of them change."""
    # numba comes with its engine: importing this module stays quick.
    from aquafish_gym.engines.compiled.closed_loop import ClosedLoop
    from aquafish_gym.engines.compiled.lanes import LaneBatch, pack_rows

    scenario, task = plan.scenario, plan.task
    if np.any(scenario.servo_lag):
        raise InvalidArgumentError(
            f"servo_lag must be 0 where many swim at once; got {scenario.servo_lag.max():g} s"
        )
    compiled = None if task is None else compiled_task(task)
    lanes = LaneBatch(scenario, dtype, plan.substeps, threads)
    loop = ClosedLoop(lanes.batch, lanes.width, dtype, program.scratch)
    loop["fins"], loop["gain"] = fins.T / TAU, gains.T
    judge = None
    if compiled is not None:
        loop.functions, loop.task = compiled
        loop["memory"] = np.pad(plan.memory.T, ((0, REMEMBERED - plan.memory.shape[1]), (0, 0)))
    elif task is not None:
        judge = _Judge(task, plan, lanes, loop)
    if plan.broken_sensors:
        loop.broken = True
        if is_noisy(scenario):
            loop.set_noise(_drawn_noise(plan))
        _set_sensors(loop, slice(None), scenario)
    weights = pack_rows(program.weights, dtype, lanes.width)
    edges = {0, plan.steps, *(step for step, *_ in scenario.schedule if step < plan.steps)}
    if judge is not None:
        edges.update(range(0, plan.steps, plan.interval))
    logs = []
    for begin, until in pairwise(sorted(edges)):
        for _, rows, to in (change for change in scenario.schedule if change.step == begin):
            lanes.update(rows, to, keep_current=plan.flows)
            if loop.broken:
                _set_sensors(loop, rows, to)
        if judge is not None and begin % plan.interval == 0:
            judge.begin(begin)
        log = lanes.run(
            program.function, weights, program.layout, until - begin, program.interval,
            "path" if plan.path else "nothing", loop=loop,
        )  # fmt: skip
        logs.append((log, loop.commands))
        if loop.broken and any(t % plan.interval == 0 for t in range(begin, until)):
            loop["fresh"] = 0.0  # they are observed
        if judge is not None and until % plan.interval == 0:
            judge.end()
    returns, diverged = loop["total"][0], lanes.diverged() | (loop["alive"][0] == 0.0)
    end = np.where(diverged[:, None], np.nan, lanes.rows(FIELDS["position"]).T)
    return Trajectories(returns, diverged, end, _path(plan, logs) if plan.path else None)


class _Judge:
    """A task that is not built in, for rows of robots, between two calls of the compiled loop."""

    def __init__(self, task: Task, plan: Plan, lanes: Any, loop: Any) -> None:
        self._task, self._plan, self._lanes, self._loop = task, plan, lanes, loop
        self._memory: Memory = tuple(plan.memory.T)

    def begin(self, step: int) -> None:
        """Set the water and the goal of an action."""
        water = self._task.current(self._memory, np.full(len(self._plan.scenario), step * TIMESTEP))
        if water is not None:
            self._lanes.set_current(np.stack(np.broadcast_arrays(*water), axis=1))
        if self._task.has_goal:
            self._loop["goal"] = np.stack(np.broadcast_arrays(*self._task.goal(self._memory)))
        self._before = self._lanes.rows()

    def end(self) -> None:
        """Add the reward of the action."""
        loop, rows = self._loop, self._lanes.rows()
        step = Step(
            tuple(self._before[FIELDS["position"]]),
            tuple(rows[FIELDS["position"]]),
            tuple(rows[FIELDS["orientation"]]),
            tuple(loop["action"]),
            self._memory,
            self._plan.dt,
        )  # fmt: skip
        speeds = np.square(rows[FIELDS["velocity"].start : FIELDS["spin"].stop]).sum(axis=0)
        alive = loop["alive"][0] * (speeds < RUNAWAY)
        reward = sum(self._task.reward_terms(step).values())
        loop["total"] += np.where(alive, reward, 0.0)
        loop["alive"] = alive[None]
        self._memory = self._task.remember(step)


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
    """Return the gyroscopes' noise in each observation (K, 3, B), drawn as ``Sensors`` does."""
    batch, begins = len(plan.scenario), np.arange(0, plan.steps, plan.interval)
    deviation = np.tile(plan.scenario.gyro_noise, (len(begins), 1))
    for step, rows, to in plan.scenario.schedule:
        deviation[np.ix_(begins >= step, rows)] = to.gyro_noise
    noise, streams = np.zeros((len(begins), 3, batch)), dict[int, Floats]()
    for b in np.flatnonzero(deviation.any(axis=0)).tolist():
        rng, noisy = plan.rngs[b], deviation[:, b] > 0.0
        if id(rng) not in streams:
            streams[id(rng)] = copy.deepcopy(rng).standard_normal((len(begins), 3))
        drawn = streams[id(rng)][: np.count_nonzero(noisy)]
        noise[noisy, :, b] = drawn * deviation[noisy, b, None]
    return noise


def _path(plan: Plan, logs: list[tuple[Any, Any]]) -> Path:
    """Return the path of robots from the logs of its parts."""
    batch, last = len(plan.scenario), plan.steps - 1
    after = [*range(plan.interval - 1, last, plan.interval), last]

    def whole(name: str) -> Floats:
        return np.concatenate([getattr(log, name) for log, _ in logs], axis=1, dtype=np.float64)

    def sampled(name: str, first: Floats) -> Floats:
        return np.concatenate([first[:, None], whole(name)[:, after]], axis=1)

    start = plan.scenario.fin_angles
    return Path(
        time=plan.times,
        position=sampled("position", np.zeros((batch, 3))),
        quaternion=sampled("quaternion", np.tile([0.0, 0.0, 0.0, 1.0], (batch, 1))),
        fin_angles=sampled("fin_angles", np.arctan2(np.sin(start), np.cos(start))),
        gyro=whole("gyro"),
        commands=np.concatenate([part for _, part in logs], axis=1, dtype=np.float64),
    )
