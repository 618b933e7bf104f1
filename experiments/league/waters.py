"""The waters of the recovery league that are no water of an engine.

- ``Vortices``: rows of vortices, which turn against each other. No model of the agents has a
  current that depends on the place.
- ``DenseWorld``: fins twice as dense, and five times the skin friction. An engine has no factor
  on the skin friction, which is a constant of the drag law.
"""

from __future__ import annotations

import importlib.util
import math
from dataclasses import replace
from functools import cache
from typing import Any, Literal, get_args

from aquafish_gym.engines.compiled.single import CompiledWorld
from aquafish_gym.engines.worlds import World
from aquafish_gym.physics.arithmetic import Vector
from aquafish_gym.physics.kinematics import Numbers, has_diverged
from aquafish_gym.physics.law import law
from aquafish_gym.physics.layout import robot_of, state_numbers
from aquafish_gym.scenario import TIMESTEP, Scenario
from aquafish_gym.utils.array_types import Triple

Water = Literal[
    "still", "current", "reactive", "mujoco", "mujoco-lift", "vortices", "dense", "pybullet"
]
WATERS: tuple[Water, ...] = get_args(Water)
VORTEX_SPEED = 0.3  # units/s, the highest of the water; a robot swims at 0.7
VORTEX_WIDTH = 10.0  # units, of a vortex: 50 cm
FIN_DENSITY = 2.0  # factor on the mass of the fins
SKIN_FRICTION = 5.0  # factor on the skin friction of the fins, their mounts and the body


class Vortices(CompiledWorld):
    """One robot among vortices side by side, each of which turns against its neighbours.

    The water's velocity is horizontal, of the stream function sin(x) sin(y) in units of
    ``VORTEX_WIDTH`` / pi: it has no divergence, and its mean is zero. It is that at the body's
    centre, and added to the current of the scenario.

    Attributes
    ----------
    phase
        (2,) of the vortices along x and y at the origin, rad; a subclass has others.
    """

    phase: tuple[float, float] = (0.0, 0.0)

    def water(self, place: Vector) -> tuple[float, float]:
        """Return the velocity along x and y at a place, units/s."""
        scale = math.pi / VORTEX_WIDTH
        x = scale * place[0] + self.phase[0]
        y = scale * place[1] + self.phase[1]
        along_x = VORTEX_SPEED * math.sin(x) * math.cos(y)
        return (along_x, -VORTEX_SPEED * math.cos(x) * math.sin(y))

    def _update(self, scenario: Scenario) -> None:
        super()._update(scenario)
        x, y, z = scenario.current[0].tolist()
        self._mean: Triple = (x, y, z)

    def set_current(self, current: Triple) -> None:
        self._mean = current

    def _swim(self, command: Numbers, steps: int) -> None:
        x, y, z = self._mean
        for _ in range(steps):
            along_x, along_y = self.water(self.state().position)
            super().set_current((x + along_x, y + along_y, z))
            super()._swim(command, 1)
            if self.diverged:
                return


def vortices_at(phase: tuple[float, float]) -> type[World]:
    """Return a world of vortices with a phase (2,), rad."""
    return type("VorticesAt", (Vortices,), {"phase": phase})


@cache
def dynamics_with(friction: float) -> Any:
    """Return the module of the dynamics, with a factor on the drag law's skin friction.

    The modules are loaded once more, apart from those that every other robot swims by.
    """
    law = _loaded_again("aquafish_gym.physics.hydrodynamics")
    law.SKIN_FRICTION *= friction
    dynamics = _loaded_again("aquafish_gym.physics.dynamics")
    for name in ("body_drag", "fin_drag"):
        setattr(dynamics, name, getattr(law, name))
    return dynamics


def _loaded_again(name: str) -> Any:
    spec = importlib.util.find_spec(name)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class DenseWorld(CompiledWorld):
    """One robot with dense fins in water of high skin friction; not compiled.

    Attributes
    ----------
    fin_density, friction
        Factors on the mass of the fins and on the skin friction.
    """

    fin_density = FIN_DENSITY
    friction = SKIN_FRICTION

    def _update(self, scenario: Scenario) -> None:
        super()._update(replace(scenario, fin_density=self.fin_density * scenario.fin_density))

    def _swim(self, command: Numbers, steps: int) -> None:
        h = TIMESTEP / self._substeps
        by = law(self._plan).driven(self._gains, command, h)
        robot = robot_of(self._numbers[self._robot].tolist())
        x, y, z = self._numbers[self._current].tolist()
        state = self.state()
        step = dynamics_with(self.friction).step
        for _ in range(steps * self._substeps):
            state = step(self._plan, robot, state, by, (x, y, z), h)
        self._numbers[self._state] = state_numbers(state)
        self.diverged = has_diverged(state) > 0.0


def engine_of(water: Water, phase: tuple[float, float]) -> str | type[World]:
    """Return the engine that simulates a water; ``phase`` (2,) is that of vortices, rad."""
    if water == "vortices":
        return vortices_at(phase)
    if water == "dense":
        return DenseWorld
    if not water.startswith("mujoco"):
        return "pybullet" if water == "pybullet" else "numba"
    from instruments.verification.mujoco_world import BoxWorld, MujocoWorld

    return BoxWorld if water == "mujoco" else MujocoWorld
