"""Evolving a gait for a body: NEAT, scored in the lanes, stopped and taken up anywhere."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.morphology import Morphology, MorphologyLike
from aquafish_gym.runs.folder import claim, held
from aquafish_gym.runs.storage import (
    DamagedFileError,
    ensure_writable_directory,
    read_document,
    write_bytes,
    write_document,
)
from aquafish_gym.utils.validation import InvalidArgumentError, finite_array, integer
from gait.controller import MAXIMUM_SEED, Controller
from gait.evolution import Evolution, genome_to_controller
from gait.rollout import (
    MAXIMUM_THREADS,
    SECONDS,
    ZERO_POSE,
    Scorer,
    random_poses,
    step_count,
    stream,
    swim_all,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

CONTROLLER_FILE = "controller.json"
HISTORY_FILE = "history.csv"
CHECKPOINT_FILE = "checkpoint.json"
# 1 drew from streams that were not this package's own, 2 had no schema of the storage's
CHECKPOINT_SCHEMA = "gait.checkpoint/3"
FILES = (CHECKPOINT_FILE, CONTROLLER_FILE, HISTORY_FILE)
MOST_CHECKPOINT_BYTES = 512 * 2**20  # a generation of 10,000 networks

# With random poses, fitness is noisy, and the best of many is the luckiest. So the leaders of
# each generation swim once more, from poses that are the same throughout the run, and that
# tells which is the best of all.
FINALISTS = 8
FINAL_POSES = 32

# A robot that left the finite numbers is worse than any that swam, backwards or not: it scores
# as if it had swum backwards at this speed (units/s), faster than any body does.
DIVERGED_SPEED = -5.0


@dataclass(frozen=True, kw_only=True)
class EvolveConfig:
    """How to evolve a gait.

    Examples
    --------
    >>> EvolveConfig(generations=200, seed=3).population
    150
    """

    seed: int = 0
    """The run follows from it alone."""
    generations: int = 60
    """How many in all, those that the directory already holds included."""
    population: int = 150
    """Controllers in a generation."""
    poses: int = 8
    """Random fin poses to swim from besides the zero pose, others in every generation."""
    clock: float = 0.7
    """Frequency of the controllers' clock, in Hz."""
    seconds: float = SECONDS
    """How long a swim lasts, in s."""
    threads: int | None = None
    """How many threads swim; every core if not given. No result depends on it."""

    def __post_init__(self) -> None:
        integer("seed", self.seed, 0, MAXIMUM_SEED)
        integer("generations", self.generations, 1, 100_000)
        integer("population", self.population, 10, 10_000)
        integer("poses", self.poses, 0, 1000)
        finite_array("clock", self.clock, (), 0.0, 50.0, "Hz")
        step_count(self.seconds)
        if self.threads is not None:
            integer("threads", self.threads, 1, MAXIMUM_THREADS)


@dataclass(frozen=True)
class Generation:
    """One row of ``history.csv``, whose columns ``gait evolve --help`` explains."""

    generation: int
    best: float
    mean: float
    species: int
    final: float
    distance: float
    nodes: int
    connections: int


@dataclass(frozen=True)
class Evolved:
    """What a run has come to.

    Attributes
    ----------
    controller
        The best of all generations' winners.
    fitness
        Its mean distance over the zero pose and the run's fixed poses, in units.
    history
        One row a generation.

    Examples
    --------
    >>> evolve_gait(config=EvolveConfig(generations=2, population=10, seconds=1)).history[1].nodes
    3
    """

    controller: Controller
    fitness: float
    history: tuple[Generation, ...]

    def __repr__(self) -> str:
        return (
            f"Evolved(fitness {self.fitness:.2f} after {len(self.history)} generations, "
            f"{self.controller!r})"
        )

    def plot(self, axes: Axes | None = None) -> Axes:
        """Draw the history, on matplotlib's present figure or the axes given."""
        from gait.plots import draw_history

        return draw_history(self.history, axes)


