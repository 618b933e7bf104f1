"""Rows of closed loops for ``python -m instruments.benchmarks``: NEAT's populations, and learning.

The benchmark finds them by name (``instruments.benchmarks.rows.GROUPS``).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from importlib import import_module
from typing import Any

import gymnasium as gym
import neat
import numpy as np

from aquafish_gym.engines.api import TIMESTEP
from aquafish_gym.engines.packages import load_pybullet
from aquafish_gym.envs.tasks import TASKS
from aquafish_gym.envs.vector import AquaFishVectorEnv
from aquafish_gym.morphology import Morphology
from aquafish_gym.plans import AQUAFISH
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.validation import install_advice
from gait.controllers.agents import ControllerAgent
from gait.controllers.controller import INTERVAL, Controller
from gait.controllers.network import GYRO_INPUT_SCALE, Senses
from gait.learning.train import LearningConfig
from gait.search.evolve import EvolveConfig
from gait.search.neat import Evolution, genome_to_controller, load_config
from gait.search.templates import Template
from gait.swims.poses import random_poses
from gait.swims.scores import scores
from gait.swims.swim import SECONDS, step_count
from instruments.benchmarks.rows import Group, Row, Settings, missing_pybullet

CLOCK = EvolveConfig().choices.clock  # Hz
LEAST_POPULATION = 10  # NEAT's species need some members
GENERATIONS = 30

TASK_CONTROLLERS, TASK_POSES, TASK_INTERVAL = 32, 8, 20

LEARNERS = 8
MANY_LEARNERS = 1024

NO_LEARNING = (
    f"stable-baselines3 is not installed, so its rows are left out: {install_advice('rl')}"
)


def populations(settings: Settings, cleanup: ExitStack) -> Group:
    """Return a population as NEAT begins with, as chance breeds it, and as evolution does."""
    usual = EvolveConfig(search="neat").choices
    count = max(LEAST_POPULATION, min(usual.population, settings.robots))
    generations = 2 if settings.quick else GENERATIONS
    seconds = 0.1 if settings.quick else SECONDS
    steps = step_count(seconds)
    body = Morphology.nominal()
    chance = np.random.default_rng(settings.seed)
    evolution = Evolution(_build, count, settings.seed)
    first = _controllers(evolution)
    drifting = Evolution(_build, count, settings.seed)
    for _ in range(generations):
        evolution.breed(_fitness(_controllers(evolution), body, seconds))
        drifting.breed(chance.uniform(size=count).tolist())
    bred, evolved = _controllers(drifting), _controllers(evolution)

    notes = missing_pybullet()
    rows: list[Row] = []
    reference = None
    if not notes:
        from aquafish_gym.engines.bullet.world import BulletWorld

        world = BulletWorld()
        cleanup.callback(world.close)
        leader = evolution.genomes[0]

        def alone() -> object:
            return swim_as_usual(world, leader, body, steps)

        reference = Row("neat-python's network", "pybullet", "float64", 1, 1, steps, alone)
        rows.append(reference)

    def row(
        name: str, controllers: Sequence[Controller], dtype: str, poses: int, threads: int
    ) -> Row:
        angles, batch = random_poses(poses, settings.seed), count * poses

        def call() -> object:
            return scores(controllers, body, angles, seconds, dtype=dtype, threads=threads)

        return Row(f"{name}, {_size(controllers)}", "numba", dtype, batch, threads,
                   batch * steps, call, reference)  # fmt: skip

    for name, controllers, dtype, poses in (
        ("generation 0", first, "float32", 1),
        (f"{generations} of chance", bred, "float32", 1),
        (f"{generations} evolved", evolved, "float32", 1),
        (f"{generations} evolved", evolved, "float64", 1),
        (f"{generations} evolved", evolved, "float32", EvolveConfig.poses + 1),
    ):
        one = row(name, controllers, dtype, poses, 1)
        rows.append(one)
        if settings.cores > 1:
            every = row(name, controllers, dtype, poses, settings.cores)
            rows.append(replace(every, against=one))
    return Group("NEAT: robot-steps", "robot-step", rows, notes)


def swim_as_usual(world: Any, genome: Any, body: Morphology, steps: int) -> float:
    """Return the progress of one swim as NEAT is usually scored, in units.

    neat-python's own network in Python, and a PyBullet world that waits for it: no numbers of
    ours but the drag law.
    """
    network = neat.nn.FeedForwardNetwork.create(genome, load_config(LEAST_POPULATION))
    matrix = load_pybullet().getMatrixFromQuaternion
    middle = ((AQUAFISH.command_low + AQUAFISH.command_high) / 2).tolist()
    reach = ((AQUAFISH.command_high - AQUAFISH.command_low) / 2).tolist()
    world.start(Scenario.create(body))
    for t in range(0, steps, INTERVAL):
        m = matrix(world.orientation)
        x, y, z = world.world_spin
        spin = [m[i] * x + m[i + 3] * y + m[i + 6] * z for i in range(3)]
        gyro = [min(max(rate / GYRO_INPUT_SCALE, -1.0), 1.0) for rate in spin]
        angle = math.tau * CLOCK * t * TIMESTEP
        heard = (*m[6:9], *m[3:6], *gyro, math.sin(angle), math.cos(angle))
        action = network.activate(heard)
        command = tuple(c + r * a for c, r, a in zip(middle, reach, action, strict=True))
        world.advance(command, min(INTERVAL, steps - t))
    return float(world.position[1])


def _build(genome: Any) -> Controller:
    return genome_to_controller(genome, CLOCK, Morphology.nominal(), 0)


def _controllers(evolution: Evolution) -> Sequence[Controller]:
    return evolution.ask().controllers


def _fitness(controllers: Sequence[Controller], body: Morphology, seconds: float) -> list[float]:
    return [float(d) for d in scores(controllers, body, seconds=seconds)[:, 0]]


def _size(controllers: Sequence[Controller]) -> str:
    """Say how large the largest network is: the lanes pad all to its nodes."""
    return f"{max(c.nodes for c in controllers)} nodes"


def tasks(settings: Settings, cleanup: ExitStack) -> Group:
    """Return populations that are scored in every task, against stepping its environment."""
    rows: list[Row] = []
    poses = random_poses(TASK_POSES, settings.seed)
    count = max(1, min(TASK_CONTROLLERS, settings.robots // TASK_POSES))
    for name, damage in (
        ("station", None),
        ("waypoint", None),
        ("recovery", "random:moderate@15-30"),
    ):
        task = TASKS[name]
        seconds = 0.4 if settings.quick else task.seconds
        task = replace(task, seconds=seconds)
        damage = "random:moderate@15-30" if name == "recovery" and not settings.quick else None
        template = Template.of_class("recurrent", Senses(goal=task.has_goal), 8, TASK_INTERVAL)
        vectors = template.random(count, np.random.default_rng(settings.seed))
        controllers = [template.controller(v, 0.7, Morphology.nominal(), 0) for v in vectors]
        batch, steps = count * TASK_POSES, step_count(seconds)
        envs = AquaFishVectorEnv(
            batch, task=task, damage=damage, frame_skip=TASK_INTERVAL, threads=1
        )
        cleanup.callback(envs.close)
        agent = ControllerAgent(controllers[0])

        def stepping(envs: Any = envs, agent: Any = agent, steps: int = steps) -> object:
            seen, info = envs.reset(seed=0)
            agent.reset(info)
            for _ in range(steps // TASK_INTERVAL):
                seen, *_ = envs.step(agent.act(seen))
            return seen

        def scoring(
            threads: int, those: Any = controllers, task: Any = task, damage: Any = damage
        ) -> object:
            return scores(those, None, poses, task=task, damage=damage, threads=threads)

        one = Row(f"{name}, stepped", "numba", "float32", batch, 1, batch * steps, stepping)
        rows.append(one)
        for threads in sorted({1, settings.cores}):
            call = partial(scoring, threads)
            rows.append(Row(name, "numba", "float32", batch, threads, batch * steps, call, one))
    return Group("Searches in tasks: robot-steps", "robot-step", rows)


def learning(settings: Settings, cleanup: ExitStack) -> Group:
    """Return what stable-baselines3 sees of the environments, which is all that learns."""
    title, unit = "SB3: env-steps", "env-step"
    try:
        vec_env: Any = import_module("stable_baselines3.common.vec_env")
        monitor: Any = import_module("stable_baselines3.common.monitor").Monitor
        lanes: Any = import_module("gait.learning.sb3_env").LaneVecEnv
    except ImportError:
        return Group(title, unit, [], [NO_LEARNING])

    def one_by_one(engine: str) -> Any:
        make = [lambda: monitor(gym.make("AquaFish-v0", engine=engine))] * LEARNERS
        return vec_env.DummyVecEnv(make)

    def row(
        what: str, envs: Any, engine: str, dtype: str, threads: int, against: Row | None
    ) -> Row:
        cleanup.callback(envs.close)
        count = envs.num_envs
        envs.reset()
        reach = np.random.default_rng(settings.seed).uniform(-1, 1, (count, 3))
        actions = reach.astype(np.float32)
        return Row(what, engine, dtype, count, threads, count, lambda: envs.step(actions), against)

    notes = missing_pybullet()
    rows: list[Row] = []
    reference = None
    if not notes:
        reference = row("DummyVecEnv", one_by_one("pybullet"), "pybullet", "float64", 1, None)
        rows.append(reference)
    rows.append(row("DummyVecEnv", one_by_one("numba"), "numba", "float64", 1, reference))
    for count in sorted({LEARNERS, min(MANY_LEARNERS, settings.robots)}):
        body = Morphology.nominal().to_array()[None]
        envs = vec_env.VecMonitor(lanes(count, body, Senses(clock=0), 0.0, LearningConfig.interval))
        rows.append(row("LaneVecEnv", envs, "numba", "float32", settings.cores, reference))
    return Group(title, unit, rows, notes)
