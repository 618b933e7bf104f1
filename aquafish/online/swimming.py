"""The gait that is swum: how it begins, acts, and goes on in imagination."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from aquafish.online.self_model import SelfModel, imu_readings
from aquafish.online.teacher_gait import TeacherAgent, TeacherGait
from aquafish_gym.command import scale_action
from aquafish_gym.engines.compiled.lanes import LaneBatch
from aquafish_gym.physics.layout import FIELDS, angles_of_rows
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.array_types import Floats
from gait.controllers.agents import ControllerAgent
from gait.controllers.controller import Controller

Gait = Controller | TeacherGait
Swimmer = ControllerAgent | TeacherAgent


class Ahead(NamedTuple):
    """Where a robot will be after some actions."""

    state: Floats  #: (25,)
    action: NDArray[np.float32]  #: (3,) the last one; 0 without one.
    way: float  #: How far it will swim along +y from there until the end, units.


def begin_gait(gait: Gait, robot: Scenario, previous: NDArray[np.floating]) -> Swimmer:
    """Return an agent that swims a gait, beginning now; see :func:`act_in`.

    A teacher's gait is given ``robot`` and the ``previous`` action (3,).
    """
    if isinstance(gait, TeacherGait):
        return TeacherAgent(gait, robot, previous)
    agent = ControllerAgent(gait)
    agent.reset({"fin_angles": np.zeros(3)})  # act_in sets them
    return agent


def act_in(agent: Swimmer, robot: Scenario, state: Floats) -> NDArray[np.float32]:
    """Return the next action (3,), in [-1, 1], of a robot in a state (25,).

    A controller knows its fin angles, a teacher the robot's sizes and servo gains.
    """
    if isinstance(agent, TeacherAgent):
        agent.inform(robot)
        return agent.act(state)
    agent.fin_angles = angles_of_rows(state)[None]
    return agent.act(imu_readings(state[:, None])[0])


def swim_ahead(agent: Swimmer, model: SelfModel, actions: int, until: int) -> Ahead:
    """Return the state after some actions, and the way from there until another.

    Both are counted from now. A copy of the agent swims: it does not change itself.
    """
    swimmer = agent.copy()
    lanes = LaneBatch(model.robot, threads=1, states=model.state[:, None])
    state = model.state
    then = Ahead(state, np.zeros(3, np.float32), 0.0)
    for k in range(1, until + 1):
        action = act_in(swimmer, model.robot, state)
        lanes.advance(scale_action(action[None]), model.hold)
        state = lanes.states[:, 0].astype(np.float64)
        if k == actions:
            then = Ahead(state, action, 0.0)
    y = FIELDS["position"].start + 1
    return then._replace(way=float(state[y] - then.state[y]))
