"""A study: many replicates of several arms in one folder, which one command at a time fills."""

from __future__ import annotations

import json
import re
import signal
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from platform import python_version_tuple
from typing import Any

import aquafish_gym
import eea
from aquafish_gym.runs.locks import only_here as hold
from aquafish_gym.runs.stamps import code_stamp
from aquafish_gym.runs.storage import (
    DamagedFileError,
    append_record,
    read_records,
    write_bytes,
    write_json,
)
from aquafish_gym.runs.workers import Event, do_jobs, wait_for_orphans
from aquafish_gym.utils.validation import InvalidArgumentError
from eea.cli.folder import flat, spell
from eea.core.checks import ConfigurationError, whole
from eea.core.config import EEAConfig
from eea.study.plan import Plan, joined, read_plan, written_plan
from eea.study.replicate import Progress, Replicate, Standing, World, run_replicate

SCHEMA = "eea.study/1"
STUDY, GUARD, RUNS, TIMES = "study.json", ".workers", "runs", "times.jsonl"
# An arm's name is a folder's name, a cell of a table, and part of options and pictures' names.
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")
_LONGEST = 120
# Of an arm's settings these are the study's, or depend on the clock.
_NOT_AN_ARMS = ("steps", "rounds", "time_limit")
_OTHERS = {
    "run.json": "a run of the EEA",
    "checkpoint.json": "a gait run",
    "controller.json": "a gait run",
    "config.json": "a case study",
}
# What decides no result: the settings, which are written down themselves, and all around a run.
_SOURCES = ("command", "damage", "imu", "morphology", "engines/**/*", "physics/*")
_NOT_SOURCES = (
    "__init__",
    "__main__",
    "ablations",
    "analysis",
    "checks",
    "config",
    "figures",
    "folder",
    "plots",
    "progress",
    "state",
    "statistics",
    "study",
    "study_command",
    "study_plan",
    "summary",
    "workers",
)


@dataclass(frozen=True)
class Study:
    """Which replicates are to be made, and everything that decides their results.

    Attributes
    ----------
    arms
        Name to settings, of which steps, rounds and time limit have no say.
    steps
        Lengths of trials; each arm has each.
    rounds
        Of every replicate.
    first_seed, replicates
        The seeds are as many from the first on, the same in each arm, so that arms are paired.
    world
        The target and the simulator.

    Raises
    ------
    ConfigurationError
        If there is nothing to do, or an argument is wrong.
    """

    arms: Mapping[str, EEAConfig]
    steps: tuple[int, ...]
    rounds: int
    first_seed: int
    replicates: int
    world: World

    def __post_init__(self) -> None:
        whole("first_seed", self.first_seed, 0)
        whole("replicates", self.replicates, 1)
        whole("the number of arms", len(self.arms), 1)
        whole("the number of steps", len(self.steps), 1)
        if len(set(self.steps)) < len(self.steps):
            raise ConfigurationError(f"steps must differ from each other; got {self.steps}")
        for name, config in self.arms.items():
            if not _NAME.fullmatch(name) or len(name) > _LONGEST:
                raise ConfigurationError(
                    f"an arm's name must be letters, digits, '.', '_' and '-', begin with a letter "
                    f"or digit and have at most {_LONGEST} characters; got {name!r}"
                )
            if config.time_limit is not None:
                raise ConfigurationError(
                    f"time_limit must be None in a study, whose results depend on no clock; "
                    f"the arm {name} has {config.time_limit}"
                )
            for steps in self.steps:
                replace(config, steps=steps, rounds=self.rounds)

    def jobs(self, folder: Path) -> list[Replicate]:
        """Return every replicate, by arm, steps and seed."""
        return [
            Replicate(
                name, replace(config, steps=steps, rounds=self.rounds), seed, self.world, folder
            )
            for name, config in self.arms.items()
            for steps in self.steps
            for seed in range(self.first_seed, self.first_seed + self.replicates)
        ]

    @property
    def plan(self) -> Plan:
        """The seeds of each arm and length of trial."""
        seeds = range(self.first_seed, self.first_seed + self.replicates)
        return {name: dict.fromkeys(sorted(self.steps), seeds) for name in self.arms}

    def to_dict(self) -> dict[str, Any]:
        """Return all that decides the results, ready for JSON."""
        arms = {name: config.to_dict() for name, config in self.arms.items()}
        return {
            "schema": SCHEMA,
            "target_morphology": self.world.morphology.to_dict(),
            "target_damage": self.world.damage.to_list(),
            "target_engine": self.world.target_engine,
            "target_orientation": self.world.target_orientation,
            "engine": self.world.engine,
            "dtype": self.world.dtype,
            "current": list(self.world.current),
            "substeps": self.world.substeps,
            "rounds": self.rounds,
            "replicates": written_plan(self.plan),
            "arms": {
                name: {k: v for k, v in arm.items() if k not in _NOT_AN_ARMS}
                for name, arm in arms.items()
            },
            "versions": [versions()],
            "source": [source_stamp()],
        }


