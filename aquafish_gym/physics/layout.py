"""The order of a robot's numbers in flat tables, stated once.

A table holds a row for each number and a column for each robot. In a flat one the robots of one
vector register are ``group`` of ``groups``, and row r of it is entry ``r * groups + group``; one
robot on plain floats is group 0 of 1. The functions of one group are straight-line code for any
scalar backend (``arithmetic.py``).

- A **state** has the numbers of ``State`` in its order, then roll, pitch and yaw.
- A **robot** has the numbers of each ``Fin`` in turn, and the scale of the hull's drag.
- Its **conditions** are the water's velocity, the gains of the servos, and their lag in steps of
  0.01 s.

How many rows each has follows from the plan: :class:`Layout`.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from itertools import accumulate
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.physics.arithmetic import Number, Vector, fetch, put
from aquafish_gym.physics.kinematics import Numbers, State
from aquafish_gym.physics.robot import Fin, Robot, box
from aquafish_gym.plans import BodyPlan

FIN_ROWS = 8
CURRENT = 0
# The first rows of a state, which every plan has.
_BODY_ROWS = {"orientation": 4, "position": 3, "velocity": 3, "spin": 3}
_BODY_FIRST = list(accumulate(_BODY_ROWS.values(), initial=0))
ORIENTATION, POSITION, VELOCITY, SPIN, JOINTS = _BODY_FIRST
# The rows of each, by name.
FIELDS: dict[str, slice] = dict(
    zip(_BODY_ROWS, map(slice, _BODY_FIRST, _BODY_FIRST[1:]), strict=True)
)


def fetch_vector(rows: Any, first: int, group: int, groups: int, like: Number) -> Vector:
    """Read three rows."""
    i = first * groups + group
    return (fetch(rows, i, like), fetch(rows, i + groups, like), fetch(rows, i + 2 * groups, like))


def put_vector(rows: Any, first: int, group: int, groups: int, value: Vector) -> None:
    """Write three rows."""
    i = first * groups + group
    put(rows, i, value[0])
    put(rows, i + groups, value[1])
    put(rows, i + 2 * groups, value[2])


def put_fin(rows: Any, first: int, group: int, groups: int, fin: Fin) -> None:
    """Write one fin's eight rows."""
    put_vector(rows, first, group, groups, (fin.width, fin.length, fin.thickness))
    put(rows, (first + 3) * groups + group, fin.mass)
    put_vector(rows, first + 4, group, groups, fin.inertia)
    put(rows, (first + 7) * groups + group, fin.drag)


def robot_of(numbers: Sequence[Number]) -> Robot:
    """Return the robot whose rows these numbers are."""
    fins = []
    for first in range(0, len(numbers) - 1, FIN_ROWS):
        width, length, thickness, mass, a, b, c, drag = numbers[first : first + FIN_ROWS]
        fins.append(Fin(width, length, thickness, mass, (a, b, c), drag))
    return Robot(tuple(fins), numbers[-1])


def state_of(numbers: Sequence[Number]) -> State:
    """Return the state whose rows these are, without roll, pitch and yaw."""
    rates = JOINTS + (len(numbers) - JOINTS) * 2 // 3
    # One by one: an environment of one robot asks in each step.
    return State(
        tuple(numbers[:POSITION]),
        tuple(numbers[POSITION:VELOCITY]),
        tuple(numbers[VELOCITY:SPIN]),
        tuple(numbers[SPIN:JOINTS]),
        tuple(numbers[JOINTS:rates]),
        tuple(numbers[rates:]),
    )


def state_numbers(state: State) -> Numbers:
    """Return the rows of a state, without roll, pitch and yaw."""
    return tuple(number for field in state for number in field)


