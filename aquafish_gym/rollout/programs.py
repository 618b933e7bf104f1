"""A program that acts outside of the compiled loop, on observations from anywhere."""

from __future__ import annotations

import copy
from dataclasses import replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from aquafish_gym.physics.arithmetic import TAU
from aquafish_gym.rollout.plan import PROGRAM_CHANNELS, Act, Program
from aquafish_gym.scenario import TIMESTEP
from aquafish_gym.utils.array_types import Floats


class ProgramAgent:
    """A program that acts for B robots, each with a memory and a dead reckoning of its fins.

    Its numbers are those of the compiled loop to the last bit.

    Parameters
    ----------
    program
        With the weights of B robots, or of one for all.
    fin_angles
        (B, F) where the fins are assumed to be at first, rad.
    servo_gain
        (F,) or (B, F) assumed gains of the servos.
    dtype
        ``np.float32`` or ``np.float64``.
    """

    def __init__(
        self,
        program: Program,
        fin_angles: Floats,
        servo_gain: ArrayLike,
        dtype: type[np.floating] = np.float64,
    ) -> None:
        # numba comes with it: importing this module stays quick.
        from aquafish_gym.rollout.program_kernel import compile_program

        robots = len(fin_angles)
        self._run = compile_program(program.plan, program.function)
        self._weights = np.ascontiguousarray(program.weights, dtype).ravel()
        self._columns = program.weights.shape[1]
        self._layout = program.layout
        self._seconds = program.interval * TIMESTEP
        self._memory = np.zeros((robots, program.scratch), dtype)
        self._gain = np.array(np.broadcast_to(servo_gain, fin_angles.shape), dtype, order="C")
        self._turns = np.zeros(fin_angles.shape, dtype)
        self.fin_angles = fin_angles

    @property
    def fin_angles(self) -> Floats:
        """Where the fins are assumed to be, (B, F) rad; set them where they are known."""
        return np.asarray(self._turns * TAU, np.float64)

    @fin_angles.setter
    def fin_angles(self, angles: Floats) -> None:
        self._turns[:] = angles / TAU

    def act(self, observations: Floats, time: float) -> Floats:
        """Return actions (B, F) in [-1, 1], which are then held for the program's interval.

        The memory is cleared at the ``time`` 0, s. ``observations`` are (B, 9) or, with the way to
        a goal, (B, 12).
        """
        seen = np.zeros((len(self._turns), PROGRAM_CHANNELS), self._turns.dtype)
        seen[:, : observations.shape[1]] = observations
        actions = np.empty_like(self._turns)
        self._run(
            self._weights, self._columns, self._layout, self._memory, self._turns.ravel(),
            self._gain.ravel(), seen.ravel(), time, self._seconds, actions.ravel(),
        )  # fmt: skip
        return actions

    def copy(self) -> Self:
        """Return an agent that goes on from here, without effect on this one."""
        other = copy.copy(self)
        other._memory = self._memory.copy()
        other._turns = self._turns.copy()
        return other


def act_alone(program: Program, robot: int, fin_angles: Floats, servo_gain: Floats) -> Act:
    """Return the policy of one of a program's robots, which begins with assumed fin angles (F,).

    They are in rad; ``servo_gain`` (F,) are the assumed gains of the servos.
    """
    own = replace(program, weights=program.weights[:, [robot]])
    agent = ProgramAgent(own, fin_angles[None], servo_gain)
    return lambda observation, time: agent.act(observation[None], time)[0]
