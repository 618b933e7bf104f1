"""What other people measured on robots that swim by a beating tail: numbers and their sources.

- ``AMPLITUDE_RUNS`` and ``BIAS_RUNS``: a robot of Michigan State University, with a tail on a
  servo; Mamakoukas, Castano, Tan and Murphey, "Local Koopman Operators for Data-Driven Control of
  Robotic Systems" (2019). Read from github.com/giorgosmamakoukas/dataDrivenControlOfRoboticFish,
  commit 1189558, folder roboticFishKoopman. It has no licence, so no file of it is here.
- ``FREQUENCY_RUNS`` and ``TIP_EXCURSION``: a robot of ETH Zurich, with a soft tail drawn by
  tendons; Michelis, Obayashi, Hughes and Katzschmann, arXiv:2602.23283 (2026). Read from
  github.com/srl-ethz/fishsim (MIT licence), commit 9e3b816, Data/Markers/rotatedMarkers_*.csv.

The first robot's tail was set to 1 Hz, but its heading swings twice a second of its files' clock,
and its servo logs last about twice as long as its tracks. Its speeds may therefore be twice too
high. No exponent depends on that, nor does what is given per beat, which is 0.5 s of that clock.
"""

from __future__ import annotations

BEAT = 0.5  # s of the first robot's clock

# Amplitude (degrees) and the mean forward speed over the last second (m/s by the files' clock) of
# each published run without bias. Runs marked A are filtered, in m per 0.1 s.
AMPLITUDE_RUNS = (
    (15, 0.1036),  # A1
    (15, 0.1045),  # A2
    (20, 0.1279),  # A1
    (20, 0.1325),  # A2
    (20, 0.1257),  # A3
    (25, 0.1808),  # STATES1
    (25, 0.1824),  # STATES2
    (25, 0.1716),  # A3
    (30, 0.2166),  # STATES1
)

# How many beats from about rest those runs last, by amplitude; the last second is two beats.
RUN_BEATS = {15: 25, 20: 14, 25: 13, 30: 11}

# Bias (degrees, without its sign) and the heading's change over the last 2 s (rad) at an
# amplitude of 15 degrees. The run at -30 is cut where the tracking loses the fish; its last
# second counts twice.
BIAS_SECONDS = 2.0
BIAS_RUNS = (
    (20, 0.360),  # 20: STATES1
    (30, 0.300),  # 30: A2
    (30, 0.439),  # -30: A1
    (40, 0.454),  # 40: A2
    (40, 0.403),  # -40: A1
    (50, 0.602),  # 50: A2
    (50, 0.500),  # -50: STATES1
)

# Frequency (Hz) and speed (m/s): the slope of the head's displacement over about 5 s.
FREQUENCY_RUNS = (
    (0.50, 0.023),
    (0.75, 0.050),
    (1.00, 0.081),
    (1.25, 0.105),
    (1.50, 0.130),
    (1.75, 0.161),
    (2.00, 0.202),
    (2.25, 0.223),
)

# The whole excursion (m) of the last marker, at the tail's tip, across the axis of the head.
TIP_EXCURSION = {0.50: 0.159, 1.00: 0.194, 2.25: 0.202}
# From the first marker on the head to the last one (m), and water's viscosity (m^2/s).
LENGTH, VISCOSITY = 0.58, 1.0e-6


def bainbridge(frequency: float) -> float:
    """Return a dace's, trout's or goldfish's speed in body lengths/s at 5 Hz and more.

    Bainbridge, J. Exp. Biol. 35 (1958): V = L (3 f - 4) / 4.
    """
    return (3 * frequency - 4) / 4


def turn_per_beat(turn: float) -> float:
    """Return what one of ``BIAS_RUNS`` turns in a beat, rad."""
    return turn * BEAT / BIAS_SECONDS
