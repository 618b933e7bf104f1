"""Evolution of a gait for a body or a sample of bodies; an interrupted run resumes."""

from __future__ import annotations

import time
import zlib
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.bodies import MorphologiesLike, body_array, median_body, sample_stamp
from aquafish_gym.damage import Damage
from aquafish_gym.envs.tasks import check_task, compiled_task
from aquafish_gym.morphology import Morphology
from aquafish_gym.physics.layout import layout
from aquafish_gym.plans import check_plan, check_same_plan
from aquafish_gym.runs.code import code_hash
from aquafish_gym.scenario import TIMESTEP
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    brief,
    callback,
    finite_array,
    instance,
    integer,
)
from aquafish_gym.world_config import WorldConfig
from gait.controllers.controller import Controller
from gait.files import run_folder
from gait.search import cma, neat
from gait.search.ask_tell import Proposal, Relay, Search
from gait.search.config import CMA_POPULATION
from gait.search.config import EvolveConfig as EvolveConfig
from gait.search.history import FILES, History, Scores, finalists_of, read_checkpoint
from gait.search.history import Generation as Generation
from gait.search.templates import Template
from gait.swims.poses import random_poses, spread_poses, stream, zero_pose
from gait.swims.scores import Swims, check_state, draw_swims, every_pair, scores
from gait.swims.swim import check_world

FINAL_POSES = 32  # random ones of the fixed swims from which a run's best controller is chosen
MAXIMUM_BODIES = 1000
SAVE_SECONDS = 1.0  # between two checkpoints
# Settings of a search from random networks; a first controller has its own.
OF_A_NETWORK = (
    "search", "controller", "senses", "interval", "hidden", "harmonics", "clock", "restarts",
    "random_candidates",
)  # fmt: skip


@dataclass(frozen=True)
class Evolved:
    """The result of :func:`evolve_gait`.

    Attributes
    ----------
    controller
        The best winner of all generations. For a sample, its ``morphology`` is the median body.
    fitness
        Its mean distance over the run's fixed swims, in units of 5 cm; in a task other than
        "forward" its mean return times the seconds of an action. They begin in the zero pose
        and in 32 random ones; for a sample, poses are added until all bodies have equally many.
        With ``start``, each body swims once, from that state.
    history
        One row a generation.
    distances
        (M,) the same on each body over the zero pose and the 32 random ones, in units. Without
        ``poses`` it is over the zero pose alone; with ``start`` it is from that state.

    Examples
    --------
    >>> config = EvolveConfig(paper=True, generations=2, population=10, seconds=1)
    >>> evolve_gait(config=config).history[1].nodes
    3
    """

    controller: Controller
    fitness: float
    history: tuple[Generation, ...]
    distances: NDArray[np.float64]

    def __repr__(self) -> str:
        bodies = f" on {len(self.distances)} bodies" if len(self.distances) > 1 else ""
        return (
            f"Evolved(fitness {self.fitness:.2f}{bodies} after {len(self.history)} generations, "
            f"{self.controller!r})"
        )


def damaged_at_random(body: Morphology, count: int, seed: int) -> list[Morphology]:
    """Return ``count`` copies of a body, each with its own random damage: domain randomisation.

    The first ones are the same for any ``count``.
    """
    body = Morphology.coerce(body)
    sources = stream(seed, 7).spawn(integer("count", count, 0, MAXIMUM_BODIES))
    rngs = map(np.random.default_rng, sources)
    return [Damage.random(rng, body.plan).apply(body) for rng in rngs]


