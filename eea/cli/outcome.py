"""The files and the printed report of a finished inference."""

from __future__ import annotations

from pathlib import Path

from aquafish_gym.bodies import write_bodies
from aquafish_gym.morphology import Morphology
from aquafish_gym.runs.storage import write_document
from eea.core.result import SCHEMA, Result
from eea.fish import save_posterior

RESULT, TIMES, MODEL, PICTURE = "result.json", "times.json", "morphology.json", "rounds.png"
POSTERIOR, BODIES, MARGINALS = "posterior.npz", "bodies.json", "posterior.png"
SAMPLED = 50  # bodies from the posterior
MASS = 0.9  # of the intervals that are printed


def write_outcome(folder: Path, result: Result) -> None:
    """Write a result and its body, and for joint inference the posterior and bodies drawn from it.

    Equal runs give equal files except times.json, the seconds after which each round ended.
    """
    document = result.to_dict()
    seconds = [record.pop("seconds") for record in document["rounds"]]
    write_document(folder / RESULT, document, SCHEMA)
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
    lines = [f"the inferred body is in {folder / MODEL}; a gait for it: {evolve}/{MODEL}"]
    if result.belief is not None:
        found = f"{SAMPLED} bodies from the posterior are in {folder / BODIES}"
        lines.append(f"{found}; one gait for all: {evolve}/{BODIES}")
    return lines


def size_table(result: Result) -> list[str]:
    """Return the inferred sizes, with intervals, the true sizes and OBJ_FIT where known."""
    columns = [[f" {size:6.3f}" for size in result.model]]
    heading = f"{'in units of 5 cm':26s}  found"
    if result.belief is not None:
        heading += f"  {MASS:.0%} interval   "
        columns.append(list(map(_ends, *result.interval(MASS))))
    if result.truth is not None:
        heading += "    true"
        columns.append([f"  {size:6.3f}" for size in result.truth])
    rows = zip(result.layout.names, *columns, strict=True)
    lines = [heading.rstrip(), *(f"{name:26s}{''.join(cells)}" for name, *cells in rows)]
    if result.truth is not None:
        lines.append(
            f"OBJ_FIT {result.objective_fitness:.2f}; the true body scores 1, "
            f"a random body {result.chance:.2f}, a mid-range body {result.mid_range:.2f}"
        )
    return lines


def belief_lines(result: Result) -> list[str]:
    """Return the posterior of the nuisances, the findings, and whether the fit is good."""
    if result.belief is None:
        return []
    lines = []
    if result.truth is not None:
        low, high = result.interval(MASS)
        inside = int(((low <= result.truth) & (result.truth <= high)).sum())
        lines.append(f"the {MASS:.0%} intervals contain {inside} of the {len(low)} true sizes")
    rows = result.belief.table(MASS)
    others = [name for name in rows if name not in result.layout.names and "@" not in name]
    if others:
        lines.append(f"{'besides the body':26s} {'found':>6s}  {MASS:.0%} interval")
    lines += [f"{name:26s} {rows[name][0]:z6.3f}{_ends(*rows[name][1:])}" for name in others]
    return [*lines, *dict.fromkeys([*result.belief.findings, result.belief.verdict])]


def _ends(low: float, high: float) -> str:
    return f"  {low:z6.3f} to {high:z5.3f}"
