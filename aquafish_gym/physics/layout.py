"""The order of a robot's numbers in flat tables, stated once.

A table holds a row for each number and a column for each robot. In a flat one the robots of one
vector register are ``group`` of ``groups``, and row r of it is entry ``r * groups + group``; one
robot on plain floats is group 0 of 1. The functions of one group are straight-line code for any
scalar backend (``arithmetic.py``).

- A **state** has 25 rows: the numbers of ``State`` in its order, then roll, pitch and yaw.
- A **robot** has 25 rows: left, right and caudal ``Fin``, the numbers of each in its order, and
  the scale of the body's drag.
- Its **conditions** have 7 rows: the water's velocity, the gains of the three servos, and their
  lag in steps of 0.01 s.
"""

from __future__ import annotations

from itertools import accumulate
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.physics.arithmetic import Number, Vector, fetch, put
from aquafish_gym.physics.kinematics import Joints, Pair, State
from aquafish_gym.physics.robot import Fin, Robot, box

_SIZES = dict(zip(State._fields, (4, 3, 3, 3, 2, 2, 2, 3), strict=True), rpy=3)
# The first row of each.
_FIRST = list(accumulate(_SIZES.values(), initial=0))
ORIENTATION, POSITION, VELOCITY, SPIN, LEFT, RIGHT, PHASE, RATES, RPY, STATE_ROWS = _FIRST
STATE_NUMBERS = RPY  # those of ``State``, without roll, pitch and yaw
# The rows of each, by name.
FIELDS: dict[str, slice] = dict(zip(_SIZES, map(slice, _FIRST, _FIRST[1:]), strict=True))
_STATE_FIELDS = [FIELDS[name] for name in State._fields]
# (cos, sin) of left, right and phase follow each other.
_COSINES, _SINES = slice(LEFT, RATES, 2), slice(LEFT + 1, RATES, 2)

FIN_ROWS = 8
ROBOT_ROWS = 3 * FIN_ROWS + 1
CURRENT = 0
SERVO_GAIN = 3
SERVO_LAG = 6
CONDITION_ROWS = 7
# The columns of (width, length, thickness) of each fin among the nine dimensions.
COLUMNS: NDArray[np.intp] = np.array([(0, 1, 2), (3, 4, 5), (8, 7, 6)])


def fetch_pair(rows: Any, first: int, group: int, groups: int, like: Number) -> Pair:
    """Read two rows."""
    i = first * groups + group
    return (fetch(rows, i, like), fetch(rows, i + groups, like))


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


def fetch_fin(rows: Any, first: int, group: int, groups: int, like: Number) -> Fin:
    """Read one fin's eight rows."""
    width, length, thickness = fetch_vector(rows, first, group, groups, like)
    mass = fetch(rows, (first + 3) * groups + group, like)
    inertia = fetch_vector(rows, first + 4, group, groups, like)
    drag = fetch(rows, (first + 7) * groups + group, like)
    return Fin(width, length, thickness, mass, inertia, drag)


def put_fin(rows: Any, first: int, group: int, groups: int, fin: Fin) -> None:
    """Write what :func:`fetch_fin` reads."""
    put_vector(rows, first, group, groups, (fin.width, fin.length, fin.thickness))
    put(rows, (first + 3) * groups + group, fin.mass)
    put_vector(rows, first + 4, group, groups, fin.inertia)
    put(rows, (first + 7) * groups + group, fin.drag)


def fetch_robot(rows: Any, first: int, group: int, groups: int, like: Number) -> Robot:
    """Read a robot's 25 rows."""
    return Robot(
        fetch_fin(rows, first, group, groups, like),
        fetch_fin(rows, first + FIN_ROWS, group, groups, like),
        fetch_fin(rows, first + 2 * FIN_ROWS, group, groups, like),
        fetch(rows, (first + 3 * FIN_ROWS) * groups + group, like),
    )


def fetch_joints(rows: Any, first: int, group: int, groups: int, like: Number) -> Joints:
    """Read the nine rows of the joints, the first of which is ``first``: of a state, ``LEFT``."""
    return (
        fetch_pair(rows, first, group, groups, like),
        fetch_pair(rows, first + (RIGHT - LEFT), group, groups, like),
        fetch_pair(rows, first + (PHASE - LEFT), group, groups, like),
        fetch_vector(rows, first + (RATES - LEFT), group, groups, like),
    )


def put_joints(rows: Any, first: int, group: int, groups: int, joints: Joints) -> None:
    """Write what :func:`fetch_joints` reads."""
    left, right, phase, rates = joints
    put_vector(rows, first, group, groups, (left[0], left[1], right[0]))
    put_vector(rows, first + 3, group, groups, (right[1], phase[0], phase[1]))
    put_vector(rows, first + (RATES - LEFT), group, groups, rates)


