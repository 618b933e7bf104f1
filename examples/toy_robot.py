"""Another robot: a motor pendulum infers its own length and friction.

    python examples/toy_robot.py

The algorithm knows no fish. The problem names what to find (two numbers), what to command (a torque
and its frequency), what is measured (one axis of a gyroscope), and what is hidden (the angle at
which each trial begins).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eea import EEA, PaperConfig, Problem, RecordedLog, Simulator, Trials
from eea.core import action_layout, model_layout
from eea.core.config import EstimationConfig, ExplorationConfig, OutOfBandConfig

STEPS, TIMESTEP, GRAVITY = 128, 0.01, 9.81  # 1.28 s a trial; s; m/s^2
TRUE_BODY = np.array([0.63, 0.37])  # m, 1/s: for the robot itself, and to judge the answer by

PENDULUM = Problem(
    models=model_layout([("length", 2.0, 7), ("friction", 1.0, 6)]),
    actions=action_layout([("torque", -8.0, 8.0), ("frequency", 0.0, 2.0)]),
    hidden=("angle",),
    axes=1,
)


class SwingingPendulums(Simulator):
    """B pendulums at once, each from rest at its angle: semi-implicit Euler."""

    def simulate(self, trials: Trials) -> RecordedLog:
        """Return the angular velocities (B, T, 1), rad/s."""
        length, friction = np.maximum(trials.models, 0.02).T
        torque, frequency = trials.commands.T
        angle, rate = trials.angles[:, 0].copy(), np.zeros(len(trials))
        log = np.empty((len(trials), STEPS, 1))
        for step in range(STEPS):
            drive = torque * np.cos(2.0 * np.pi * frequency * step * TIMESTEP)
            # The angle is measured from hanging down; the torque is an acceleration's, 1/s^2.
            rate += TIMESTEP * (drive - GRAVITY / length * np.sin(angle) - friction * rate)
            angle += TIMESTEP * rate
            log[:, step, 0] = rate
        return RecordedLog(gyro=log)


class Robot:
    """The real pendulum, which starts each trial at a hidden random angle."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng(seed)

    def perform(self, command: NDArray[np.float64]) -> RecordedLog:
        """Swing for one trial and return the gyroscope's signal."""
        angle = self._rng.uniform(-np.pi, np.pi, (1, 1))
        return SwingingPendulums().simulate(Trials(TRUE_BODY[None], command[None], angle))


def main(seed: int = 0, rounds: int = 5) -> NDArray[np.float64]:
    """Model the pendulum, tell how it went, and return the body that was found."""
    config = PaperConfig(
        condition="out-of-band",
        steps=STEPS,
        rounds=rounds,
        exploration=ExplorationConfig(population=10, generations=5),
        estimation=EstimationConfig(generations=40),
        out_of_band=OutOfBandConfig(period=20, inner_generations=10, sampled_models=5, revisit=2),
    )
    eea = EEA(Robot(seed), SwingingPendulums(), PENDULUM, config, seed, TRUE_BODY)
    for record in eea:
        torque, frequency = record.command
        print(
            f"trial {record.round}: {torque:+.1f} /s^2 at {frequency:.2f} Hz; it began somewhere "
            f"near {record.min_angle[0]:+.2f} rad; OBJ_FIT {record.objective_fitness:.3f}"
        )
    found = eea.result.model
    for name, size, true in zip(PENDULUM.models.names, found, TRUE_BODY, strict=True):
        print(f"{name}: found {size:.3f}, it is {true:.3f}")
    return found


if __name__ == "__main__":
    main()
