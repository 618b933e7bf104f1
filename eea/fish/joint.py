"""The fish as a problem of joint inference: its signal, nuisances and discrepancy."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.bodies import plan_key
from aquafish_gym.engines.api import simulate_scenario
from aquafish_gym.plans import AQUAFISH, BodyPlan
from aquafish_gym.scenario import TIMESTEP, Scenario
from aquafish_gym.utils.storage import read_packaged
from aquafish_gym.world_config import MAXIMUM_SUBSTEPS
from eea.core.angles import Floats
from eea.core.checks import choice
from eea.fish.hypotheses import AS_COMMANDED, REACTIVE_WATER, fault_hypotheses, servo_names
from eea.fish.simulator import EngineSimulator
from eea.fish.simulator_error import (
    ASSUMED,
    MATERIAL_CHANGE,
    OTHER_MATERIALS,
    Calibration,
    Discrepancy,
    Material,
)
from eea.fish.windows import LogWindows
from eea.infer.robot import Robot
from eea.infer.statement import MOST_STRIDE, Number, Part, Values

DISCREPANCY_SCHEMA = "eea.discrepancy/1"
FINER_STEPS = 4  # per step of the simulator, to measure the error of its time step
GYRO_SCALE_SD = 0.03
GYRO_MOUNTING_SD = 0.03  # rad, about each axis
HULL_MASS_SD = 1.0  # of the nominal mass: little is known of the hull
#: rad/s. A gyroscope that costs a dollar has a hundredth of it; louder noise has to be given.
LOUDEST_NOISE = 0.3
HEAVIER_HULL = 1.1  # times the nominal mass, to find the difference that mass makes

CURRENT = tuple(f"current {axis}" for axis in "xyz")
DRAG = tuple(f"drag of the {what}" for what in ("fins", "body"))
SERVO_GAIN = "servo gain"
GYRO_BIAS = tuple(f"gyro bias {axis}" for axis in "xyz")
LAG = "lag"
START_VELOCITY = tuple(f"start velocity {axis}" for axis in "xyz")
START_SPIN = tuple(f"start spin {axis}" for axis in "xyz")

# The priors' widths are typical of a laboratory's robot; the ranges are beyond what is plausible.
CURRENTS = {n: Number(-0.5, 0.5, mean=0.0, sd=0.15, group="current") for n in CURRENT}
NUISANCES: dict[str, Number] = {
    **{name: Number(0.5, 1.5, mean=1.0, sd=0.2, group="drag") for name in DRAG},
    SERVO_GAIN: Number(0.7, 1.3, mean=1.0, sd=0.1, group="servo_gain"),
    **{name: Number(-0.3, 0.3, mean=0.0, sd=0.05, group="gyro_bias") for name in GYRO_BIAS},
    # A servo starts with a jerk, which lies within a sample of 0.01 s or not.
    LAG: Number(0.0, 0.2, mean=0.0, sd=0.05, valleys=20),
}
# A window of a swim begins with a velocity relative to the water, which replaces the current. The
# gyroscope measures the spin, apart from its noise.
STARTS: dict[str, Number] = {
    **{name: Number(-2.0, 2.0, mean=0.0, sd=0.5, varies=True) for name in START_VELOCITY},
    **{name: Number(-0.5, 0.5, mean=0.0, sd=0.1, varies=True) for name in START_SPIN},
}


# Simulations whose commands are their own take memory: a batch has at most this number of steps.
MOST_STEPS = 2**22


def change_names(windows: LogWindows | None) -> tuple[str, ...]:
    """Return the names of the numbers that say when a command changed between two rows."""
    changes = None if windows is None else windows.changes
    return tuple(f"change {k} of the command" for k in range(1, 1 + len(changes or ())))


def fish_signal(
    values: Values,
    inputs: NDArray[Any],
    fine: bool,
    simulator: EngineSimulator,
    windows: LogWindows | None = None,
    material: Material | None = None,
) -> NDArray[np.floating]:
    """Return the gyroscope's readings (B, T, 3) in rad/s; see ``eea.infer.statement.Simulate``.

    ``inputs`` are commands (B, F), or with the ``windows`` of a log the windows' numbers (B,). The
    ``material`` is by default that of the engines.
    """
    material = material or Material()
    if windows is not None and windows.changes is not None:
        most = max(1, MOST_STEPS // windows.steps)
        if len(inputs) > most:  # each robot has a series of its own, which takes memory
            return np.concatenate([
                fish_signal(
                    {name: value[i : i + most] for name, value in values.items()},
                    inputs[i : i + most],
                    fine,
                    simulator,
                    windows,
                    material,
                )
                for i in range(0, len(inputs), most)
            ])  # fmt: skip
    reactive = values[REACTIVE_WATER] > 0.5
    if reactive.any() and not reactive.all():  # an engine's call has one kind of water
        parts = [
            fish_signal(
                {name: value[rows] for name, value in values.items()},
                inputs[rows],
                fine,
                simulator,
                windows,
                material,
            )
            for rows in (~reactive, reactive)
        ]
        signal = np.empty((len(reactive), *parts[0].shape[1:]), parts[0].dtype)
        signal[~reactive], signal[reactive] = parts
        return signal
    plan = simulator.plan
    gain = values[SERVO_GAIN][:, None]
    bias = _columns(values, GYRO_BIAS)
    fields = {
        **material.fields(plan, _columns(values, size_numbers(plan)), _columns(values, DRAG)),
        "servo_gain": gain * _columns(values, servo_names(plan).values()),
        "servo_lag": values[LAG],
        "fin_angles": _columns(values, plan.names),
    }
    if windows is not None and windows.begun:
        fields["velocity"] = _columns(values, START_VELOCITY)
        fields["spin"] = windows.spin[inputs] - bias + _columns(values, START_SPIN)
    else:
        fields["current"] = np.asarray(simulator.current) + _columns(values, CURRENT)
    commands = inputs
    if windows is not None:
        commands = windows.commands(inputs, [values[name] for name in change_names(windows)])
    gyro = simulate_scenario(
        Scenario.fill(fields, bool(reactive.any()), plan),
        commands,
        simulator.steps,
        simulator.engine,
        "float64" if fine else simulator.dtype,
        simulator.substeps,
        simulator.threads,
        record="gyro",
        interval=1 if windows is None else windows.interval,
        begun=0 if windows is None else windows.begun,
    ).gyro
    assert gyro is not None
    gyro += bias[:, None].astype(gyro.dtype)
    found: NDArray[np.floating] = gyro if windows is None else windows.sampled(gyro, inputs)
    return found


def _columns(values: Values, names: Iterable[str]) -> Floats:
    """Return some of the values as columns (B, n)."""
    return np.stack([values[name] for name in names], axis=1)


def fish_discrepancy(
    values: Values,
    inputs: NDArray[Any],
    simulator: EngineSimulator,
    windows: LogWindows | None = None,
) -> Floats:
    """Return errors of known shape (B, K, T, 3) that the simulator may have, in rad/s.

    Each is one standard deviation: the error of the time step, the mass of the hull, a scale of
    the gyroscope, and a turn of the gyroscope about each axis.
    """
    robots = (values, inputs, True)
    now = fish_signal(*robots, simulator, windows)
    finer = replace(simulator, substeps=min(FINER_STEPS * simulator.substeps, MAXIMUM_SUBSTEPS))
    # The scheme is of first order: n times finer steps leave 1/n of the error.
    left = simulator.substeps / finer.substeps
    step = (fish_signal(*robots, finer, windows) - now) / max(1.0 - left, 0.5)
    heavier = (
        (fish_signal(*robots, simulator, windows, Material(hull=HEAVIER_HULL)) - now)
        * HULL_MASS_SD
        / (HEAVIER_HULL - 1.0)
    )
    turns = [np.cross(GYRO_MOUNTING_SD * axis, now) for axis in np.eye(3)]
    return np.stack([step, heavier, GYRO_SCALE_SD * now, *turns], axis=1)


def assumed_differences(
    values: Values,
    inputs: NDArray[Any],
    simulator: EngineSimulator,
    windows: LogWindows | None = None,
) -> Floats:
    """Return the differences (B, 2, T, 3), rad/s, that one ``sd`` of each of ``ASSUMED`` makes."""
    now = fish_signal(values, inputs, True, simulator, windows)
    found = []
    for other, assumed in zip(OTHER_MATERIALS, ASSUMED, strict=True):
        changed = fish_signal(values, inputs, True, simulator, windows, other)
        found.append((changed - now) * assumed.sd / MATERIAL_CHANGE)
    return np.stack(found, axis=1)


def _discrepancy(simulator: EngineSimulator, windows: LogWindows | None) -> Discrepancy:
    """Return the measured discrepancy between the simulator and the robot."""
    table = discrepancy_table()
    unit = TIMESTEP if windows is None else 1.0  # s, because trials of commands have no times
    measured = simulator.plan == AQUAFISH
    calibration = Calibration(tuple(table["levels"]), tuple(map(tuple, table["factors"])))
    return Discrepancy(
        table["share"],
        table["seconds"] / unit,
        partial(fish_discrepancy, simulator=simulator, windows=windows),
        # The factors hold for trials from rest: they do not scale intervals from mid-swim. They
        # were measured on the paper's fish.
        calibration if measured and (windows is None or not windows.begun) else None,
        ASSUMED,
        partial(assumed_differences, simulator=simulator, windows=windows),
    )


@cache
def discrepancy_table() -> dict[str, Any]:
    """Return the measured discrepancy and the factors of the intervals.

    ``python -m instruments.inference.discrepancy`` makes the file.
    """
    return read_packaged("eea.fish", "discrepancy.json", DISCREPANCY_SCHEMA)


def size_numbers(plan: BodyPlan) -> dict[str, Number]:
    """Return the sizes of a plan's fins, which are sought."""
    return {d.name: Number(0.0, d.maximum) for d in plan.dimensions}


