"""Rollouts: policies swim the robots of a scenario, in a task, on an engine.

:func:`rollout` has two loops. Programs, policies of straight-line code, run on the compiled engine
with everything else in one threaded loop (``engines/compiled/kernel.py``). Any other policy, task
or engine runs in ``one.py``, a robot at a time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.engines.packages import GPU, check_engine, refuse_threads
from aquafish_gym.envs.tasks import Task, compiled_task
from aquafish_gym.physics.layout import layout
from aquafish_gym.plans import check_same_plan
from aquafish_gym.rollout.many import swim_many
from aquafish_gym.rollout.one import swim_one
from aquafish_gym.rollout.plan import Act, Path, Plan, Program, Trajectories
from aquafish_gym.rollout.programs import act_alone
from aquafish_gym.scenario import TIMESTEP, Scenario
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    brief,
    finite_array,
    instance,
    integer,
    sequence,
)
from aquafish_gym.world_config import MAXIMUM_SUBSTEPS

__all__ = ["Path", "Program", "Trajectories", "rollout"]

MAXIMUM_SECONDS = 3600.0


def rollout(
    policy: Program | Sequence[Act],
    scenario: Scenario,
    task: Task | None = None,
    *,
    engine: str = "numba",
    seconds: float | None = None,
    interval: int | None = None,
    believed: ArrayLike | None = None,
    believed_gain: ArrayLike | None = None,
    memory: ArrayLike | None = None,
    rngs: Sequence[np.random.Generator] = (),
    dtype: type[np.floating] = np.float64,
    threads: int | None = None,
    substeps: int = 1,
    start: NDArray[np.float64] | None = None,
) -> Trajectories:
    """Swim the B robots of a scenario under a policy, and return what they did.

    Parameters
    ----------
    policy
        A :class:`Program` for all robots, or a function for each.
    scenario
        Robots, water and faults.
    task
        What is rewarded; it may have a goal, a current, and a memory. Only the built-in tasks are
        compiled: in a task of another class a program swims one robot at a time, much slower. So
        do robots with late, slow or scaled channels.
    engine
        As of :func:`~aquafish_gym.simulate`. ``"cuda"`` refuses what is not compiled. Only a
        program of your own that computes with the time in plain floats may differ there from
        ``"numba"``, in the last bits.
    seconds
        How long; None is the task's own time.
    interval
        For how many steps of 0.01 s an action is held; None is 5, or what a program states.
    believed, believed_gain
        (B, F) or (F,), of programs only: the initial fin angles, rad, and the servo gains that a
        program assumes for dead reckoning. None assumes the true angles, and gains of 1.
    memory
        (B, M) the task's, as its ``begin`` draws it; None draws it from ``rngs``. Without a task
        there is none.
    rngs
        A generator for each robot, for ``memory``, for the fin angles of servos that are dead from
        the start, and for the noise of gyroscopes; may be empty if none of these is drawn. Noise
        is drawn from copies: robots that share one observe the same noise.
    dtype, threads, substeps
        As of :func:`~aquafish_gym.simulate`; the first two are of programs in the compiled loop.
    start
        States (25, B) to begin in, as ``LaneBatch.states``, of programs in the compiled loop;
        None begins at rest, or as the scenario says. Its fin angles stand for the scenario's.
        Earlier commands are 0: servos with a lag stand until it is over.

    Raises
    ------
    InvalidArgumentError, EngineUnavailableError
        If arguments do not fit each other.
    """
    _check(scenario, task, substeps, rngs)
    batch = len(scenario)
    known_gain = np.ones(len(scenario.plan.fins)) if believed_gain is None else believed_gain
    gains = _rows("believed_gain", known_gain, scenario)
    if seconds is None:
        if task is None:
            raise InvalidArgumentError("seconds must be given where there is no task")
        seconds = task.seconds
    seconds = float(finite_array("seconds", seconds, (), TIMESTEP, MAXIMUM_SECONDS, "s"))
    if memory is not None and task is None:
        raise InvalidArgumentError("memory must be None where there is no task")
    if not isinstance(policy, Program):
        interval = 5 if interval is None else integer("interval", interval, 1)
        if len(sequence("policy", policy)) != batch or not all(map(callable, policy)):
            raise InvalidArgumentError(
                f"policy must be a Program or {batch} functions, one for each robot; "
                f"got {brief(policy)}"
            )
        of_programs = {
            "believed": believed is not None,
            "believed_gain": believed_gain is not None,
            "dtype": dtype is not np.float64,
            "threads": threads is not None,
        }
        for name, given in of_programs.items():
            if given:
                raise InvalidArgumentError(
                    f"{name} must not be given with policies that are functions: it is of programs"
                )
    else:
        if interval not in (None, policy.interval):
            raise InvalidArgumentError(
                f"interval must be None or {policy.interval}, the program's own; got {interval}"
            )
        interval = policy.interval
        check_same_plan("policy", policy.plan, scenario.plan)
        if policy.observes_goal and (task is None or not task.has_goal):
            raise InvalidArgumentError(
                "policy must not observe a goal in a task that has none; choose a task with a goal"
            )
    if start is not None:
        start = finite_array("start", start, (layout(scenario.plan).state_rows, batch))
        scenario = replace(scenario, fin_angles=layout(scenario.plan).angles(start).T)
    steps = round(seconds / TIMESTEP)
    if task is not None and steps % interval:
        raise InvalidArgumentError(
            f"interval must divide the {steps} steps of the task's {seconds:g} s; got {interval}"
        )
    if memory is not None:
        memory = finite_array("memory", memory, (batch, None), flat=True)
    drawn = bool(np.isnan(scenario.fin_angles).any())
    needed = drawn or scenario.has("gyro_noise")
    if memory is None and task is not None and type(task).begin is not Task.begin:
        needed = True
        memory = [task.begin(rng) for rng in rngs]
    if needed and len(rngs) != batch:
        raise InvalidArgumentError(
            f"rngs must be one for each of the {batch} robots, for noise, the task's memory or the "
            f"angles of dead servos; got {len(rngs)}"
        )
    if drawn:
        scenario = scenario.draw_angles(rngs)
    begun = np.zeros((batch, 0)) if memory is None else np.reshape(memory, (batch, -1))
    plan = Plan(scenario, task, steps, interval, begun, tuple(rngs), substeps)
    engine = check_engine(engine, batch=True)
    refuse_threads(engine, threads)
    if isinstance(policy, Program):
        fins = scenario.fin_angles if believed is None else _rows("believed", believed, scenario)
        known = task is None or compiled_task(task) is not None
        if engine in ("numba", GPU) and known and not scenario.is_late:
            return swim_many(policy, plan, fins, gains, dtype, threads, start, engine)
        policy = [act_alone(policy, b, fins[b], gains[b]) for b in range(batch)]
    if engine == GPU:
        raise InvalidArgumentError(
            'engine must be "numba" or "pybullet" for functions, tasks of your own and late, slow '
            f"or scaled channels: a GPU swims programs in the built-in tasks; got {engine!r}"
        )
    if start is not None:
        raise InvalidArgumentError(
            "start must be None, except for programs on the engines numba and cuda, in a built-in "
            "task and without late, slow or scaled channels"
        )
    swum = [swim_one(act, plan, b, engine) for b, act in enumerate(policy)]
    returns, diverged, paths = zip(*swum, strict=True)
    end = np.array([path.position[-1] for path in paths])
    return Trajectories(np.array(returns), np.array(diverged), end, paths)


def _check(
    scenario: Scenario, task: Task | None, substeps: int, rngs: Sequence[np.random.Generator]
) -> None:
    """Refuse what is no scenario, task, number of substeps or list of generators."""
    instance("scenario", scenario, Scenario)
    if task is not None:
        instance("task", task, Task)
    integer("substeps", substeps, 1, MAXIMUM_SUBSTEPS)
    if not all(isinstance(rng, np.random.Generator) for rng in sequence("rngs", rngs)):
        raise InvalidArgumentError(f"rngs must be generators of numpy; got {brief(rngs)}")


def _rows(argument: str, value: ArrayLike, scenario: Scenario) -> NDArray[np.float64]:
    """Return numbers (B, F), or (F,) for all, as (B, F)."""
    batch, fins = len(scenario), len(scenario.plan.fins)
    given = finite_array(argument, value, (None, fins), flat=True)
    if len(given) not in (1, batch):
        raise InvalidArgumentError(
            f"{argument} must have shape ({fins},) or ({batch}, {fins}); got {given.shape}"
        )
    return np.broadcast_to(given, (batch, fins))
