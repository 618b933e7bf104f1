"""The scores of many controllers in many swims: pairs of a body and a pose, or episodes of a task.

The variance of a controller's mean over Q swims, of m bodies and q poses, is
``between bodies / m + between poses / q + rest / Q``. For a given Q it is least if every swim has a
pose of its own, and a body of its own as far as there are enough. All controllers of a generation
swim the same pairs (common random numbers), so that an easy pair favours none of them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from aquafish_gym.bodies import MorphologiesLike, body_array
from aquafish_gym.damage import Damage
from aquafish_gym.engines.packages import MAXIMUM_THREADS, check_engine
from aquafish_gym.envs.episode import begin_episodes, check_episode
from aquafish_gym.envs.tasks import Task, check_task, compiled_task
from aquafish_gym.envs.vector import AquaFishVectorEnv
from aquafish_gym.physics.layout import FIELDS, layout
from aquafish_gym.plans import BodyPlan, check_same_plan, plan_of
from aquafish_gym.rollout import rollout
from aquafish_gym.scenario import TIMESTEP, Scenario
from aquafish_gym.utils.array_types import Floats
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    brief,
    finite_array,
    flag,
    integer,
    one_of,
)
from aquafish_gym.world_config import WorldConfig
from gait.controllers.agents import ControllerAgent, refuse_unused
from gait.controllers.controller import MAXIMUM_SEED, Controller, check_controllers, program_of
from gait.swims.episode import transitions
from gait.swims.poses import zero_pose
from gait.swims.swim import SECONDS, check_world, step_count

FORWARD = "forward"  # the task whose score is a distance
# A diverged robot scores as if it had swum backwards at this speed (units/s), faster than any does.
DIVERGED_SPEED = -5.0


# Bodies (Q, S) and initial poses (Q, F), in rad, of Q swims.
Swims = tuple[Floats, Floats]


def draw_swims(bodies: Floats, poses: Floats, source: np.random.SeedSequence) -> Swims:
    """Return swims from poses (Q, F), with bodies (M, S) dealt at random and equally often."""
    order = np.random.default_rng(source).permutation(len(bodies))
    return bodies[np.resize(order, len(poses))], poses


def every_pair(bodies: Floats, poses: Floats) -> Swims:
    """Return the M x Q swims of each body (M, S) from each pose (Q, F), body by body."""
    return np.repeat(bodies, len(poses), axis=0), np.tile(poses, (len(bodies), 1))


def distances(
    controllers: Sequence[Controller],
    bodies: MorphologiesLike,
    poses: ArrayLike | None = None,
    seconds: float = SECONDS,
    threads: int | None = None,
    world: WorldConfig | None = None,
) -> Floats:
    """Return the mean distance of each controller on each body over some poses, in float32.

    Each of the M bodies swims from each of the poses (Q, F), in rad, by default 0; otherwise as
    :func:`gait.scores`.

    Returns
    -------
    ndarray
        (K, M) in units of 5 cm. A diverged robot counts as one that swam backwards at 5 units/s.

    Raises
    ------
    InvalidArgumentError
        If an argument does not fit, or there is no pose.

    Examples
    --------
    >>> from aquafish_gym import Morphology
    >>> body, still = Morphology.nominal(), [0.0, 0.0, -9.0]
    >>> silent = Controller(np.zeros((3, 14)), still, np.ones(3), 0.7, body, seed=0)
    >>> distances([silent], [body, {"caudal": (0, 0, 0)}], seconds=1).round(3).tolist()
    [[0.0, 0.0]]
    """
    plan = plan_of(controllers, bodies)
    sizes = body_array(bodies, "bodies", plan)
    given = zero_pose(plan) if poses is None else poses
    angles = finite_array("poses", given, (None, len(plan.fins)), unit="rad")
    if not len(angles):
        raise InvalidArgumentError("poses must be one or more; got none")
    swims = every_pair(sizes, angles)
    found = scores(controllers, *swims, seconds, threads=threads, world=world)
    return np.asarray(found.reshape(len(controllers), len(sizes), len(angles)).mean(axis=2))


def scores(
    controllers: Sequence[Controller],
    morphologies: MorphologiesLike = None,
    fin_angles: ArrayLike | None = None,
    seconds: float = SECONDS,
    *,
    task: object = FORWARD,
    damage: object = None,
    world: WorldConfig | None = None,
    seed: int = 0,
    engine: str = "numba",
    dtype: str = "float32",
    threads: int | None = None,
    believed: ArrayLike | None = None,
    believed_gain: ArrayLike | None = None,
    start: ArrayLike | None = None,
    penalize: bool = True,
) -> Floats:
    """Return the score of each controller in each swim.

    The score is the distance swum in ``seconds`` and ``world``. For another task than "forward", or
    with ``damage``, it is the return of the task's episode times the time step: of swimming forward
    units along the world's +y, whatever the interval.

    Parameters
    ----------
    controllers
        P of :class:`gait.Controller`, of one body plan. For functions, agents and models see
        :func:`gait.swim` and :func:`gait.evaluate`; for genomes of neat-python,
        :func:`gait.search.genome.genome_to_controller`.
    morphologies
        Q bodies, or one for all: one as ``Morphology.coerce`` takes it, a list, or (Q, S) sizes.
    fin_angles
        (Q, F) each fin's initial angle, or its phase if it sweeps, rad; (1, F) for all bodies, by
        default 0. The i-th body swims from the i-th pose; see also :func:`every_pair`.
    seconds
        Length of a swim.
    task, damage
        As of the environment. Built-in tasks run in the compiled loop, and one of your own class in
        a batched environment.
    world
        The water and the servos; None is ``WorldConfig()``. An episode, with a task or damage, has
        its own: there a world may only be ``reactive``.
    seed
        Of the task's and the damage's random choices, which are the same for all controllers: swim
        q is the episode of an environment that was seeded with ``seed + q``.
    engine
        ``"numba"``, all robots at once; ``"cuda"``, the same on a GPU, which refuses tasks of your
        own and late, slow or scaled channels; or as of :func:`gait.swim`, where on PyBullet one
        robot swims after the other.
    dtype
        ``"float32"`` or ``"float64"`` on these two; others compute in float64.
    threads
        None uses every core; no result depends on it. The engine cuda refuses others.
    believed, believed_gain
        What controllers that sense their fins assume: initial angles (Q, F) or (1, F) in rad, and
        servo gains (F,) or (Q, F). None for the true ones. Refused if none senses them.
    start
        A state in which all swims begin, as the vector environment's ``states`` has it; its
        fin angles stand for ``fin_angles``, which is then left out. None begins at rest.
    penalize
        Whether a robot that diverged scores as one that swam backwards at 5 units/s; else NaN.

    Returns
    -------
    ndarray
        (P, Q); distances in units of 5 cm.

    Raises
    ------
    InvalidArgumentError, UnknownNameError
        If an argument does not fit. Episodes have ``seconds``, ``world``, ``believed``,
        ``believed_gain`` and ``start`` of their own, and refuse others.

    Examples
    --------
    >>> from aquafish_gym import Morphology
    >>> scores([], [Morphology.nominal(), {"caudal": (0.0, 0.0, 0.0)}]).shape
    (0, 2)
    """
    controllers = check_controllers(controllers)
    world = check_world(world)
    broken = Damage.coerce(damage)
    judged = check_task(task)
    integer("seed", seed, 0, MAXIMUM_SEED)
    if threads is not None:
        integer("threads", threads, 1, MAXIMUM_THREADS)
    one_of("dtype", dtype, ("float32", "float64"))
    flag("penalize", penalize)
    engine = check_engine(engine, batch=True)
    plan = plan_of(controllers, morphologies)
    for i, controller in enumerate(controllers):
        check_same_plan(f"controllers[{i}]", controller.plan, plan)
    sizes = body_array(morphologies, plan=plan)
    pose = zero_pose(plan) if fin_angles is None else fin_angles
    angles = finite_array("fin_angles", pose, (None, len(plan.fins)), unit="rad")
    if isinstance(task, str) and task == FORWARD and not broken:
        found = _distances(
            plan, controllers, sizes, angles, step_count(seconds) * TIMESTEP,
            world, engine, dtype, threads, believed, believed_gain, start,
        )  # fmt: skip
        return penalize_diverged(found, seconds) if penalize else found
    for name, given in (
        ("seconds", seconds != SECONDS),
        ("world", replace(world, reactive=False) != WorldConfig()),
        ("believed", believed is not None),
        ("believed_gain", believed_gain is not None),
        ("start", start is not None),
    ):
        if given:
            raise InvalidArgumentError(f"{name} has no effect on an episode, which has its own")
    swims = pair_swims(sizes, angles)
    returns = np.empty((len(controllers), len(swims[1])))
    if not returns.size:
        return returns
    play = _step_episodes if compiled_task(judged) is None else _roll_out_episodes
    for numbers, those in by_kind(controllers):
        one_kind = play(
            plan, those, swims, judged, broken, world.reactive, seed, engine, dtype, threads
        )
        returns[numbers] = one_kind.reshape(len(those), -1)
    return penalize_diverged(returns, judged.seconds) if penalize else returns


def penalize_diverged(found: Floats, seconds: float) -> Floats:
    """Return scores of swims of ``seconds``, with ``DIVERGED_SPEED`` for robots that diverged."""
    return np.where(np.isfinite(found), found, DIVERGED_SPEED * seconds)


def _distances(
    plan: BodyPlan,
    controllers: list[Controller],
    sizes: Floats,
    angles: Floats,
    seconds: float,
    world: WorldConfig,
    engine: str,
    dtype: str,
    threads: int | None,
    believed: ArrayLike | None,
    believed_gain: ArrayLike | None,
    start: ArrayLike | None,
) -> Floats:
    """Return the distances (P, Q) of controllers; NaN where a robot diverged."""
    state = None if start is None else check_state(start, plan)
    begun = angles if state is None else _only_pose(plan, state, angles)
    bodies, poses = pair_swims(sizes, begun)
    swims = len(poses)
    fins = None if believed is None else _each_swim("believed", believed, poses.shape)
    gain = world.gains(plan) if believed_gain is None else believed_gain
    gains = _each_swim("believed_gain", gain, poses.shape)
    sensing = not controllers or any(controller.senses.fins for controller in controllers)
    refuse_unused(sensing, "believed", believed)
    refuse_unused(sensing, "believed_gain", believed_gain)
    found = np.empty((len(controllers), swims))
    if not swims:
        return found
    first_y = 0.0 if state is None else state[FIELDS["position"]][1]
    for numbers, those in by_kind(controllers):
        each = (len(those), 1)
        fields = {"body": np.tile(bodies, each), "fin_angles": np.tile(poses, each)}
        robots = Scenario.fill(fields, plan=plan)
        swum = rollout(
            program_of(those, swims),
            world.edit(robots),
            seconds=seconds,
            believed=None if fins is None else np.tile(fins, each),
            believed_gain=np.tile(gains, each),
            engine=engine,
            dtype=np.dtype(dtype).type,
            threads=threads,
            substeps=world.substeps,
            start=None if state is None else np.repeat(state[:, None], len(robots), axis=1),
        )
        far = swum.end[:, 1] - first_y - world.current[1] * seconds
        found[numbers] = far.reshape(len(those), swims)
    return found


def _roll_out_episodes(
    plan: BodyPlan,
    controllers: list[Controller],
    swims: Swims,
    task: Task,
    damage: Damage,
    reactive: bool,
    seed: int,
    engine: str,
    dtype: str,
    threads: int | None,
) -> Floats:
    """Return the scores (P Q,) of P controllers of one kind in the episodes of a built-in task."""
    count = len(swims[1])
    program = program_of(controllers, count)
    rngs = [np.random.default_rng(seed + q) for q in range(count)]
    config = check_episode(task, damage=damage, plan=plan)
    configs = [
        config.with_options({"morphology": body, "fin_angles": pose})
        for body, pose in zip(*swims, strict=True)
    ]
    scenario, memory = begin_episodes(configs, rngs, program.interval, reactive)
    found = rollout(
        program,
        scenario.take(np.tile(np.arange(count), len(controllers))),
        task,
        memory=np.tile(memory, (len(controllers), 1)),
        rngs=rngs * len(controllers),  # each controller's swims observe the same noise
        engine=engine,
        dtype=np.dtype(dtype).type,
        threads=threads,
    )
    returns = found.returns * (program.interval * TIMESTEP)
    return np.where(found.diverged, np.nan, returns)


def _step_episodes(
    plan: BodyPlan,
    controllers: list[Controller],
    swims: Swims,
    task: Task,
    damage: Damage,
    reactive: bool,
    seed: int,
    engine: str,
    dtype: str,
    threads: int | None,
) -> Floats:
    """Return what ``_roll_out_episodes`` does, in a task of any class."""
    count = len(swims[1])
    agent = ControllerAgent([one for one in controllers for _ in range(count)])
    if controllers[0].senses.goal and not task.has_goal:
        raise InvalidArgumentError(
            "controllers must not sense a goal in a task that has none; choose a task with a goal"
        )
    envs = AquaFishVectorEnv(
        len(controllers) * count,
        plan=plan,
        morphology=np.tile(swims[0], (len(controllers), 1)),
        fin_angles=np.tile(swims[1], (len(controllers), 1)),
        damage=damage,
        task=task,
        reactive=reactive,
        frame_skip=agent.interval,
        engine=engine,
        dtype=dtype if engine == "numba" else None,
        threads=threads if engine == "numba" else None,
    )
    try:
        seen, info = envs.reset(seed=[seed + q for q in range(count)] * len(controllers))
        agent.reset(info)
        returns = np.zeros(envs.num_envs)
        lost = np.zeros(envs.num_envs, bool)
        for step in transitions(envs, agent.act, seen):
            returns += np.where(step.was_over, 0.0, step.reward)
            lost |= step.info["diverged"] & ~step.was_over
    finally:
        envs.close()
    return np.where(lost, np.nan, returns * envs.dt)


def by_kind(controllers: Sequence[Controller]) -> Iterator[tuple[list[int], list[Controller]]]:
    """Yield the controllers of each kind, which swim together, and their numbers."""
    kinds: dict[tuple[Any, ...], list[int]] = {}
    for i, controller in enumerate(controllers):
        kinds.setdefault(controller.kind, []).append(i)
    for numbers in kinds.values():
        yield numbers, [controllers[i] for i in numbers]


def check_state(start: ArrayLike, plan: BodyPlan) -> Floats:
    """Return the state of a plan's robot, in the order of ``aquafish_gym.physics.layout``."""
    return finite_array("start", start, (layout(plan).state_rows,))


