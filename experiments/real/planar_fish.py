"""A fish with one tail in the plane, by the drag law and the reactive terms of this project.

The functions of ``aquafish_gym.physics`` give the water's forces on hull and tail, a plate of no
thickness. What is new is the plane, and that the hull's length, masses and drag are numbers of this
fish: the engines' hull is one capsule. A test compares this motion with the engine's.

Axes are the body's forward and left; metres, kilograms, seconds, rad.
"""

from __future__ import annotations

import functools
import math
import sys
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.physics.added_mass import plate_inertia, plate_mass, trailing_edge
from aquafish_gym.physics.arithmetic import Number
from aquafish_gym.physics.compiling import compiled_function, register_functions, register_module
from aquafish_gym.physics.hydrodynamics import fin_drag
from aquafish_gym.physics.law import law
from aquafish_gym.physics.robot import Fin
from aquafish_gym.plans import AQUAFISH

Array = NDArray[np.float64]

FRAME = 1 / 30  # s, between the camera's frames
STEPS = 3  # of the integration in a frame
WATER = 1000.0  # kg/m^3; the physics has density 1
CAPSULE_LENGTH = AQUAFISH.hull.length  # units
_hull_drag = law(AQUAFISH).body_drag


class Swimmer(NamedTuple):
    """The numbers of a fish.

    No trajectory tells the scale of masses and forces. Masses, and drag with them, are relative to
    the hull's surge mass, which is 1 kg with its added mass.
    """

    tail_length: Number  #: m
    tail_height: Number  #: m
    tail_drag: Number  #: A factor on the drag law of fins.
    hinge: Number  #: The tail's, m behind the hull's centre.
    hull_length: Number  #: Of the capsule whose drag the hull has, m.
    hull_along: Number  #: A factor on the capsule's drag along its axis.
    hull_across: Number  #: And across it.
    sway_mass: Number  #: With added mass, kg.
    yaw_inertia: Number  #: With added inertia, kg m^2.
    servo_gain: Number  #: The tail's angle over the commanded one.
    trim: Number  #: The tail's angle where none is commanded, rad.
    marker: Number  #: The tracked point, m ahead of the hull's centre.


class Beat(NamedTuple):
    """The tail's motion in a trial: angle = middle + amplitude sin(phase)."""

    amplitude: Number  #: rad
    middle: Number  #: rad
    rate: Number  #: Of the phase, rad/s.


class Planar(NamedTuple):
    """The state of the hull's centre, and the phase of the tail."""

    x: Number
    y: Number
    heading: Number
    surge: Number
    sway: Number
    yaw_rate: Number
    phase: Number


