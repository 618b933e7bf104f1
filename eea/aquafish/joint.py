"""The fish as joint inference sees it: what may differ from the models' plain world, and how."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.engines.base import simulate
from aquafish_gym.morphology import DIMENSIONS, FINS
from eea.aquafish.simulator import EngineSimulator
from eea.core.angles import Floats
from eea.core.problem import Problem
from eea.joint.problem import Hypothesis, JointProblem, Nuisance, Part

FIN_WORDS = dict(zip(FINS, ("left flipper", "right flipper", "tail"), strict=True))

# The order of the columns of ``nuisances`` in ``fish_signal``. The priors' widths are what a
# laboratory's robot may have; the ranges, what it can hardly have.
NUISANCES: tuple[Nuisance, ...] = (
    *(Nuisance(f"current {axis}", -0.5, 0.5, 0.0, 0.15, "current") for axis in "xyz"),
    *(Nuisance(f"drag of the {what}", 0.5, 1.5, 1.0, 0.2, "drag") for what in ("fins", "body")),
    Nuisance("servo gain", 0.7, 1.3, 1.0, 0.1, "servo_gain"),
    *(Nuisance(f"gyro bias {axis}", -0.3, 0.3, 0.0, 0.05, "gyro_bias") for axis in "xyz"),
    Nuisance("lag", 0.0, 0.2, 0.0, 0.05),
    *(Nuisance(f"servo of the {word}", 0.0, 1.0, 1.0, switch=True) for word in FIN_WORDS.values()),
    Nuisance("reactive water", 0.0, 1.0, 0.0, switch=True),
)
CURRENT, DRAG, GAIN, BIAS = slice(0, 3), slice(3, 5), slice(5, 6), slice(6, 9)
LAG, SERVOS, REACTIVE = 9, slice(10, 13), 13

# Seized is stuck wherever it was; dead does not move by itself, but is elsewhere in each trial.
HYPOTHESES: tuple[Hypothesis, ...] = (
    *(
        Hypothesis(f"the servo of the {word} is seized", {f"servo of the {word}": 0.0}, (fin,))
        for fin, word in FIN_WORDS.items()
    ),
    *(
        Hypothesis(f"the servo of the {word} is dead", {f"servo of the {word}": 0.0})
        for word in FIN_WORDS.values()
    ),
    Hypothesis("the water also resists acceleration", {"reactive water": 1.0}),
)


def fish_signal(
    bodies: Floats,
    nuisances: Floats,
    commands: Floats,
    angles: Floats,
    fine: bool,
    simulator: EngineSimulator,
) -> NDArray[np.floating]:
    """Return what the gyroscope says (B, T, 3) in rad/s; see ``eea.joint.problem.Simulate``.

    Where ``simulator`` has a current of its own, the inferred one comes on top.
    """
    reactive = nuisances[:, REACTIVE] > 0.5
    signal: NDArray[np.floating] | None = None
    for kind in (False, True):
        rows = reactive == kind
        if not rows.any():
            continue
        told = nuisances[rows]
        gyro = simulate(
            bodies[rows],
            commands[rows],
            angles[rows],
            steps=simulator.steps,
            engine=simulator.engine,
            dtype="float64" if fine else simulator.dtype,
            current=np.asarray(simulator.current) + told[:, CURRENT],
            substeps=simulator.substeps,
            threads=simulator.threads,
            record="gyro",
            reactive=kind,
            drag=told[:, DRAG],
            servo_gain=told[:, GAIN] * told[:, SERVOS],
            lag=told[:, LAG],
        ).gyro
        assert gyro is not None
        gyro = gyro + told[:, None, BIAS].astype(gyro.dtype)
        if rows.all():
            whole: NDArray[np.floating] = gyro
            return whole
        if signal is None:
            signal = np.empty((len(bodies), *gyro.shape[1:]), gyro.dtype)
        signal[rows] = gyro
    assert signal is not None
    return signal


def fish_joint(problem: Problem, simulator: EngineSimulator) -> JointProblem:
    """Return the fish for joint inference, simulated as ``simulator`` says."""
    return JointProblem(
        problem,
        partial(fish_signal, simulator=simulator),
        NUISANCES,
        HYPOTHESES,
        {
            word: Part(
                {d.name: d.size for d in DIMENSIONS if d.fin == fin},
                ("length", "width"),
                f"a faster {word} would tell",
            )
            for fin, word in FIN_WORDS.items()
        },
    )
