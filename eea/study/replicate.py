"""One replicate of a study: its two files, and how it goes on after whatever stopped it.

A line goes to the log as each round ends, and then the state is replaced at once or not at all.
So the state is never ahead of the log: after a kill at any instant it is of the log's last round
or of the one before, and from there the run repeats itself to the bit.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from aquafish_gym.damage import Damage
from aquafish_gym.morphology import Morphology
from aquafish_gym.runs.storage import DamagedFileError, append_record, read_records
from eea.aquafish.fish import EngineTarget, Orientation, fish_eea
from eea.cli.folder import keep_lines, read_state, write_state
from eea.core.algorithm import EEA, RoundRecord, streams
from eea.core.checks import ConfigurationError
from eea.core.config import EEAConfig


@dataclass(frozen=True)
class World:
    """Where a study's fish swims, and where its models do.

    Attributes
    ----------
    morphology
        The target's body before the damage.
    damage
        What broke.
    target_engine
        Where the target swims.
    target_orientation
        How it lies at the start; see ``EngineTarget``.
    engine, dtype
        Where the models swim.
    current
        Velocity of the water, units/s.
    substeps
        Physics steps in each 0.01 s.
    """

    morphology: Morphology
    damage: Damage
    target_engine: str = "numba"
    target_orientation: Orientation = "upright"
    engine: str = "numba"
    dtype: str = "float32"
    current: tuple[float, float, float] = (0.0, 0.0, 0.0)
    substeps: int = 1

    @property
    def target(self) -> Morphology:
        """The damaged body."""
        return self.damage.apply(self.morphology)


@dataclass(frozen=True)
class Replicate:
    """One seed of one arm at one length of trial; enough to be sent to another process.

    Attributes
    ----------
    arm
        The arm's name.
    config
        Its settings, with the steps and rounds.
    seed
        Of everything random.
    world
        The target and the simulator.
    folder
        The study's.
    """

    arm: str
    config: EEAConfig
    seed: int
    world: World
    folder: Path

    @property
    def cell(self) -> tuple[str, int]:
        """The arm and the steps."""
        return self.arm, self.config.steps

    @property
    def name(self) -> str:
        """For people."""
        return f"{self.arm}, {self.config.steps} steps, seed {self.seed}"

    @property
    def log(self) -> Path:
        """The file with a checksummed line a round."""
        return self.folder / "runs" / self.arm / str(self.config.steps) / f"{self.seed}.jsonl"

    @property
    def state(self) -> Path:
        """The file from which an unfinished replicate goes on."""
        return self.log.with_suffix(".state")

    def begin(self) -> EEA:
        """Return the algorithm before its first round.

        Raises
        ------
        InvalidArgumentError, EngineUnavailableError, ConfigurationError
            If a setting is wrong or an engine is not to be had.
        """
        world = self.world
        target = EngineTarget(
            world.morphology,
            world.damage,
            streams(self.seed)["target"],
            self.config.steps,
            world.target_engine,
            world.current,
            world.substeps,
            world.target_orientation,
        )
        return fish_eea(
            target,
            self.config,
            self.seed,
            target.morphology,
            engine=world.engine,
            dtype=world.dtype,
            current=world.current,
            substeps=world.substeps,
            threads=1,
        )

    def ends_with(self, record: dict[str, Any]) -> bool:
        """Return whether this record is the last that the replicate will ever have."""
        accurate = self.config.accurate
        if accurate is not None and record["model_fitness"] >= accurate:
            return True
        return bool(record["round"] == self.config.rounds)


@dataclass(frozen=True)
class Standing:
    """How far a replicate's files say it is.

    Attributes
    ----------
    records
        The sound records, from the first round on.
    ended
        Whether it is complete.
    complaint
        What is damaged, by file and line; ``None`` if nothing is. A last line that was being
        written when the process was killed is no damage.
    """

    records: list[dict[str, Any]]
    ended: bool
    complaint: str | None = None


@dataclass(frozen=True)
class Progress:
    """What a worker says after each round.

    Attributes
    ----------
    round
        From 1; a replicate that goes on begins with a word about the round it is at.
    objective_fitness
        OBJ_FIT after it; ``None`` at a beginning.
    cpu, wall
        Seconds that the round took.
    """

    round: int
    objective_fitness: float | None = None
    cpu: float = 0.0
    wall: float = 0.0


def log_record(record: RoundRecord) -> dict[str, Any]:
    """Return a record without its clock, as it comes back from a log."""
    document: dict[str, Any] = json.loads(json.dumps(record.to_dict()))
    del document["seconds"]
    return document


def look(replicate: Replicate) -> Standing:
    """Read a replicate's log; change nothing."""
    torn = False
    try:
        records, complaint = read_records(replicate.log), None
    except FileNotFoundError:
        return Standing([], ended=False)
    except OSError as error:  # whoever goes on with it will fail for the same reason
        return Standing([], ended=False, complaint=f"{replicate.log}: {error.strerror}")
    except DamagedFileError as error:
        records = error.records
        lines = replicate.log.read_bytes().split(b"\n")
        torn = error.line == len(lines)  # what follows the last end of a line
        complaint = None if torn else str(error)
    for number, record in enumerate(records, start=1):
        if not isinstance(record, dict) or record.get("round") != number:
            complaint = f"{replicate.log}, line {number}: the record is not of round {number}"
            records = records[: number - 1]
            break
        if replicate.ends_with(record) and (number < len(records) or torn):
            complaint = f"{replicate.log}, line {number + 1}: there is no round {number + 1}"
            records = records[:number]
            break
    ended = complaint is None and bool(records) and replicate.ends_with(records[-1])
    return Standing(records, ended, complaint)


def run_replicate(replicate: Replicate) -> Iterator[Progress]:
    """Run a replicate to its end from wherever its files are, and say so after each round.

    Files that do not agree with each other, or are damaged, are not gone on from: the replicate
    starts again.
    """
    replicate.log.parent.mkdir(parents=True, exist_ok=True)
    # What a kill left of a file that was about to replace one of this replicate's.
    for stale in replicate.log.parent.glob(f".{replicate.log.stem}.*"):
        stale.unlink()
    standing = look(replicate)
    if not standing.ended:
        eea = _resume(replicate, standing)
        yield Progress(len(eea.result.rounds))
        cpu, wall = time.process_time(), time.monotonic()
        for record in eea:
            line = log_record(record)
            append_record(replicate.log, line)
            if not replicate.ends_with(line):
                write_state(replicate.state, eea.save())
            before = cpu, wall
            cpu, wall = time.process_time(), time.monotonic()
            yield Progress(
                record.round, record.objective_fitness, cpu - before[0], wall - before[1]
            )
    replicate.state.unlink(missing_ok=True)


def _resume(replicate: Replicate, standing: Standing) -> EEA:
    """Return the algorithm as the files left it, and the log cut to just its rounds."""
    eea = replicate.begin()
    saved = read_state(replicate.state)
    if saved is not None:
        try:
            eea.restore(saved)
        except ConfigurationError:
            eea = replicate.begin()
    done = [log_record(record) for record in eea.result.rounds]
    if done != standing.records[: len(done)]:
        eea, done = replicate.begin(), []
    if not done:
        replicate.state.unlink(missing_ok=True)
        replicate.log.unlink(missing_ok=True)
    else:
        keep_lines(replicate.log, len(done))
    return eea