def switch_numbers(plan: BodyPlan, reactive: bool = False) -> dict[str, Number]:
    """Return the numbers that change only where something is broken or assumed otherwise."""
    servos = servo_names(plan)
    # A sweep is symmetric: reversal only shifts its phase.
    return {
        **{
            servos[fin.name]: Number(-1.0 if fin.turns else 0.0, 1.0, mean=1.0, switch=True)
            for fin in plan.fins
        },
        REACTIVE_WATER: Number(0.0, 1.0, mean=float(reactive), switch=True),
    }


def fish_numbers(
    plan: BodyPlan, windows: LogWindows | None = None, reactive: bool = False
) -> dict[str, Number]:
    """Return the fish's numbers in trials from rest, or in the windows of a log."""
    begun = windows is not None and windows.begun > 0
    return {
        **size_numbers(plan),
        **({} if begun else CURRENTS),
        **NUISANCES,
        **switch_numbers(plan, reactive),
        **(STARTS if begun else {}),
        # The share of the time between two rows after which a command changed.
        **{name: Number(0.0, 1.0, varies=True) for name in change_names(windows)},
        **{fin: Number.angle() for fin in plan.names},
    }


def check_groups(
    chosen: Iterable[str] | None, plan: BodyPlan, windows: LogWindows | None = None
) -> None:
    """Raise a ConfigurationError for a group of numbers that trials lack; None is all groups.

    It needs no simulator, so it is quick before anything is compiled.
    """
    numbers = fish_numbers(plan, windows).items()
    groups = dict.fromkeys(number.group or name for name, number in numbers if number.grouped)
    for name in chosen or ():
        choice("nuisances", name, groups)


def fish_robot(simulator: EngineSimulator, windows: LogWindows | None = None) -> Robot:
    """Return the fish as joint inference knows it, in trials from rest or in windows of a log.

    The inputs of a log's windows (E,) are their numbers from 0.
    """
    plan = simulator.plan
    return Robot(
        partial(fish_signal, simulator=simulator, windows=windows),
        fish_numbers(plan, windows, simulator.reactive),
        {f"gyro {axis}": "rad/s" for axis in "xyz"},
        hypotheses=fault_hypotheses(plan, simulator.reactive),
        parts={
            word: Part(
                {d.name: d.size for d in plan.dimensions if d.fin == fin},
                (f"{fin}.length", f"{fin}.width"),
                f"move the {word} faster to find out",
            )
            for fin, word in plan.words.items()
        },
        nominal=AS_COMMANDED,
        discrepancy=_discrepancy(simulator, windows),
        stride=MOST_STRIDE if windows is None else min(MOST_STRIDE, windows.stride),
        loudest=LOUDEST_NOISE,
        plan=plan_key(plan).get("plan"),
    )
