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
high. No exponent of it depends on that, nor does what is given per beat, which is 0.5 s of that
clock; the number of beats after which our swims are compared does.
"""

from __future__ import annotations

BEAT = 0.5  # s of the first robot's clock

# Amplitude (degrees) of each of the twelve published runs without bias, and its mean forward speed
# (m/s) in the second about each of SPEED_SECONDS after it began: of ASTATES1 to ASTATES3, filtered
# by the authors. ``python -m experiments.real fish --data DIR`` prints them.
SPEED_SECONDS = (3, 4, 5)  # the shortest run ends at 5.53
AMPLITUDE_RUNS = (
    (15, (0.0488, 0.0583, 0.0652)),
    (15, (0.0503, 0.0592, 0.0681)),
    (15, (0.0449, 0.0579, 0.0659)),
    (20, (0.0844, 0.0974, 0.1084)),
    (20, (0.0879, 0.1027, 0.1168)),
    (20, (0.0818, 0.1210, 0.1238)),
    (25, (0.1230, 0.1461, 0.1643)),
    (25, (0.1268, 0.1435, 0.1658)),
    (25, (0.1198, 0.1445, 0.1579)),
    (30, (0.1716, 0.1946, 0.2120)),
    (30, (0.1658, 0.1966, 0.2347)),
    (30, (0.1748, 0.1952, 0.2089)),
)
SPEED_BEATS = tuple(round(seconds / BEAT) for seconds in SPEED_SECONDS)
WINDOW_BEATS = round(1.0 / BEAT)  # of each mean


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


def speeds_at(number: int) -> list[tuple[int, float]]:
    """Return amplitude and speed of each of ``AMPLITUDE_RUNS`` at one of ``SPEED_SECONDS``."""
    return [(amplitude, speeds[number]) for amplitude, speeds in AMPLITUDE_RUNS]