class Layout:
    """Where a plan's numbers stand in tables, and the tables of robots.

    Attributes
    ----------
    joints, rates, rpy
        Rows of a state: cos and sin of each joint in turn, the joints' speeds, and roll, pitch and
        yaw.
    state_numbers, state_rows
        How many rows a state has without roll, pitch and yaw, and with them.
    robot_rows, condition_rows
        How many rows a robot and its conditions have.
    servo_gain, servo_lag
        Rows of the conditions: the gain of each servo, and the lag.
    """

    def __init__(self, plan: BodyPlan) -> None:
        fins = len(plan.fins)
        self._plan = plan
        self.joints = slice(JOINTS, JOINTS + 2 * fins)
        self._cosines = slice(JOINTS, self.joints.stop, 2)
        self._sines = slice(JOINTS + 1, self.joints.stop, 2)
        self.rates = slice(self.joints.stop, self.joints.stop + fins)
        self.state_numbers = self.rates.stop
        self.rpy = slice(self.state_numbers, self.state_numbers + 3)
        self.state_rows = self.rpy.stop
        self.robot_rows = FIN_ROWS * fins + 1
        self.servo_gain = slice(CURRENT + 3, CURRENT + 3 + fins)
        self.servo_lag = self.servo_gain.stop
        self.condition_rows = self.servo_lag + 1

    def state(self, rows: NDArray[np.floating]) -> State:
        """Return the states of rows (state_rows, B) or (state_numbers, B), on rows (B,)."""
        return state_of(list(rows[: self.state_numbers]))

    def angles(self, rows: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return fin angles (F, B) in rad of states in rows (state_rows, B), or (F,) of one's."""
        cosines, sines = rows[self._cosines], rows[self._sines]
        found: NDArray[np.float64] = np.arctan2(sines, cosines, dtype=np.float64)
        return found

    def start(
        self,
        fin_angles: NDArray[np.float64],
        velocity: ArrayLike = (0.0, 0.0, 0.0),
        spin: ArrayLike = (0.0, 0.0, 0.0),
        rates: ArrayLike = 0.0,
    ) -> NDArray[np.float64]:
        """Return the states (state_rows, B) of robots upright, facing +y, fins at these angles.

        ``fin_angles`` is (B, F): angles, or the phases of fins that sweep, rad. They are at rest
        unless ``velocity`` or ``spin``, (3,) or (B, 3), or the joints' ``rates``, (F,) or (B, F),
        are given.
        """
        rows = np.zeros((self.state_rows, len(fin_angles)))
        rows[ORIENTATION + 3] = 1.0
        rows[FIELDS["velocity"]].T[:] = velocity
        rows[FIELDS["spin"]].T[:] = spin
        rows[self.rates].T[:] = rates
        rows[self._cosines] = np.cos(fin_angles).T
        rows[self._sines] = np.sin(fin_angles).T
        return rows

    def robots(
        self,
        morphologies: NDArray[np.float64],
        drag: ArrayLike = (1.0, 1.0),
        fin_density: ArrayLike = 1.0,
    ) -> NDArray[np.float64]:
        """Return the rows (robot_rows, B) of bodies (B, S), whose sizes are in the plan's order.

        For each fin width, length, thickness, mass, the three inertias and the scale of its drag;
        then that of the hull's. ``drag`` is (2,) or (B, 2): of the fins, and of the hull.
        ``fin_density``, (B,) or (B, F) for each fin, multiplies the fins' mass.
        """
        batch = len(morphologies)
        fins, hull = np.asarray(drag, dtype=np.float64).T
        table = np.empty((self.robot_rows, batch))
        table[-1] = hull
        rows = table[:-1].reshape(len(self._plan.fins), FIN_ROWS, batch).transpose(1, 0, 2)
        width, length, thickness, density = rows[:4]
        rows[:3] = morphologies.T[self._plan.columns].transpose(1, 0, 2)
        density[:] = np.asarray(fin_density).T
        rows[7] = fins
        # All fins at once, and some robots: numbers that leave the cache take five times as long.
        for first in range(0, batch, 2000):
            some = np.s_[:, first : first + 2000]
            fin = box(
                self._plan.hull,
                width[some], length[some], thickness[some], density[some], rows[7][some],
            )  # fmt: skip
            put_fin(rows[:, *some], 0, 0, 1, fin)
        return table

    def conditions(
        self,
        current: NDArray[np.float64],
        servo_gain: NDArray[np.float64],
        lag: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Return the rows (condition_rows, B) of currents (B, 3), gains (B, F) and lags (B,).

        A lag is in steps of 0.01 s.
        """
        rows = np.empty((self.condition_rows, len(current)))
        rows[CURRENT : CURRENT + 3] = current.T
        rows[self.servo_gain] = servo_gain.T
        rows[self.servo_lag] = lag
        return rows


@functools.cache
def layout(plan: BodyPlan) -> Layout:
    """Return the layout of a plan's tables."""
    return Layout(plan)
