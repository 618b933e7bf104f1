"""The files and the printed report of a finished inference."""

from __future__ import annotations

from pathlib import Path

from aquafish_gym.bodies import write_bodies
from aquafish_gym.morphology import Morphology
from aquafish_gym.utils.storage import write_document
from eea.core.result import RUN_SCHEMA, Result
from eea.fish import save_posterior

RESULT, TIMES, MODEL, PICTURE = "result.json", "times.json", "morphology.json", "rounds.png"
POSTERIOR, BODIES, MARGINALS = "posterior.npz", "bodies.json", "posterior.png"
SAMPLED = 50  # bodies from the posterior


def write_outcome(folder: Path, result: Result) -> None:
    """Write a result and its body, and for joint inference the posterior and bodies drawn from it.

    Equal runs give equal files except times.json, the seconds after which each round ended.
    """
    document = result.to_dict()
    seconds = [record.pop("seconds") for record in document["rounds"]]
    write_document(folder / RESULT, document, RUN_SCHEMA)
    write_document(folder / TIMES, {"seconds": seconds})
    if result.rounds:
        write_document(folder / MODEL, Morphology.from_array(result.body).to_dict())
    if result.rounds and result.belief is not None:
        save_posterior(folder / POSTERIOR, result.belief)
        write_bodies(folder / BODIES, result.sample(SAMPLED, result.seed))


def remove_outcome(folder: Path) -> None:
    """Remove the files of an earlier run."""
    for name in (RESULT, TIMES, MODEL, PICTURE, POSTERIOR, BODIES, MARGINALS):
        (folder / name).unlink(missing_ok=True)


def draw_outcome(folder: Path, result: Result, rounds: bool = True) -> None:
    """Draw the fitness of each round, and for joint inference the posterior."""
    from aquafish_gym.rendering.pictures import save_figure
    from eea.fish.plots import fitness_figure, posterior_figure

    if rounds:
        save_figure(fitness_figure(result), folder / PICTURE)
    if result.belief is not None:
        save_figure(posterior_figure(result), folder / MARGINALS)


def file_lines(folder: Path, result: Result) -> list[str]:
    """Return lines that name the body's files, with the command that uses them."""
    evolve = f"aquafish evolve --morphology {folder}"
    if result.belief is not None and not result.belief.good:
        return [f"the best fit, which does not explain the trials, is in {folder / MODEL}"]
    lines = [f"the inferred body is in {folder / MODEL}; a gait for it: {evolve}/{MODEL}"]
    if result.belief is not None:
        found = f"{SAMPLED} bodies from the posterior are in {folder / BODIES}"
        lines.append(f"{found}; one gait for all: {evolve}/{BODIES}")
    return lines
