"""What a step of many environments is besides the physics, compiled.

numpy takes a third as long for it as the engine for the physics, and on one thread alone. The
formulas are the single environment's, the same function objects in double precision, and so are
the bits. numpy, whose sines are its own, still computes what has sines.
"""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from aquafish_gym import command, sense
from aquafish_gym.command import servo_speeds
from aquafish_gym.engines.worlds import RUNAWAY_SQUARE
from aquafish_gym.envs import motion as motions
from aquafish_gym.envs import tasks
from aquafish_gym.envs.motion import MOTION, motion
from aquafish_gym.envs.tasks import MEMORY_NUMBERS, Step, Task, compiled_task
from aquafish_gym.physics.arithmetic import Vector, clip
from aquafish_gym.physics.compiling import compiled, register, register_module, source_stamp
from aquafish_gym.physics.layout import (
    FIELDS,
    ORIENTATION,
    POSITION,
    SPIN,
    STATE_ROWS,
    VELOCITY,
    angles_of_rows,
)
from aquafish_gym.physics.simd import inlined
from aquafish_gym.sense import GYRO_RANGE, up_and_north
from aquafish_gym.utils.array_types import Flags, Reals

_AFTER_SPEEDS = FIELDS["spin"].stop
# Division by zero is infinity, as in rows, and no exception.
_OPTIONS: dict[str, Any] = {"slow": True, "nogil": True, "error_model": "numpy"}


class Outcome(NamedTuple):
    """What B robots are after a step, and how it was."""

    now: Reals  #: (25, B) states; of robots that diverged their last ones
    lost: Flags  #: (B,) whether each diverged
    seen: NDArray[np.float32]  #: (B, 9 or more) what whole sensors observe: the first nine
    moved: NDArray[np.float64]  #: (7, B) ``motion``
    terms: NDArray[np.float64]  #: (T, B) terms of a built-in task's reward, 0 if it does not count
    reward: NDArray[np.float64]  #: (B,) their sum
    fin_angles: NDArray[np.float64]  #: (3, B) rad


class Judgement(NamedTuple):
    """What a task makes of a step of B robots."""

    terms: dict[str, NDArray[np.float64]]  #: (B,) of the reward; 0 where a step does not count
    reward: NDArray[np.float64]  #: (B,) their sum
    memory: NDArray[np.float64]  #: (M, B) after the step
    succeeded: Flags  #: (B,) whether the step ended the episode by success


class Judge:
    """Turns actions into commands, and what the engine made of them into an :class:`Outcome`.

    Attributes
    ----------
    task
        As given.
    names
        Of the reward's terms if the task is built in; else there are none.
    """

    def __init__(self, task: Task) -> None:
        self.task = task
        found = compiled_task(task)
        self.names: tuple[str, ...] = () if found is None else task.terms  # type: ignore[attr-defined]
        self._rewards: Callable[..., Any] | None = None if found is None else found[0].rewards
        self._numbers = () if found is None else found[1]

    def of(self, task: Task) -> Judge:
        """Return the judge of a task: this one, if it is its own."""
        return self if task is self.task else Judge(task)

    def command(self, actions: Reals, gains: Reals, speeds: Reals) -> NDArray[np.float64] | None:
        """Set servos' ``speeds`` (3, B), in rev/s, rev/s and Hz, by actions and gains (B, 3).

        Return the actions (3, B) clipped to [-1, 1]; None if some are not finite.
        """
        action = np.empty((3, len(actions)))
        return action if _set_servos()(actions, gains, action, speeds) else None

    def outcome(self, before: Reals, channels: int) -> Outcome:
        """Return an outcome, to be filled, of states ``before`` a step and of some channels."""
        count = before.shape[1]
        return Outcome(
            np.empty_like(before),
            np.empty(count, np.bool_),
            np.empty((count, channels), np.float32),
            np.empty((len(MOTION), count)),
            np.empty((len(self.names), count)),
            np.empty(count),
            np.empty((3, count)),
        )

    def fill(
        self,
        outcome: Outcome,
        robots: tuple[int, int],
        states: Reals,
        before: Reals,
        over: Flags,
        action: Reals,
        memory: Reals,
        dt: float,
    ) -> None:
        """Fill the outcome of the robots from one to before another.

        ``states`` (25, B) are the engine's after the step, and ``before`` (25, B) those before it.
        No reward counts of a robot that diverged, or whose episode was ``over`` (B,).
        """
        finish = _finish(self._rewards, len(memory) > 0)
        if 0 < len(memory) < MEMORY_NUMBERS:  # the compiled loop reads this many numbers
            memory = np.concatenate([memory, np.zeros((MEMORY_NUMBERS - len(memory), len(over)))])
        *compiled, fin_angles = outcome
        finish(states, before, over, action, memory, dt, self._numbers, tuple(compiled), *robots)
        part = slice(*robots)
        fin_angles[:, part] = angles_of_rows(outcome.now[:, part])  # numpy's, which is no loop's

    def judge(
        self,
        outcome: Outcome,
        over: Flags,
        memory: NDArray[np.float64],
        look: Callable[[], Step],
    ) -> Judgement:
        """Return the task's judgement of an outcome, with the memory (M, B) before it.

        No step counts of a robot that diverged, or whose episode was ``over`` (B,). ``look``
        returns the step, which is needed by tasks that are not built in, remember or have success.
        """
        task = self.task
        bad = outcome.lost | over
        terms = dict(zip(self.names, outcome.terms, strict=True))
        reward = outcome.reward
        succeeded = np.zeros(len(bad), np.bool_)
        remembers = type(task).remember is not Task.remember
        if self.names and not remembers and not task.has_success:
            return Judgement(terms, reward, memory, succeeded)
        step = look()
        if not self.names:
            for name, value in task.reward_terms(step).items():
                terms[name] = np.where(bad, 0.0, np.broadcast_to(value, bad.shape))
            reward = sum(terms.values(), reward)
        if task.has_success:
            succeeded = np.asarray(task.succeeded(step)).astype(np.bool_) & ~bad
        if remembers:
            pairs = zip(memory, task.remember(step), strict=True)
            memory = np.array([np.where(bad, old, new) for old, new in pairs])
        return Judgement(terms, reward, memory, succeeded)


