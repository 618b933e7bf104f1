"""What is scored: controllers that know nothing, that were evolved, and that were learned."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from aquafish.scores.recurrent import Recurrent, RecurrentConfig, learn_recurrent
from aquafish_gym.bodies import MorphologiesLike
from aquafish_gym.engines.worlds import WorldConfig
from aquafish_gym.envs.tasks import TASKS
from gait.baselines import BaselineConfig, Leg, train_baseline
from gait.config import EvolveConfig, TaskName
from gait.controller import Controller
from gait.evolve import Evolved, Generation, evolve_gait
from gait.task import Crew

Floats = NDArray[np.float64]
Tell = Callable[[str, float], None]
INTERVAL = 20  # steps of 0.01 s that an action is held for: the environments' frame_skip


class Player(Protocol):
    """What acts for B robots through an episode."""

    def act(self, observations: NDArray[np.float32], times: Floats) -> NDArray[np.float32]:
        """Return actions (B, 3) for observations (B, k) at so many s (B,) of the episode."""


@dataclass(frozen=True)
class Script:
    """A player that hears nothing but the time.

    ``shape`` is its action, whose sign is a square wave of so many Hz.
    """

    shape: tuple[float, float, float] = (0.0, 0.0, 0.0)
    hertz: float = 0.0

    def act(self, observations: NDArray[np.float32], times: Floats) -> NDArray[np.float32]:  # noqa: ARG002
        """See :class:`Player`."""
        sign = np.where((times * self.hertz) % 1.0 < 0.5, 1.0, -1.0)
        return np.outer(sign, self.shape).astype(np.float32)


class Chance:
    """A player that does anything."""

    def __init__(self) -> None:
        self._rng = np.random.default_rng(0)

    def act(self, observations: NDArray[np.float32], times: Floats) -> NDArray[np.float32]:  # noqa: ARG002
        """See :class:`Player`."""
        return self._rng.uniform(-1.0, 1.0, (len(times), 3)).astype(np.float32)


class Made(NamedTuple):
    """A controller, and how it came to be."""

    controller: Controller | Recurrent | None = None
    #: After so many actions of all robots, what they earned while they learned; or after so many
    #: generations, that one's best gait's score. Either is a sum of rewards times the time step.
    curve: Sequence[tuple[int, float]] = ()


@dataclass(frozen=True)
class Entry:
    """One row of the table.

    Attributes
    ----------
    knows
        What it hears, in words.
    config
        How it is evolved or learned; None of one that is what it is.
    damage
        What breaks while it learns.
    play
        Makes what acts, where nothing is evolved or learned.
    """

    knows: str
    config: EvolveConfig | BaselineConfig | RecurrentConfig | None = None
    damage: str = "none"
    play: Callable[[], Player] = Script

    def make(self, task: TaskName, seed: int, shorter: int, tell: Tell) -> Made:
        """Evolve or learn a controller for a task, in a ``shorter``-th of the time."""
        match self.config:
            case BaselineConfig() as config:
                few = max(1, config.steps // shorter)
                config = replace(config, task=task, seed=seed, steps=few)
                whole = config.legs * config.leg

                def learning(steps: int, legs: Sequence[Leg]) -> None:
                    tell(f"score {legs[-1].score:.1f}" if legs else "learning", steps / whole)

                found = train_baseline(None, config, damage=self.damage, on_step=learning)
                return Made(found.controller, [(leg.steps, leg.training) for leg in found.curve])
            case RecurrentConfig() as config:
                few = max(1, config.steps // shorter)
                config = replace(config, steps=few)
                return Made(*learn_recurrent(config, task, seed, self.damage, tell))
            case EvolveConfig() as config:
                # As many simulated seconds for a task whose episodes are longer.
                shorter *= round(TASKS[task].seconds / TASKS["forward"].seconds)
                evolved = evolve(replace(config, task=task, seed=seed), shorter, tell)
                curve = [(row.generation + 1, row.final) for row in evolved.history]
                return Made(evolved.controller, curve)
        return Made()

    def player(self, controller: Controller | Recurrent | None, fins: Floats) -> Player:
        """Return what acts for robots whose fins stand at angles (B, 3), rad, when they begin."""
        if isinstance(controller, Recurrent):
            return controller.player(fins)
        return self.play() if controller is None else Crew([controller], fins)


def evolve(
    config: EvolveConfig,
    shorter: int,
    tell: Tell,
    body: MorphologiesLike = None,
    world: WorldConfig | None = None,
) -> Evolved:
    """Evolve a controller in a ``shorter``-th of the time, on one thread."""
    plan = config.plan
    fewer: dict[str, Any] = {"generations": max(1, plan.generations // shorter)}
    if plan.polish:
        fewer["polish"] = max(1, plan.polish // shorter)
    if plan.screened:
        fewer["screened"] = max(plan.starts, plan.screened // shorter)
    config = replace(config, threads=1, **fewer)

    def evolving(row: Generation) -> None:
        tell(f"final {row.final:.1f}", (row.generation + 1) / config.plan.rows)

    return evolve_gait(body, config, world=world, on_generation=evolving)


_FINS: Any = ("imu", "clock", "fins")
_FEW: Any = {"interval": INTERVAL, "starts": 3, "generations": 400}
ENTRIES: dict[str, Entry] = {
    "zero": Entry("nothing"),
    "still": Entry("nothing", play=partial(Script, (0.0, 0.0, -1.0))),
    "random": Entry("nothing", play=Chance),
    "bang-bang": Entry("the time", play=partial(Script, (1.0, 1.0, 1.0), 0.5)),
    "tail only": Entry("nothing", play=partial(Script, (0.0, 0.0, 1.0))),
    "CPG": Entry(
        "the time", EvolveConfig(search="cma", controller="fourier", senses=("clock",), **_FEW)
    ),
    "NEAT": Entry("IMU, clock", EvolveConfig(interval=INTERVAL, starts=2)),
    "CMA-ES": Entry("IMU, clock", EvolveConfig(search="cma", **_FEW)),
    "CMA-ES, fins": Entry("IMU, clock, fins", EvolveConfig(search="cma", senses=_FINS, **_FEW)),
    "PPO": Entry("IMU, clock", BaselineConfig(senses=("imu", "clock"))),
    "PPO, fins": Entry("IMU, clock, fins", BaselineConfig(senses=_FINS)),
    "PPO, damaged": Entry("IMU, clock, fins", BaselineConfig(senses=_FINS), "random:moderate"),
    "PPO, damaged, 8 frames": Entry(
        "IMU, clock, fins", BaselineConfig(senses=_FINS, frames=8), "random:moderate"
    ),
    "PPO, damaged, LSTM": Entry("IMU, clock, fins", RecurrentConfig(), "random:moderate"),
    "SAC, fins": Entry(
        "IMU, clock, fins", BaselineConfig(algorithm="SAC", senses=_FINS, steps=400_000)
    ),
}
