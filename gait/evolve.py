"""Evolution of a gait for a body or a sample of bodies; an interrupted run resumes."""

from __future__ import annotations

import time
import zlib
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.bodies import MorphologiesLike, body_array, median_body, sample_stamp
from aquafish_gym.damage import Damage
from aquafish_gym.morphology import Morphology
from aquafish_gym.utils.validation import InvalidArgumentError, instance
from aquafish_gym.world_config import WorldConfig
from gait.config import CMA_POPULATION
from gait.config import EvolveConfig as EvolveConfig
from gait.controller import Controller
from gait.files import run_folder
from gait.fitness import Swims, draw_swims, every_pair, swim_scores
from gait.history import FILES, History, Scores, finalists_of, read_checkpoint
from gait.history import Generation as Generation
from gait.rollout import ZERO_POSE, lane_world, random_poses, stream
from gait.search import cma, neat
from gait.search.ask_tell import Proposal, Relay, Search
from gait.search.templates import Template

FINAL_POSES = 32  # random ones of the fixed swims from which a run's best controller is chosen
MAXIMUM_BODIES = 1000
SAVE_SECONDS = 1.0  # between two checkpoints


@dataclass(frozen=True)
class Evolved:
    """The result of :func:`evolve_gait`.

    Attributes
    ----------
    controller
        The best winner of all generations. For a sample, its ``morphology`` is the median body.
    fitness
        Its mean distance over the run's fixed swims, in units of 5 cm: from the
        zero pose and 32 random ones, and for a sample as many more as give each body equally many.
    history
        One row a generation.
    distances
        (M,) mean distance on each body over the zero pose and the same 32 random poses, in units;
        from the zero pose alone without ``poses``.

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
    sources = stream(seed, 7).spawn(count)
    return [Damage.random(np.random.default_rng(source)).apply(body) for source in sources]


def evolve_gait(
    morphologies: MorphologiesLike = None,
    config: EvolveConfig | None = None,
    *,
    out: Path | str | None = None,
    world: WorldConfig | None = None,
    on_generation: Callable[[Generation], None] | None = None,
) -> Evolved:
    """Evolve a controller that swims a body forward, or does another task, or a sample of bodies.

    A sample costs no more than one body: each swim has its own body and pose (``gait.fitness``
    says why). Only the leaders of each generation swim on every body, so fifty bodies are nearly
    free, and hundreds are not.

    Parameters
    ----------
    morphologies
        A body as ``Morphology.coerce`` takes it; None is the nominal one. Or a sample of at most
        1000 equally likely bodies: a list, or sizes (M, 9).
    config
        None is ``EvolveConfig()``.
    out
        A folder for ``controller.json`` (the best so far), ``history.csv``, ``checkpoint.json``
        and a sample's ``bodies.json``, saved every second. An unfinished run of the same bodies
        and settings resumes, and ends in the same files as without the interruption.
    world
        The water and the servos, without a lag; None is ``WorldConfig()``.
    on_generation
        Called with every generation, including those that ``out`` already holds.

    Raises
    ------
    InvalidArgumentError
        If an argument does not fit, a sample has no ``poses``, ``world`` is given with another
        task, or ``out`` cannot be written, is in use, or holds another run or a damaged checkpoint.
    """
    config = EvolveConfig() if config is None else instance("config", config, EvolveConfig)
    world = lane_world(world)
    bodies = body_array(morphologies)
    _check(bodies, config, world)
    body, sample = median_body(bodies), sample_stamp(bodies) if len(bodies) > 1 else None
    settings = {"morphology": body.to_dict(), **config.settings}
    settings |= {} if sample is None else {"sample": sample}
    settings |= {} if world == WorldConfig() else {"world": asdict(world)}
    trials = _Trials(bodies, config, world)
    search, run = make_search(config, body), History(sample)
    with run_folder(out, "a gait", settings, FILES, bodies) as folder:
        recorded = read_checkpoint(folder, config.plan) if folder else []
        saved = -np.inf
        try:
            while len(run.rows) < config.plan.rows:
                generation = len(run.rows)
                proposal = search.ask()
                replayed = generation < len(recorded)
                scores = recorded[generation] if replayed else trials.score(proposal, generation)
                row = run.record(proposal, scores)
                search.tell(scores.fitness, run.winner, row.final)
                if on_generation:
                    on_generation(row)
                if folder and not replayed and time.monotonic() > saved + SAVE_SECONDS:
                    run.save(folder)
                    saved = time.monotonic()
        finally:
            if folder and run.rows and len(run.rows) >= len(recorded):
                run.save(folder)
    return Evolved(run.best, run.fitness, tuple(run.rows), trials.distances(run.best))


def make_search(config: EvolveConfig, body: Morphology) -> Search:
    """Return the search of a configuration, whose random streams follow from its seed."""
    c, plan = config, config.plan
    if c.search == "cma":
        template = Template.of_class(c.controller, plan.senses, c.hidden, c.interval)
        rng = np.random.default_rng(stream(c.seed, 6))
        turns = cma.multistart(
            template.random(plan.random_candidates, rng),
            lambda x: template.controller(x, c.clock, body, c.seed),
            plan.population,
            plan.restarts,
            rng,
        )
        return Relay(turns)
    streams = [stream(c.seed, 0), *(stream(c.seed, 4, k) for k in range(1, plan.restarts))]
    starts = [
        neat.Evolution(
            lambda genome: neat.genome_to_controller(
                genome, c.clock, body, c.seed, plan.senses, c.interval
            ),
            plan.population,
            int(source.generate_state(1)[0]),
            len(plan.senses.names),
            growing=i % 3 > 0,
        )
        for i, source in enumerate(streams)
    ]
    tuning = CMA_POPULATION, np.random.default_rng(stream(c.seed, 5))
    return Relay(
        neat.multistart(starts, plan.generations, tuning if plan.cma_generations else None)
    )


class _Trials:
    """The swims of a run: random ones in each generation, and fixed ones for the finalists."""

    def __init__(
        self, bodies: NDArray[np.float64], config: EvolveConfig, world: WorldConfig
    ) -> None:
        self._bodies, self._config, self._world = bodies, config, world
        count = 1 + (FINAL_POSES if config.poses else 0)
        rounds = -(-count // len(bodies))
        poses = self._poses(max(count, rounds * len(bodies)) - 1, 1)
        self._final_poses = poses[:count]
        self._finals = np.resize(bodies, (len(poses), 9)), poses

    def score(self, proposal: Proposal, generation: int) -> Scores:
        """Let a generation swim, and then its finalists."""
        seed, count = self._config.seed, self._config.poses
        poses = self._poses(count, 2, generation)
        if proposal.poses is not None:
            poses = poses[: 1 + proposal.poses]
        swims = draw_swims(self._bodies, poses, stream(seed, 3, generation))
        fitness = self._swim(proposal.controllers, swims).mean(axis=1)
        finalists = finalists_of(proposal, fitness)
        if not finalists:
            return Scores(fitness.tolist())
        distances = self._swim(finalists, self._finals)
        finals = distances.mean(axis=1)
        first = int(finals.argmax())
        return Scores(fitness.tolist(), first, float(finals[first]), float(distances[first, 0]))

    def distances(self, controller: Controller) -> NDArray[np.float64]:
        """Return the mean distance on each body (M,) over the final poses."""
        swims = self._swim([controller], every_pair(self._bodies, self._final_poses))
        return np.asarray(swims.reshape(len(self._bodies), -1).mean(axis=1))

    def _swim(self, controllers: Sequence[Controller], swims: Swims) -> NDArray[np.float64]:
        c = self._config
        seed = zlib.crc32(swims[1].tobytes())  # new random tasks with new poses
        return swim_scores(
            controllers, *swims, c.task, seconds=c.seconds, world=self._world, seed=seed,
            threads=c.threads,
        )  # fmt: skip

    def _poses(self, count: int, *key: int) -> NDArray[np.float64]:
        return np.vstack([ZERO_POSE, random_poses(count, stream(self._config.seed, *key))])


def _check(bodies: NDArray[np.float64], config: EvolveConfig, world: WorldConfig) -> None:
    """Refuse arguments that do not fit together."""
    if not 1 <= len(bodies) <= MAXIMUM_BODIES:
        raise InvalidArgumentError(
            f"morphologies must be 1 to {MAXIMUM_BODIES} bodies; got {len(bodies)}"
        )
    if len(bodies) > 1 and not config.poses:
        raise InvalidArgumentError(
            f"poses must be at least 1 for a sample of {len(bodies)} bodies, since each swim is on "
            "another body; got 0"
        )
    if world != WorldConfig() and config.task != "forward":
        raise InvalidArgumentError(f'world has no effect with the task "{config.task}"')
