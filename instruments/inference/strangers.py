"""Twelve robots of other people: their simulators, and whether the intervals hold.

Each is a kind of simulator or of log that the fish is not: an adaptive solver, noise in the
simulator itself, single precision, a compass that wraps, a whole number, an alias, two numbers that
can be exchanged, a true value beyond the range, few samples, many numbers. Of each, random robots
are drawn from the statement, simulated exactly, and inferred as a user would.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.stats import binomtest

from eea import Number, Robot, Trial, one_by_one

Floats = NDArray[np.float64]
Values = Mapping[str, Any]

#: Kind -> its title.
KINDS = {
    "solver": "adaptive solver, rtol 1e-3",
    "jitter": "simulator that does not repeat",
    "float32": "single precision",
    "compass": "compass that wraps",
    "delay": "delay in whole samples",
    "alias": "aliased frequency",
    "pair": "two rates in exchange",
    "bound": "true gain at its bound or beyond",
    "slow": "four samples a second",
    "second": "one sample a second",
    "fifteen": "15 numbers",
    "twentyfive": "25 numbers",
}
#: Robots of each kind, at full size: those with short logs are quick, and a share of few numbers
#: is vague.
DRAWS = dict.fromkeys(KINDS, 40) | dict.fromkeys(("slow", "second"), 400)
MASS = 0.9
STEP = 0.05  # s
#: What an answer says where its intervals are not to be trusted as they are.
WARNINGS = ("may be beyond", "alike", "may be too narrow")
SECOND = 20  # steps in a second


@dataclass(frozen=True)
class Stranger:
    """A kind of robot: its statement, its exact simulator, its noise and its input."""

    robot: Robot
    exact: Callable[[Values, Any], Any]
    noise: tuple[float, ...]
    inputs: Callable[[np.random.Generator], Any]
    #: Where true values are drawn from; by default the stated range, a tenth from its ends.
    truth: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    whole: tuple[str, ...] = ()  #: Numbers whose true values are whole.


def drive(values: Values, thrust: Floats) -> Floats:
    """Return speeds (B, T, 1), m/s, of a boat with a gain and a linear drag."""
    speed = np.zeros(len(thrust))
    out = np.empty((*thrust.shape, 1))
    for step in range(thrust.shape[1]):
        speed = speed + STEP * (values["gain"] * thrust[:, step] - values["drag"] * speed)
        out[:, step, 0] = speed
    return out


def single(values: Values, thrust: Floats) -> Floats:
    """Return what ``drive`` does in single precision."""
    speed = np.zeros(len(thrust), np.float32)
    gain = np.float32(1.0) * values["gain"].astype(np.float32)
    drag = values["drag"].astype(np.float32)
    out = np.empty((*thrust.shape, 1), np.float32)
    for step in range(thrust.shape[1]):
        push = thrust[:, step].astype(np.float32)
        speed = speed + np.float32(STEP) * (gain * push - drag * speed)
        out[:, step, 0] = speed
    return out


class Counting:
    """A simulator that counts the trials that it simulates."""

    def __init__(self, simulate: Callable[..., Any]) -> None:
        self._simulate = simulate
        self.trials = 0

    def __call__(self, values: Values, inputs: Any) -> Any:
        self.trials += len(inputs)
        return self._simulate(values, inputs)


class Jittering:
    """``drive`` on a machine that does not repeat itself: each call has an error of its own."""

    def __init__(self, size: float) -> None:
        self._size = size
        self._rng = np.random.default_rng(0)

    def __call__(self, values: Values, thrust: Floats) -> Floats:
        exact = drive(values, thrust)
        return exact + self._rng.normal(0.0, self._size, exact.shape)


def delayed(values: Values, thrust: Floats) -> Floats:
    """Return what ``drive`` does of thrusts that arrive a whole number of samples late."""
    late = np.arange(thrust.shape[1])[None] - np.round(values["delay"]).astype(int)[:, None]
    sent = np.where(late >= 0, np.take_along_axis(thrust, np.maximum(late, 0), 1), 0.0)
    return drive(values, sent)


def turn(values: Values, thrust: Floats, wraps: bool = True) -> Floats:
    """Return rates and headings (B, T, 2), rad/s and rad, from any heading."""
    rate = np.zeros(len(thrust))
    heading = values["heading"].copy()
    out = np.empty((*thrust.shape, 2))
    for step in range(thrust.shape[1]):
        rate = rate + STEP * (values["gain"] * thrust[:, step] - values["drag"] * rate)
        heading = heading + STEP * rate
        out[:, step, 0] = rate
        out[:, step, 1] = heading
    if wraps:
        out[:, :, 1] = (out[:, :, 1] + np.pi) % (2.0 * np.pi) - np.pi
    return out


def _pendulum(rtol: float, atol: float) -> Callable[[Values, Floats], Floats]:
    """Return a simulator of a driven pendulum by SciPy's solver: rates (T, 1), rad/s."""

    def swing(values: Values, torque: Floats) -> Floats:
        times = STEP * np.arange(1, len(torque) + 1)

        def slope(time: float, state: Floats) -> list[float]:
            push = torque[min(int(time / STEP), len(torque) - 1)]
            pull = 9.81 / values["length"] * np.sin(state[0])
            return [state[1], push - pull - values["friction"] * state[1]]

        found = solve_ivp(slope, (0.0, times[-1]), [0.0, 0.0], t_eval=times, rtol=rtol, atol=atol)
        if not found.success:
            raise ArithmeticError(found.message)
        return np.asarray(found.y[1])[:, None]

    return swing


