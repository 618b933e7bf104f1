"""A quadrotor for joint inference: what its propellers have lost, from the commands of a hover.

Four balances give the propellers' thrusts: the weight is carried, and nothing rolls, pitches or
turns the drone. Blade theory (:mod:`experiments.real.blade`) gives each propeller's speed and
torque, a direct-current motor its voltage, and the firmware's own map the command that asks for it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from eea import Hypothesis, Number, Robot
from experiments.real.blade import loss
from experiments.real.crazypad import MOTORS, Floats
from experiments.real.hover import AXES, MIX

#: The firmware asks for ``LINEAR f - SQUARE f^2`` volts for f grams of thrust of all four motors;
#: the greatest command is 60 g.
LINEAR_V = 0.088
SQUARE_V = 0.0006239
FULL_GRAMS = 60.0
#: The share of a hovering motor's voltage that its resistance takes. The same map is
#: ``a f + b sqrt(f)`` through 25 and 45 g, which is such a motor with thrust ~ speed^2; of its
#: voltage at 36 g, a hover, ``a f`` is 0.36.
RESISTIVE = Number(0.36, sd=0.05)
#: The loss of a cut propeller, over that of blade theory. The theory knows the outline within 10%,
#: and takes a blade for a lifting line that is three times as long as wide.
BLADE = Number(1.0, sd=0.2)
FLAPPING = Number(0.0, sd=0.05)  # pitch command at a forward speed of 1 m/s
LOST_MM = Number(mean=0.0, sd=4.0, low=0.0)  # a propeller of 47 mm loses a few mm, hardly 10
LOAD = Number(mean=0.0, sd=0.3, low=0.0)  # a weight at a motor, over a quarter of the drone's
MOST_LOST_MM = 10.0
MOST_LOAD = 0.8
ONE_CUT_ODDS = 0.6  # over nothing's, of all four
TWO_CUT_ODDS = 0.2
LOAD_ODDS = 0.2
LEAST_THRUST = 0.05  # of a whole drone's motor

TRIMS = tuple(f"{axis} trim" for axis in AXES)
GAINS = tuple(f"{motor} gain" for motor in MOTORS)


@dataclass(frozen=True)
class Spread:
    """How far commands of a drone may differ where nothing is broken: standard deviations."""

    flight: Floats  #: (4,), from flight to flight, of ``AXES``
    gain: float  #: of each motor, since the reference
    battery: float  #: of all motors at once, since the reference


@dataclass(frozen=True, eq=False)
class Known:
    """The drone as it was."""

    level: Floats  #: (4,), the mean of a hover's signal, as ``AXES``
    cuts: Floats  #: (4,), mm that the propellers had lost already
    spread: Spread


def voltages(cuts: Floats, load: Floats, blade: Floats, resistive: Floats) -> Floats:
    """Return the motors' voltages (B, 4) in a hover, over those of a whole drone.

    ``cuts`` (B, 4) are mm, ``load`` (B, 4) weights at the motors over a quarter of the drone's.
    """
    lost = loss(cuts)
    thrust_loss = blade[:, None] * lost.thrust
    torque_loss = blade[:, None] * lost.torque_per_thrust
    balance = np.repeat(np.sign(MIX)[None], len(cuts), axis=0)
    balance[:, 3] *= np.exp(torque_loss)  # M1 and M3 turn against M2 and M4
    wanted = (1.0 + load) @ np.sign(MIX).T
    wanted[:, 3] = 0.0
    thrust = np.linalg.solve(balance, wanted[:, :, None])[:, :, 0]
    thrust = np.maximum(thrust, LEAST_THRUST)
    speed = np.sqrt(thrust * np.exp(-thrust_loss))
    share = resistive[:, None]
    found: Floats = share * np.exp(torque_loss) * thrust + (1.0 - share) * speed
    return found


def commanded(level: Floats, over: Floats) -> Floats:
    """Return logarithms of commands (B, 4) for voltages ``over`` (B, 4) times those of a level."""
    grams = FULL_GRAMS * np.exp(level)
    wanted = (LINEAR_V * grams - SQUARE_V * grams**2) * over
    most = LINEAR_V * FULL_GRAMS - SQUARE_V * FULL_GRAMS**2
    root = np.sqrt(LINEAR_V**2 - 4.0 * SQUARE_V * np.minimum(wanted, most))
    found: Floats = np.log((LINEAR_V - root) / (2.0 * SQUARE_V * FULL_GRAMS))
    return found


def together(values: Mapping[str, Floats], names: Sequence[str]) -> Floats:
    """Return some of the values as columns (B, n)."""
    return np.array([values[name] for name in names]).T


def quadrotor(known: Known) -> Robot:
    """Return a drone of which is asked what it has lost since it was known."""
    lost = tuple(f"{motor} lost" for motor in MOTORS)
    loads = tuple(f"load at {motor}" for motor in MOTORS)
    level = known.level @ np.linalg.inv(MIX).T
    spread = known.spread

    def simulate(values: Mapping[str, Floats], inputs: Floats) -> Floats:
        """Return the commands (B, T, 4) of drones that fly forward at ``inputs`` (B, T), m/s."""
        cuts = known.cuts + together(values, lost)
        factors = values["blade"], values["resistive"]
        before = voltages(np.broadcast_to(known.cuts, cuts.shape), 0.0 * cuts, *factors)
        over = voltages(cuts, together(values, loads), *factors) / before
        motors = commanded(level, over) + together(values, GAINS) + values["battery"][:, None]
        axes = motors @ MIX.T + together(values, TRIMS)
        signal = np.repeat(axes[:, None], inputs.shape[1], axis=1)
        signal[:, :, AXES.index("pitch")] += values["flapping"][:, None] * inputs
        return signal

    trims = spread.flight.tolist()
    return Robot(
        simulate=simulate,
        numbers=dict.fromkeys(lost, Number(0.0, MOST_LOST_MM, healthy=0.0, unit="mm"))
        | dict.fromkeys(loads, Number(0.0, MOST_LOAD, healthy=0.0))
        | {"blade": BLADE, "resistive": RESISTIVE, "flapping": FLAPPING}
        | {gain: Number(0.0, sd=spread.gain) for gain in GAINS}
        | {"battery": Number(0.0, sd=spread.battery)}
        | {trim: Number(0.0, sd=sd, varies=True) for trim, sd in zip(TRIMS, trims, strict=True)},
        channels=dict.fromkeys(AXES, "log command"),
        hypotheses=what_may_break(),
    )


def what_may_break() -> list[Hypothesis]:
    """Return the hypotheses: one or two propellers have lost some of their length, or a weight."""
    found = [
        Hypothesis(f"{m} is cut", moves={f"{m} lost": LOST_MM}, odds=ONE_CUT_ODDS / 4)
        for m in MOTORS
    ]
    for one, other in combinations(MOTORS, 2):
        moves = {f"{one} lost": LOST_MM, f"{other} lost": LOST_MM}
        found.append(Hypothesis(f"{one} and {other} are cut", moves=moves, odds=TWO_CUT_ODDS / 6))
    hint = "weigh the drone"
    for m in MOTORS:
        moves = {f"load at {m}": LOAD}
        found.append(Hypothesis(f"a weight is at {m}", moves=moves, odds=LOAD_ODDS / 4, hint=hint))
    return found
