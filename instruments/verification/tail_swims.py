"""Swims by a tail that beats at any amplitude, frequency and bias, in our two laws of water."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.engines.api import TIMESTEP
from aquafish_gym.engines.compiled.lanes import LaneBatch
from aquafish_gym.imu import ImuLog
from aquafish_gym.physics.layout import FIELDS
from instruments.verification.fish_data import SPEED_BEATS, WINDOW_BEATS
from instruments.verification.paper_robot import SWEEP
from instruments.verification.propulsion import straight_swims
from instruments.verification.trials import STILL, lane_batch

Array = NDArray[np.float64]

SUBSTEPS = 54  # at 1 Hz; at other frequencies a beat has as many steps
# Beats after a push: until measuring, to the middle, and to the end.
BEATS = (4, 8, 12)
ROUNDS, FIRST_PUSH = 10, 10.0  # the first push is this often what was gained
TURNING = (12, 16)  # beats from rest between which a turn is measured, as the published ones are


def tail_commands(frequency: float, amplitude: float, bias: float, samples: int) -> Array:
    """Return commands (samples, 3) under which the tail's angle is bias + amplitude sin(2 pi f t).

    The servo turns the phase of an angle of ``SWEEP`` sin(phase), and the engine's servos turn
    either way, so any angle within ``SWEEP`` can be had. Between samples the phase is a straight
    line. Angles are in rad.
    """
    t = TIMESTEP * np.arange(samples + 1)
    angle = bias + amplitude * np.sin(2 * math.pi * frequency * t)
    commands = np.zeros((samples, 3))
    if amplitude == SWEEP and not bias:
        commands[:, 2] = frequency
    else:
        commands[:, 2] = np.diff(np.arcsin(angle / SWEEP)) / (2 * math.pi * TIMESTEP)
    return commands


def beat_tails(
    bodies: Array,
    frequency: float,
    reactive: bool,
    beats: int,
    amplitude: float = SWEEP,
    bias: float = 0.0,
    substeps: int = SUBSTEPS,
) -> ImuLog:
    """Return the logs of robots (B, 9) that beat their tails from rest, with still pectorals.

    Parameters
    ----------
    bodies, frequency, reactive
        As of :func:`~instruments.verification.propulsion.swim_straight`.
    beats
        How many.
    amplitude, bias
        Of the tail's angle, rad.
    substeps
        Steps in a sample of 0.01 s.
    """
    samples = round(beats / (frequency * TIMESTEP))
    commands = tail_commands(frequency, amplitude, bias, samples)
    start = (0.0, 0.0, math.asin(bias / SWEEP))
    lanes = lane_batch(bodies, start, dtype=np.float64, substeps=substeps, reactive=reactive)
    return lanes.log(np.tile(commands, (len(bodies), 1, 1)), samples, "pose")


def steady_swims(
    bodies: Array,
    frequency: float,
    reactive: bool,
    amplitude: float = SWEEP,
    substeps: int = SUBSTEPS,
) -> tuple[Array, Array, Array]:
    """Return the steady swims of beating tails.

    From rest a weak swimmer needs hundreds of beats. Every few beats it gets a push ahead here, to
    the speed at which, by the secant method, it would neither gain nor lose any.

    Returns
    -------
    speeds : (B,)
        Units/s.
    strouhal : (B,)
        Strouhal numbers.
    unsettled : (B,)
        By which share the speed still changes between the two halves of the last beats.
    """
    per_beat = round(1 / (frequency * TIMESTEP))
    settled, middle, end = (beats * per_beat for beats in BEATS)
    lanes = lane_batch(bodies, STILL, dtype=np.float64, substeps=substeps, reactive=reactive)
    commands = tail_commands(frequency, amplitude, 0.0, ROUNDS * end)
    commands = np.tile(commands, (len(bodies), 1, 1))
    mean = gain = strouhal = np.zeros(len(bodies))
    for turn in range(ROUNDS):
        log = lanes.log(commands, end, "pose")
        before, gained = mean, gain
        first, _ = straight_swims(bodies, log, frequency, settled, middle)
        mean, strouhal = straight_swims(bodies, log, frequency, middle, end)
        gain = mean - first
        if turn == ROUNDS - 1:
            break
        change = np.where(gain == gained, np.inf, gain - gained)
        assert log.position is not None
        _push(lanes, np.asarray(log.position[:, -1] - log.position[:, middle], np.float64),
              -gain * (mean - before) / change if turn else FIRST_PUSH * gain)  # fmt: skip
    return mean, strouhal, np.abs(gain / mean)


def _push(lanes: LaneBatch, course: Array, push: Array) -> None:
    """Give swimmers a push (B,), units/s, along their course (B, 3), and level them.

    Rounding tips an unstable swimmer, slowly; levelled, it stays in its plane.
    """
    rows = lanes.states
    rows[FIELDS["orientation"]][:2] = 0.0
    rows[FIELDS["orientation"]] /= np.linalg.norm(rows[FIELDS["orientation"]], axis=0)
    rows[FIELDS["spin"]][:2] = 0.0
    ahead = course[:, :2] / np.linalg.norm(course[:, :2], axis=1, keepdims=True)
    rows[FIELDS["velocity"]][:2] += (push[:, None] * ahead).T
    rows[FIELDS["velocity"]][2] = 0.0


def begun_swims(
    bodies: Array, reactive: bool, amplitude: int, substeps: int
) -> list[tuple[Array, Array]]:
    """Return speeds and Strouhal numbers (B,) about each of ``SPEED_BEATS`` from rest."""
    half, per_beat = WINDOW_BEATS // 2, round(1 / TIMESTEP)
    beats = max(SPEED_BEATS) + half
    log = beat_tails(bodies, 1.0, reactive, beats, math.radians(amplitude), substeps=substeps)
    return [
        straight_swims(bodies, log, 1.0, (at - half) * per_beat, (at + half) * per_beat)
        for at in SPEED_BEATS
    ]


def turns_per_beat(bodies: Array, reactive: bool, bias: float, amplitude: float) -> Array:
    """Return the change of heading (B,) in a beat, rad, towards the side that the tail leans to."""
    begin, end = TURNING
    log = beat_tails(bodies, 1.0, reactive, end, amplitude, bias, substeps=4)
    assert log.quaternion is not None
    x, y, z, w = np.moveaxis(np.asarray(log.quaternion, np.float64), -1, 0)
    heading = np.unwrap(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))
    samples = round(1 / TIMESTEP)
    turned: Array = (heading[:, end * samples - 1] - heading[:, begin * samples - 1]) / (
        begin - end
    )
    return turned
