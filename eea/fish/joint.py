"""The fish as a problem of joint inference: its signal, nuisances and discrepancy."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.engines.api import simulate_scenario
from aquafish_gym.morphology import DIMENSIONS, FIN_WORDS
from aquafish_gym.scenario import TIMESTEP, Change, Scenario
from aquafish_gym.utils.storage import read_packaged
from aquafish_gym.world_config import MAXIMUM_SUBSTEPS
from eea.core.angles import Floats
from eea.core.checks import choice
from eea.fish.hypotheses import HYPOTHESES, SERVO
from eea.fish.simulator import EngineSimulator, fish_problem
from eea.fish.windows import LogWindows
from eea.joint.problem import (
    MOST_STRIDE,
    Calibration,
    Discrepancy,
    JointProblem,
    Nuisance,
    Part,
    groups_of,
)

DISCREPANCY_SCHEMA = "eea.discrepancy/1"
FINER_STEPS = 4  # per step of the simulator, to measure the error of its time step
GYRO_SCALE_SD = 0.03
GYRO_MOUNTING_SD = 0.03  # rad, about each axis
HULL_MASS_SD = 1.0  # share of the nominal mass, because the hull is little known
HEAVIER_HULL = 1.1  # factor on the nominal mass, to measure the effect of mass

# The columns of ``nuisances`` in ``fish_signal``. The priors' widths are typical of a robot in a
# laboratory; the ranges exceed plausible values.
NUISANCES: tuple[Nuisance, ...] = (
    *(Nuisance(f"current {axis}", -0.5, 0.5, 0.0, 0.15, "current") for axis in "xyz"),
    *(Nuisance(f"drag of the {what}", 0.5, 1.5, 1.0, 0.2, "drag") for what in ("fins", "body")),
    Nuisance("servo gain", 0.7, 1.3, 1.0, 0.1, "servo_gain"),
    *(Nuisance(f"gyro bias {axis}", -0.3, 0.3, 0.0, 0.05, "gyro_bias") for axis in "xyz"),
    # A servo starts with a jerk. A sample of 0.01 s either contains it or not.
    Nuisance("lag", 0.0, 0.2, 0.0, 0.05, valleys=20),
    # The tail's sweep is symmetric, so reversal only shifts its phase.
    *(
        Nuisance(name, 0.0 if fin == "caudal" else -1.0, 1.0, 1.0, switch=True)
        for fin, name in SERVO.items()
    ),
    Nuisance("reactive water", 0.0, 1.0, 0.0, switch=True),
)
CURRENT_PLACES = slice(0, 3)
DRAG_PLACES = slice(3, 5)
GAIN_PLACES = slice(5, 6)
BIAS_PLACES = slice(6, 9)
LAG_PLACE = 9
SERVO_PLACES = slice(10, 13)
REACTIVE_PLACE = 13

# A window of a swim begins with a velocity relative to the water, which replaces the current. The
# gyroscope measures the spin, apart from its noise.
START_NUISANCES: tuple[Nuisance, ...] = (
    *(Nuisance(f"start velocity {axis}", -2.0, 2.0, 0.0, 0.5, start=True) for axis in "xyz"),
    *(Nuisance(f"start spin {axis}", -0.5, 0.5, 0.0, 0.1, start=True) for axis in "xyz"),
)
VELOCITY_PLACES = CURRENT_PLACES
SPIN_PLACES = slice(14, 17)


def fish_signal(
    bodies: Floats,
    nuisances: Floats,
    commands: NDArray[Any],
    angles: Floats,
    fine: bool,
    simulator: EngineSimulator,
    windows: LogWindows | None = None,
    hull: float = 1.0,
) -> NDArray[np.floating]:
    """Return the gyroscope's readings (B, T, 3) in rad/s; see ``eea.joint.problem.Simulate``.

    ``nuisances`` (B, n) has the columns of ``NUISANCES``, or in mid-swim those of ``fish_joint``.
    With the ``windows`` of a log, ``commands`` (B,) are numbers of windows. ``hull`` is a factor on
    the hull's mass.
    """
    start = None if windows is None else windows.start
    reactive = nuisances[:, REACTIVE_PLACE] > 0.5
    if reactive.any() and not reactive.all():  # all robots of a call share one kind of water
        parts = [
            fish_signal(
                bodies[rows],
                nuisances[rows],
                commands[rows],
                angles[rows],
                fine,
                simulator,
                windows,
                hull,
            )
            for rows in (~reactive, reactive)
        ]
        signal = np.empty((len(bodies), *parts[0].shape[1:]), parts[0].dtype)
        signal[~reactive], signal[reactive] = parts
        return signal
    fields = {
        "body": bodies,
        "fin_angles": angles,
        "current": np.asarray(simulator.current) + nuisances[:, CURRENT_PLACES],
        # A heavier hull is simulated as lighter fins with less drag.
        "drag": nuisances[:, DRAG_PLACES] / hull,
        "fin_density": np.full(len(bodies), 1.0 / hull),
        "servo_gain": nuisances[:, GAIN_PLACES] * nuisances[:, SERVO_PLACES],
        "servo_lag": nuisances[:, LAG_PLACE],
    }
    still = np.zeros((len(bodies), 3))
    if start is not None:
        known = {n: still + getattr(start, n) for n in ("fin_angles", "velocity", "spin")}
        fields |= {"current": still, **known}
    elif windows is not None and windows.begun:
        spin = windows.spin[commands] - nuisances[:, BIAS_PLACES] + nuisances[:, SPIN_PLACES]
        fields |= {"current": still, "velocity": nuisances[:, VELOCITY_PLACES], "spin": spin}
    scenario = Scenario.fill(fields, bool(reactive.any()))
    if start is not None:  # before the start every servo obeyed its command
        obeyed = replace(scenario, servo_gain=still + nuisances[:, GAIN_PLACES])
        scenario = replace(obeyed, schedule=(Change(0, np.arange(len(bodies)), scenario),))
    gyro = simulate_scenario(
        scenario,
        commands if windows is None else windows.series[commands],
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
    gyro += nuisances[:, None, BIAS_PLACES].astype(gyro.dtype)
    found: NDArray[np.floating] = gyro if windows is None else windows.sampled(gyro, commands)
    return found


def fish_discrepancy(
    bodies: Floats,
    nuisances: Floats,
    commands: NDArray[Any],
    angles: Floats,
    simulator: EngineSimulator,
    windows: LogWindows | None = None,
) -> Floats:
    """Return errors of known shape (B, K, T, 3) that the simulator may have, in rad/s.

    Each is one standard deviation: the error of the time step, the mass of the hull, a scale of
    the gyroscope, and a turn of the gyroscope about each axis.
    """
    robots = (bodies, nuisances, commands, angles, True)
    now = fish_signal(*robots, simulator, windows)
    finer = replace(simulator, substeps=min(FINER_STEPS * simulator.substeps, MAXIMUM_SUBSTEPS))
    # The scheme is of first order: n times finer steps leave 1/n of the error.
    left = simulator.substeps / finer.substeps
    step = (fish_signal(*robots, finer, windows) - now) / max(1.0 - left, 0.5)
    heavier = (
        (fish_signal(*robots, simulator, windows, HEAVIER_HULL) - now)
        * HULL_MASS_SD
        / (HEAVIER_HULL - 1.0)
    )
    turns = [np.cross(GYRO_MOUNTING_SD * axis, now) for axis in np.eye(3)]
    return np.stack([step, heavier, GYRO_SCALE_SD * now, *turns], axis=1)


def _discrepancy(simulator: EngineSimulator, windows: LogWindows | None) -> Discrepancy:
    """Return the measured discrepancy between the simulator and the robot."""
    table = discrepancy_table()
    unit = TIMESTEP if windows is None else 1.0  # s, because trials of commands have no times
    calibration = Calibration(tuple(table["levels"]), tuple(map(tuple, table["factors"])))
    return Discrepancy(
        table["share"],
        table["seconds"] / unit,
        partial(fish_discrepancy, simulator=simulator, windows=windows),
        # The factors hold for trials from rest: they do not scale intervals from mid-swim.
        calibration if windows is None or not windows.begun else None,
    )


@cache
def discrepancy_table() -> dict[str, Any]:
    """Return the measured discrepancy and the factors of the intervals.

    ``python -m instruments.inference.discrepancy`` makes the file.
    """
    return read_packaged("eea.fish", "discrepancy.json", DISCREPANCY_SCHEMA)


def _at_known_start(nuisance: Nuisance) -> Nuisance:
    """Return a nuisance for a known initial state in still water."""
    if nuisance.group == "current":
        return replace(nuisance, switch=True)
    # A reversed tail can be recognised if its phase is known.
    return replace(nuisance, low=-1.0) if nuisance.name == SERVO["caudal"] else nuisance


def fish_nuisances(windows: LogWindows | None = None) -> tuple[Nuisance, ...]:
    """Return the nuisances of trials from rest, or of the windows of a log."""
    if windows is not None and windows.start is not None:
        return tuple(map(_at_known_start, NUISANCES))
    if windows is not None and windows.begun:
        return (*START_NUISANCES[:3], *NUISANCES[3:], *START_NUISANCES[3:])
    return NUISANCES


def check_groups(chosen: Iterable[str] | None, windows: LogWindows) -> None:
    """Raise a ConfigurationError for a group of nuisances that a log lacks; None is all groups.

    It needs no simulator, so it is quick before anything is compiled.
    """
    groups = groups_of(fish_nuisances(windows))
    for name in chosen or ():
        choice("nuisances", name, groups)


def fish_joint(simulator: EngineSimulator, windows: LogWindows | None = None) -> JointProblem:
    """Return the fish as a joint problem, for trials from rest or for the windows of a log.

    The windows (E,) of a log are numbered from 0; these numbers replace commands.
    """
    known = windows is not None and windows.start is not None
    hypotheses = HYPOTHESES
    if known:
        hypotheses = tuple(replace(h, shared_angles=()) for h in HYPOTHESES)
    return JointProblem(
        fish_problem(),
        partial(fish_signal, simulator=simulator, windows=windows),
        fish_nuisances(windows),
        hypotheses,
        {
            word: Part(
                {d.name: d.size for d in DIMENSIONS if d.fin == fin},
                (f"{fin}.length", f"{fin}.width"),
                f"move the {word} faster to find out",
            )
            for fin, word in FIN_WORDS.items()
        },
        hidden=() if known else None,
        discrepancy=_discrepancy(simulator, windows),
        stride=MOST_STRIDE if windows is None else min(MOST_STRIDE, windows.stride),
    )