class _Run:
    """One evolution, a generation at a time."""

    def __init__(self, morphology: Morphology, config: EvolveConfig, scorer: Scorer | None) -> None:
        self.morphology = morphology
        self.config = config
        self.history: list[Generation] = []
        self.best: Controller | None = None
        self.fitness = -np.inf
        self._scorer = scorer or (
            lambda controllers, poses: swim_all(
                controllers, morphology, poses, config.seconds, threads=config.threads
            )
        )
        # Streams of their own, found by name, so that a run taken up again needs no generator.
        self._evolution = Evolution(
            config.population, int(stream(config.seed, 0).generate_state(1)[0])
        )
        self._final_poses = self._poses(FINAL_POSES if config.poses else 0, 1)

    @property
    def settings(self) -> dict[str, Any]:
        """All that decides what each generation comes to."""
        config = asdict(self.config)
        del config["generations"], config["threads"]
        return {"morphology": self.morphology.to_dict(), **config}

    def step(self) -> Generation:
        """Let one generation swim, and breed the next."""
        c = self.config
        controllers = [
            genome_to_controller(genome, c.clock, self.morphology, c.seed)
            for genome in self._evolution.ask()
        ]
        poses = self._poses(c.poses, 2, len(self.history))
        fitness = self._score(controllers, poses).mean(axis=1)
        leaders = [controllers[i] for i in np.argsort(-fitness, kind="stable")[:FINALISTS]]
        finals = self._score(leaders, self._final_poses)
        first = int(finals.mean(axis=1).argmax())
        winner = leaders[first]
        row = Generation(
            generation=len(self.history),
            best=float(fitness.max()),
            mean=float(fitness.mean()),
            species=self._evolution.species,
            final=float(finals[first].mean()),
            distance=float(finals[first, 0]),
            nodes=winner.nodes,
            connections=winner.connections,
        )
        self._evolution.tell(fitness.tolist())
        if row.final > self.fitness:
            self.best, self.fitness = winner, row.final
        self.history.append(row)
        return row

    def _score(
        self, controllers: list[Controller], poses: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        distances = self._scorer(controllers, poses)
        return np.where(np.isfinite(distances), distances, DIVERGED_SPEED * self.config.seconds)

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
            "evolution": self._evolution.state(),
        }
        write_document(directory / CHECKPOINT_FILE, checkpoint, CHECKPOINT_SCHEMA)
        self.best.save(directory / CONTROLLER_FILE)
        write_history(directory / HISTORY_FILE, self.history)

    def read(self, directory: Path) -> None:
        """Go on from what :meth:`write` wrote for the same settings."""
        path = directory / CHECKPOINT_FILE
        try:
            checkpoint = _read_checkpoint(directory)
            if checkpoint["settings"] != self.settings:
                raise InvalidArgumentError("out holds another run's checkpoint")
            self.history = [Generation(**row) for row in checkpoint["history"]]
            self.best = Controller.from_dict(checkpoint["best"])
            self.fitness = checkpoint["fitness"]
            self._evolution = Evolution.from_state(checkpoint["evolution"])
        except DamagedFileError as error:
            raise DamagedFileError(f"{error}; delete it to start again") from None
        except (KeyError, TypeError):
            raise InvalidArgumentError(
                f"out: {path} lacks something that a run needs; choose another directory"
            ) from None
        if len(self.history) > self.config.generations:
            raise InvalidArgumentError(
                f"generations must be at least the {len(self.history)} that out already holds; "
                f"got {self.config.generations}"
            )


def evolve_gait(
    morphology: MorphologyLike = None,
    config: EvolveConfig | None = None,
    *,
    out: Path | str | None = None,
    scorer: Scorer | None = None,
    on_generation: Callable[[Generation], None] | None = None,
) -> Evolved:
    """Evolve a controller that swims a body forward.

    Parameters
    ----------
    morphology
        The body, as ``Morphology.coerce`` takes it; None is the nominal one.
    config
        How; None is ``EvolveConfig()``.
    out
        A directory for ``controller.json`` (the best so far), ``history.csv`` and
        ``checkpoint.json``, all brought up to date with every generation. If it holds an
        unfinished run of the same body and configuration, that run is taken up, and ends in
        the same files as if it had never stopped.
    scorer
        Says how far networks swim; by default that body in the lanes.
    on_generation
        Called with every generation, those already in ``out`` included.

    Raises
    ------
    InvalidArgumentError
        If the body is none, or ``out`` cannot be written, is in use by another command, or holds
        another run or a damaged checkpoint.
    """
    run = _Run(Morphology.coerce(morphology), config or EvolveConfig(), scorer)
    tell = on_generation or (lambda _row: None)
    directory = None if out is None else ensure_writable_directory(out)
    with held(directory) if directory else nullcontext():
        if directory:
            claim(directory, "a gait", run.settings, outputs=FILES)
            if (directory / CHECKPOINT_FILE).exists():
                run.read(directory)
                run.write(directory)  # a kill may have left the results a generation behind
        for row in run.history:
            tell(row)
        while len(run.history) < run.config.generations:
            row = run.step()
            if directory:
                run.write(directory)
            tell(row)
    assert run.best is not None
    return Evolved(run.best, run.fitness, tuple(run.history))


def finished_generations(out: Path) -> tuple[Generation, ...]:
    """Return the generations that a directory's checkpoint holds; none if it cannot be read.

    ``history.csv`` may be one behind, if the run broke off in between.
    """
    try:
        return tuple(Generation(**row) for row in _read_checkpoint(out)["history"])
    except (InvalidArgumentError, KeyError, TypeError):
        return ()


def _read_checkpoint(directory: Path) -> dict[str, Any]:
    path = directory / CHECKPOINT_FILE
    return read_document(path, CHECKPOINT_SCHEMA, "out", MOST_CHECKPOINT_BYTES)


def write_history(path: Path, history: Sequence[Generation]) -> None:
    """Write a ``history.csv``, whole or not at all; every number reads back exactly."""
    lines = [",".join(field.name for field in fields(Generation))]
    lines += [",".join(map(json.dumps, asdict(row).values())) for row in history]
    write_bytes(path, ("\n".join(lines) + "\n").encode())
