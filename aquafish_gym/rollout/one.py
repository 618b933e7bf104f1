"""The loop of a rollout for one robot and any policy, on any engine."""

from __future__ import annotations

import copy
import math

import numpy as np

from aquafish_gym.command import lane_servo_speeds, reckon, scale_action
from aquafish_gym.damage.delays import DelayLines, delay_steps, longest
from aquafish_gym.damage.sensors import ONLY_ROBOT, Readings, Sensors
from aquafish_gym.engines.worlds import make_world
from aquafish_gym.envs.tasks import Memory, Step, Task
from aquafish_gym.physics.arithmetic import TAU, Number, Vector
from aquafish_gym.physics.kinematics import State
from aquafish_gym.rollout.plan import Act, Path, Plan, Program
from aquafish_gym.scenario import TIMESTEP, Scenario
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
    now = plan.scenario.take(robot)
    changes = {step: to for step, _, to in now.schedule}
    rngs = [copy.deepcopy(rng) for rng in plan.rngs[robot : robot + 1]]
    memory: Memory = tuple(plan.memory[robot].tolist())
    total = 0.0
    most = limits(observe_fins=False, has_goal=False)
    path = np.full((-(-plan.steps // plan.interval) + 1, 10), math.nan)
    gyro, commands = np.full((2, plan.steps, 3), math.nan)
    sensors, servos = Sensors(1, np.float64, dt=plan.dt), DelayLines(1, 3, first=np.zeros(3))
    for stage in (now, *changes.values()):
        sensors.remember(stage.sensor_delay)
        servos.remember(longest(stage.servo_delay, plan.dt))
    _set_channels(now, sensors, servos, plan.dt)
    world = make_world(engine, now, plan.substeps)
    try:
        for count, t in enumerate(range(0, plan.steps, plan.interval)):
            if t in changes:
                world.update(changes[t])
                _set_channels(changes[t], sensors, servos, plan.dt)
            state = world.state()
            path[count] = _sample(state)
            water = task.current(memory, t * TIMESTEP)
            if water is not None:
                water = (float(water[0]), float(water[1]), float(water[2]))
                world.set_current(water)
            observation = np.array(imu(state))
            if sensors.broken:
                observation = sensors.observe(observation[None], -most, most, rngs, ONLY_ROBOT)[0]
            if task.has_goal:
                way = beyond_imu(state, goal=task.goal(memory))
                observation = np.concatenate([observation, way])
            action = finite_array("action", act(observation, t * TIMESTEP), (3,))
            left, right, caudal = scale_action(action).tolist()
            follow = servos.carry(np.array([[left, right, caudal]]), ONLY_ROBOT)[0].tolist()
            for k in range(t, min(t + plan.interval, plan.steps)):
                if k > t and k in changes:
                    world.update(changes[k])
                    _set_channels(changes[k], sensors, servos, plan.dt)
                    if water is not None:
                        world.set_current(water)
                world.advance((follow[0], follow[1], follow[2]))
                gyro[k], commands[k] = world.state().spin, (left, right, caudal)
            if world.diverged:
                break
            after = world.state()
            done = tuple(np.clip(action, -1.0, 1.0).tolist())
            step = Step(state.position, after.position, after.orientation, done, memory, plan.dt)
            total += float(sum(task.reward_terms(step).values()))
            memory = task.remember(step)
        else:
            path[-1] = _sample(after)
        diverged = world.diverged
    finally:
        world.close()
    time = np.array([*range(0, plan.steps, plan.interval), plan.steps]) * TIMESTEP
    return total, diverged, Path(time, path[:, :3], path[:, 3:7], path[:, 7:], gyro, commands)


def _sample(state: State) -> tuple[float, ...]:
    pairs = (state.left, state.right, state.phase)
    angles = [math.atan2(sine, cosine) for cosine, sine in pairs]
    return (*state.position, *state.orientation, *angles)


def _set_channels(robot: Scenario, sensors: Sensors, servos: DelayLines, dt: float) -> None:
    """Let a robot's sensors and the links to its servos become what a scenario says."""
    sensors.update(ONLY_ROBOT, Readings.of(robot))
    servos.update(ONLY_ROBOT, delay_steps(robot.servo_delay, dt), robot.servo_hold / dt)


def act_alone(program: Program, robot: int, fins: Floats, gains: Floats) -> Act:
    """Return one robot's program on plain floats."""
    weights, layout = program.weights[:, robot].tolist(), program.layout.tolist()
    scratch, held = [0.0] * program.scratch, program.interval * TIMESTEP
    left, right, phase = (fins / TAU).tolist()
    angles: Vector = (left, right, phase)

    def act(observation: Floats, time: float) -> Vector:
        nonlocal angles
        o = [*observation.tolist(), 0.0, 0.0, 0.0]
        action = program.function(
            weights, layout, scratch, 0, 1, time, o[0:3], o[3:6], o[6:9], angles, o[9:12]
        )
        left, right, caudal = lane_servo_speeds(action)
        angles = reckon(angles, (gains[0] * left, gains[1] * right, gains[2] * caudal), held)
        return action

    return act
