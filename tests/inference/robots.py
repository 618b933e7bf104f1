"""Random robots: their true bodies and worlds, and what their gyroscopes say."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import truncnorm

from aquafish_gym.engines.base import simulate
from aquafish_gym.morphology import DIMENSIONS, FINS
from eea import RecordedLog
from eea.aquafish.joint import BIAS, CURRENT, DRAG, GAIN, LAG, NUISANCES
from tests.inference.settings import Setting

Floats = NDArray[np.float64]

SPANS = np.array([d.maximum for d in DIMENSIONS])
NOMINAL = np.array([n.nominal for n in NUISANCES])


def draw_body(setting: Setting, number: int, rng: np.random.Generator) -> Floats:
    """Return the sizes (9,) of a setting's robot, in units of 5 cm."""
    shares = rng.uniform(0.0 if setting.bodies == "prior" else 0.1, 1.0, len(DIMENSIONS))
    if setting.bodies == "edge":
        size, value = (("length", 0.0), ("thickness", 1.0))[number // len(FINS) % 2]
        fin = FINS[number % len(FINS)]
        shares[[d.fin == fin and d.size == size for d in DIMENSIONS]] = value
    return shares * SPANS


def draw_world(setting: Setting, rng: np.random.Generator) -> Floats:
    """Return the nuisances of a setting's robot, as ``eea.aquafish.joint`` orders them."""
    values = NOMINAL.copy()
    if setting.world == "other numbers":
        way = rng.normal(size=3)
        values[CURRENT] = 0.15 * way / np.linalg.norm(way)
        values[DRAG] = 1.0 + 0.2 * rng.choice([-1.0, 1.0], 2)
        values[GAIN] = 0.95
    elif setting.world == "prior":
        for i, n in enumerate(NUISANCES):
            if not n.switch:
                ends = (n.low - n.nominal) / n.sd, (n.high - n.nominal) / n.sd
                values[i] = truncnorm.rvs(*ends, n.nominal, n.sd, random_state=rng)
    return values


@dataclass
class Robot:
    """A robot as the inference asks it; what it did is kept."""

    setting: Setting
    body: Floats
    world: Floats
    rng: np.random.Generator

    def __post_init__(self) -> None:
        self.commands: list[Floats] = []
        self.angles: list[Floats] = []
        self.logs: list[Floats] = []

    def perform(self, command: Floats) -> RecordedLog:
        """Hold a command (3,) from fin angles drawn anew; return the log of that one trial."""
        angles = self.rng.uniform(-np.pi, np.pi, 3)
        gyro = simulate(
            self.body,
            command,
            angles,
            steps=self.setting.steps,
            engine="mujoco" if self.setting.world == "mujoco" else "numba",
            dtype="float64",
            threads=1,
            record="gyro",
            current=self.world[CURRENT],
            drag=self.world[DRAG],
            servo_gain=self.world[GAIN].item(),
            lag=self.world[LAG].item(),
            reactive=self.setting.world == "reactive",
        ).gyro
        assert gyro is not None
        noise = self.setting.noise * self.rng.normal(size=gyro.shape)
        felt = gyro + self.world[BIAS] + noise
        self.commands.append(command)
        self.angles.append(angles)
        self.logs.append(felt[0])
        return RecordedLog(gyro=felt)