def versions() -> dict[str, str]:
    """Return the versions of what computes the results."""
    return {
        **{name: version(name) for name in ("aquafish-gym", "numba", "numpy")},
        "python": ".".join(python_version_tuple()[:2]),
    }


def source_stamp() -> str:
    """Return a hash of the code that decides the results; comments and docstrings have no say."""
    robot, algorithm = (Path(str(package.__file__)).parent for package in (aquafish_gym, eea))
    sources = [file for name in _SOURCES for file in robot.glob(f"{name}.py")]
    sources += [file for file in algorithm.rglob("*.py") if file.stem not in _NOT_SOURCES]
    return code_stamp(sources)


@contextmanager
def only_here(folder: Path) -> Iterator[None]:
    """Hold a folder for this command, and wait for the workers of one that was killed.

    Raises
    ------
    InvalidArgumentError
        If another command holds it; the message says which and since when.
    """
    with hold(folder):
        try:
            if not wait_for_orphans(folder / GUARD):
                raise InvalidArgumentError(
                    f"out: {folder} is in use by workers of a command that was killed"
                )
            yield
        finally:
            (folder / GUARD).unlink(missing_ok=True)


def refuse_others(folder: Path) -> None:
    """Refuse a folder that holds something else.

    Raises
    ------
    InvalidArgumentError
        The message says what.
    """
    rule = "out must be a new directory or hold a study"
    for name, kind in _OTHERS.items():
        if (folder / name).exists():
            raise InvalidArgumentError(f"{rule}; {folder} holds {kind} ({name})")
    if (folder / RUNS).exists() and not (folder / STUDY).exists():
        raise InvalidArgumentError(
            f"{rule}; {folder} holds {RUNS} but no {STUDY}, so what they are is not known"
        )


def extended(folder: Path, study: Study, other_code: bool = False) -> dict[str, Any]:
    """Return what study.json is to say, of this study and of the one that is in its folder.

    Parameters
    ----------
    folder
        Held by ``only_here``. Nothing is changed in it.
    study
        What is asked for.
    other_code
        Whether results of other code, or of other versions of numpy and the like, are gone on
        from.

    Raises
    ------
    InvalidArgumentError
        If the folder holds a study of other settings; the message names the first difference.
    """
    path = folder / STUDY
    ours: dict[str, Any] = json.loads(json.dumps(study.to_dict()))
    if not path.exists():
        return ours
    try:
        held = json.loads(path.read_bytes())
        if held["schema"] != SCHEMA:
            raise ValueError(held["schema"])
        theirs = read_plan(held)
        if isinstance(held["versions"], dict):  # as the first studies had them
            held["versions"] = [held["versions"]]
        if not held["versions"] or not held["source"]:
            raise ValueError("nothing is said of the code")
        before, asked = _comparable(held, ours), _comparable(ours, held)
    except (ValueError, KeyError, IndexError, TypeError, AttributeError):
        raise InvalidArgumentError(
            f"out: {path} is damaged, so what the folder holds is not known; restore it or choose "
            "another folder"
        ) from None
    for name in before | asked:
        if before.get(name) != asked.get(name):
            raise InvalidArgumentError(
                f"out: {folder} holds a study with {name} {spell(name, before.get(name))}, not "
                f"{spell(name, asked.get(name))}; choose another folder"
            )
    try:
        plan = joined(theirs, study.plan)
    except ValueError as gap:
        raise InvalidArgumentError(f"out: {folder} holds {gap}") from None
    if not other_code:
        _refuse_other_code(folder, held, ours)
    return {
        **{name: value for name, value in held.items() if name not in ("steps", "seeds")},
        "replicates": written_plan(plan),
        "arms": {**held["arms"], **ours["arms"]},
        "versions": _both(held["versions"], ours["versions"]),
        "source": _both(held["source"], ours["source"]),
    }


