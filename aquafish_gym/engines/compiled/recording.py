"""Recording in the compiled loop: samples are gathered in blocks and written to logs.

A log is an array (B, channels, T). A block holds some samples of one register's robots, and stays
in the fastest cache until it is written.
"""

from __future__ import annotations

from typing import Any

from aquafish_gym.physics import simd
from aquafish_gym.physics.arithmetic import Number, Vector, put
from aquafish_gym.physics.kinematics import State
from aquafish_gym.physics.layout import put_vector

BLOCK = 16  # samples
WIDTHS = (1, 2, 4, 8, 16)  # a block is transposed in squares, so they divide it

# What to record. The spectrum is the gyroscope's. Where it or the gyroscope is recorded alone, the
# attitude is computed only at the end.
RPY_BIT = 1
GYRO_BIT = 2
POSE_BIT = 4
SPECTRUM_BIT = 8
# The channels of each log, in the order of the logs; an angle for each fin follows the pose's.
RECORDED_CHANNELS = {RPY_BIT: 3, GYRO_BIT: 3, POSE_BIT: 7}


def put_sample(blocks: Any, record: int, at: int, rpy: Vector, state: State) -> None:
    """Put sample ``at`` of a block: roll, pitch and yaw, the gyroscope, the pose without fins."""
    if record & RPY_BIT:
        put_vector(blocks[0], 0, at, BLOCK, rpy)
    if record & GYRO_BIT:
        put_vector(blocks[1], 0, at, BLOCK, state.spin)
    if record & POSE_BIT:
        q = state.orientation
        put_vector(blocks[2], 0, at, BLOCK, state.position)
        put_vector(blocks[2], 3, at, BLOCK, (q[0], q[1], q[2]))
        put(blocks[2], 6 * BLOCK + at, q[3])


def write_blocks(
    blocks: Any, logs: Any, record: int, first: int, count: int, group: int, zero: Number
) -> None:
    """Write ``count`` samples of every block to the logs, from sample ``first`` on."""
    if record & RPY_BIT:
        write_block(blocks[0], logs[0], first, count, group, zero)
    if record & GYRO_BIT:
        write_block(blocks[1], logs[1], first, count, group, zero)
    if record & POSE_BIT:
        write_block(blocks[2], logs[2], first, count, group, zero)


def write_block(block: Any, log: Any, first: int, count: int, group: int, zero: Number) -> None:
    """Write ``count`` samples of every channel of a group's robots to log (B, channels, T)."""
    width = block.size // (log.shape[1] * BLOCK)
    robot = group * width
    channels = log.shape[1]
    samples = log.shape[2]
    if count == BLOCK and robot + width <= log.shape[0]:
        for channel in range(channels):
            start = (robot * channels + channel) * samples + first
            for k in range(0, BLOCK, width):
                at = channel * BLOCK + k
                simd.put_transposed(block, at, log, start + k, channels * samples, zero)
        return
    first_lane = simd.first_lane(zero)
    last_lane = min(first_lane + simd.lanes_here(zero), log.shape[0] - robot)
    for lane in range(first_lane, last_lane):
        for channel in range(channels):
            at = channel * BLOCK * width + lane
            for k in range(count):
                log[robot + lane, channel, first + k] = block[at + k * width]
