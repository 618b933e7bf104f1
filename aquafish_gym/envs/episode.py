"""What the single and the batched environment share: arguments, starts and spaces."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from inspect import isabstract
from typing import Any

import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.spaces import Box
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.damage import Damage, edit_each
from aquafish_gym.engines.packages import check_engine
from aquafish_gym.engines.worlds import World
from aquafish_gym.envs.specification import FishSpec, read_class
from aquafish_gym.envs.tasks import Task, check_task
from aquafish_gym.morphology import Morphology
from aquafish_gym.physics.arithmetic import Vector, square_root
from aquafish_gym.plans import AQUAFISH, BodyPlan, PlanLike, check_plan
from aquafish_gym.scenario import LATE_FIELDS, TIMESTEP, Scenario, check_row
from aquafish_gym.sense import limits
from aquafish_gym.utils.array_types import Floats, Triple
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    brief,
    finite_array,
    flag,
    integer,
    one_of,
)

OPTIONS = ("fin_angles", "morphology", "damage")


@dataclass(frozen=True)
class EpisodeConfig:
    """What an episode begins with; made by :func:`check_episode`.

    ``fin_angles`` is ``"random"`` or F angles in rad; ``hold`` is for how many steps of 0.01 s an
    action is held; ``limit`` is after how many s an episode is cut off, if before its end.
    """

    task: Task
    current: Triple
    morphology: Morphology
    damage: Damage
    fin_angles: str | tuple[float, ...]
    hold: int = 1
    limit: float | None = None

    @property
    def plan(self) -> BodyPlan:
        """Of the robot."""
        return self.morphology.plan

    def within(self, seconds: float) -> EpisodeConfig:
        """Return it for episodes that are cut off after ``seconds``; late damage is refused."""
        return replace(self, limit=seconds).with_options({"damage": self.damage})

    def with_options(self, options: Mapping[str, Any]) -> EpisodeConfig:
        """Return it with the options of ``reset``."""
        if not options:
            return self
        for name in options:
            one_of("options", name, OPTIONS)
        found = replace(
            self,
            morphology=Morphology.coerce(options.get("morphology", self.morphology), self.plan),
            damage=Damage.coerce(options.get("damage", self.damage)),
            fin_angles=check_fin_angles(options.get("fin_angles", self.fin_angles), self.plan),
        )
        found.damage.check_onsets(self.task.seconds)
        if self.limit is not None:
            found.damage.certain.check_onsets(self.limit)
        found.damage.check_steps(TIMESTEP * self.hold)
        found.damage.check_parts(found.plan)
        found.damage.certain.check_fits(found.morphology, TIMESTEP * self.hold)
        return found


def check_episode(
    task: Task,
    morphology: object = None,
    damage: object = None,
    current: ArrayLike = (0.0, 0.0, 0.0),
    fin_angles: object = "zero",
    hold: int = 1,
    plan: PlanLike = AQUAFISH,
) -> EpisodeConfig:
    """Return the configuration of an environment's arguments, for a checked task."""
    x, y, z = check_row("current", current).tolist()
    if type(task).current is not Task.current and any((x, y, z)):
        raise InvalidArgumentError(
            f"current must be 0 where the task has a current of its own; got {(x, y, z)} with "
            f"{type(task).__name__}"
        )
    intact = EpisodeConfig(task, (x, y, z), Morphology.nominal(plan), Damage(), "random", hold)
    return intact.with_options(
        {"morphology": morphology, "damage": damage, "fin_angles": fin_angles}
    )


def check_world(engine: object) -> str | type[World]:
    """Return an engine's name, or the class of a world of one's own."""
    if isinstance(engine, str) and ":" in engine:  # as a specification in JSON has a class
        engine = read_class("engine", engine, World)
    if isinstance(engine, type) and issubclass(engine, World):
        if isabstract(engine):
            raise InvalidArgumentError(
                f"engine must define all that World leaves open; {engine.__name__} lacks "
                f"{', '.join(sorted(engine.__abstractmethods__))}"
            )
        return engine
    return check_engine(engine)


def check_options(options: object) -> dict[str, Any]:
    """Return the options of ``reset`` as a dictionary of their own."""
    if options is not None and not isinstance(options, Mapping):
        raise InvalidArgumentError(f"options must be a dictionary; got {brief(options)}")
    return dict(options or {})


def begin_episodes(
    configs: Sequence[EpisodeConfig],
    rngs: Sequence[np.random.Generator],
    hold: int,
    reactive: bool = False,
) -> tuple[Scenario, Floats]:
    """Return a scenario of n robots, changes included, and their tasks' memories (n, M).

    The robots are of one plan. Each draws its fin angles, then its task's memory, then its damage:
    a seed gives the same task with and without damage. ``hold`` is how many steps of 0.01 s an
    action is held.
    """
    # Most robots share a configuration: each is asked once for what is not drawn.
    numbers: dict[int, int] = {}
    which = [numbers.setdefault(id(config), len(numbers)) for config in configs]
    distinct = [configs[which.index(i)] for i in range(len(numbers))]
    random = np.array([isinstance(config.fin_angles, str) for config in distinct])[which]
    plan = configs[0].plan
    angles = np.empty((len(configs), len(plan.fins)))
    memories = []
    for row, is_random, config, rng in zip(angles, random.tolist(), configs, rngs, strict=True):
        if is_random:
            rng.random(out=row)  # several times faster than rng.uniform, to the same bits
        else:
            row[:] = config.fin_angles
        memories.append(config.task.begin(rng))
    angles[random] = -math.pi + 2.0 * math.pi * angles[random]
    fields = {
        "body": np.array([config.morphology.to_array() for config in distinct])[which],
        "fin_angles": angles,
        "current": np.array([config.current for config in distinct])[which],
    }
    damages = [config.damage for config in configs]
    intact = Scenario.fill(fields, reactive, plan)
    scenario = edit_each(intact, damages, hold, rngs).draw_angles(rngs)
    return scenario, np.array(memories, np.float64).reshape(len(configs), -1)


