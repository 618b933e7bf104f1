"""The entries of the reference scores: fixed, evolved and learned controllers, and an oracle."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aquafish_gym import IDS
from aquafish_gym.bodies import MorphologiesLike
from aquafish_gym.envs.tasks import TASKS
from aquafish_gym.plans import BodyPlan
from aquafish_gym.world_config import WorldConfig
from experiments.scores.episodes import IDS_OF, RECOVERY, MadeFor, swim_to_onset
from experiments.tables import shortened
from gait.controllers.agents import Agent
from gait.controllers.controller import Controller
from gait.learning.train import LearningConfig, train
from gait.search.config import EvolveConfig, Sense, TaskName
from gait.search.evolve import Evolved, evolve_gait

# A learning curve: (actions of all robots, their mean reward times the time step), or
# (generations, the best gait's score).
Curve = Sequence[tuple[int, float]]
INTERVAL = 20  # steps of 0.01 s that an action is held for: the environments' frame_skip
SECONDS = 0.01 * INTERVAL


@dataclass
class Script:
    """An agent that depends on the time alone: actions of a plan times a square wave of ``hertz``.

    ``turning`` is the action of the fins that turn, ``sweeping`` of those that sweep.
    """

    plan: BodyPlan
    turning: float = 0.0
    sweeping: float = 0.0
    hertz: float = 0.0
    steps: int = 0

    def reset(self, info: dict[str, Any]) -> None:  # noqa: ARG002
        """Begin with the first step."""
        self.steps = 0

    def act(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """See ``Agent``."""
        time = self.steps * SECONDS
        self.steps += 1
        sign = 1.0 if (time * self.hertz) % 1.0 < 0.5 else -1.0
        shape = [self.turning if fin.turns else self.sweeping for fin in self.plan.fins]
        return np.tile(sign * np.asarray(shape, np.float32), (len(observations), 1))


@dataclass
class Uniform:
    """An agent whose actions are uniformly random."""

    plan: BodyPlan

    def reset(self, info: dict[str, Any]) -> None:  # noqa: ARG002
        """Draw the same actions in every batch of episodes."""
        self._rng = np.random.default_rng(0)

    def act(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """See ``Agent``."""
        shape = len(observations), len(self.plan.fins)
        return self._rng.uniform(-1.0, 1.0, shape).astype(np.float32)


@dataclass(frozen=True)
class Entry:
    """One row of the table.

    Attributes
    ----------
    observes
        What it observes, in words.
    config
        How it is evolved or learned; None of a fixed one.
    damage
        What breaks while it learns.
    fixed
        Makes the agent of a plan, where nothing is evolved or learned.
    """

    observes: str
    config: EvolveConfig | LearningConfig | None = None
    damage: str = "none"
    fixed: Callable[[BodyPlan], Agent] = Script

    def make(self, made_for: MadeFor, seed: int, divisor: int) -> tuple[Controller | None, Curve]:
        """Return a controller and its learning curve, at 1/``divisor`` of the cost."""
        given = IDS[IDS_OF[made_for][0]]
        task: TaskName = given.get("task", "forward")
        plan, reactive = given.get("plan", "aquafish"), given.get("reactive", False)
        match self.config:
            case LearningConfig() as config:
                few = max(1, config.steps // divisor)
                config = replace(
                    config, task=task, seed=seed, steps=few, plan=plan, reactive=reactive
                )
                found = train(None, config, damage=self.damage)
                return found.controller, [(point.steps, point.training) for point in found.curve]
            case EvolveConfig() as config:
                # As many simulated seconds for a task whose episodes are longer.
                divisor *= round(TASKS[task].seconds / TASKS["forward"].seconds)
                config = replace(config, task=task, seed=seed, plan=plan)
                evolved = evolve(config, divisor, world=WorldConfig(reactive=reactive))
                return evolved.controller, [(r.generation + 1, r.final) for r in evolved.history]
        return None, ()


def evolve(
    config: EvolveConfig,
    divisor: int,
    body: MorphologiesLike = None,
    world: WorldConfig | None = None,
) -> Evolved:
    """Evolve a controller at 1/``divisor`` of the cost."""
    return evolve_gait(body, shortened(config, divisor), world=world)


_FINS: Any = ("imu", "clock", "fins")
_FEW: Any = {"interval": INTERVAL, "restarts": 3, "generations": 400}
ORACLE_CONFIG = EvolveConfig(search="cma", senses=_FINS, **_FEW)
REFINEMENT = 400  # generations of the oracle's gait from the state at the onset
ENTRIES: dict[str, Entry] = {
    "zero": Entry("nothing"),
    "still": Entry("nothing", fixed=partial(Script, sweeping=-1.0)),
    "random": Entry("nothing", fixed=Uniform),
    "bang-bang": Entry("the time", fixed=partial(Script, turning=1.0, sweeping=1.0, hertz=0.5)),
    "tail only": Entry("nothing", fixed=partial(Script, sweeping=1.0)),
    "CPG": Entry(
        "the time", EvolveConfig(controller="linear", senses=("clock",), harmonics=3, **_FEW)
    ),
    "NEAT": Entry("IMU, clock", EvolveConfig(search="neat", interval=INTERVAL, restarts=2)),
    "CMA-ES": Entry("IMU, clock", EvolveConfig(search="cma", **_FEW)),
    "CMA-ES, fins": Entry("IMU, clock, fins", ORACLE_CONFIG),
    "PPO": Entry("IMU, clock", LearningConfig(senses=("imu", "clock"))),
    "PPO, fins": Entry("IMU, clock, fins", LearningConfig(senses=_FINS)),
    "PPO, damaged": Entry("IMU, clock, fins", LearningConfig(senses=_FINS), "random:moderate"),
}


def oracle(tier: str, episode: int, divisor: int) -> float:
    """Return how far the best gait for the broken robot swims after the onset, in units.

    Until the onset the robot swims with a gait for the whole robot. Gaits are evolved for the body
    and the servos after the onset; where a sensor is broken, also one that observes the clock and
    the fins alone. The one that swims farthest from the onset on, the gait so far included, is
    refined from the state at the onset for the time that is left. The best of all takes over.
    """
    whole = _whole(divisor)
    onset = swim_to_onset(RECOVERY, tier, whole, episode)
    left = onset.info
    senses: list[tuple[Sense, ...]] = [("imu", "clock", "fins")]
    if any(left[f"sensor_{what}"].any() for what in ("noise", "bias", "lost")):
        senses.append(("clock", "fins"))
    world = WorldConfig(servo_gain=left["servo_gain"])
    body = left["morphology"]
    gaits = [whole]
    for sense in senses:
        config = replace(ORACLE_CONFIG, seed=episode, senses=sense)
        gaits.append(evolve(config, divisor, body, world).controller)
    far = [onset.swim_on(gait) for gait in gaits]
    refined = evolve_gait(
        body,
        EvolveConfig(
            generations=max(1, REFINEMENT // divisor),
            seconds=onset.seconds,
            seed=episode,
            threads=1,
        ),
        first=gaits[int(np.argmax(far))],
        start=onset.state,
        world=world,
    )
    return max(*far, onset.swim_on(refined.controller))


@cache
def _whole(divisor: int) -> Controller:
    """Return the gait for the whole robot."""
    return evolve(ORACLE_CONFIG, divisor).controller
