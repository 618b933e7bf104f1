"""The fish as joint inference sees it: what may differ from the models' plain world, and how."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.engines.api import simulate
from aquafish_gym.morphology import DIMENSIONS, FIN_WORDS
from eea.core.angles import Floats
from eea.core.problem import Problem
from eea.fish.simulator import EngineSimulator
from eea.joint.problem import Hypothesis, JointProblem, Nuisance, Part

_SERVO = {fin: f"servo of the {word}" for fin, word in FIN_WORDS.items()}

# The order of the columns of ``nuisances`` in ``fish_signal``. The priors' widths are what a
# evaluator's robot may have; the ranges, what it can hardly have.
NUISANCES: tuple[Nuisance, ...] = (
    *(Nuisance(f"current {axis}", -0.5, 0.5, 0.0, 0.15, "current") for axis in "xyz"),
    *(Nuisance(f"drag of the {what}", 0.5, 1.5, 1.0, 0.2, "drag") for what in ("fins", "body")),
    Nuisance("servo gain", 0.7, 1.3, 1.0, 0.1, "servo_gain"),
    *(Nuisance(f"gyro bias {axis}", -0.3, 0.3, 0.0, 0.05, "gyro_bias") for axis in "xyz"),
    # A servo starts with a jerk, which a sample of 0.01 s feels or not.
    Nuisance("lag", 0.0, 0.2, 0.0, 0.05, valleys=20),
    # The tail's sweep is the same both ways: reversed is but another phase.
    *(
        Nuisance(name, 0.0 if fin == "caudal" else -1.0, 1.0, 1.0, switch=True)
        for fin, name in _SERVO.items()
    ),
    Nuisance("reactive water", 0.0, 1.0, 0.0, switch=True),
)
CURRENT, DRAG, GAIN, BIAS = slice(0, 3), slice(3, 5), slice(5, 6), slice(6, 9)
LAG, SERVOS, REACTIVE = 9, slice(10, 13), 13

# A window of a swim begins with a velocity, which takes the current's place: relative to the water
# they are one. Of the spin only what the gyroscope's noise leaves open has to be found.
STARTS: tuple[Nuisance, ...] = (
    *(Nuisance(f"start velocity {axis}", -2.0, 2.0, 0.0, 0.5, start=True) for axis in "xyz"),
    *(Nuisance(f"start spin {axis}", -0.5, 0.5, 0.0, 0.1, start=True) for axis in "xyz"),
)
VELOCITY, SPIN = CURRENT, slice(14, 17)

# Seized is stuck wherever it was; dead does not move by itself, but is elsewhere in each trial;
# reversed turns the other way; weak is at any share of its speed, either way.
HYPOTHESES: tuple[Hypothesis, ...] = (
    *(
        Hypothesis(
            f"the {word} is missing",
            {d.name: 0.0 for d in DIMENSIONS if d.fin == fin},
            part=word,
        )
        for fin, word in FIN_WORDS.items()
    ),
    *(
        Hypothesis(f"the servo of the {word} is seized", {_SERVO[fin]: 0.0}, (fin,), part=word)
        for fin, word in FIN_WORDS.items()
    ),
    *(
        Hypothesis(f"the servo of the {word} is dead", {_SERVO[fin]: 0.0}, part=word)
        for fin, word in FIN_WORDS.items()
    ),
    *(
        Hypothesis(f"the servo of the {word} is reversed", {_SERVO[fin]: -1.0}, part=word)
        for fin, word in FIN_WORDS.items()
        if fin != "caudal"
    ),
    *(
        Hypothesis(f"the servo of the {word} is weak", freed=(_SERVO[fin],), part=word)
        for fin, word in FIN_WORDS.items()
    ),
    Hypothesis("the water also resists acceleration", {"reactive water": 1.0}),
)


@dataclass(frozen=True)
class SwimWindows:
    """Windows of swims as a joint problem's commands: an array (E,) of what happened in each.

    Its fields are the ``series`` of commands (K, 3), each held for ``interval`` samples, of which
    ``begun`` had passed when the window began; if any had, the robot was in mid-swim, and ``spin``
    (3,) is what its gyroscope said last, rad/s.
    """

    interval: int
    begun: int

    @property
    def moving(self) -> bool:
        """Whether the windows begin in mid-swim."""
        return self.begun > 0

    @staticmethod
    def array(series: Floats, spin: Floats) -> NDArray[np.void]:
        """Return the array (E,) of series (E, K, 3) and spins (E, 3)."""
        rows = np.empty(
            len(series), dtype=[("series", np.float64, series.shape[1:]), ("spin", np.float64, 3)]
        )
        rows["series"], rows["spin"] = series, spin
        return rows


def fish_signal(
    bodies: Floats,
    nuisances: Floats,
    commands: NDArray[Any],
    angles: Floats,
    fine: bool,
    simulator: EngineSimulator,
    swims: SwimWindows | None = None,
) -> NDArray[np.floating]:
    """Return what the gyroscope says (B, T, 3) in rad/s; see ``eea.joint.problem.Simulate``.

    Where ``simulator`` has a current of its own, the inferred one comes on top. With ``swims``,
    ``commands`` are of ``SwimWindows.array``.
    """
    reactive = nuisances[:, REACTIVE] > 0.5
    signal: NDArray[np.floating] | None = None
    for kind in (False, True):
        rows = reactive == kind
        if not rows.any():
            continue
        told = nuisances[rows]
        options: dict[str, Any] = {"current": np.asarray(simulator.current) + told[:, CURRENT]}
        series = commands[rows]
        if swims is not None:
            spin, series = series["spin"], series["series"]
            options = {"interval": swims.interval, "begun": swims.begun}
            if swims.moving:
                options["velocity"] = told[:, VELOCITY]
                options["spin"] = spin - told[:, BIAS] + told[:, SPIN]
            else:
                options["current"] = np.asarray(simulator.current) + told[:, CURRENT]
        gyro = simulate(
            bodies[rows],
            series,
            angles[rows],
            steps=simulator.steps,
            engine=simulator.engine,
            dtype="float64" if fine else simulator.dtype,
            substeps=simulator.substeps,
            threads=simulator.threads,
            record="gyro",
            reactive=kind,
            drag=told[:, DRAG],
            servo_gain=told[:, GAIN] * told[:, SERVOS],
            lag=told[:, LAG],
            **options,
        ).gyro
        assert gyro is not None
        gyro += told[:, None, BIAS].astype(gyro.dtype)
        if rows.all():
            whole: NDArray[np.floating] = gyro
            return whole
        if signal is None:
            signal = np.empty((len(bodies), *gyro.shape[1:]), gyro.dtype)
        signal[rows] = gyro
    assert signal is not None
    return signal


def fish_joint(
    problem: Problem, simulator: EngineSimulator, swims: SwimWindows | None = None
) -> JointProblem:
    """Return the fish for joint inference, simulated as ``simulator`` says.

    It is asked for trials from rest, of a command each, or has been watched: ``swims``.
    """
    nuisances = NUISANCES
    if swims is not None and swims.moving:
        nuisances = (*STARTS[:3], *NUISANCES[3:], *STARTS[3:])
    return JointProblem(
        problem,
        partial(fish_signal, simulator=simulator, swims=swims),
        nuisances,
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