def pair_swims(bodies: Floats, poses: Floats) -> Swims:
    """Return bodies (Q, S) and poses (Q, F) of Q swims, where one of either was for all."""
    swims = len(bodies) if len(poses) == 1 else len(poses)
    if len(bodies) not in (1, swims):
        raise InvalidArgumentError(
            "morphologies and fin_angles must be equally many, or one for all; "
            f"got {len(bodies)} and {len(poses)}"
        )
    shape = (swims, poses.shape[1])
    return np.broadcast_to(bodies, (swims, bodies.shape[1])), np.broadcast_to(poses, shape)


def _only_pose(plan: BodyPlan, start: Floats, poses: Floats) -> Floats:
    """Return the fin angles (1, F) of a state, from which ``poses`` must not differ."""
    begun = layout(plan).angles(start)[None]
    if poses.any() and not (poses == begun).all():
        raise InvalidArgumentError(
            f"fin_angles must be those of start, in which all swims begin; got {brief(poses)}"
        )
    return begun


def _each_swim(name: str, values: ArrayLike, shape: tuple[int, ...]) -> Floats:
    """Return values (Q, F) from one row for all swims, or one for each."""
    swims, fins = shape
    table = finite_array(name, values, (None, fins), flat=name == "believed_gain")
    if len(table) not in (1, swims):
        raise InvalidArgumentError(f"{name} must be one for all swims or {swims}; got {len(table)}")
    return np.broadcast_to(table, shape)
