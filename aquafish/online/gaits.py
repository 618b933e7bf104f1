"""Gaits on the self-model: which swims farthest from its very state, and the one being swum."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aquafish.online.self_model import SelfModel, imu_readings
from aquafish_gym.command import scale_action
from aquafish_gym.engines.compiled.lanes import LaneBatch
from aquafish_gym.physics.layout import FIELDS, angles_of_rows
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.array_types import Floats
from aquafish_gym.utils.storage import read_document, read_packaged
from aquafish_gym.world_config import WorldConfig
from gait.controllers.agent import ControllerAgent
from gait.controllers.controller import Controller
from gait.scores.fitness import swim_scores

LIBRARY_SCHEMA = "aquafish.library/1"
MAXIMUM_REFINED_NODES = 30  # nodes of a network that CMA-ES refines in a second


def read_library(path: Path | None = None) -> dict[str, Any]:
    """Return the content of a library: its ``gaits``, and what they took, ``offline``.

    It is the packaged one for None. ``experiments.gaits.library`` made that.
    """
    if path is not None:
        return read_document(path, LIBRARY_SCHEMA, "library")
    return read_packaged("aquafish.online", "library.json", LIBRARY_SCHEMA)


def load_library(path: Path | None = None) -> list[Controller]:
    """Return the gaits of a library: two for the whole robot, then those for broken ones."""
    return [Controller.from_dict(one) for one in read_library(path)["gaits"]]


def imagine(
    controllers: Sequence[Controller], robot: Scenario, state: Floats, seconds: float
) -> Floats:
    """Return how far (P,) controllers would swim along +y from a state (25,), in units.

    ``robot`` is a scenario of one. The controllers know its fin angles and servo gains.
    """
    world = WorldConfig.of(robot)
    far = swim_scores(
        controllers, robot.body[0], seconds=seconds, world=world, threads=1, start=state
    )
    return far[:, 0]


def gait_to_refine(
    swum: Controller, gaits: Sequence[Controller], robot: Scenario, state: Floats, seconds: float
) -> Controller | None:
    """Return the gait that is swum; if it is too large to refine, the best small one, if any.

    The others are compared as by :func:`imagine`.
    """
    if swum.nodes <= MAXIMUM_REFINED_NODES:
        return swum
    small = [gait for gait in gaits if gait.nodes <= MAXIMUM_REFINED_NODES]
    return small[int(imagine(small, robot, state, seconds).argmax())] if small else None


def begin_gait(gait: Controller) -> ControllerAgent:
    """Return an agent that swims a gait, beginning now; see :func:`act_in`."""
    agent = ControllerAgent(gait)
    agent.reset({"fin_angles": np.zeros(3)})  # act_in sets them
    return agent


def act_in(agent: ControllerAgent, state: Floats) -> NDArray[np.float32]:
    """Return the next action (3,), in [-1, 1], in a state (25,), whose fin angles it knows."""
    agent.fin_angles = angles_of_rows(state)[None]
    return agent.act(imu_readings(state[:, None])[0])


def swim_ahead(
    agent: ControllerAgent, model: SelfModel, actions: int, until: int
) -> tuple[Floats, float]:
    """Return the state (25,) after some actions, and the way from there until another, units.

    Both are counted from now. A copy of the agent swims: it does not change itself.
    """
    swimmer = agent.copy()
    lanes = LaneBatch(model.robot, threads=1)
    lanes.states[:] = model.state[:, None]
    states = [model.state]
    for _ in range(until):
        action = act_in(swimmer, states[-1])
        lanes.advance(scale_action(action[None]), model.hold)
        states.append(lanes.states[:, 0].astype(np.float64))
    then = states[actions]
    y = FIELDS["position"].start + 1
    return then, float(states[-1][y] - then[y])
