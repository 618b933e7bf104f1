"""Recovery without stopping: the damage strikes a robot that models itself as it swims."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from aquafish.online.agent import AgentConfig, SelfModelAgent
from aquafish.online.gaits import ControllerGait, imagine
from aquafish_gym import Damage, Morphology
from aquafish_gym.damage import Fault
from aquafish_gym.envs.env import AquaFishEnv
from aquafish_gym.envs.tasks import SwimForward
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.array_types import Floats
from aquafish_gym.utils.validation import instance
from gait.controllers.controller import Controller
from gait.swims.episode import transitions
from gait.swims.poses import random_poses
from gait.swims.transfer import TransferConfig

ONSET_SECONDS = 12.0  # s; in the first ten the agent measures its model's error


def swim_on(
    morphology: Morphology,
    damage: Damage,
    config: TransferConfig,
    noise: float,
    reactive: bool = False,
) -> tuple[Morphology, Controller, Floats, Floats]:
    """Return the self-model and the gait of a robot that breaks in mid-swim, and how far it swims.

    It swims the library's first gait until ``damage`` strikes, and for ``config.seconds`` after it.
    The agent knows its initial fin angles, and whether its water is ``reactive``, and observes its
    gyroscope alone, with ``noise`` (rad/s).

    Returns
    -------
    body, gait
        The recognised body and the last gait of the swim from the zero pose.
    native, target
        (1 + poses,) from the zero pose and from each random one, in units: how far the last gait
        would swim on the self-model from the last state in ``config.seconds``, and how far the
        robot swam after the damage; NaN if it diverged.
    """
    plan = morphology.plan
    faults = [replace(fault, onset=ONSET_SECONDS) for fault in damage]
    faults += [Fault("gyro", "noise", noise)] if noise else []
    end = ONSET_SECONDS + config.seconds
    task = SwimForward(seconds=0.2 * math.ceil(end / 0.2 - 1e-9))
    env = AquaFishEnv(
        morphology, Damage(tuple(faults)), config.target_engine,
        task=task, reactive=reactive, plan=plan,
    )  # fmt: skip
    settings = AgentConfig(
        end,
        gyro_noise=noise,
        gyro_only=True,
        refinements=1,  # which therefore may take as long as any
        quick_generations=AgentConfig.generations,
        quick_seconds=AgentConfig.refinement_seconds,
        seed=config.seed,
    )
    env.reset(seed=config.seed)
    bodies = []
    gaits = []
    native = []
    target = []
    robot = Scenario.create(morphology, reactive=reactive)
    for pose in (np.zeros(len(plan.fins)), *random_poses(config.poses, config.seed, plan)):
        # Without teachers: the case study compares and exports controllers.
        agent = SelfModelAgent(config=settings, robot=robot, teachers=())
        observation, _ = env.reset(options={"fin_angles": pose})
        agent.begin(pose)
        steps = list(transitions(env, agent.act, observation))
        way = [0.0, *(step.info["y_position"] for step in steps)]
        first, last = np.interp((ONSET_SECONDS, end), env.dt * np.arange(len(way)), way)
        target.append(math.nan if steps[-1].terminated else last - first)
        model = agent.model
        gait = instance("gait", agent.gait, ControllerGait).controller
        native.append(imagine([gait], model.robot, model.state, config.seconds)[0])
        bodies.append(model.robot.body[0])
        gaits.append(gait)
    env.close()
    return Morphology.from_array(bodies[0], plan), gaits[0], np.array(native), np.array(target)
