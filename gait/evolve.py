"""Evolving a gait for a body, or a sample of them: scored in the lanes, taken up anywhere."""

from __future__ import annotations

import time
import zlib
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.bodies import (
    MorphologiesLike,
    body_array,
    median_body,
    sample_stamp,
    write_bodies,
)
from aquafish_gym.damage import Damage
from aquafish_gym.engines.worlds import WorldConfig
from aquafish_gym.morphology import Morphology
from aquafish_gym.runs.folder import claim, held
from aquafish_gym.runs.storage import (
    DamagedFileError,
    ensure_writable_directory,
    write_document,
)
from aquafish_gym.utils.validation import InvalidArgumentError
from gait.config import CMA_POPULATION
from gait.config import EvolveConfig as EvolveConfig
from gait.controller import Controller
from gait.fitness import Scorer, Swims, draw_swims, every_pair, worth
from gait.records import (
    BODIES_FILE,
    CHECKPOINT_FILE,
    CHECKPOINT_SCHEMA,
    CONTROLLER_FILE,
    FILES,
    HISTORY_FILE,
    read_checkpoint,
    write_history,
)
from gait.records import Generation as Generation
from gait.rollout import ZERO_POSE, lane_world, random_poses, stream, swim_all
from gait.search import cma, neat
from gait.search.asking import Answer, Ask, Search
from gait.search.templates import Template

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# With random poses, fitness is noisy, and the best of many is the luckiest. So the leaders of
# each generation swim once more, from poses that are the same throughout the run, each body of a
# sample equally often, and that tells which is the best of all.
FINALISTS = 8
FINAL_POSES = 32
MAXIMUM_BODIES = 1000
EVERY = 1.0  # s between two writings of what there is


@dataclass(frozen=True)
class Evolved:
    """What a run has come to.

    Attributes
    ----------
    controller
        The best of all generations' winners. Of a sample, its ``morphology`` is the median body.
    fitness
        Its mean distance, or the quantile asked for, over the run's fixed swims, in units: from
        the zero pose and 32 random ones, and of a sample so many that each body has equally many.
    history
        One row a generation.
    distances
        (M,) its mean distance on each body over the zero pose and the run's first 32 random poses
        (only the zero pose without ``poses``), in units: how it holds over a sample.

    Examples
    --------
    >>> evolve_gait(config=EvolveConfig(generations=2, population=10, seconds=1)).history[1].nodes
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

    def plot(self, axes: Axes | None = None) -> Axes:
        """Draw the history, on matplotlib's present figure or the axes given."""
        from gait.plots import draw_history

        return draw_history(self.history, axes)


