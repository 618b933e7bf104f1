"""Random robots: their true bodies and worlds, and what their gyroscopes say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation
from scipy.stats import truncnorm

from aquafish_gym.imu import ImuLog
from aquafish_gym.plans import AQUAFISH
from aquafish_gym.utils.array_types import Triple
from eea.core.experiment import Performed
from eea.fish.gap import RealityGap
from eea.fish.joint import (
    CURRENT,
    CURRENTS,
    DRAG,
    GYRO_BIAS,
    LAG,
    NUISANCES,
    SERVO_GAIN,
    switch_numbers,
)
from eea.fish.simulator import fish_problem
from eea.fish.target import EngineTarget
from eea.infer.trials import Observed
from instruments.inference.settings import Setting
from instruments.verification.foreign_law import Defects, simulate_law
from instruments.verification.mujoco_world import simulate_mujoco

Floats = NDArray[np.float64]

#: Worlds that ``simulate_law`` simulates.
DEFECTS = {
    "law": Defects(),
    "exponent": Defects(exponent=1.8),
    "centre": Defects(centre=(0.0, 0.1, 0.0)),
    "hull": Defects(hull=1.2),
    "double": Defects(hull=2.0),
    "servo": Defects(servo=0.1),
    "dense": Defects(fin_density=2.0, friction=5.0),
}
SCALE, TURN, COLOUR = 1.03, np.radians(3.0), 0.9
SETTLE = 100  # samples after which coloured noise has forgotten its beginning

SPANS = np.array([d.maximum for d in AQUAFISH.dimensions])


#: The nuisances of an ordinary robot, by name.
NUMBERS = {**CURRENTS, **NUISANCES, **switch_numbers(AQUAFISH)}
ORDINARY_WORLD = {name: number.mean or 0.0 for name, number in NUMBERS.items()}


def draw_body(setting: Setting, number: int, rng: np.random.Generator) -> Floats:
    """Return the sizes (9,) of a setting's robot, in units of 5 cm."""
    shares = rng.uniform(0.0 if setting.bodies == "prior" else 0.1, 1.0, len(AQUAFISH.dimensions))
    if setting.bodies == "edge":
        size, value = (("length", 0.0), ("thickness", 1.0))[number // len(AQUAFISH.names) % 2]
        fin = AQUAFISH.names[number % len(AQUAFISH.names)]
        shares[[d.fin == fin and d.size == size for d in AQUAFISH.dimensions]] = value
    sizes: Floats = shares * SPANS
    return sizes


def draw_world(setting: Setting, rng: np.random.Generator) -> dict[str, float]:
    """Return the nuisances of a setting's robot, by the names of ``eea.fish.joint``."""
    values = dict(ORDINARY_WORLD)
    if setting.world == "other numbers":
        way = rng.normal(size=3)
        values |= dict(zip(CURRENT, 0.15 * way / np.linalg.norm(way), strict=True))
        values |= dict(zip(DRAG, 1.0 + 0.2 * rng.choice([-1.0, 1.0], 2), strict=True))
        values[SERVO_GAIN] = 0.95
    elif setting.world == "prior":
        for name, n in NUMBERS.items():
            if not n.switch:
                mean = ORDINARY_WORLD[name]
                ends = (n.low - mean) / n.sd, (n.high - mean) / n.sd
                values[name] = truncnorm.rvs(*ends, mean, n.sd, random_state=rng)
    return values


def _vector(world: dict[str, float], names: tuple[str, ...]) -> Triple:
    x, y, z = (world[name] for name in names)
    return (x, y, z)


class Robot(EngineTarget):
    """A robot that keeps its commands, hidden angles and logs.

    Where the setting is not ``fast`` it performs random commands instead of those asked for.
    """

    def __init__(
        self,
        setting: Setting,
        body: Floats,
        world: dict[str, float],
        rng: np.random.Generator,
        commanding: np.random.Generator,
    ) -> None:
        gap = RealityGap(
            current=_vector(world, CURRENT),
            drag=(world[DRAG[0]], world[DRAG[1]]),
            servo_gain=(world[SERVO_GAIN],) * 3,
            lag=world[LAG],
            reactive=setting.world == "reactive",
            gyro_bias=_vector(world, GYRO_BIAS),
            gyro_noise=0.0 if setting.world == "coloured" else setting.noise,
            substeps=4 if setting.world == "quarter" else 1,
        )
        self.setting, self.body, self.world = setting, body, world
        self._aside = rng.spawn(1)[0]  # of the foreign worlds
        way = self._aside.normal(size=3)
        self._turned = Rotation.from_rotvec(TURN * way / np.linalg.norm(way)).as_matrix()
        engine = "pybullet" if setting.world == "quarter" else "numba"
        super().__init__(body, None, rng, setting.steps, engine, gap=gap)
        self._commanding = commanding
        self.commands: list[Floats] = []
        self.angles: list[Floats] = []
        self.logs: list[Floats] = []

    def perform(self, command: Floats) -> Performed:  # type: ignore[override]
        """Hold a command (3,) from random fin angles; return the log of that one trial."""
        if not self.setting.fast:
            actions = fish_problem().actions
            command = actions.decode(actions.random(1, self._commanding))[0]
        log = super().perform(command)
        assert log.gyro is not None
        self.commands.append(command)
        self.angles.append(self.start_angles)
        self.logs.append(log.gyro[0])
        return Performed(log, command)

    def _simulate(self, command: Floats, angles: Floats) -> ImuLog:
        world, steps = self.setting.world, self.setting.steps
        if world == "mujoco":
            return simulate_mujoco(self.body, command, angles, steps)
        log = super()._simulate(command, angles)
        gyro = log.gyro
        assert gyro is not None
        if world in DEFECTS:
            gyro = simulate_law(self.body, command, angles, steps, DEFECTS[world])[None]
        elif world == "scale":
            gyro = SCALE * gyro
        elif world == "axes":
            gyro = gyro @ self._turned
        elif world == "coloured":
            white = self._aside.normal(size=(1, SETTLE + steps, 3))
            drawn = lfilter([(1.0 - COLOUR**2) ** 0.5], [1.0, -COLOUR], white, axis=1)
            gyro = gyro + self.setting.noise * drawn[:, SETTLE:]
        return replace(log, gyro=gyro)

    @property
    def observed(self) -> Observed:
        """All trials so far."""
        return Observed(np.array(self.commands), np.array(self.logs))
