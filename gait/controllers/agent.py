"""A controller as an agent: it acts for one robot, or for all robots of a batched environment."""

from __future__ import annotations

import copy
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.rollout.plan import PROGRAM_CHANNELS
from aquafish_gym.rollout.programs import ProgramAgent
from aquafish_gym.scenario import TIMESTEP
from aquafish_gym.sense import limits, valid_readings
from aquafish_gym.utils.array_types import Floats
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    brief,
    finite_array,
    instance,
    real_array,
)
from gait.controllers.controller import Controller, program_of


class ControllerAgent:
    """An agent (see ``gait.evaluate``) whose robots have one controller.

    It keeps their clock, their network's memory and the fin angles by dead reckoning. A reading
    that is not finite, or outside of the observation space, is not observed: the controller senses
    the last one of that channel.

    Parameters
    ----------
    controller
        Its ``interval`` must be the environment's ``frame_skip``.
    believed_gain
        (3,) the servo gains by which it reckons its fins from its commands.

    Examples
    --------
    >>> from aquafish_gym import Morphology
    >>> body = Morphology.nominal()
    >>> silent = Controller(np.zeros((3, 14)), np.zeros(3), np.ones(3), 0.7, body, seed=0)
    >>> agent = ControllerAgent(silent)
    >>> agent.reset({"fin_angles": np.zeros(3)})
    >>> agent.act(np.zeros(9)).tolist()
    [0.0, 0.0, 0.0]
    """

    def __init__(self, controller: Controller, believed_gain: ArrayLike = (1.0, 1.0, 1.0)) -> None:
        self.controller = instance("controller", controller, Controller)
        self.interval = controller.interval
        self._gain = finite_array("believed_gain", believed_gain, (3,))
        self._program = program_of([controller])

    def reset(self, info: dict[str, Any]) -> None:
        """Begin an episode of each robot, at the true fin angles (B, 3) or (3,) in ``info``."""
        if "fin_angles" not in instance("info", info, dict):
            raise InvalidArgumentError(f"info must have 'fin_angles' (B, 3); got {brief(info)}")
        fins = finite_array("fin_angles", info["fin_angles"], (None, 3), unit="rad", flat=True)
        self._robots = ProgramAgent(self._program, fins, self._gain)
        self._sensed = np.zeros((len(fins), PROGRAM_CHANNELS))
        self._steps = 0

    def act(self, observations: ArrayLike) -> NDArray[np.float32]:
        """Return actions (B, 3) for observations (B, k), or (3,) for the one of a single robot."""
        if not hasattr(self, "_robots"):
            raise InvalidArgumentError("reset(info) must be called before act(observations)")
        robots = len(self._sensed)
        needed = 9 + 3 * self._program.observes_goal
        wanted = f"({robots}, {needed} or more)"
        given = real_array("observations", observations, wanted)
        rows = given[None] if given.ndim == 1 else given
        if rows.ndim != 2 or len(rows) != robots or rows.shape[1] < needed:
            raise InvalidArgumentError(f"observations must have shape {wanted}; got {given.shape}")
        sensed = np.zeros((robots, PROGRAM_CHANNELS))
        sensed[:, :9] = rows[:, :9]
        if self._program.observes_goal:
            sensed[:, 9:] = rows[:, -3:]
        sensed = valid_readings(sensed, limits(observe_fins=False, has_goal=True))
        self._sensed = np.where(np.isnan(sensed), self._sensed, sensed)
        time = self._steps * (self.interval * TIMESTEP)
        self._steps += 1
        actions = self._robots.act(self._sensed, time).astype(np.float32)
        return actions.reshape((*given.shape[:-1], 3))

    @property
    def fin_angles(self) -> Floats:
        """Where it assumes the fins to be, (B, 3) rad; set them where they are known."""
        return self._robots.fin_angles

    @fin_angles.setter
    def fin_angles(self, angles: Floats) -> None:
        self._robots.fin_angles = angles

    def copy(self) -> Self:
        """Return an agent that goes on from here, without effect on this one."""
        other = copy.copy(self)
        other._robots = self._robots.copy()
        return other
