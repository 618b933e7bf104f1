"""Networks that act for robots: their clock, what they sense, and the fins that they reckon."""

from __future__ import annotations

import copy
import math
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.rollout import Program
from aquafish_gym.rollout.plan import PROGRAM_CHANNELS, Act
from aquafish_gym.rollout.programs import ProgramAgent
from aquafish_gym.scenario import CHANNELS, TIMESTEP
from aquafish_gym.sense import limits, valid_readings
from aquafish_gym.utils.array_types import Floats
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    brief,
    finite_array,
    instance,
    real_array,
)
from gait.controllers.inputs import reckoned


class NetworkAgent:
    """An agent by a program of networks; see :class:`gait.ControllerAgent`.

    Parameters
    ----------
    program
        Of one network for all robots, or of one for each.
    believed_gain
        (F,) the servo gains by which it reckons its fins from its commands; None is 1 for each.
    argument
        The name of the gains in messages.
    """

    def __init__(
        self,
        program: Program,
        believed_gain: ArrayLike | None = None,
        argument: str = "believed_gain",
    ) -> None:
        self.interval = program.interval
        self.plan = program.plan
        self._program = program
        fins = len(self.plan.fins)
        gain = np.ones(fins) if believed_gain is None else believed_gain
        self._gain = finite_array(argument, gain, (fins,))
        self._needed = len(CHANNELS) + 3 * program.observes_goal

    def reset(self, info: dict[str, Any]) -> None:
        """Begin an episode of each robot, at the true fin angles (B, F) or (F,) in ``info``."""
        fins = fin_angles_of(info, len(self.plan.fins))
        known = self._program.weights.shape[1]
        if known not in (1, len(fins)):
            raise InvalidArgumentError(
                f"controller must be one for all {len(fins)} robots or one for each; got {known}"
            )
        self._robots = ProgramAgent(self._program, fins, self._gain)
        self._sensed = np.zeros((len(fins), PROGRAM_CHANNELS))
        self._intervals = 0

    def act(self, observations: ArrayLike) -> NDArray[np.float32]:
        """Return actions (B, F) for observations (B, k), or (F,) for the one of a single robot."""
        if not hasattr(self, "_robots"):
            raise InvalidArgumentError("reset(info) must be called before act(observations)")
        robots = len(self._sensed)
        wanted = f"({robots}, {self._needed} or more)"
        given = real_array("observations", observations, wanted)
        rows = given[None] if given.ndim == 1 else given
        if rows.ndim != 2 or len(rows) != robots or rows.shape[1] < self._needed:
            raise InvalidArgumentError(f"observations must have shape {wanted}; got {given.shape}")
        self._refuse_without_goal(rows.shape[1])
        time = self._intervals * (self.interval * TIMESTEP)
        actions = self._act(rows, time).astype(np.float32)
        return actions.reshape((*given.shape[:-1], actions.shape[1]))

    def _refuse_without_goal(self, entries: int) -> None:
        """Refuse observations of the IMU, and maybe of the fins, where the way to a goal is sensed.

        The way is the last three of more entries than these.
        """
        without = len(CHANNELS), len(CHANNELS) + 2 * len(self.plan.fins)
        if self._program.observes_goal and entries in without:
            raise InvalidArgumentError(
                "observations must end with the way to the goal, which the controller senses; got "
                f"{entries} entries, those of a task without a goal"
            )

    def _act(self, observations: Floats, time: float) -> Floats:
        """Return actions (B, F) in double precision for what is observed at a time, s."""
        sensed = np.zeros_like(self._sensed)
        sensed[:, : len(CHANNELS)] = observations[:, : len(CHANNELS)]
        if self._program.observes_goal:
            sensed[:, len(CHANNELS) :] = observations[:, -3:]
        sensed = valid_readings(sensed, limits(has_goal=True))
        self._sensed = np.where(np.isnan(sensed), self._sensed, sensed)
        self._intervals += 1
        return self._robots.act(self._sensed, time)

    def _miss(self, intervals: int, actions: Floats) -> None:
        """Let intervals pass in which actions (B, F) remained in force."""
        seconds = intervals * self.interval * TIMESTEP
        self._robots.fin_angles = reckoned(self.fin_angles, actions, seconds, self._gain, self.plan)
        self._intervals += intervals

    def policy(self, fin_angles: ArrayLike) -> Act:
        """Return a policy of one robot that begins with fin angles (F,), rad.

        See :meth:`gait.Controller.policy`. It is the only user of this agent from then on.
        """
        fins = len(self.plan.fins)
        self.reset({"fin_angles": finite_array("fin_angles", fin_angles, (fins,), unit="rad")})
        wanted = f"({self._needed} or more,)"
        half = TIMESTEP / 2
        begun = last = -math.inf
        actions = np.zeros((1, fins))

        def act(observation: ArrayLike, time: float) -> Floats:
            nonlocal begun, last, actions
            given = real_array("observation", observation, wanted)
            if given.ndim != 1 or len(given) < self._needed:
                raise InvalidArgumentError(
                    f"observation must have shape {wanted}; got {given.shape}"
                )
            self._refuse_without_goal(len(given))
            if not last <= time < math.inf:
                raise InvalidArgumentError(
                    "time must be finite and not go back in the swim of a policy; make another "
                    f"policy for another swim; got {time:g} s after {last:g} s"
                )
            if not math.isfinite(begun):
                begun = time
            last = time
            over = math.floor((time - begun + half) / (self.interval * TIMESTEP))
            if over >= self._intervals:
                if over > self._intervals:
                    self._miss(over - self._intervals, actions)
                # As a rollout multiplies: whole steps of 0.01 s first.
                actions = self._act(given[None], begun + over * self.interval * TIMESTEP)
            return np.asarray(actions[0])

        return act

    @property
    def fin_angles(self) -> Floats:
        """Where it assumes the fins to be, (B, F) rad; set them where they are known."""
        return self._robots.fin_angles

    @fin_angles.setter
    def fin_angles(self, angles: Floats) -> None:
        self._robots.fin_angles = angles

    def copy(self) -> Self:
        """Return an agent that goes on from here, without effect on this one."""
        other = copy.copy(self)
        other._robots = self._robots.copy()
        return other


def fin_angles_of(info: dict[str, Any], fins: int | None = None) -> Floats:
    """Return the fin angles (B, F) in the ``info`` of a reset; None is any number of fins."""
    if "fin_angles" not in instance("info", info, dict):
        raise InvalidArgumentError(
            f"info must have 'fin_angles' (B, {fins or 'F'}); got {brief(info)}"
        )
    return finite_array("fin_angles", info["fin_angles"], (None, fins), unit="rad", flat=True)
