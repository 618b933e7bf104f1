"""What a finished inference leaves: its files in a folder, and what is said of it."""

from __future__ import annotations

from pathlib import Path

from aquafish_gym.bodies import write_bodies
from aquafish_gym.morphology import Morphology
from aquafish_gym.runs.storage import write_document
from eea.core.result import SCHEMA, Result
from eea.fish import save_posterior

RESULT, MODEL, PICTURE = "result.json", "morphology.json", "rounds.png"
POSTERIOR, BODIES, MARGINALS = "posterior.npz", "bodies.json", "posterior.png"
SAMPLED = 50  # bodies: as many as a gait's evolution takes for the price of one
MASS = 0.9  # of the intervals that are printed


def write_outcome(folder: Path, result: Result) -> None:
    """Put a result, and the body that it comes to, in the place of what was there."""
    write_document(folder / RESULT, result.to_dict(), SCHEMA)
    if result.rounds:
        write_document(folder / MODEL, Morphology.from_array(result.model).to_dict())
        if result.belief is not None:
            save_posterior(folder / POSTERIOR, result.belief)
            write_bodies(folder / BODIES, result.sample(SAMPLED, result.seed))
    else:
        for name in (MODEL, PICTURE, POSTERIOR, BODIES, MARGINALS):
            (folder / name).unlink(missing_ok=True)


def draw_posterior(folder: Path, result: Result) -> None:
    """Draw what is believed, where that is known."""
    if result.belief is not None:
        from aquafish_gym.rendering.pictures import save_figure
        from eea.fish.posterior_figure import posterior_figure

        save_figure(posterior_figure(result), folder / MARGINALS)


def outcome_words(folder: Path, result: Result) -> list[str]:
    """Return what the files are for."""
    model, bodies = folder / MODEL, folder / BODIES
    said = [f"the body found is {model}, for python -m gait evolve --morphology {model}"]
    if result.belief is not None:
        said.append(
            f"{SAMPLED} bodies that the trials allow are {bodies}, for "
            f"python -m gait evolve --morphology {bodies}"
        )
    return said


def size_table(result: Result) -> list[str]:
    """Return the sizes found, how sure they are, and the true ones and OBJ_FIT where known."""
    columns = [[f" {size:6.3f}" for size in result.model]]
    heading = f"{'in units of 5 cm':26s}  found"
    if result.belief is not None:
        heading += f"  {MASS:.0%} interval   "
        columns.append(list(map(_ends, *result.interval(MASS))))
    if result.truth is not None:
        heading += "    true"
        columns.append([f"  {size:6.3f}" for size in result.truth])
    rows = zip(result.layout.names, *columns, strict=True)
    said = [heading.rstrip(), *(f"{name:26s}{''.join(cells)}" for name, *cells in rows)]
    if result.truth is not None:
        said.append(
            f"OBJ_FIT {result.objective_fitness:.2f}; the true body scores 1, "
            f"a random body {result.chance:.2f}, a mid-range body {result.mid_range:.2f}"
        )
    return said


def belief_words(result: Result) -> list[str]:
    """Return what else was inferred, what cannot be told, and whether the fit explains all."""
    if result.belief is None:
        return []
    said = []
    if result.truth is not None:
        low, high = result.interval(MASS)
        kept = int(((low <= result.truth) & (result.truth <= high)).sum())
        said.append(f"the {MASS:.0%} intervals hold {kept} of the {len(low)} true sizes")
    rows = result.belief.table(MASS)
    others = [name for name in rows if name not in result.layout.names and "@" not in name]
    if others:
        said.append(f"{'besides the body':26s} {'found':>6s}  {MASS:.0%} interval")
    said += [f"{name:26s} {rows[name][0]:z6.3f}{_ends(*rows[name][1:])}" for name in others]
    return [*said, *dict.fromkeys([*result.belief.findings, result.belief.verdict])]


def _ends(low: float, high: float) -> str:
    return f"  {low:z6.3f} to {high:z5.3f}"