def evolve_gait(
    morphologies: MorphologiesLike = None,
    config: EvolveConfig | None = None,
    *,
    first: Controller | None = None,
    start: ArrayLike | None = None,
    out: Path | str | None = None,
    world: WorldConfig | None = None,
    cpu_seconds: float | None = None,
    on_generation: Callable[[Generation], None] | None = None,
) -> Evolved:
    """Evolve a controller that swims a body forward, or does another task, or a sample of bodies.

    In each generation a swim has its own body and pose (see ``gait.swims.scores``), so a sample
    takes as many swims as one body. Only the leaders of a generation swim on every body: fifty
    bodies are nearly free, hundreds are not.

    Parameters
    ----------
    morphologies
        A body of ``config.plan`` as ``Morphology.coerce`` takes it; None is the nominal one. Or a
        sample of at most 1000 equally likely bodies: a list, or sizes (M, S).
    config
        None is ``EvolveConfig()``.
    first
        A controller to refine by CMA-ES for ``config.generations``, with small steps and without
        new connections. The result is no worse in the swims of ``Evolved.fitness``. None searches
        from random networks.
    start
        A state in mid-swim, such as a column of the vector environment's ``states``. Each
        controller then swims on from it for ``config.seconds``, once on each body and with its
        clock at 0; ``config.poses`` is refused. None begins at rest, in poses that change with
        every generation.
    out
        A folder for ``controller.json`` (the best so far), ``history.csv``, ``checkpoint.json``
        and a sample's ``bodies.json``, saved every second. An unfinished run of the same bodies
        and settings resumes, and ends in the same files as without the interruption.
    world
        The water and the servos; None is ``WorldConfig()``. The robot knows its servos' gains:
        controllers that sense their fins integrate their commands with them.
    cpu_seconds
        CPU time of this process, compilation included, after which the present generation is the
        last. The result then depends on the computer. Such a search in ``out`` is unfinished: the
        same call resumes it, for as much time again.
    on_generation
        Called with every generation, including those that ``out`` already holds.

    Raises
    ------
    InvalidArgumentError
        If an argument does not fit, a sample has no ``poses``, ``world`` or ``start`` is given with
        another task, ``config`` sets what ``first`` has of its own, or ``out`` cannot be written,
        is in use, or holds another run, a run of other code or a damaged checkpoint, or is given
        with a task that no file can state.
    """
    config = EvolveConfig() if config is None else instance("config", config, EvolveConfig)
    world = check_world(world)
    plan = check_plan(config.plan)
    bodies = body_array(morphologies, plan=plan)
    callback("on_generation", on_generation)
    state = None if start is None else check_state(start, plan)
    began = time.process_time()
    budget = np.inf if cpu_seconds is None else finite_array("cpu_seconds", cpu_seconds, (), 0.0)
    _check(bodies, config, world, state is not None)
    choices = config.choices
    if first is not None:
        _check_first(first, config)
        choices = choices._replace(rows=choices.generations)
    body = median_body(bodies, plan)
    sample = sample_stamp(bodies) if len(bodies) > 1 else None
    settings: dict[str, Any] = {}
    if out is not None:
        more = {
            "sample": sample,
            "world": None if world == WorldConfig() else asdict(world),
            "first": None if first is None else first.to_dict(),
            "start": None if state is None else state.tolist(),
        }
        settings = {"morphology": body.to_dict(), **_written(config)}
        settings |= {name: value for name, value in more.items() if value is not None}
    trials = _Trials(bodies, config, world, state)
    search = make_search(config, body, first)
    run = History(sample)
    with run_folder(out, "a gait", settings, FILES, bodies, evolve_gait, plan) as folder:
        recorded = read_checkpoint(folder, choices) if folder else []
        saved = -np.inf
        try:
            while len(run.rows) < choices.rows:
                generation = len(run.rows)
                proposal = trials.nominate(search.ask())
                replayed = generation < len(recorded)
                scores = recorded[generation] if replayed else trials.score(proposal, generation)
                row = run.record(proposal, scores)
                search.tell(scores.fitness, run.winner, row.final)
                if on_generation:
                    on_generation(row)
                if folder and not replayed and time.monotonic() > saved + SAVE_SECONDS:
                    run.save(folder)
                    saved = time.monotonic()
                if not replayed and time.process_time() - began >= budget:
                    break
        finally:
            if folder and run.rows and len(run.rows) >= len(recorded):
                run.save(folder)
    return Evolved(run.best, run.fitness, tuple(run.rows), trials.distances(run.best))


