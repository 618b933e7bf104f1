"""The network of a controller: its inputs, its nodes, its action, as straight-line scalar Python.

:func:`responder` is the only statement of the controllers' inputs and of their network. It runs on
plain floats (one robot) and in the compiled time loop, where a number is a register of many robots;
:func:`put_inputs` runs on rows of numbers too, for learners. So nothing here branches on data, and
nothing but ``+ - * /`` and the primitives of ``arithmetic.py`` is used.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

from aquafish_gym.physics.arithmetic import (
    Number,
    Vector,
    clip,
    fetch,
    fma,
    put,
    sine_cosine,
    square_root,
)
from aquafish_gym.physics.kinematics import Numbers
from aquafish_gym.physics.law import law
from aquafish_gym.plans import AQUAFISH, BodyPlan

GYRO_INPUT_SCALE = 2.0  # rad/s
GOAL_INPUT_SCALE = 5.0  # units

# neat-python's activation is tanh(2.5 z); its clamp at 60 is far beyond where tanh is 1.
OUTPUT_GAIN = 2.5
_TANH_LIMIT = 20.0  # 1 - tanh(20) = 8e-18

# Entries of a controller's layout, see :func:`responder`.
IMU_ENTRY = 0
CLOCK_ENTRY = 1
FINS_ENTRY = 2
GOAL_ENTRY = 3
INPUTS_ENTRY = 4
NODES_ENTRY = 5
MEMORY_ENTRY = 6
CLIPPED_ENTRY = 7
LAYERS_ENTRY = 8
HEADER_ROWS = 1  # rows of the genes before the nodes': the clock's frequency


@dataclass(frozen=True)
class Senses:
    """What a controller observes.

    Examples
    --------
    >>> Senses(imu=False, fins=True, clock=0).names()[:2]
    ('left_pectoral_sine', 'left_pectoral_cosine')
    """

    imu: bool = True  #: The directions up and north, and the angular velocity.
    clock: int = 1  #: Harmonics of a clock, at multiples of its frequency.
    fins: bool = False  #: The fins' angles, by dead reckoning from the initial ones.
    goal: bool = False  #: The way to a goal in body axes; only a task with a goal has one.

    @property
    def layout(self) -> tuple[int, ...]:
        """The first numbers of a controller's layout, see :func:`responder`."""
        return (int(self.imu), self.clock, int(self.fins), int(self.goal))

    @cache  # noqa: B019  # a search asks for them as often as it makes controllers
    def names(self, plan: BodyPlan = AQUAFISH) -> tuple[str, ...]:
        """Return the inputs of a plan's robot, in the order of the weights."""
        axes = [f"{what}_{axis}" for what in ("up", "north", "gyro") for axis in "xyz"]
        waves = [f"{i}" if i > 1 else "" for i in range(1, self.clock + 1)]
        clock = [f"clock{i}_{wave}" for i in waves for wave in ("sine", "cosine")]
        fins = [f"{fin}_{wave}" for fin in plan.names for wave in ("sine", "cosine")]
        goal = ("goal_x", "goal_y", "goal_z")
        return (
            *(axes if self.imu else ()),
            *clock,
            *(fins if self.fins else ()),
            *(goal if self.goal else ()),
        )


def tanh(z: Number) -> Number:
    """Return tanh z to 1e-15 in float64, with one division and no exponential.

    The Pade approximant [7/6] of tanh(z / 32) as a fraction, then five times the
    double-angle formula tanh 2y = 2 n d / (d^2 + n^2), which needs no division either.
    """
    y = clip(z, _TANH_LIMIT) * (1 / 32)
    q = y * y
    n = y * (1 + q * (17325 / 135135 + q * (378 / 135135 + q * (1 / 135135))))
    d = 1 + q * (62370 / 135135 + q * (3150 / 135135 + q * (28 / 135135)))
    for _ in range(5):
        n, d = 2 * n * d, d * d + n * n
    return n / d


def observe_imu(values: Any, at: int, up: Vector, north: Vector, gyro: Vector) -> None:
    """Put up, north and gyro into nine entries of ``values``.

    Attitude comes as direction cosines rather than as angles: they are bounded, never jump, and do
    not depend on which of its two triples (see physics/attitude.py) the log is in. They are the
    world's vertical, z, and its y, where the robot faces at the start, in body axes. The
    gyroscope's rad/s about body axes are 1 at ``GYRO_INPUT_SCALE``.
    """
    for i in range(3):
        put(values, at + i, up[i])
        put(values, at + 3 + i, north[i])
        put(values, at + 6 + i, clip(gyro[i] * (1 / GYRO_INPUT_SCALE), 1.0))


def observe_clock(values: Any, at: int, harmonics: int, turns: Number) -> None:
    """Put sine and cosine of the harmonics of a clock that has made ``turns``."""
    first = sine_cosine(turns)
    sine, cosine = first
    for k in range(harmonics):
        put(values, at + 2 * k, sine)
        put(values, at + 2 * k + 1, cosine)
        sine, cosine = (
            sine * first[1] + cosine * first[0],
            cosine * first[1] - sine * first[0],
        )


