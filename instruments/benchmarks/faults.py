"""Rows of faults of any environment: what they add to a step on NumPy, and to one of tensors."""

from __future__ import annotations

import time
from contextlib import ExitStack
from functools import partial
from importlib import import_module
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from aquafish_gym import FaultWrapper, VectorFaultWrapper
from instruments.benchmarks.gait import NO_LEARNING
from instruments.benchmarks.rows import Group, Row, Settings

ROBOTS = 1024
STEP_SECONDS = 1e-3
EPISODE_STEPS = 200
WARM_UP_STEPS, TIMED_STEPS = 5, 100
ACTUATORS, SENSORS = 2, 6
TWO_FAULTS = "action_0:weak=0.5@1; observation_2:bias=0.5@2"


def arrays(settings: Settings, cleanup: ExitStack) -> Group:
    """Return steps of Pendulum-v1, and of a batch of pendulums, whole and with faults."""
    robots = min(ROBOTS, settings.robots)
    row = partial(Row, engine="numpy", dtype="float32", threads=1, amount=1, as_time=True)
    pendulum = gym.make("Pendulum-v1").unwrapped  # without the checks of gym.make
    cleanup.callback(pendulum.close)
    one = row("Pendulum-v1", batch=1, call=_stepper(pendulum, settings))
    many = row("pendulums", batch=robots, call=_stepper(Pendulums(robots), settings))
    rng = np.random.default_rng(settings.seed)
    onsets = rng.uniform(0.0, 5.0, (robots, 2))
    damages = {
        "two faults": TWO_FAULTS,
        "at times of each": [
            f"action_0:weak=0.5@{a:.2f}; observation_2:bias=0.5@{b:.2f}~1" for a, b in onsets
        ],
        "random:moderate": "random:moderate@1-5",
    }
    broken = FaultWrapper(pendulum, TWO_FAULTS)
    rows = [one, row("two faults", batch=1, call=_stepper(broken, settings), against=one), many]
    for what, damage in damages.items():
        envs = VectorFaultWrapper(Pendulums(robots), damage, dt=0.05)
        rows.append(row(what, batch=robots, call=_stepper(envs, settings), against=many))
    return Group("faults on NumPy", "step", rows)