def _written(config: EvolveConfig) -> dict[str, Any]:
    """Return a configuration's settings; of a task of the user's own class, its code, too."""
    try:
        settings = config.settings
    except InvalidArgumentError as error:
        raise InvalidArgumentError(f"out must be None with this task: {error}") from None
    task = config.task
    if not isinstance(task, str) and compiled_task(task) is None:
        settings["task_code"] = code_hash(type(task))
    return settings


def make_search(config: EvolveConfig, body: Morphology, first: Controller | None = None) -> Search:
    """Return the search of a configuration, whose random streams follow from its seed."""
    choices = config.choices
    if first is not None:
        mine = replace(first, morphology=body, seed=config.seed, sample=None)
        rng = np.random.default_rng(stream(config.seed, 6))
        return cma.tuner(mine, choices.population, rng, cma.REFINING)
    if choices.search == "cma":
        template = Template.of_class(
            choices.controller, choices.senses, choices.hidden, config.interval, body.plan
        )
        silent = template.silent(choices.clock, body, config.seed)
        rng = np.random.default_rng(stream(config.seed, 6))
        turns = cma.multistart(
            template.random(choices.random_candidates, rng),
            lambda vectors: template.controllers(vectors, silent),
            choices.population,
            choices.restarts,
            config.poses,
            rng,
        )
        return Relay(turns)
    streams = [
        stream(config.seed, 0),
        *(stream(config.seed, 4, k) for k in range(1, choices.restarts)),
    ]
    starts = [
        neat.Evolution(
            lambda genome: neat.genome_to_controller(
                genome, choices.clock, body, config.seed, choices.senses, config.interval
            ),
            choices.population,
            int(source.generate_state(1)[0]),
            choices.senses,
            growing=i % 3 > 0,
            plan=body.plan,
        )
        for i, source in enumerate(streams)
    ]
    tuning = CMA_POPULATION, np.random.default_rng(stream(config.seed, 5))
    return Relay(
        neat.multistart(starts, choices.generations, tuning if choices.cma_generations else None)
    )


