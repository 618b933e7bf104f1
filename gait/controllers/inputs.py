"""The inputs of networks that numpy or torch evaluates, such as those that learn."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from aquafish_gym.command import reckon, servo_speeds
from aquafish_gym.physics.arithmetic import TAU
from aquafish_gym.plans import AQUAFISH, BodyPlan
from aquafish_gym.scenario import TIMESTEP
from aquafish_gym.utils.array_types import Floats
from gait.controllers.network import Senses, put_inputs


def reckoned(
    fin_angles: Floats,
    actions: ArrayLike,
    seconds: float,
    servo_gain: ArrayLike = 1.0,
    plan: BodyPlan = AQUAFISH,
) -> Floats:
    """Return fin angles (B, F), rad, after actions (B, F), clipped to [-1, 1], by dead reckoning.

    An action is held for some ``seconds``; ``servo_gain``, (F,) or one number, are the assumed
    gains of the servos.

    Examples
    --------
    >>> (reckoned(np.zeros((1, 3)), [[1.0, -1.0, 0.0]], 0.2) / np.pi).round(3).tolist()
    [[0.2, -0.2, 0.2]]
    """
    speeds = servo_speeds(plan, tuple(np.clip(actions, -1.0, 1.0, dtype=np.float64).T))
    gains = np.broadcast_to(servo_gain, len(speeds)).tolist()
    turned = tuple(gain * speed for gain, speed in zip(gains, speeds, strict=True))
    return np.array(reckon(tuple(fin_angles.T), turned, TAU * seconds)).T


class NetworkInputs:
    """The inputs of the networks of B robots, with a clock and a dead reckoning for each.

    Of a controller, :class:`gait.controllers.agent.ControllerAgent` computes inputs and actions in
    compiled code.

    Parameters
    ----------
    senses
        What the networks observe.
    clock
        Frequency of the clocks, Hz.
    interval
        For how many steps of 0.01 s an action is held.
    fin_angles
        (B, F) rad at first.
    plan
        The robots' body plan.
    """

    def __init__(
        self,
        senses: Senses,
        clock: float,
        interval: int,
        fin_angles: Floats,
        plan: BodyPlan = AQUAFISH,
    ) -> None:
        self.senses = senses
        self.plan = plan
        self.fin_angles = np.array(fin_angles, np.float64)
        self._clock = clock
        self._seconds = interval * TIMESTEP
        self._actions = np.zeros(len(fin_angles))

    def begin(self, robots: Any, fin_angles: Floats) -> None:
        """Begin episodes of the robots that an index or mask selects, at angles (N, F), rad."""
        self._actions[robots] = 0.0
        self.fin_angles[robots] = fin_angles

    def observe(self, observations: Floats) -> Floats:
        """Return the inputs (B, I) for observations (B, k)."""
        up, north, gyro = (tuple(observations[:, i : i + 3].T) for i in (0, 3, 6))
        way = tuple(observations[:, -3:].T)
        turns = self._clock * self._seconds * self._actions
        fins = tuple(self.fin_angles.T / TAU)
        values = np.empty((len(self.senses.names(self.plan)), len(observations)))
        put_inputs(values, self.senses.layout, turns, up, north, gyro, fins, way)
        return values.T

    def follow(self, actions: ArrayLike) -> None:
        """Carry clocks and fins on by actions (B, F), which are clipped to [-1, 1]."""
        self.fin_angles = reckoned(self.fin_angles, actions, self._seconds, plan=self.plan)
        self._actions += 1.0