def check_fin_angles(value: object, plan: BodyPlan) -> str | tuple[float, ...]:
    """Return ``"random"``, or the angle of each fin in rad, which ``"zero"`` says of all."""
    if isinstance(value, str):
        if one_of("fin_angles", value, ("zero", "random")) == "random":
            return "random"
        value = np.zeros(len(plan.fins))
    angles = finite_array("fin_angles", value, (len(plan.fins),))  # type: ignore[arg-type]
    return tuple(angles.tolist())


def motion_info(position: Vector, velocity: Vector) -> dict[str, Any]:
    """Return what ``info`` says of the position after a step and of its mean velocity, by name.

    Numbers, or rows (B,).
    """
    x, y, z = position
    along_x, along_y, along_z = velocity
    return {
        "x_position": x,
        "y_position": y,
        "z_position": z,
        "x_velocity": along_x,
        "y_velocity": along_y,
        "z_velocity": along_z,
        "distance_from_origin": square_root(x * x + y * y + z * z),
    }


#: Of late channels, of tasks with success, and of batches that begin again within a step.
SOMETIMES_IN_INFO = frozenset((*LATE_FIELDS, "is_success", "final_info", "final_obs"))


def refuse_reserved(terms: Mapping[str, Any], info: Mapping[str, Any]) -> None:
    """Refuse terms of a reward that are called like what ``info`` says anyway."""
    if clash := terms.keys() & (info.keys() | SOMETIMES_IN_INFO):
        raise InvalidArgumentError(
            f"reward_terms must have other names than info has, such as reward_{min(clash)}; "
            f"got {min(clash)}"
        )


class FishEnvBase:
    """The plan, the task, the steps and the observations of an environment, and its ``spec``."""

    _spec: EnvSpec | None = None

    def __init__(
        self, task: object, frame_skip: object, observe_fins: object, plan: object
    ) -> None:
        self.plan = check_plan(plan)
        self.task = check_task(task)
        steps = round(self.task.seconds / TIMESTEP)
        self.frame_skip = integer("frame_skip", frame_skip, 1, steps)
        if steps % self.frame_skip:
            raise InvalidArgumentError(
                f"frame_skip must divide {steps}, the physics steps of an episode of "
                f"{self.task.seconds:g} s; got {self.frame_skip}"
            )
        self.dt = TIMESTEP * self.frame_skip  # length of one step, s
        self._last = steps // self.frame_skip  # how many steps an episode has
        self._reckons = isinstance(observe_fins, str)  # whether from the commands
        if isinstance(observe_fins, str):
            one_of("observe_fins", observe_fins, ("reckoned",))
        self._observe_fins = self._reckons or flag("observe_fins", observe_fins)
        self._limits = limits(len(self.plan.fins) * self._observe_fins, self.task.has_goal)

    @property
    def episode_steps(self) -> int:
        """How many steps an episode has at most."""
        return self._last

    @property
    def spec(self) -> EnvSpec | None:
        """Gymnasium's description, with the length of an episode of this task and frame_skip.

        A limit in the registry would also cut off episodes of another ``frame_skip`` or task.
        """
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        self._spec = spec and FishSpec.of(spec, self._last, self.plan)


def float_action(action: object, shape: tuple[int, ...]) -> Floats | NDArray[np.float32]:
    """Return an action as an array of floats of this shape, which may be any if it was one."""
    if type(action) is np.ndarray and action.shape == shape and action.dtype.char in "fd":
        return np.ascontiguousarray(action)
    return np.ascontiguousarray(finite_array("action", action, shape))  # type: ignore[arg-type]


def check_action(action: object, shape: tuple[int, ...]) -> Floats:
    """Return an action as float64 of this shape, clipped to [-1, 1]."""
    return finite_array("action", action, shape).clip(-1.0, 1.0)  # type: ignore[arg-type]


def check_single_action(action: object, shape: tuple[int, ...]) -> tuple[float, ...]:
    """Return ``check_action(action, shape)`` as plain floats, with which one robot is faster."""
    if type(action) is np.ndarray and action.shape == shape and action.dtype.char in "fd":
        commanded: list[float] = action.tolist()
        for x in commanded:
            if not -1.0 <= x <= 1.0:  # NaN, too, which is refused below
                break
        else:
            return tuple(commanded)
    return tuple(check_action(action, shape).tolist())


def action_space(plan: BodyPlan) -> Box[np.float32]:
    """Return the space of actions: a plan's servos in [-1, 1]."""
    return Box(-1.0, 1.0, (len(plan.fins),), np.float32)


def observation_space(most: Floats) -> Box[np.float32]:
    """Return the space of observations whose channels have these limits; see ``AquaFishEnv``."""
    high = most.astype(np.float32)
    return Box(-high, high, dtype=np.float32)
