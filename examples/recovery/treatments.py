"""One treatment of one replicate: get a model, evolve a gait on it, score it on the target."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aquafish_gym import Damage, Morphology
from aquafish_gym.runs.storage import (
    append_record,
    ensure_writable_directory,
    write_bytes,
    write_json,
)
from eea import EEAConfig, EngineTarget
from eea.aquafish.fish import fish_eea, fish_models
from eea.cli.folder import resume_log, write_state
from eea.core.algorithm import streams
from eea.core.config import Condition
from eea.core.fitness import objective_fitness
from gait.evolve import EvolveConfig, evolve_gait
from gait.rollout import Swim
from gait.transfer import TransferConfig, transfer

# What each treatment takes for the robot's body. The oracle knows the damage, which no robot
# does: it is the best that self-modelling can give.
TREATMENTS = ("undamaged", "none", "out-of-band", "oracle")
MODELLED: dict[str, Condition] = {"none": "none", "out-of-band": "out-of-band"}

MODEL_FILE = "model.json"
OUTCOME_FILE = "outcome.json"
ROUNDS_FILE = "rounds.jsonl"
STATE_FILE = "rounds.state"
SWIMS_FILE = "swims.npz"
PATHS = ("time", "position", "quaternion", "fin_angles")

Say = Callable[[str, float], None]  # what happens now, and the share of the work that is done


@dataclass(frozen=True)
class Job:
    """One treatment of one replicate, complete enough to be sent to another process."""

    treatment: str
    seed: int
    morphology: Morphology
    damage: Damage
    eea: EEAConfig
    gait: EvolveConfig
    transfer: TransferConfig
    directory: Path

    @property
    def name(self) -> str:
        return f"seed {self.seed}, {self.treatment}"

    @property
    def target(self) -> Morphology:
        """The damaged body."""
        return self.damage.apply(self.morphology)

    @property
    def finished(self) -> bool:
        """Whether an earlier run of the command left this job's outcome."""
        return (self.directory / OUTCOME_FILE).exists()


def run_job(job: Job, say: Say) -> dict[str, Any]:
    """Do one job, write its files and return its outcome, ready for JSON.

    ``outcome.json`` is written last, so a job that has it is complete. Rounds of the self-model
    and generations of the gait are on disk as they come. An interrupted job goes on where it
    stopped, to the same end.

    A robot that diverges has made no progress: its distance counts as 0, and ``diverged`` tells
    how many of the swims on the target did.
    """
    ensure_writable_directory(job.directory)
    model, model_fitness = _model(job, say)
    total = job.gait.generations
    evolved = evolve_gait(
        model,
        job.gait,
        out=job.directory,
        on_generation=lambda g: say(
            f"gait: generation {g.generation + 1}/{total}, {g.best:.1f} units",
            0.4 + 0.5 * (g.generation + 1) / total,
        ),
    )
    say("swimming on the target", 0.9)
    scored = transfer(evolved.controller, job.target, job.transfer)
    _write_swims(job.directory / SWIMS_FILE, scored.native.swim, scored.target.swim)
    numbers = scored.to_dict()
    outcome = {
        "treatment": job.treatment,
        "seed": job.seed,
        "morphology": model.to_dict(),
        "model_fitness": model_fitness,
        "objective_fitness": float(
            objective_fitness(model.to_array(), job.target.to_array(), fish_models())
        ),
        "native_distance": numbers["native"]["distance"] or 0.0,
        "target_distance": numbers["target"]["distance"] or 0.0,
        "native_random_distances": [d or 0.0 for d in numbers["native"]["random_distances"]],
        "target_random_distances": [d or 0.0 for d in numbers["target"]["random_distances"]],
        "diverged": [
            numbers["target"]["distance"],
            *numbers["target"]["random_distances"],
        ].count(None),
    }
    write_json(job.directory / OUTCOME_FILE, outcome)
    return outcome


def read_outcome(directory: Path) -> dict[str, Any]:
    """Return what :func:`run_job` left in a directory."""
    outcome: dict[str, Any] = json.loads((directory / OUTCOME_FILE).read_text(encoding="utf-8"))
    return outcome


def read_swims(directory: Path) -> dict[str, Swim]:
    """Return the swims from the zero pose on the ``native`` body and on the ``target``.

    A robot that diverged stays where it was last seen.
    """
    with np.load(directory / SWIMS_FILE, allow_pickle=False) as arrays:
        return {
            body: Swim(*(_held(arrays[f"{body}_{name}"]) for name in PATHS))
            for body in ("native", "target")
        }


def _held(samples: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return samples (T, ...) with those that are not finite replaced by the last that was."""
    good = np.isfinite(samples.reshape(len(samples), -1)).all(axis=1)
    return samples[np.maximum.accumulate(np.where(good, np.arange(len(samples)), 0))].astype(
        np.float64
    )


def _model(job: Job, say: Say) -> tuple[Morphology, float | None]:
    """Return the body that this treatment believes in, and its MOD_FIT if it was inferred."""
    if job.treatment not in MODELLED:
        return (job.morphology if job.treatment == "undamaged" else job.target), None
    kept, rounds = job.directory / MODEL_FILE, job.directory / ROUNDS_FILE
    state = job.directory / STATE_FILE
    if kept.exists():
        state.unlink(missing_ok=True)  # after a kill between the two
        found = json.loads(kept.read_text(encoding="utf-8"))
        return Morphology.coerce(found["morphology"]), found["model_fitness"]
    config = replace(job.eea, condition=MODELLED[job.treatment])
    chance = streams(job.seed)["target"]
    target = EngineTarget(
        job.morphology, job.damage, chance, config.steps, job.transfer.target_engine
    )
    eea = fish_eea(target, config, job.seed, target.morphology, threads=job.gait.threads)
    if not resume_log(eea, rounds, state):
        rounds.unlink(missing_ok=True)
    done = len(eea.result.rounds)
    say(f"self-model: {done} rounds done", 0.4 * done / job.eea.rounds)
    for record in eea:
        append_record(rounds, record.to_dict())
        write_state(state, eea.save())
        say(
            f"self-model: round {record.round}/{job.eea.rounds}, "
            f"MOD_FIT {record.model_fitness:.3f}, OBJ_FIT {record.objective_fitness:.3f}",
            0.4 * record.round / job.eea.rounds,
        )
    model, fitness = Morphology.from_array(eea.result.model), eea.result.rounds[-1].model_fitness
    write_json(kept, {"morphology": model.to_dict(), "model_fitness": fitness})
    state.unlink()
    return model, fitness


def _write_swims(path: Path, native: Swim, target: Swim) -> None:
    content = io.BytesIO()
    arrays = {
        f"{body}_{name}": getattr(swim, name).astype(np.float32)
        for body, swim in (("native", native), ("target", target))
        for name in PATHS
    }
    np.savez_compressed(content, allow_pickle=False, **arrays)
    write_bytes(path, content.getvalue())