class _Trials:
    """The swims of a run: random ones in each generation, and fixed ones for the finalists.

    From a state, all controllers swim the fixed ones.
    """

    def __init__(
        self,
        bodies: NDArray[np.float64],
        config: EvolveConfig,
        world: WorldConfig,
        start: NDArray[np.float64] | None,
    ) -> None:
        self._bodies = bodies
        self._config = config
        self._world = world
        self._start = start
        self._plan = check_plan(config.plan)
        # CMA-ES ranks controllers that differ little. With independent poses it finds worse gaits,
        # some of them good in the fixed swims only. NEAT has the poses of the paper.
        self._spread = config.choices.search == "cma"
        if start is not None:
            self._final_poses = layout(self._plan).angles(start)[None]
            self._finals = every_pair(bodies, self._final_poses)
            return
        count = 1 + (FINAL_POSES if config.poses else 0)
        rounds = -(-count // len(bodies))
        poses = self._poses(max(count, rounds * len(bodies)) - 1, 1)  # the same in all generations
        self._final_poses = poses[:count]
        self._finals = np.resize(bodies, (len(poses), bodies.shape[1])), poses

    def nominate(self, proposal: Proposal) -> Proposal:
        """Return the proposal; from a state, with all controllers as finalists."""
        if self._start is None:
            return proposal
        return proposal._replace(finalists=[*proposal.controllers, *(proposal.finalists or ())])

    def score(self, proposal: Proposal, generation: int) -> Scores:
        """Let a generation swim, and then its finalists."""
        if self._start is not None:
            assert proposal.finalists
            scores = self._finish(proposal.finalists)
            return scores._replace(fitness=scores.fitness[: len(proposal.controllers)])
        seed = self._config.seed
        poses = self._drawn_poses(proposal, generation)
        swims = draw_swims(self._bodies, poses, stream(seed, 3, generation))
        fitness = self._swim(proposal.controllers, swims).mean(axis=1)
        finalists = finalists_of(proposal, fitness)
        if not finalists:
            return Scores(fitness.tolist())
        return self._finish(finalists)._replace(fitness=fitness.tolist())

    def _finish(self, finalists: Sequence[Controller]) -> Scores:
        """Let finalists swim the fixed swims, and return their scores."""
        distances = self._swim(finalists, self._finals)
        finals = distances.mean(axis=1)
        best = int(finals.argmax())
        return Scores(finals.tolist(), best, float(finals[best]), float(distances[best, 0]))

    def distances(self, controller: Controller) -> NDArray[np.float64]:
        """Return the mean distance on each body (M,) over the final poses."""
        swims = self._swim([controller], every_pair(self._bodies, self._final_poses))
        return np.asarray(swims.reshape(len(self._bodies), -1).mean(axis=1))

    def _swim(self, controllers: Sequence[Controller], swims: Swims) -> NDArray[np.float64]:
        c = self._config
        seed = zlib.crc32(swims[1].tobytes())  # new random tasks with new poses
        return scores(
            controllers, *swims, c.seconds, task=c.task, world=self._world, seed=seed,
            threads=c.threads, start=self._start,
        )  # fmt: skip

    def _drawn_poses(self, proposal: Proposal, generation: int) -> NDArray[np.float64]:
        """Return the random poses of a generation."""
        c = self._config
        count = c.poses if proposal.poses is None else proposal.poses
        if count and self._spread:
            return spread_poses(1 + count, stream(c.seed, 2, generation), self._plan)
        return self._poses(count, 2, generation)

    def _poses(self, count: int, *key: int) -> NDArray[np.float64]:
        draw = spread_poses if self._spread else random_poses
        drawn = draw(count, stream(self._config.seed, *key), self._plan)
        return np.vstack([zero_pose(self._plan), drawn])


def _check(
    bodies: NDArray[np.float64], config: EvolveConfig, world: WorldConfig, moving: bool
) -> None:
    """Refuse arguments that do not fit together."""
    if not 1 <= len(bodies) <= MAXIMUM_BODIES:
        raise InvalidArgumentError(
            f"morphologies must be 1 to {MAXIMUM_BODIES} bodies; got {len(bodies)}"
        )
    if len(bodies) > 1 and not config.poses and not moving:
        raise InvalidArgumentError(
            f"poses must be at least 1 for a sample of {len(bodies)} bodies, since each swim is on "
            "another body; got 0"
        )
    own_water = replace(world, reactive=False) != WorldConfig()
    for name, given in (("world", own_water), ("start", moving)):
        if given and not config.is_forward:
            raise InvalidArgumentError(f"{name} has no effect with the task {brief(config.task)}")
    if moving and config.poses != EvolveConfig.poses:
        raise InvalidArgumentError(
            f"poses has no effect with start, from which all swim; got {config.poses}"
        )


def _check_first(first: object, config: EvolveConfig) -> None:
    """Refuse a first controller that does not fit a configuration."""
    checked = instance("first", first, Controller)
    check_same_plan("first", checked.plan, check_plan(config.plan))
    task = check_task(config.task)
    default = EvolveConfig()
    for name in OF_A_NETWORK:
        if getattr(config, name) != getattr(default, name):
            raise InvalidArgumentError(
                f"{name} has no effect with first, a search by CMA-ES whose network, senses and "
                f"clock are that controller's; got {getattr(config, name)!r}"
            )
    words = f"the task {brief(config.task)}"
    if checked.senses.goal and not task.has_goal:
        raise InvalidArgumentError(f"first must not observe a goal in {words}")
    steps = round(config.episode_seconds / TIMESTEP)
    if not config.is_forward and steps % checked.interval:
        raise InvalidArgumentError(
            f"first must hold its actions for a number of steps that divides the {steps} steps of "
            f"{words}; got an interval of {checked.interval}"
        )
