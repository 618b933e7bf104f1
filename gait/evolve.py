"""Evolving a gait for a body: NEAT, scored in the lanes, stopped and taken up anywhere."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.morphology import Morphology, MorphologyLike
from aquafish_gym.runs.storage import ensure_writable_directory, write_bytes, write_json
from aquafish_gym.utils.validation import InvalidArgumentError, finite_array, integer
from gait.controller import Controller, read_json
from gait.evolution import Evolution, genome_to_controller
from gait.history import HISTORY_FILE, Generation, write_history
from gait.rollout import SECONDS, ZERO_POSE, Scorer, random_poses, step_count, stream, swim_all

CONTROLLER_FILE = "controller.json"
CHECKPOINT_FILE = "checkpoint.json"
CHECKPOINT_SCHEMA = 2  # 1 drew from streams that were not this package's own

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
    """How to evolve a gait."""

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
        integer("seed", self.seed, 0)
        integer("generations", self.generations, 1)
        integer("population", self.population, 10, 10_000)
        integer("poses", self.poses, 0, 1000)
        finite_array("clock", self.clock, (), 0.0, 50.0, "Hz")
        step_count(self.seconds)
        if self.threads is not None:
            integer("threads", self.threads, 1)


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
    """

    controller: Controller
    fitness: float
    history: tuple[Generation, ...]