def planar_step(fish: Swimmer, beat: Beat, state: Planar, h: Number) -> Planar:
    """Return the state after a step of ``h`` seconds, in the scheme of the engines.

    The step's joint speed and acceleration are the sine's own at its beginning.
    """
    u = state.surge
    v = state.sway
    r = state.yaw_rate
    swing = beat.amplitude * math.sin(state.phase)
    angle = beat.middle + swing
    rate = beat.amplitude * beat.rate * math.cos(state.phase)
    acceleration = -swing * beat.rate * beat.rate
    # The tail's unit vectors: along it towards the hinge, and its normal.
    along_x = math.cos(angle)
    along_y = math.sin(angle)
    normal_x = -along_y
    normal_y = along_x
    spin = r + rate
    hinge_sway = v - r * fish.hinge
    hinge_along = u * along_x + hinge_sway * along_y
    hinge_normal = u * normal_x + hinge_sway * normal_y

    # Drag and the shed water, in the tail's axes (width, length, normal) and about the hinge.
    fin = Fin(
        fish.tail_height, fish.tail_length, 0.0, 0.0, (0.0, 0.0, 0.0), fish.tail_drag
    )  # fmt: skip
    drag, turning = fin_drag(fin, (0.0, hinge_along, hinge_normal), (spin, 0.0, 0.0))
    end = (0.0, hinge_along, hinge_normal - spin * fish.tail_length)
    shed = trailing_edge(fin, end, (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    pull = WATER * (drag[1] + shed[1])
    push = WATER * (drag[2] + shed[2])
    torque = WATER * (turning[0] - fish.tail_length * shed[2])

    # The water that moves with the tail, without the hull's acceleration: its momentum is
    # mass (V . n) n with V the velocity of the tail's centre.
    mass = WATER * plate_mass(fish.tail_height, fish.tail_length)
    inertia = WATER * plate_inertia(fish.tail_height, fish.tail_length)
    half = 0.5 * fish.tail_length
    centre_normal = hinge_normal - spin * half
    hinge_bias = r * r * fish.hinge * normal_x  # the hinge turns about the hull's centre
    growth = hinge_bias - acceleration * half - spin * hinge_along
    pull += mass * centre_normal * spin
    push -= mass * growth
    torque += half * mass * growth - inertia * acceleration
    torque -= mass * hinge_along * centre_normal
    force_x = pull * along_x + push * normal_x
    force_y = pull * along_y + push * normal_y
    moment = torque - fish.hinge * force_y

    # The hull: the capsule's drag, and Kirchhoff's equations.
    unit = fish.hull_length / CAPSULE_LENGTH
    hull, hull_torque = _hull_drag((-v / unit, u / unit, 0.0), (0.0, 0.0, r))
    scale = WATER * unit * unit * unit * unit
    force_x += fish.hull_along * scale * hull[1] + fish.sway_mass * v * r
    force_y -= fish.hull_across * scale * hull[0] + u * r
    moment += fish.hull_across * scale * unit * hull_torque[2] + (1.0 - fish.sway_mass) * u * v

    # Newton and Euler, with the water that the hull's acceleration moves at the tail.
    lever = -fish.hinge * normal_y - half
    turned = mass * (u * normal_y - v * normal_x) * r
    force_x -= turned * normal_x
    force_y -= turned * normal_y
    moment -= turned * lever
    xx = 1.0 + mass * normal_x * normal_x
    xy = mass * normal_x * normal_y
    yy = fish.sway_mass + mass * normal_y * normal_y
    xz = mass * normal_x * lever
    yz = mass * normal_y * lever
    zz = fish.yaw_inertia + inertia + mass * lever * lever
    cx = yy * zz - yz * yz
    cy = xz * yz - xy * zz
    cz = xy * yz - xz * yy
    per = 1.0 / (xx * cx + xy * cy + xz * cz)
    dy = xx * zz - xz * xz
    dz = xy * xz - xx * yz
    ez = xx * yy - xy * xy
    u += h * per * (cx * force_x + cy * force_y + cz * moment)
    v += h * per * (cy * force_x + dy * force_y + dz * moment)
    r += h * per * (cz * force_x + dz * force_y + ez * moment)
    heading = state.heading + h * r
    cosine = math.cos(heading)
    sine = math.sin(heading)
    return Planar(
        state.x + h * (u * cosine - v * sine),
        state.y + h * (u * sine + v * cosine),
        heading,
        u,
        v,
        r,
        state.phase + h * beat.rate,
    )


def _swim(fish: Array, beats: Array, starts: Array, frames: NDArray[np.intp], pose: Array) -> None:
    """Fill ``pose`` (B, T, 3): of the tracked point, from the start on."""
    h = FRAME / STEPS
    for i in range(len(fish)):
        f = fish[i]
        one = Swimmer(
            f[0], f[1], f[2], f[3], f[4], f[5], f[6], f[7], f[8], f[9], f[10], f[11]
        )  # fmt: skip
        beat = Beat(beats[i, 0], beats[i, 1], beats[i, 2])
        s = starts[i]
        x = s[0] - one.marker * math.cos(s[2])
        y = s[1] - one.marker * math.sin(s[2])
        state = Planar(x, y, s[2], s[3], s[4], s[5], s[6])
        for t in range(pose.shape[1]):
            pose[i, t, 0] = state.x + one.marker * math.cos(state.heading)
            pose[i, t, 1] = state.y + one.marker * math.sin(state.heading)
            pose[i, t, 2] = state.heading
            if t + 1 < frames[i]:
                for _ in range(STEPS):
                    state = planar_step(one, beat, state, h)


@functools.cache
def _kernel() -> Any:
    register_functions(_hull_drag)
    register_module(sys.modules[__name__])
    return compiled_function(_swim)


def swim(
    fish: Mapping[str, Array],
    command: Array,
    start: Array,
    beat_rate: Array,
    frames: NDArray[np.intp],
    longest: int,
) -> Array:
    """Return the tracked poses (B, longest, 3), m and rad, of B trials from their start on.

    Parameters
    ----------
    fish
        The fields of a :class:`Swimmer`, (B,) each.
    command
        The commanded amplitude and bias of the tail, rad, (B, 2).
    start
        The tracked pose, surge, sway and yaw rate of the hull's centre, and phase of the tail,
        (B, 7).
    beat_rate
        Of the phase, rad/s, (B,).
    frames
        How many each trial has, (B,); then it stays where it is.
    """
    count = len(command)
    numbers = np.column_stack([np.broadcast_to(fish[name], count) for name in Swimmer._fields])
    gain = numbers[:, Swimmer._fields.index("servo_gain")]
    trim = numbers[:, Swimmer._fields.index("trim")]
    beats = np.column_stack([gain * command[:, 0], gain * command[:, 1] + trim, beat_rate])
    pose = np.empty((count, longest, 3))
    _kernel()(numbers, beats, np.ascontiguousarray(start, np.float64), frames, pose)
    return pose
