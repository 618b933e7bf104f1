"""Studies' folders with made-up results, in the form that the study's command writes."""

from __future__ import annotations

import numpy as np

from aquafish_gym.damage import Damage
from aquafish_gym.morphology import Morphology
from aquafish_gym.plans import AQUAFISH
from aquafish_gym.runs.jobs import RESULT_SCHEMA
from aquafish_gym.utils.storage import encode_document, write_document
from eea.study import study
from eea.study.replicate import ReplicateKey

DAMAGE = "left_pectoral:length=0.5"
TRUTH = Damage.parse(DAMAGE).apply(Morphology.nominal()).to_array()
QUANTA = AQUAFISH.maxima / [2**d.bits - 1 for d in AQUAFISH.dimensions]
# Mean errors at the start and the end, and of the inferred angles, rad.
LEVELS = {
    "ideal": (0.22, 0.012, 0.0),
    "none": (0.30, 0.34, 1.57),
    "in-band": (0.30, 0.20, 0.9),
    "in-band-200": (0.28, 0.15, 0.7),
    "out-of-band": (0.28, 0.09, 0.35),
    "out-of-band-100": (0.26, 0.05, 0.2),
}


def write_study(folder, arms=("ideal", "none"), steps=(128, 256), seeds=5, rounds=4):
    """Write a study.json and finished runs whose arms differ as the paper's do."""
    (folder / "runs").mkdir(parents=True)
    write_document(
        folder / "study.json",
        {
            "target_morphology": Morphology.nominal().to_dict(),
            "target_damage": Damage.parse(DAMAGE).to_list(),
            "target_engine": "numba",
            "rounds": rounds,
            "replicates": {
                arm: {str(duration): {"first": 0, "count": seeds} for duration in steps}
                for arm in arms
            },
            "arms": {arm: _settings(arm) for arm in arms},
            "versions": [{"numpy": "2.4"}],
            "source": ["0123abcd"],
        },
        study.STUDY_SCHEMA,
    )
    for i, arm in enumerate(arms):
        for duration in steps:
            for seed in range(seeds):
                start, end, angle = LEVELS.get(arm, (0.3, 0.05 + 0.01 * (i % 7), 0.5))
                rng = np.random.default_rng([i, duration, seed])
                records = make_records(rng, start, end - 0.004 * np.log2(duration / 256), rounds)
                for record in records:
                    error = rng.normal(0.0, angle + 1e-9, 3)
                    record["angle_error"] = np.minimum(np.abs(error), np.pi).tolist()
                write_records(folder, arm, duration, seed, records)
    return folder


def _settings(arm):
    """Return as much of an arm's settings as a report reads."""
    models = {"in-band-200": 200, "out-of-band-100": 100}.get(arm, 25)
    endings = [name for name in ("ideal", "none", "out-of-band", "in-band") if name in arm]
    return {"condition": next(iter(endings), "ideal"), "estimation": {"population": models}}


def make_records(rng, start, end, rounds):
    """Return the records of one replicate whose mean error goes from start to about end."""
    hard = np.array([1, 0.5, 1.6, 1, 0.5, 1.6, 1.4, 0.4, 0.9])
    luck = rng.lognormal(0.0, 0.35)
    records = []
    for number in range(1, rounds + 1):
        level = end * luck + (start - end * luck) * np.exp(-(number - 1) / 4)
        apart = np.abs(rng.normal(0.0, 1.2 * level * hard)) * AQUAFISH.maxima
        inside = np.where(TRUTH + apart > AQUAFISH.maxima, TRUTH - apart, TRUTH + apart)
        body = np.clip(np.rint(inside / QUANTA) * QUANTA, 0.0, AQUAFISH.maxima)
        error = np.abs(body - TRUTH) / AQUAFISH.maxima
        records.append(
            {
                "round": number,
                "action_fitness": None if number == 1 else float(rng.uniform(0.2, 0.4)),
                "model_fitness": float(1.0 - 2 * level),
                "angle_error": [0.0] * 3,
                "objective_fitness": float(1.0 - error.mean()),
                "dimension_error": error.tolist(),
                "spread": np.abs(level * hard * rng.lognormal(-0.7, 0.3, 9)).tolist(),
                "trials": 45_000 + int(rng.integers(1000)),
            }
        )
    return records


def write_records(folder, arm, steps, seed, records):
    """Write a finished replicate as the runner does, and return its file."""
    key = ReplicateKey(arm, steps, seed)
    path = folder / key.file
    path.parent.mkdir(parents=True, exist_ok=True)
    content = {"job": key.file, **key._asdict(), "stopped": "rounds", "rounds": records}
    path.write_bytes(encode_document(content, RESULT_SCHEMA))
    return path