class GaitRun:
    """One evolution, a generation at a time.

    Parameters
    ----------
    morphology
        The body to find a gait for.
    config
        How.
    scorer
        Says how far networks swim; by default that body in the lanes.
    """

    def __init__(
        self, morphology: Morphology, config: EvolveConfig, scorer: Scorer | None = None
    ) -> None:
        self.morphology = morphology
        self.config = config
        self.history: list[Generation] = []
        self._scorer: Scorer = scorer or partial(
            _swim_body, morphology=morphology, seconds=config.seconds, threads=config.threads
        )
        neat_seed = int(self._stream(0).generate_state(1)[0])
        self._evolution = Evolution(config.population, neat_seed)
        self._final_poses = self._poses(FINAL_POSES if config.poses else 0, self._stream(1))
        self._best: Controller | None = None
        self._fitness = -np.inf

    @property
    def finished(self) -> bool:
        """Whether all generations of the configuration have swum."""
        return len(self.history) >= self.config.generations

    @property
    def result(self) -> Evolved:
        """The best so far. There is none before the first :meth:`step`."""
        assert self._best is not None
        return Evolved(self._best, self._fitness, tuple(self.history))

    def step(self) -> Generation:
        """Let one generation swim, and breed the next."""
        c = self.config
        controllers = [
            genome_to_controller(genome, c.clock, self.morphology, c.seed)
            for genome in self._evolution.ask()
        ]
        poses = self._poses(c.poses, self._stream(2, len(self.history)))
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
        if row.final > self._fitness:
            self._best, self._fitness = winner, row.final
        self.history.append(row)
        return row

    def _score(
        self, controllers: list[Controller], poses: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        distances = self._scorer(controllers, poses)
        return np.where(np.isfinite(distances), distances, DIVERGED_SPEED * self.config.seconds)

    def _stream(self, *key: int) -> np.random.SeedSequence:
        # Streams of their own, found by name, so that a run taken up again needs no generator.
        return stream(self.config.seed, *key)

    @staticmethod
    def _poses(count: int, source: np.random.SeedSequence) -> NDArray[np.float64]:
        return np.vstack([ZERO_POSE, random_poses(count, source)])

    def checkpoint(self) -> dict[str, Any]:
        """Return everything that the rest of the run depends on, ready for JSON."""
        return {
            "config": asdict(self.config),
            "morphology": self.morphology.to_dict(),
            "history": [asdict(row) for row in self.history],
            "best": None if self._best is None else self._best.to_dict(),
            "fitness": None if self._best is None else self._fitness,
            "evolution": self._evolution.state(),
        }

    def restore(self, checkpoint: dict[str, Any]) -> None:
        """Go on from what :meth:`checkpoint` returned for the same body and configuration.

        Raises
        ------
        InvalidArgumentError
            If it is another run's: only ``threads`` may differ, and ``generations`` may grow.
        """
        theirs, ours = dict(checkpoint["config"]), asdict(self.config)
        for name in (f.name for f in fields(EvolveConfig)):
            if name not in ("threads", "generations") and theirs[name] != ours[name]:
                raise InvalidArgumentError(
                    f"out holds a run with {name} {theirs[name]}, not {ours[name]}; "
                    "choose another directory"
                )
        if checkpoint["morphology"] != self.morphology.to_dict():
            raise InvalidArgumentError(
                "out holds a run for another morphology; choose another directory"
            )
        if len(checkpoint["history"]) > self.config.generations:
            raise InvalidArgumentError(
                f"generations must be at least the {len(checkpoint['history'])} that out already "
                f"holds; got {self.config.generations}"
            )
        self.history = [Generation(**row) for row in checkpoint["history"]]
        if self.history:
            self._best = Controller.from_dict(checkpoint["best"])
            self._fitness = checkpoint["fitness"]
        self._evolution = Evolution.from_state(checkpoint["evolution"])


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
        If the body is none, or ``out`` cannot be written, holds another run, or its checkpoint
        is damaged.

    Examples
    --------
    >>> gait = evolve_gait(config=EvolveConfig(generations=1, population=10, seconds=1))
    >>> gait.controller.to_dict()["outputs"]
    ['left_pectoral', 'right_pectoral', 'caudal']
    """
    run = GaitRun(Morphology.coerce(morphology), config or EvolveConfig(), scorer)
    directory = None if out is None else ensure_writable_directory(out)
    if directory is not None and (directory / CHECKPOINT_FILE).exists():
        _read_checkpoint(run, directory / CHECKPOINT_FILE)
        _write_results(run, directory)
    for row in run.history:
        if on_generation is not None:
            on_generation(row)
    while not run.finished:
        row = run.step()
        if directory is not None:
            _write_checkpoint(run, directory / CHECKPOINT_FILE)
            _write_results(run, directory)
        if on_generation is not None:
            on_generation(row)
    return run.result


def finished_generations(out: Path | str) -> tuple[Generation, ...]:
    """Return the generations that a directory's checkpoint holds; none if it cannot be read.

    ``history.csv`` may be one behind, if the run broke off in between.
    """
    try:
        data = json.loads((Path(out) / CHECKPOINT_FILE).read_bytes())
        return tuple(Generation(**row) for row in data["run"]["history"])
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return ()


def _swim_body(
    controllers: Sequence[Controller],
    fin_angles: NDArray[np.float64],
    *,
    morphology: Morphology,
    seconds: float,
    threads: int | None,
) -> NDArray[np.float64]:
    return swim_all(controllers, morphology, fin_angles, seconds, threads=threads)


def _write_results(run: GaitRun, directory: Path) -> None:
    if not run.history:
        return
    write_json(directory / CONTROLLER_FILE, run.result.controller.to_dict())
    write_history(directory / HISTORY_FILE, run.history)


def _write_checkpoint(run: GaitRun, path: Path) -> None:
    text = json.dumps(run.checkpoint(), allow_nan=False)
    head = f'{{"schema": {CHECKPOINT_SCHEMA}, "checksum": "{_checksum(text)}", "run": '
    write_bytes(path, f"{head}{text}}}\n".encode())


def _read_checkpoint(run: GaitRun, path: Path) -> None:
    data = read_json(path, "out")
    if not isinstance(data, dict) or data.get("schema") != CHECKPOINT_SCHEMA:
        raise InvalidArgumentError(
            f"out: {path} is not a checkpoint of schema {CHECKPOINT_SCHEMA}; "
            "choose another directory"
        )
    if data.get("checksum") != _checksum(json.dumps(data.get("run"))):
        raise InvalidArgumentError(f"out: {path} is damaged; delete it to start again")
    try:
        run.restore(data["run"])
    except InvalidArgumentError:
        raise
    except (KeyError, IndexError, TypeError, ValueError, AttributeError):
        raise InvalidArgumentError(
            f"out: {path} lacks something that a run needs; choose another directory"
        ) from None


def _checksum(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
