"""One robot, compiled: the lanes' loop at width one, without what only batches need.

An environment of one robot takes a few steps at a time, so that what surrounds them counts as
much as they do. All that the robot is therefore stands in one flat array: numba unpacks one
argument, and the loop runs on plain float64, on the same physics as the lanes, to the same bits.
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from aquafish_gym.engines.base import TIMESTEP
from aquafish_gym.engines.compiled.lanes import LaneBatch, rest_rows
from aquafish_gym.engines.worlds import RUNAWAY, Triple
from aquafish_gym.physics import simd
from aquafish_gym.physics.arithmetic import Vector
from aquafish_gym.physics.dynamics import step
from aquafish_gym.physics.kinematics import State, drive
from aquafish_gym.physics.reactive import step_reactive
from aquafish_gym.physics.robot import PARAMETERS_PER_FIN, Fin, Robot, robot_parameters

# Where things stand in the array: State's numbers in order, the robot's, and the current.
STATE = slice(0, 22)
ROBOT = slice(22, 22 + 3 * PARAMETERS_PER_FIN)
CURRENT = slice(ROBOT.stop, ROBOT.stop + 3)
SIZE = CURRENT.stop

_FIRST_FIN, _FIRST_CURRENT = ROBOT.start, CURRENT.start


def unpack_state(v: Any) -> State:
    """Return the state that the first 22 numbers are: of an array, or of a list of floats."""
    return State(
        (v[0], v[1], v[2], v[3]),
        (v[4], v[5], v[6]),
        (v[7], v[8], v[9]),
        (v[10], v[11], v[12]),
        (v[13], v[14]),
        (v[15], v[16]),
        (v[17], v[18]),
        (v[19], v[20], v[21]),
    )


def pack_state(v: Any, s: State) -> None:
    """Write a state to the first 22 numbers."""
    v[0], v[1], v[2], v[3] = s.orientation
    v[4], v[5], v[6] = s.position
    v[7], v[8], v[9] = s.velocity
    v[10], v[11], v[12] = s.spin
    v[13], v[14] = s.left
    v[15], v[16] = s.right
    v[17], v[18] = s.phase
    v[19], v[20], v[21] = s.rates


def _unpack_fin(v: Any, i: int) -> Fin:
    return Fin(v[i], v[i + 1], v[i + 2], v[i + 3], (v[i + 4], v[i + 5], v[i + 6]))


@functools.cache
def compile_single(reactive: bool = False) -> Any:
    """Return the compiled loop; compilation itself is lazy.

    ``reactive`` brings in the terms of ``physics/reactive.py``.
    Its signature is ``(v, left, right, caudal, steps) -> well``: hold a command (rev/s, rev/s,
    Hz) for some steps of 0.01 s, and say whether the robot has not diverged.
    """
    simd.register()
    for function in (unpack_state, pack_state, _unpack_fin):
        simd.inlined(function)
    stamp = simd.source_stamp(compile_single)
    swim = step_reactive if reactive else step

    def advance(v: Any, left: float, right: float, caudal: float, steps: int) -> bool:
        stamp  # noqa: B018  # part of the cache's key; see simd.source_stamp
        robot = Robot(
            _unpack_fin(v, _FIRST_FIN),
            _unpack_fin(v, _FIRST_FIN + PARAMETERS_PER_FIN),
            _unpack_fin(v, _FIRST_FIN + 2 * PARAMETERS_PER_FIN),
        )
        current = (v[_FIRST_CURRENT], v[_FIRST_CURRENT + 1], v[_FIRST_CURRENT + 2])
        by = drive((left, right, caudal), TIMESTEP)
        state = unpack_state(v)
        for _ in range(steps):
            state = swim(robot, state, by, current, TIMESTEP)
        pack_state(v, state)
        nothing, squares = 0.0, 0.0  # nothing stays 0 unless a number is infinite or NaN
        for i in range(22):
            nothing += v[i] * 0.0
        for i in range(7, 13):
            squares += v[i] * v[i]
        return nothing == 0.0 and squares < RUNAWAY

    # Division by zero is infinity, as in the lanes, and no exception.
    options = {"nogil": True, "error_model": "numpy"}
    try:
        return njit(cache=True, **options)(advance)
    except RuntimeError:  # nowhere to keep a cache: compile anew in every process
        return njit(**options)(advance)


class CompiledWorld:
    """One robot on the compiled engine, in double precision: the robot of the lanes.

    Unlike PyBullet's it can be pickled, copied and carried across a fork.

    Parameters
    ----------
    reactive
        Whether the water has the terms of ``physics/reactive.py``.
    """

    def __init__(self, reactive: bool = False) -> None:
        self._reactive = reactive
        # The whole robot. No views of it are kept: a copy's would show the original.
        self._numbers = np.zeros(SIZE)
        self.diverged = False

    def reset(self, morphology: NDArray[np.float64], fin_angles: Triple, current: Triple) -> None:
        """See :class:`~aquafish_gym.engines.worlds.World`."""
        self._numbers[STATE] = rest_rows(np.array([fin_angles]))[STATE, 0]
        self._numbers[ROBOT] = robot_parameters(morphology[None])[:, 0]
        self._numbers[CURRENT] = current
        self.diverged = False

    def advance(self, command: Vector, steps: int = 1) -> None:
        """See :class:`~aquafish_gym.engines.worlds.World`."""
        left, right, caudal = command
        self.diverged = not compile_single(self._reactive)(
            self._numbers, left, right, caudal, steps
        )

    def state(self) -> State:
        """See :class:`~aquafish_gym.engines.worlds.World`."""
        return unpack_state(self._numbers.tolist())

    @property
    def fin_angles(self) -> Vector:
        """See :class:`~aquafish_gym.engines.worlds.World`."""
        left, right, phase = LaneBatch.angles(self._numbers).tolist()
        return (left, right, phase)

    def close(self) -> None:
        """See :class:`~aquafish_gym.engines.worlds.World`."""
