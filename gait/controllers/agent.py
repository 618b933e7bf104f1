"""A controller as an agent: it acts for all robots of a batched environment."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.command import lane_servo_speeds, reckon
from aquafish_gym.physics.arithmetic import TAU
from aquafish_gym.scenario import TIMESTEP
from aquafish_gym.sense import limits, valid_readings
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    brief,
    finite_array,
    instance,
    real_array,
)
from gait.controllers import network
from gait.controllers.controller import Controller, program_of


def respond_all(
    genes: Any, layout: Any, scratch: Any, time: float, felt: Any, fins: Any, actions: Any
) -> None:
    """Set the actions (B, 3) of B robots with one controller: ``network.respond``, one by one.

    ``scratch`` (B, n) lives through an episode; ``felt`` (B, 12) holds up, north, gyro and the way
    to the goal, and ``fins`` (B, 3) the assumed fin angles in turns.
    """
    for i in range(len(actions)):
        up = (felt[i, 0], felt[i, 1], felt[i, 2])
        north = (felt[i, 3], felt[i, 4], felt[i, 5])
        gyro = (felt[i, 6], felt[i, 7], felt[i, 8])
        way = (felt[i, 9], felt[i, 10], felt[i, 11])
        angles = (fins[i, 0], fins[i, 1], fins[i, 2])
        actions[i, 0], actions[i, 1], actions[i, 2] = network.respond(
            genes, layout, scratch[i], 0, 1, time, up, north, gyro, angles, way
        )


@cache
def _compiled() -> Any:
    from aquafish_gym.physics.compiling import compiled_function, register_module

    register_module(network)
    return compiled_function(respond_all, slow=True, nogil=True)


class ControllerAgent:
    """An agent (see ``gait.evaluate``) whose robots have one controller.

    A reading that is not finite, or outside of the observation space, is not observed: the
    controller senses the last one of that channel.

    Parameters
    ----------
    controller
        Its ``interval`` must be the environment's ``frame_skip``.
    believed_gain
        (3,) the servo gains by which it reckons its fins from its commands.
    """

    def __init__(self, controller: Controller, believed_gain: ArrayLike = (1.0, 1.0, 1.0)) -> None:
        self._program = program_of([instance("controller", controller, Controller)])
        self._gain = finite_array("believed_gain", believed_gain, (3,))
        self._genes = np.ascontiguousarray(self._program.weights[:, 0])
        self.interval = controller.interval

    def reset(self, info: dict[str, Any]) -> None:
        """Begin an episode of each robot, at the true fin angles (B, 3) in ``info``."""
        if "fin_angles" not in instance("info", info, dict):
            raise InvalidArgumentError(f"info must have 'fin_angles' (B, 3); got {brief(info)}")
        self._fins = finite_array("fin_angles", info["fin_angles"], (None, 3), unit="rad") / TAU
        self._felt = np.zeros((len(self._fins), 12))
        self._scratch = np.zeros((len(self._fins), self._program.scratch))
        self._steps = 0

    def act(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return actions (B, 3) for observations (B, k)."""
        if not hasattr(self, "_felt"):
            raise InvalidArgumentError("reset(info) must be called before act(observations)")
        needed = 9 + 3 * self._program.observes_goal
        wanted = f"({len(self._felt)}, {needed} or more)"
        given = real_array("observations", observations, wanted)
        if given.ndim != 2 or len(given) != len(self._felt) or given.shape[1] < needed:
            raise InvalidArgumentError(f"observations must have shape {wanted}; got {given.shape}")
        felt = np.zeros((len(given), 12))
        felt[:, :9] = given[:, :9]
        if self._program.observes_goal:
            felt[:, 9:] = given[:, -3:]
        felt = valid_readings(felt, limits(observe_fins=False, has_goal=True))
        self._felt = felt = np.where(np.isnan(felt), self._felt, felt)
        program, dt = self._program, self._program.interval * TIMESTEP
        actions = np.empty((len(felt), 3))
        _compiled()(
            self._genes, program.layout, self._scratch, self._steps * dt, felt, self._fins, actions
        )
        left, right, caudal = lane_servo_speeds((actions[:, 0], actions[:, 1], actions[:, 2]))
        gain, fins = self._gain, self._fins
        speeds = (gain[0] * left, gain[1] * right, gain[2] * caudal)
        self._fins = np.stack(reckon((fins[:, 0], fins[:, 1], fins[:, 2]), speeds, dt), axis=1)
        self._steps += 1
        return actions.astype(np.float32)