def fetch_state(rows: Any, group: int, groups: int, like: Number) -> State:
    """Read a state, without its roll, pitch and yaw."""
    x, y, z = fetch_vector(rows, ORIENTATION, group, groups, like)
    left, right, phase, rates = fetch_joints(rows, LEFT, group, groups, like)
    orientation = (x, y, z, fetch(rows, (ORIENTATION + 3) * groups + group, like))
    position = fetch_vector(rows, POSITION, group, groups, like)
    velocity = fetch_vector(rows, VELOCITY, group, groups, like)
    spin = fetch_vector(rows, SPIN, group, groups, like)
    return State(orientation, position, velocity, spin, left, right, phase, rates)


def put_state(rows: Any, group: int, groups: int, state: State) -> None:
    """Write what :func:`fetch_state` reads."""
    q = state.orientation
    put_vector(rows, ORIENTATION, group, groups, (q[0], q[1], q[2]))
    put(rows, (ORIENTATION + 3) * groups + group, q[3])
    put_vector(rows, POSITION, group, groups, state.position)
    put_vector(rows, VELOCITY, group, groups, state.velocity)
    put_vector(rows, SPIN, group, groups, state.spin)
    put_joints(rows, LEFT, group, groups, (state.left, state.right, state.phase, state.rates))


def state_from_numbers(numbers: list[float] | NDArray[np.floating]) -> State:
    """Return one robot's state on plain floats, or that of states (25, B) in rows."""
    fields: list[Any] = [tuple(numbers[rows]) for rows in _STATE_FIELDS]
    return State(*fields)


def robot_from_column(column: NDArray[np.float64]) -> Robot:
    """Return one robot on plain floats from a column (25,) of :func:`robot_parameters`."""
    found: Robot = fetch_robot(column.tolist(), 0, 0, 1, 0.0)
    return found


def robot_parameters(
    morphologies: NDArray[np.float64],
    drag: ArrayLike = (1.0, 1.0),
    fin_density: ArrayLike = 1.0,
) -> NDArray[np.float64]:
    """Return the parameters of bodies (B, 9), in the order of ``DIMENSIONS``, for the dynamics.

    (25, B): for each fin width, length, thickness, mass, the three inertias and the scale of its
    drag; and that of the body's. ``drag`` is (2,) or (B, 2): of the fins, and of the body.
    ``fin_density``, (B,) or (B, 3) for each fin, multiplies the fins' mass.
    """
    batch = len(morphologies)
    fins, body = np.asarray(drag, dtype=np.float64).T
    table = np.empty((ROBOT_ROWS, batch))
    table[-1] = body
    rows = table[:-1].reshape(3, FIN_ROWS, batch).transpose(1, 0, 2)
    width, length, thickness, density = rows[:4]
    rows[:3] = morphologies.T[COLUMNS].transpose(1, 0, 2)
    density[:] = np.asarray(fin_density).T
    rows[7] = fins
    # The three fins at once, and some robots: numbers that leave the cache take five times as long.
    for first in range(0, batch, 2000):
        some = np.s_[:, first : first + 2000]
        fin = box(width[some], length[some], thickness[some], density[some], rows[7][some])
        put_fin(rows[:, *some], 0, 0, 1, fin)
    return table


def condition_rows(
    current: NDArray[np.float64], servo_gain: NDArray[np.float64], lag: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the conditions (7, B) for currents and gains (B, 3), and lags (B,) in steps."""
    rows = np.empty((CONDITION_ROWS, len(current)))
    rows[CURRENT : CURRENT + 3] = current.T
    rows[SERVO_GAIN : SERVO_GAIN + 3] = servo_gain.T
    rows[SERVO_LAG] = lag
    return rows


def start_rows(
    fin_angles: NDArray[np.float64],
    velocity: ArrayLike = (0.0, 0.0, 0.0),
    spin: ArrayLike = (0.0, 0.0, 0.0),
    rates: ArrayLike = (0.0, 0.0, 0.0),
) -> NDArray[np.float64]:
    """Return the states (25, B) of robots upright, facing +y, fins at these angles.

    ``fin_angles`` is (B, 3): left and right pectoral angle and caudal phase, rad. They are at rest
    unless ``velocity``, ``spin`` or the joints' ``rates`` are given, (3,) or (B, 3).
    """
    rows = np.zeros((STATE_ROWS, len(fin_angles)))
    rows[ORIENTATION + 3] = 1.0
    for name, value in (("velocity", velocity), ("spin", spin), ("rates", rates)):
        rows[FIELDS[name]].T[:] = value
    rows[_COSINES] = np.cos(fin_angles).T
    rows[_SINES] = np.sin(fin_angles).T
    return rows


def angles_of_rows(rows: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return fin angles (3, B) in rad of states (25, B), or (3,) of one robot's (22,)."""
    found: NDArray[np.float64] = np.arctan2(rows[_SINES], rows[_COSINES], dtype=np.float64)
    return found