def _comparable(document: dict[str, Any], other: dict[str, Any]) -> dict[str, Any]:
    """Return what must be equal in both, under dotted names: the arms that both have."""
    apart = ("schema", "replicates", "steps", "seeds", "versions", "source", "arms")
    settings = {name: value for name, value in document.items() if name not in apart}
    shared = {name: arm for name, arm in document["arms"].items() if name in other["arms"]}
    return flat({"arms": shared, **settings})


def _refuse_other_code(folder: Path, held: dict[str, Any], ours: dict[str, Any]) -> None:
    """Refuse results of other code, or of other versions of what computes them."""
    now, last = ours["versions"][0], held["versions"][-1]
    difference = None
    if now not in held["versions"]:
        name = next(name for name in {**last, **now} if last.get(name) != now.get(name))
        difference = f"{name} {last.get(name)}, not {now.get(name)}"
    elif ours["source"][0] not in held["source"]:
        difference = f"other code (source {held['source'][-1]}, not {ours['source'][0]})"
    if difference is not None:
        raise InvalidArgumentError(
            f"out: {folder} holds results of {difference}; choose another folder, or say "
            "--other-code if no result can have changed"
        )


def _both(held: list[Any], ours: list[Any]) -> list[Any]:
    return [*held, *(one for one in ours if one not in held)]


def claim(folder: Path, document: dict[str, Any]) -> None:
    """Write study.json, if it does not say so already, and mend what a kill left of the times."""
    path = folder / STUDY
    if not path.exists() or json.loads(path.read_bytes()) != document:
        write_json(path, document)
    times = folder / TIMES
    if times.exists():
        try:
            read_records(times)
        except DamagedFileError as error:  # the clock decides nothing: what is whole is kept
            whole_lines = times.read_bytes().split(b"\n")[: error.line - 1]
            write_bytes(times, b"".join(line + b"\n" for line in whole_lines))


def cost(job: Replicate, number: int) -> float:
    """Return about how much work one of a replicate's rounds is, in no unit."""
    config, models = job.config, job.config.estimation.population
    exploration, estimation = config.exploration, config.estimation
    trials = 0.0
    if number > 1:
        judges = min(models, exploration.best_models or models)
        trials += exploration.population * exploration.generations * judges
    # Angles that stand still are simulated once for each new body, others again and again.
    searched = 1.0 + 0.2 * (number - 1)
    if config.condition == "in-band":
        searched = float(number)
    trials += models * estimation.generations * searched
    if config.condition == "out-of-band":
        inner = config.out_of_band
        pauses = -(-estimation.generations // inner.period) * (1 + inner.revisit)
        judges = min(models, inner.sampled_models or models)
        trials += pauses * inner.inner_population * inner.inner_generations * judges
    return trials * config.steps


def cost_left(job: Replicate, done: int) -> float:
    """Return about how much work is left of a replicate after ``done`` rounds."""
    return sum(cost(job, number) for number in range(done + 1, job.config.rounds + 1))


def fill(
    standings: Mapping[Replicate, Standing],
    folder: Path,
    workers: int,
    on_event: Callable[[Event[Replicate]], None],
) -> list[str]:
    """Make all replicates that are not complete, the longest first.

    Parameters
    ----------
    standings
        Each replicate's, from ``look``; the files are looked at again by whoever goes on with them.
    folder
        The study's, held by ``only_here``.
    workers
        Processes at most. No result depends on it.
    on_event
        Told what happens.

    Returns
    -------
    list of str
        A sentence for each replicate that could not be completed.

    Raises
    ------
    KeyboardInterrupt
        On Ctrl-C or SIGTERM, after the workers have been stopped.
    """
    left = [job for job, standing in standings.items() if not standing.ended or job.state.exists()]
    left.sort(key=lambda job: -cost_left(job, len(standings[job].records)))
    failures = []
    before = signal.signal(signal.SIGTERM, _interrupt)
    events = do_jobs(left, run_replicate, workers, folder / GUARD)
    try:
        for event in events:
            if event.kind == "failed":
                failures.append(f"{event.job.name}: {event.content}")
            if isinstance(event.content, Progress) and event.content.wall > 0.0:
                _note_time(folder / TIMES, event.job, event.content)
            on_event(event)
    finally:
        events.close()
        signal.signal(signal.SIGTERM, before)
    return failures


def _note_time(path: Path, job: Replicate, progress: Progress) -> None:
    record = {
        "arm": job.arm,
        "steps": job.config.steps,
        "seed": job.seed,
        "round": progress.round,
        "cpu": round(progress.cpu, 4),
        "wall": round(progress.wall, 4),
    }
    append_record(path, record)


def _interrupt(_signal: int, _frame: object) -> None:
    raise KeyboardInterrupt
