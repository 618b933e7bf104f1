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
FINER_STEPS = 4  # for each of the simulator's steps; they show the error of its time step
GYRO_SCALE_SD = 0.03
GYRO_MOUNTING_SD = 0.03  # rad, about each axis
HULL_MASS_SD = 1.0  # of the nominal mass: little is known of the hull
HEAVIER_HULL = 1.1  # times the nominal mass, to find the difference that mass makes

# The columns of ``nuisances`` in ``fish_signal``. The priors' widths are typical of a laboratory's
# robot; the ranges are beyond what is plausible.
NUISANCES: tuple[Nuisance, ...] = (
    *(Nuisance(f"current {axis}", -0.5, 0.5, 0.0, 0.15, "current") for axis in "xyz"),
    *(Nuisance(f"drag of the {what}", 0.5, 1.5, 1.0, 0.2, "drag") for what in ("fins", "body")),
    Nuisance("servo gain", 0.7, 1.3, 1.0, 0.1, "servo_gain"),
    *(Nuisance(f"gyro bias {axis}", -0.3, 0.3, 0.0, 0.05, "gyro_bias") for axis in "xyz"),
    # A servo starts with a jerk, which lies within a sample of 0.01 s or not.
    Nuisance("lag", 0.0, 0.2, 0.0, 0.05, valleys=20),
    # The tail's sweep is symmetric: reversal only shifts its phase.
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
# gyroscope measures the spin up to its noise.
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
    With the ``windows`` of a log, ``commands`` (B,) are the windows' numbers. ``hull`` is a factor
    on the hull's mass.
    """
    start = None if windows is None else windows.start
    reactive = nuisances[:, REACTIVE_PLACE] > 0.5
    if reactive.any() and not reactive.all():  # an engine's call has one kind of water
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
        # A heavier hull moves as if all else weighed less and met less drag.
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
    if start is not None:  # until then every servo obeyed its command
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
    """Return what the simulator may get wrong in a known way, (B, K, T, 3) in rad/s.

    Each is one standard deviation: the error of its time step, the mass of the hull, a scale of
    the gyroscope, and a turn of the gyroscope about each axis.
    """
    robots = (bodies, nuisances, commands, angles, True)
    now = fish_signal(*robots, simulator, windows)
    finer = replace(simulator, substeps=min(FINER_STEPS * simulator.substeps, MAXIMUM_SUBSTEPS))
    # The scheme is of first order: what is left after n times finer steps is 1/n of the error.
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
    """Return how far the simulator may be from the robot, as measured."""
    table = discrepancy_table()
    unit = TIMESTEP if windows is None else 1.0  # s: trials that were commanded have no times
    calibration = Calibration(tuple(table["levels"]), tuple(map(tuple, table["factors"])))
    return Discrepancy(
        table["share"],
        table["seconds"] / unit,
        partial(fish_discrepancy, simulator=simulator, windows=windows),
        # Measured in trials from rest: intervals of windows in mid-swim are left as wide.
        calibration if windows is None or not windows.begun else None,
    )


@cache
def discrepancy_table() -> dict[str, Any]:
    """Return the measured discrepancy and the factors of the intervals.

    ``python -m instruments.inference.discrepancy`` makes the file.
    """
    return read_packaged("eea.fish", "discrepancy.json", DISCREPANCY_SCHEMA)


def _at_known_start(nuisance: Nuisance) -> Nuisance:
    """Return a nuisance as it is where the initial state is known, in still water."""
    if nuisance.group == "current":
        return replace(nuisance, switch=True)
    # A reversed tail shows where its phase is known.
    return replace(nuisance, low=-1.0) if nuisance.name == SERVO["caudal"] else nuisance


def fish_nuisances(windows: LogWindows | None = None) -> tuple[Nuisance, ...]:
    """Return the nuisances of trials from rest, or of the windows of a log."""
    if windows is not None and windows.start is not None:
        return tuple(map(_at_known_start, NUISANCES))
    if windows is not None and windows.begun:
        return (*START_NUISANCES[:3], *NUISANCES[3:], *START_NUISANCES[3:])
    return NUISANCES


def check_groups(chosen: Iterable[str] | None, windows: LogWindows) -> None:
    """Raise a ConfigurationError if a log has no such group of nuisances; None is all of them.

    It needs no simulator, so it is quick where nothing is compiled yet.
    """
    groups = groups_of(fish_nuisances(windows))
    for name in chosen or ():
        choice("nuisances", name, groups)


def fish_joint(simulator: EngineSimulator, windows: LogWindows | None = None) -> JointProblem:
    """Return the fish as a joint problem, for trials from rest or for the windows of a log.

    The commands of a log's windows (E,) are their numbers from 0.
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