def wave(values: Values, times: Floats) -> Floats:
    """Return a wave (B, T, 1) of a size and an angular frequency, rad/s."""
    height: Floats = values["size"][:, None] * np.sin(values["frequency"][:, None] * times)
    return height[:, :, None]


def decays(values: Values, times: Floats) -> Floats:
    """Return the sum (B, T, 1) of two decays."""
    one, other = (np.exp(-values[name][:, None] * times) for name in ("one", "other"))
    charge: Floats = one + other
    return charge[:, :, None]


def thrusters(count: int) -> Callable[[Values, Floats], Floats]:
    """Return a simulator of a vehicle with ``count`` thrusters and three drags: rates (B, T, 3)."""
    rng = np.random.default_rng(count)
    arms = rng.normal(size=(count, 3))  # where the thrusters are, which is known

    def simulate(values: Values, thrust: Floats) -> Floats:
        gains = np.stack([values[f"thruster {k + 1}"] for k in range(count)], axis=1)
        drags = np.stack([values[f"drag {axis}"] for axis in "xyz"], axis=1)
        rate = np.zeros((len(thrust), 3))
        out = np.empty((*thrust.shape[:2], 3))
        for step in range(thrust.shape[1]):
            moment = (gains * thrust[:, step]) @ arms
            rate = rate + STEP * (moment - drags * rate * (1.0 + np.abs(rate)))
            out[:, step] = rate
        return out

    return simulate


