"""The loop of a rollout for one robot and any policy, on any engine."""

from __future__ import annotations

import copy
import math

import numpy as np

from aquafish_gym.command import servo_speeds
from aquafish_gym.envs.robots import OneRobot
from aquafish_gym.envs.tasks import Memory, Step, Task
from aquafish_gym.physics.arithmetic import Number, Vector
from aquafish_gym.physics.kinematics import State
from aquafish_gym.rollout.plan import Act, Path, Plan
from aquafish_gym.scenario import TIMESTEP
from aquafish_gym.sense import beyond_imu, imu, limits
from aquafish_gym.utils.array_types import Floats
from aquafish_gym.utils.validation import finite_array


class _NoTask(Task):
    def reward_terms(self, step: Step) -> dict[str, Number]:  # noqa: ARG002
        return {}


def swim_one(act: Act, plan: Plan, robot: int, engine: str) -> tuple[float, bool, Path]:
    """Return the return, whether it diverged, and the path of one robot.

    This is the loop that the compiled one runs for many.
    """
    task = plan.task or _NoTask()
    rngs = [copy.deepcopy(rng) for rng in plan.rngs[robot : robot + 1]]
    memory: Memory = tuple(plan.memory[robot].tolist())
    total = 0.0
    fins = len(plan.scenario.plan.fins)
    path = np.full((-(-plan.steps // plan.interval) + 1, 7 + fins), math.nan)
    gyro = np.full((plan.steps, 3), math.nan)
    commands = np.full((plan.steps, fins), math.nan)
    most = limits(has_goal=task.has_goal)
    scenario = plan.scenario.take(robot)
    fish = OneRobot(engine, scenario, plan.interval, dtype=np.float64, substeps=plan.substeps)
    world = fish.start(scenario)
    try:
        for count, t in enumerate(range(0, plan.steps, plan.interval)):
            fish.change(t)
            before = world.state()
            path[count] = _sample(before)
            fish.flow(task.current(memory, t * TIMESTEP))
            goal = task.goal(memory) if task.has_goal else None
            observation = fish.sense(_observe(before, goal), most, rngs)
            action = finite_array("action", act(observation, t * TIMESTEP), (fins,))
            done = tuple(np.clip(action, -1.0, 1.0).tolist())
            command = servo_speeds(plan.scenario.plan, done)
            followed = servo_speeds(plan.scenario.plan, fish.robots.follow(done))
            for k in range(t, min(t + plan.interval, plan.steps)):
                fish.change(k)
                world.advance(followed)
                gyro[k] = world.state().spin
                commands[k] = command
            if world.diverged:
                break
            after = world.state()
            step = Step(before.position, after.position, after.orientation, done, memory, plan.dt)
            total += float(sum(task.reward_terms(step).values()))
            memory = task.remember(step)
        else:
            path[-1] = _sample(after)
        diverged = world.diverged
    finally:
        fish.close()
    time = np.array([*range(0, plan.steps, plan.interval), plan.steps]) * TIMESTEP
    return total, diverged, Path(time, path[:, :3], path[:, 3:7], path[:, 7:], gyro, commands)


def _observe(state: State, goal: Vector | None) -> Floats:
    """Return what intact sensors observe, in double precision and not yet saturated."""
    return np.array(imu(state) + beyond_imu(state, goal=goal))


def _sample(state: State) -> tuple[float, ...]:
    angles = map(math.atan2, state.joints[1::2], state.joints[::2])
    return (*state.position, *state.orientation, *angles)