class _Run:
    """One evolution, a generation at a time."""

    def __init__(
        self,
        bodies: NDArray[np.float64],
        config: EvolveConfig,
        scorer: Scorer | None,
        world: WorldConfig,
    ) -> None:
        self.world = world
        self.bodies = bodies
        self.morphology = median_body(bodies)
        self.sample = sample_stamp(bodies) if len(bodies) > 1 else None
        self.config = config
        self.history: list[Generation] = []
        self.best: Controller | None = None
        self.fitness = -np.inf
        self._winner: Controller  # the last generation's that had finalists, and what it came to
        self._final = self._distance = -np.inf
        self._scorer = scorer or _scorer(config, world)
        # Streams of their own, found by name, so that a run taken up again needs no generator.
        self._search = self._begin()
        self._asked = next(self._search)
        self._answers: list[tuple[list[float], int]] = []
        swims = 1 + (FINAL_POSES if config.poses else 0)
        rounds = -(-swims // len(bodies))
        poses = self._poses(max(swims, rounds * len(bodies)) - 1, 1)
        self._final_poses = poses[:swims]
        self._finals = Swims(np.resize(bodies, (len(poses), 9)), poses)

    def _begin(self) -> Search:
        """Return the search, whose streams of random numbers are found by name."""
        c, plan = self.config, self.config.plan
        if c.search == "neat":
            recurrent = plan.controller == "recurrent"
            seeds = [stream(c.seed, 0), *(stream(c.seed, 4, k) for k in range(1, plan.starts))]
            inputs = len(plan.senses.names)
            return neat.race(
                [
                    neat.Evolution(
                        plan.population,
                        int(source.generate_state(1)[0]),
                        inputs,
                        recurrent,
                        lively=i % 3 > 0,
                    )
                    for i, source in enumerate(seeds)
                ],
                lambda genome: neat.genome_to_controller(
                    genome, c.clock, self.morphology, c.seed, plan.senses, recurrent, c.interval
                ),
                plan.generations,
                (CMA_POPULATION, np.random.default_rng(stream(c.seed, 5))) if plan.polish else None,
            )
        template = Template.of_class(plan.controller, plan.senses, c.hidden, c.interval)
        rng = np.random.default_rng(stream(c.seed, 6))
        return cma.race(
            template.random(plan.screened, rng),
            lambda x: template.controller(x, c.clock, self.morphology, c.seed),
            plan.population,
            plan.starts,
            rng,
        )

    @property
    def settings(self) -> dict[str, Any]:
        """All that decides what each generation comes to."""
        sample = {} if self.sample is None else {"sample": self.sample}
        world = {} if self.world == WorldConfig() else {"world": asdict(self.world)}
        return {
            "morphology": self.morphology.to_dict(), **sample, **world, **self.config.settings
        }  # fmt: skip

    def step(self) -> Generation:
        """Let one generation swim, and tell the search how it did."""
        c, asked, now = self.config, self._asked, len(self.history)
        poses = self._poses(c.poses, 2, now)[: None if asked.poses is None else 1 + asked.poses]
        swims = draw_swims(self.bodies, poses, stream(c.seed, 3, now))
        fitness = self._fitness(self._score(asked.controllers, swims))
        leaders, first = _finalists(asked, fitness), 0
        if leaders:
            finals = self._score(leaders, self._finals)
            final = self._fitness(finals)
            first = int(final.argmax())
            self._winner = leaders[first]
            self._final, self._distance = float(final[first]), float(finals[first, 0])
            if self._final > self.fitness:
                self.best, self.fitness = replace(self._winner, sample=self.sample), self._final
        winner = self._winner
        row = Generation(
            generation=now,
            best=float(fitness.max()),
            mean=float(fitness.mean()),
            species=asked.species,
            final=self._final,
            distance=self._distance,
            nodes=winner.nodes,
            connections=winner.connections,
        )
        self._answers.append((fitness.tolist(), first))
        self.history.append(row)
        self._asked = self._search.send(Answer(fitness.tolist(), winner, row.final))
        return row

    def result(self) -> Evolved:
        """Return what the run has come to, once there is a generation."""
        assert self.best is not None
        swims = self._score([self.best], every_pair(self.bodies, self._final_poses))
        distances = swims.reshape(len(self.bodies), -1).mean(axis=1)
        return Evolved(self.best, self.fitness, tuple(self.history), distances)

    def _fitness(self, distances: NDArray[np.float64]) -> NDArray[np.float64]:
        if self.config.aggregate == "mean":
            return np.asarray(distances.mean(axis=1))
        return np.asarray(np.quantile(distances, self.config.quantile, axis=1))

    def _score(self, controllers: Sequence[Controller], swims: Swims) -> NDArray[np.float64]:
        return worth(self._scorer(controllers, *swims), self.config.lasts)

    def _poses(self, count: int, *key: int) -> NDArray[np.float64]:
        return np.vstack([ZERO_POSE, random_poses(count, stream(self.config.seed, *key))])

    def write(self, directory: Path) -> None:
        """Write everything that the rest of the run depends on, and then the results."""
        assert self.best is not None
        checkpoint = {
            "settings": self.settings,
            "history": [asdict(row) for row in self.history],
            "best": self.best.to_dict(),
            "fitness": self.fitness,
            # What the search is told again, to come to where it was.
            "answers": self._answers[: len(self.history)],
        }
        write_document(directory / CHECKPOINT_FILE, checkpoint, CHECKPOINT_SCHEMA)
        self.best.save(directory / CONTROLLER_FILE)
        write_history(directory / HISTORY_FILE, self.history)

    def read(self, directory: Path) -> None:
        """Go on from what :meth:`write` wrote for the same settings."""
        path = directory / CHECKPOINT_FILE
        try:
            checkpoint = read_checkpoint(directory)
            if checkpoint["settings"] != self.settings:
                raise InvalidArgumentError("out holds another run's checkpoint")
            self.history = [Generation(**row) for row in checkpoint["history"]]
            self.best = Controller.from_dict(checkpoint["best"])
            self.fitness = checkpoint["fitness"]
            for row, (fitness, first) in zip(self.history, checkpoint["answers"], strict=True):
                leaders = _finalists(self._asked, np.array(fitness))
                if leaders:
                    self._winner = leaders[first]
                    self._final, self._distance = row.final, row.distance
                self._answers.append((fitness, first))
                self._asked = self._search.send(Answer(fitness, self._winner, row.final))
        except DamagedFileError as error:
            raise DamagedFileError(f"{error}; delete it to start again") from None
        except InvalidArgumentError:
            raise
        except (KeyError, TypeError, ValueError, IndexError):
            raise InvalidArgumentError(
                f"out: {path} lacks something that a run needs; choose another directory"
            ) from None
        plan = self.config.plan
        if len(self.history) > plan.rows:
            name = "polish" if plan.polish else "generations"
            most = getattr(plan, name) + len(self.history) - plan.rows
            raise InvalidArgumentError(
                f"{name} must be at least the {most} that out already holds; "
                f"got {getattr(plan, name)}"
            )


def _scorer(config: EvolveConfig, world: WorldConfig) -> Scorer:
    """Return what says how good controllers are at a task."""
    if config.task == "forward":
        return lambda controllers, bodies, poses: swim_all(
            controllers, bodies, poses, config.seconds, threads=config.threads, world=world
        )
    from gait.task import perform  # which needs gymnasium

    # What a task leaves to chance is drawn anew for each generation, as its poses are.
    return lambda controllers, bodies, poses: perform(
        controllers, bodies, poses,
        task=config.task, threads=config.threads, seed=zlib.crc32(poses.tobytes()),
    )  # fmt: skip


def _finalists(asked: Ask, fitness: NDArray[np.float64]) -> Sequence[Controller]:
    """Return those of a generation that swim once more."""
    if asked.finalists is not None:
        return asked.finalists
    return [asked.controllers[i] for i in np.argsort(-fitness, kind="stable")[:FINALISTS]]


def damaged_at_random(body: Morphology, count: int, seed: int) -> list[Morphology]:
    """Return a body with so many random damages, one at a time: domain randomisation.

    The first ones are the same for any ``count``.
    """
    sources = stream(seed, 7).spawn(count)
    return [Damage.random(np.random.default_rng(source)).apply(body) for source in sources]


def evolve_gait(
    morphologies: MorphologiesLike = None,
    config: EvolveConfig | None = None,
    *,
    out: Path | str | None = None,
    scorer: Scorer | None = None,
    world: WorldConfig | None = None,
    on_generation: Callable[[Generation], None] | None = None,
) -> Evolved:
    """Evolve a controller that swims a body forward, or a sample of bodies.

    A sample, of a posterior, makes a gait for what is not known, at the cost of one body: each
    swim has a body and a pose of its own (see ``gait.fitness`` for why). Only the leaders of each
    generation swim on every body, so that some fifty bodies are as good as free, and hundreds are
    not.

    Parameters
    ----------
    morphologies
        The body, as ``Morphology.coerce`` takes it; None is the nominal one. Or a list of such, or
        (M, 9) sizes: a sample, of 1000 at most. Equally likely ones: likelier bodies stand there
        more often.
    config
        How; None is ``EvolveConfig()``.
    out
        A directory for ``controller.json`` (the best so far), ``history.csv`` and
        ``checkpoint.json``, all brought up to date every second, and a sample's ``bodies.json``.
        If it holds an unfinished run of the same bodies and configuration, that run is taken up,
        and ends in the same files as if it had never stopped.
    scorer
        Says how far networks swim on which body from which pose; by default in the lanes.
    world
        The water and the servos that a gait is wanted for, such as a servo that is seized, without
        a lag; None is ``WorldConfig()``.
    on_generation
        Called with every generation, those already in ``out`` included.

    Raises
    ------
    InvalidArgumentError
        If a body is none, a sample has no ``poses`` to swim from, the ``world`` has a lag, or a
        ``scorer`` that would not ask it, or ``out`` cannot be written, is
        in use by another command, or holds another run or a damaged checkpoint.
    """
    config = config or EvolveConfig()
    bodies = body_array(morphologies)
    if not 1 <= len(bodies) <= MAXIMUM_BODIES:
        raise InvalidArgumentError(
            f"morphologies must be 1 to {MAXIMUM_BODIES} bodies; got {len(bodies)}"
        )
    if len(bodies) > 1 and not config.poses:
        raise InvalidArgumentError(
            f"poses must be at least 1 for a sample of {len(bodies)} bodies, since each swim is on "
            "another body; got 0"
        )
    own = world is not None and world != WorldConfig()
    if own and (scorer is not None or config.task != "forward"):
        other = "a scorer is" if scorer is not None else f'the task "{config.task}" is'
        raise InvalidArgumentError(f"world has no say where {other} given: give one of them")
    run = _Run(bodies, config, scorer, lane_world(world))
    tell = on_generation or (lambda _row: None)
    directory = None if out is None else ensure_writable_directory(out)
    with held(directory) if directory else nullcontext():
        if directory:
            claim(directory, "a gait", run.settings, outputs=FILES)
            if run.sample:
                write_bodies(directory / BODIES_FILE, bodies)
            if (directory / CHECKPOINT_FILE).exists():
                run.read(directory)
                run.write(directory)  # a kill may have left the results a generation behind
        for row in run.history:
            tell(row)
        written = -np.inf
        try:
            while len(run.history) < config.plan.rows:
                row = run.step()
                if directory and time.monotonic() > written + EVERY:
                    run.write(directory)
                    written = time.monotonic()
                tell(row)
        finally:
            if directory and run.history:
                run.write(directory)
        return run.result()