def observe_fins(values: Any, at: int, fins: Numbers) -> None:
    """Put sine and cosine of the fins' angles, in turns."""
    for i in range(len(fins)):
        sine, cosine = sine_cosine(fins[i])
        put(values, at + 2 * i, sine)
        put(values, at + 2 * i + 1, cosine)


def observe_goal(values: Any, at: int, way: Vector) -> None:
    """Put the way to a goal, units in body axes, scaled to the length d / sqrt(d^2 + s^2) for a
    distance d and s = ``GOAL_INPUT_SCALE``: it is bounded, and keeps the direction at any distance.
    """
    x, y, z = way
    shrink = 1.0 / square_root(fma(x, x, fma(y, y, fma(z, z, GOAL_INPUT_SCALE * GOAL_INPUT_SCALE))))
    for i in range(3):
        put(values, at + i, way[i] * shrink)


def put_inputs(
    values: Any,
    layout: Any,
    turns: Number,
    up: Vector,
    north: Vector,
    gyro: Vector,
    fins: Numbers,
    way: Vector,
) -> None:
    """Put a controller's inputs into ``values``, in the order of ``Senses.names``.

    ``turns`` is what the clock has made; see :func:`responder` for the others.
    """
    at = 0
    if layout[IMU_ENTRY]:
        observe_imu(values, at, up, north, gyro)
        at += 9
    if layout[CLOCK_ENTRY]:
        observe_clock(values, at, layout[CLOCK_ENTRY], turns)
        at += 2 * layout[CLOCK_ENTRY]
    if layout[FINS_ENTRY]:
        observe_fins(values, at, fins)
        at += 2 * len(fins)
    if layout[GOAL_ENTRY]:
        observe_goal(values, at, way)


def forward(genes: Any, layout: Any, values: Any, group: int, groups: int, like: Number) -> None:
    """Put the nodes' values after the inputs in ``values``.

    A node is connected to all inputs, to all nodes of the layers before its own, and, where there
    is memory, to the previous values of the nodes of its own layer and of those after.

    Parameters
    ----------
    genes, layout
        See :func:`responder`.
    values
        Flat scratch space: the inputs, the nodes, and as many once more.
    group, groups
        Which robots (see ``engines/compiled/kernel.py``); 0 of 1 on plain floats.
    like
        Any number of the arithmetic.
    """
    inputs = layout[INPUTS_ENTRY]
    nodes = layout[NODES_ENTRY]
    memory = layout[MEMORY_ENTRY]
    clipped = layout[CLIPPED_ENTRY]
    at = HEADER_ROWS * groups + group
    begin = inputs
    for layer in range(layout[LAYERS_ENTRY]):
        end = inputs + layout[LAYERS_ENTRY + 1 + layer]
        sources = inputs + nodes if memory else begin
        for node in range(begin, end):
            bias = fetch(genes, at, like)
            response = fetch(genes, at + groups, like)
            at += 2 * groups
            total = 0.0 * like
            for i in range(sources):
                total = total + fetch(genes, at, like) * fetch(values, i, like)
                at += groups
            z = OUTPUT_GAIN * (bias + response * total)
            if clipped and end == inputs + nodes:
                put(values, node + nodes, clip(z, 1.0))
            else:
                put(values, node + nodes, tanh(z))
        for node in range(begin, end):
            put(values, node, fetch(values, node + nodes, like))
        begin = end


@cache
def responder(plan: BodyPlan) -> Any:
    """Return the function by which controllers of a plan's robots act.

    It is a policy of ``engines/compiled/kernel.py``, and returns the last nodes' values: the
    action, in [-1, 1]. Its parameters:

    genes
        Flat table whose row r is entry ``r * groups + group``. The first row is the clock's
        frequency in Hz; then follow, for each node, its bias, its response, and its weights from
        the inputs and from the nodes that it is connected to.
    layout
        Whole numbers, in this order: whether the IMU is observed; the number of harmonics of the
        clock; whether the fins are observed; whether the goal is; the number of inputs; of nodes;
        whether they have a memory; whether the outputs are clipped at 1 instead of tanh; the number
        of layers, and the node at which each ends.
    scratch
        Numbers that live through a swim: the inputs, and the nodes twice.
    time
        s since the swim began.
    up, north, gyro, way
        See :func:`observe_imu` and :func:`observe_goal`.
    fins
        Where the fins are believed to be, in turns.
    """
    fetch_fins = law(plan).fetch_fins
    count = len(plan.fins)

    def respond(
        genes: Any,
        layout: Any,
        scratch: Any,
        group: int,
        groups: int,
        time: float,
        up: Vector,
        north: Vector,
        gyro: Vector,
        fins: Numbers,
        way: Vector,
    ) -> Numbers:
        like = gyro[0]
        if time == 0.0:
            for i in range(layout[INPUTS_ENTRY] + 2 * layout[NODES_ENTRY]):
                put(scratch, i, 0.0 * like)
        turns = fetch(genes, group, like) * time
        put_inputs(scratch, layout, turns, up, north, gyro, fins, way)
        forward(genes, layout, scratch, group, groups, like)
        last = layout[INPUTS_ENTRY] + layout[NODES_ENTRY]
        return fetch_fins(scratch, last - count, 0, 1, like)

    return respond
