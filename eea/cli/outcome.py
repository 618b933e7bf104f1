"""The files and the printed report of a finished inference."""

from __future__ import annotations

from pathlib import Path

from aquafish_gym.bodies import body_document, write_bodies
from aquafish_gym.utils.storage import write_document
from eea.core.result import RUN_SCHEMA, Result
from eea.fish import MorphologyEstimate, save_posterior

RESULT_FILE = "result.json"
TIMES_FILE = "times.json"
MODEL_FILE = "morphology.json"
ROUNDS_PICTURE = "rounds.png"
POSTERIOR_FILE = "posterior.npz"
SAMPLE_FILE = "bodies.json"
MARGINALS_PICTURE = "posterior.png"
SAMPLED_BODIES = 50  # number of bodies drawn from the posterior


def write_outcome(folder: Path, result: MorphologyEstimate) -> None:
    """Write a result and its body, and for joint inference the posterior and bodies drawn from it.

    Equal runs give equal files except times.json, the seconds after which each round ended.
    """
    document = result.to_dict()
    if "rounds" in document:
        seconds = [record.pop("seconds") for record in document["rounds"]]
        write_document(folder / TIMES_FILE, {"seconds": seconds})
    write_document(folder / RESULT_FILE, document, RUN_SCHEMA)
    if result.complete:
        write_document(folder / MODEL_FILE, body_document(result.morphology))
    if result.belief is not None:
        save_posterior(folder / POSTERIOR_FILE, result.belief)
        write_bodies(folder / SAMPLE_FILE, result.sample(SAMPLED_BODIES, result.seed), result.plan)


def remove_outcome(folder: Path) -> None:
    """Remove the files of an earlier run."""
    for name in (
        RESULT_FILE,
        TIMES_FILE,
        MODEL_FILE,
        ROUNDS_PICTURE,
        POSTERIOR_FILE,
        SAMPLE_FILE,
        MARGINALS_PICTURE,
    ):
        (folder / name).unlink(missing_ok=True)


def draw_outcome(folder: Path, result: Result) -> None:
    """Draw the fitness of a run's rounds, and for joint inference the posterior."""
    from aquafish_gym.rendering.pictures import save_figure
    from eea.fish.plots import fitness_figure, posterior_figure

    if result.rounds:
        save_figure(fitness_figure(result), folder / ROUNDS_PICTURE)
    if result.belief is not None:
        save_figure(posterior_figure(result), folder / MARGINALS_PICTURE)


def file_lines(folder: Path, result: Result) -> list[str]:
    """Return lines with the body's files and the command that uses them."""
    evolve = f"aquafish evolve --morphology {folder}"
    if result.belief is not None and not result.belief.good:
        return [f"the best fit, which does not explain the trials, is in {folder / MODEL_FILE}"]
    lines = [f"the inferred body is in {folder / MODEL_FILE}; a gait for it: {evolve}/{MODEL_FILE}"]
    if result.belief is not None:
        found = f"{SAMPLED_BODIES} bodies from the posterior are in {folder / SAMPLE_FILE}"
        lines.append(f"{found}; one gait for all: {evolve}/{SAMPLE_FILE}")
    return lines