def _stepper(env: Any, settings: Settings) -> partial[Any]:
    """Return what takes a step, in which faults are active."""
    env.reset(seed=settings.seed)
    actions = np.zeros(env.action_space.shape, np.float32)
    for _ in range(EPISODE_STEPS // 2):
        env.step(actions)
    return partial(env.step, actions)


class Pendulums(VectorEnv[Any, Any, Any]):
    """Pendulums that swing together, in episodes of ``EPISODE_STEPS``."""

    metadata = {"autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012

    def __init__(self, count: int) -> None:
        self.num_envs = count
        most = np.array([1.0, 1.0, 8.0], np.float32)
        self.single_action_space = Box(-2.0, 2.0, (1,))
        self.single_observation_space = Box(-most, most)
        self.action_space = batch_space(self.single_action_space, count)
        self.observation_space = batch_space(self.single_observation_space, count)
        self._steps = np.zeros(count, np.int64)

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:  # noqa: ARG002
        self._angle, self._rate = np.random.default_rng(seed).uniform(-1, 1, (2, self.num_envs))
        self._steps[:] = 0
        return self._observed(), {}

    def step(self, actions: Any) -> Any:
        torque = np.clip(actions[:, 0], -2.0, 2.0)
        rate = self._rate + 0.05 * (15.0 * np.sin(self._angle) + 3.0 * torque)
        self._rate = np.clip(rate, -8.0, 8.0)
        self._angle = self._angle + 0.05 * self._rate
        self._steps += 1
        over = self._steps >= EPISODE_STEPS
        self._steps[over] = 0
        return self._observed(), -(self._angle**2), over & ~over, over, {}

    def _observed(self) -> Any:
        columns = np.cos(self._angle), np.sin(self._angle), self._rate
        return np.stack(columns, axis=1).astype(np.float32)


def tensors(settings: Settings, cleanup: ExitStack) -> Group:
    """Return steps of a batch of PyTorch without faults and with faults of each environment."""
    title = f"faults in batches of tensors: steps of {STEP_SECONDS * 1e3:g} ms"
    try:
        torch = import_module("torch")
    except ImportError:
        return Group(title, "step", [], [NO_LEARNING])
    threads = torch.get_num_threads()
    cleanup.callback(torch.set_num_threads, threads)
    torch.set_num_threads(1)
    robots = min(ROBOTS, settings.robots)
    rng = np.random.default_rng(settings.seed)
    plain = Springs(torch, robots, settings.seed)
    damages = {
        "an actuator of each wears": [
            f"action_0:weak={gain:.2f}@{onset:d}~20"
            for gain, onset in zip(
                rng.uniform(0, 0.5, robots), rng.integers(0, 150, robots), strict=True
            )
        ],
    }
    damages["and a sensor of each drifts"] = [
        f"{text}; observation_1:bias={bias:.2f}@{onset:d}+50~10"
        for text, bias, onset in zip(
            damages["an actuator of each wears"],
            rng.uniform(-1, 1, robots),
            rng.integers(0, 150, robots),
            strict=True,
        )
    ]
    actions = torch.rand(robots, ACTUATORS, generator=plain.generator)
    row = partial(
        Row,
        engine="torch",
        dtype="float32",
        batch=robots,
        threads=1,
        amount=1,
        as_time=True,
        own_clock=True,
    )
    rows = [row("whole", call=partial(_step, plain, actions))]
    for what, damage in [*damages.items(), ("random:moderate", "random:moderate@0-150")]:
        envs = VectorFaultWrapper(
            Springs(torch, robots, settings.seed, plain.repeats), damage, dt=1
        )
        envs.reset(seed=settings.seed)
        rows.append(row(what, call=partial(_step, envs, actions), against=rows[0]))
    return Group(title, "step", rows)


def _step(envs: Any, actions: Any) -> float:
    """Return the processor's time of a step, s: other programs take none of it."""
    for _ in range(WARM_UP_STEPS):
        envs.step(actions)
    began = time.process_time()
    for _ in range(TIMED_STEPS):
        envs.step(actions)
    return (time.process_time() - began) / TIMED_STEPS


class Springs(VectorEnv[Any, Any, Any]):
    """Masses on springs, in as many time steps as take a millisecond."""

    metadata = {"autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012

    def __init__(self, torch: Any, count: int, seed: int, repeats: int | None = None) -> None:
        self.num_envs, self._torch = count, torch
        self.single_action_space = Box(-np.inf, np.inf, (ACTUATORS,))  # as Isaac Lab's
        self.single_observation_space = Box(-np.inf, np.inf, (SENSORS,))
        self.action_space = batch_space(self.single_action_space, count)
        self.observation_space = batch_space(self.single_observation_space, count)
        self.generator = torch.Generator().manual_seed(seed)
        self._forces = torch.rand(ACTUATORS, SENSORS, generator=self.generator)
        self._rates = torch.zeros(count, SENSORS)
        self._steps = torch.zeros(count, dtype=torch.int32)
        self.reset()
        self.repeats = repeats or self._calibrate()

    def reset(self, *, seed: Any = None, options: Any = None) -> Any:  # noqa: ARG002
        self._places = self._torch.rand(self.num_envs, SENSORS, generator=self.generator)
        return self._places, {}

    def step(self, actions: Any) -> Any:
        self._swing(actions, self.repeats)
        self._steps = self._steps + 1
        over = self._steps >= EPISODE_STEPS
        self._steps = self._steps * ~over
        return self._places, self._places[:, 0], over & ~over, over, {}

    def _swing(self, actions: Any, repeats: int) -> None:
        forces = actions @ self._forces
        for _ in range(repeats):
            self._rates = self._rates + 1e-3 * (
                forces - self._torch.sin(self._places) - self._rates
            )
            self._places = self._places + 1e-3 * self._rates

    def _calibrate(self) -> int:
        """Return the number of time steps that take ``STEP_SECONDS``."""
        actions = self._torch.zeros(self.num_envs, ACTUATORS)
        self._swing(actions, 20)
        best = np.inf
        for _ in range(20):
            began = time.process_time()
            self._swing(actions, 5)
            best = min(best, time.process_time() - began)
        return max(1, round(5 * STEP_SECONDS / best))