@functools.cache
def _register() -> None:
    register()
    for module in (command, sense, motions, tasks, sys.modules[__name__]):
        register_module(module)


@functools.cache
def _set_servos() -> Any:
    _register()
    stamp = source_stamp(_set_servos)

    def set_servos(actions: Any, gains: Any, clipped: Any, speeds: Any) -> bool:
        stamp  # noqa: B018  # part of the cache's key; see source_stamp
        nothing = 0.0  # it stays 0 unless a number is infinite or NaN
        for i in range(len(actions)):
            for k in range(3):
                nothing += np.float64(actions[i, k]) * 0.0
                clipped[k, i] = clip(np.float64(actions[i, k]), 1.0)
            turned = servo_speeds((clipped[0, i], clipped[1, i], clipped[2, i]))
            for k in range(3):
                # The lanes' own gains are 1: their product would be of single precision.
                speeds[k, i] = gains[i, k] * turned[k]
        return nothing == 0.0

    return compiled(set_servos, **_OPTIONS)


@functools.cache
def _finish(rewards: Any, remembers: bool) -> Any:
    _register()
    judged, recall = rewards is not None, _recall if remembers else _recall_nothing
    if judged:
        inlined(rewards)
    stamp = source_stamp(_finish)  # with ``tasks``

    def finish(
        states: Any, before: Any, over: Any, action: Any, memory: Any, dt: float, task: Any,
        outcome: Any, begin: Any, end: Any,
    ) -> None:  # fmt: skip
        stamp  # noqa: B018  # part of the cache's key; see source_stamp
        now, lost, seen, moved, terms, total = outcome
        begin, end = np.uint64(begin), np.uint64(end)  # no index is negative
        _settle(states, before, now, lost, begin, end)
        # One loop for each, of which the compiler makes vectors; of one for all it does not.
        _look(now, seen, begin, end)
        _trace(before, now, dt, moved, begin, end)
        if judged:
            for i in range(begin, end):
                was, there = _vector(before, POSITION, i), _vector(now, POSITION, i)
                done = Step(
                    was, there, _orientation(now, i), _vector(action, 0, i), recall(memory, i), dt
                )
                values = rewards(task, done)
                total[i] = 0.0
                for k in range(len(values)):
                    terms[k, i] = 0.0 if over[i] or lost[i] else values[k]
                    total[i] += terms[k, i]
        else:
            total[begin:end] = 0.0

    return compiled(finish, **_OPTIONS)


def _vector(rows: Any, first: int, i: int) -> Vector:
    """Read three of robot i's numbers in double precision."""
    x = rows[first, i]
    y = rows[first + 1, i]
    z = rows[first + 2, i]
    return (np.float64(x), np.float64(y), np.float64(z))


def _orientation(rows: Any, i: int) -> Any:
    x, y, z = _vector(rows, ORIENTATION, i)
    return (x, y, z, np.float64(rows[ORIENTATION + 3, i]))


def _recall(memory: Any, i: int) -> Any:
    return _vector(memory, 0, i) + _vector(memory, 3, i)


def _recall_nothing(_memory: Any, _i: int) -> Any:
    return (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def _look(now: Any, seen: Any, begin: int, end: int) -> None:
    """Let whole sensors observe up, north and gyro."""
    for i in range(begin, end):
        up, north = up_and_north(_orientation(now, i))
        gyro = _vector(now, SPIN, i)
        for k in range(3):
            seen[i, k] = clip(up[k], 1.0)
            seen[i, 3 + k] = clip(north[k], 1.0)
            seen[i, 6 + k] = clip(gyro[k], GYRO_RANGE)


def _trace(before: Any, now: Any, dt: float, moved: Any, begin: int, end: int) -> None:
    for i in range(begin, end):
        numbers = motion(_vector(before, POSITION, i), _vector(now, POSITION, i), dt)
        for k in range(len(MOTION)):
            moved[k, i] = numbers[k]


def _settle(states: Any, before: Any, now: Any, lost: Any, begin: int, end: int) -> None:
    """Copy the states into ``now`` except of robots that are ``lost``, which this finds out."""
    # Row by row, of which the compiler makes vectors.
    nothing = np.zeros(end - begin, states.dtype)  # 0 unless a number is infinite or NaN
    squares = np.zeros(end - begin)
    for r in range(STATE_ROWS):
        for i in range(begin, end):
            nothing[i - begin] += states[r, i] - states[r, i]
            now[r, i] = states[r, i]
    for r in range(VELOCITY, _AFTER_SPEEDS):
        for i in range(begin, end):
            x = np.float64(states[r, i])
            squares[i - begin] += x * x
    for i in range(begin, end):
        lost[i] = not (nothing[i - begin] == 0.0 and squares[i - begin] < RUNAWAY_SQUARE)
        if lost[i]:
            for r in range(STATE_ROWS):
                now[r, i] = before[r, i]