def _steps(count: int, hold: int, *shape: int) -> Callable[[np.random.Generator], Floats]:
    """Return what draws ``count`` steps of thrust in [-1, 1], each held for ``hold`` of them."""

    def draw(rng: np.random.Generator) -> Floats:
        drawn: Floats = rng.uniform(-1.0, 1.0, (-(-count // hold), *shape))
        return drawn.repeat(hold, axis=0)[:count]

    return draw


def _sparse(simulate: Callable[[Values, Any], Any], kept: int) -> Callable[[Values, Any], Any]:
    """Return a simulator of every ``kept``-th sample."""

    def simulated(values: Values, inputs: Any) -> Any:
        return simulate(values, inputs)[:, kept - 1 :: kept]

    return simulated


def strangers() -> dict[str, Stranger]:
    """Return the kinds of robots, by name."""
    boat = {"gain": Number(0.1, 3.0), "drag": Number(0.05, 2.0)}
    speed = {"speed": "m/s"}
    thrust = _steps(200, 10)
    noise = (0.02,)
    times = 0.1 * np.arange(1, 101)
    exact = one_by_one(_pendulum(1e-10, 1e-12))

    def vehicle(count: int) -> Stranger:
        numbers = {f"thruster {k + 1}": Number(0.0, 2.0) for k in range(count)}
        numbers |= {f"drag {axis}": Number(0.1, 2.0) for axis in "xyz"}
        axes = {f"gyro {axis}": "rad/s" for axis in "xyz"}
        simulate = thrusters(count)
        robot = Robot(simulate=simulate, numbers=numbers, channels=axes)
        return Stranger(robot, simulate, (0.02,) * len(axes), _steps(300, 10, count))

    def of(simulate: Any, numbers: Mapping[str, Number], channels: Mapping[str, str]) -> Robot:
        return Robot(simulate=simulate, numbers=numbers, channels=channels)

    heading = Number(-3.2, 3.2, mean=0.0, sd=2.0, varies=True)
    compass = of(turn, {**boat, "heading": heading}, {"gyro": "rad/s", "compass": "rad, wraps"})
    late = of(delayed, {**boat, "delay": Number(0.0, 20.0)}, speed)
    waving = of(wave, {"size": Number(0.1, 2.0), "frequency": Number(0.0, 100.0)}, {"height": "m"})
    decaying = of(decays, {"one": Number(0.0, 5.0), "other": Number(0.0, 5.0)}, {"charge": "V"})
    swinging = of(
        one_by_one(_pendulum(1e-3, 1e-6)),
        {"length": Number(0.2, 2.0), "friction": Number(0.0, 1.0)},
        {"gyro": "rad/s"},
    )
    bounded = of(drive, {**boat, "gain": Number(0.1, 1.2)}, speed)
    twitching = of(Jittering(noise[0] / 2000.0), boat, speed)
    every_fifth = _sparse(drive, 5)
    every_second = _sparse(drive, SECOND)
    push = _steps(50, 10)
    return {
        "solver": Stranger(swinging, exact, (0.05,), lambda rng: 4.0 * push(rng)),
        "jitter": Stranger(twitching, drive, noise, thrust),
        "float32": Stranger(of(single, boat, speed), drive, noise, thrust),
        "compass": Stranger(compass, turn, (0.02, 0.05), lambda rng: 2.0 * thrust(rng)),
        "delay": Stranger(late, delayed, noise, thrust, whole=("delay",)),
        "alias": Stranger(waving, wave, (0.1,), lambda _: times, {"frequency": (1.0, 25.0)}),
        "pair": Stranger(decaying, decays, noise, lambda _: times),
        "bound": Stranger(bounded, drive, noise, thrust, {"gain": (1.2, 1.5)}),
        "slow": Stranger(of(every_fifth, boat, speed), every_fifth, noise, thrust),
        "second": Stranger(of(every_second, boat, speed), every_second, noise, thrust),
        "fifteen": vehicle(12),
        "twentyfive": vehicle(22),
    }


def measure_stranger(name: str, rng: np.random.Generator) -> dict[str, Any]:
    """Return what is found of one random robot of a kind, and whether its intervals hold."""
    stranger = strangers()[name]
    truth = _drawn(stranger, rng)
    inputs = stranger.inputs(rng)
    values = {number: np.array([value]) for number, value in truth.items()}
    signal = np.asarray(stranger.exact(values, inputs[None]), np.float64)[0]
    signal += rng.normal(0.0, stranger.noise, signal.shape)
    if name == "compass":
        signal[:, 1] = (signal[:, 1] + np.pi) % (2.0 * np.pi) - np.pi
    began = time.process_time()
    simulate = Counting(stranger.robot.simulate)
    robot = replace(stranger.robot, simulate=simulate)
    answer = robot.infer([Trial(signal, inputs)], int(rng.integers(2**32)))
    seconds = time.process_time() - began
    table = {key.partition("@")[0]: row for key, row in answer.table(MASS).items()}
    told = [answer.verdict, *answer.findings]
    return {
        "kind": name,
        "truth": truth,
        "low": {number: table[number][1] for number in truth},
        "high": {number: table[number][2] for number in truth},
        "good": answer.good,
        "warned": not answer.good or any(w in one for one in told for w in WARNINGS),
        "told": told,
        "simulations": simulate.trials,
        "seconds": seconds,
    }


def _drawn(stranger: Stranger, rng: np.random.Generator) -> dict[str, float]:
    """Return true values by name, a tenth of the range from its ends unless it says otherwise."""
    truth = {}
    for name, number in stranger.robot.numbers.items():
        edge = 0.1 * (number.high - number.low)
        low, high = stranger.truth.get(name, (number.low + edge, number.high - edge))
        value = float(rng.uniform(low, high))
        truth[name] = float(round(value)) if name in stranger.whole else value
    return truth


def summarise_strangers(documents: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the coverage of one kind, or of all: of robots whose answers warn of nothing."""
    trusted = [one for one in documents if not one["warned"]]
    held = [
        one["low"][name] <= value <= one["high"][name]
        for one in trusted
        for name, value in one["truth"].items()
    ]
    part: dict[str, Any] = {
        "robots": len(documents),
        "good": sum(one["good"] for one in documents),
        "warned": sum(one["warned"] for one in documents),
        "numbers": len(held),
        "simulations": float(np.median([one["simulations"] for one in documents])),
        "seconds": float(np.mean([one["seconds"] for one in documents])),
    }
    if held:
        interval = binomtest(sum(held), len(held)).proportion_ci(0.95, method="wilson")
        part["share"] = sum(held) / len(held)
        part["interval"] = [interval.low, interval.high]
    return part
