"""Read the committed results under docs/, as sentences of the pages state them."""

from __future__ import annotations

import json
import math
import re
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
HERO = "self-model"
WORDS = (
    "none", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten",
    "eleven", "twelve", "thirteen", "fourteen", "fifteen", "sixteen",
)  # fmt: skip
TIERS = ("severe", "moderate", "mild")


@cache
def document(path: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((DOCS / path).read_text(encoding="utf-8"))
    return found


def recovered(treatment: str, *keys: str) -> Any:
    """Return an entry of a treatment of the case study."""
    found: Any = document("recovery/report.json")["treatments"][treatment]
    for key in keys:
        found = found[key]
    return found


def distance(treatment: str) -> float:
    """Return how far a treatment swims on the target from random poses, in units."""
    return float(recovered(treatment, "target_distance_random_poses"))


def way(entrant: str, tier: str) -> float:
    """Return the interquartile mean of an entrant's way in the league, in units."""
    return float(document("results/league/league.json")[entrant][tier]["way_after_onset"][0])


def gain(entrant: str, tier: str, over: str = "blind") -> float:
    """Return an entrant's mean gain over another in the same episodes, in units."""
    found = document("results/league/league.json")
    if over in found[entrant][tier]["over"]:
        return float(found[entrant][tier]["over"][over]["mean"][0])
    return -float(found[over][tier]["over"][entrant]["mean"][0])  # known the other way round


def worse(entrant: str) -> int:
    """Return the number of episodes in which an entrant is behind blind."""
    tiers = document("results/league/league.json")[entrant].values()
    return sum(tier["over"]["blind"]["worse"] for tier in tiers)


def word(count: int) -> str:
    """Return a small count as pages write it."""
    return WORDS[count] if count < len(WORDS) else str(count)


def rows(path: str) -> list[list[str]]:
    """Return the cells of a committed table, with its head."""
    return cells_of((DOCS / path).read_text(encoding="utf-8").splitlines())


def cells_of(lines: list[str]) -> list[list[str]]:
    """Return the cells of the lines of a table, without the line below its head."""
    cells = [[one.strip() for one in line.strip("|").split("|")] for line in lines]
    return [row for row in cells if not row[0].startswith("---")]


def cell(path: str, row: str, column: str) -> str:
    """Return a cell of a committed table: the row that begins with some cells."""
    table = rows(path)
    head = next(r for r in table if column in r)
    wanted = [one.strip() for one in row.split("|")]
    (found,) = [r for r in table if r[: len(wanted)] == wanted]
    return found[head.index(column)]


def number(path: str, row: str, column: str) -> float:
    """Return the first number of a cell of a committed table."""
    return numbers(path, row, column)[0]


def numbers(path: str, row: str, column: str) -> list[float]:
    """Return the numbers of a cell of a committed table: often a mean and its interval."""
    return [float(one) for one in re.findall(r"-?\d+(?:\.\d+)?", cell(path, row, column))]


def percent(more: str, than: str) -> float:
    """Return by how much a treatment of the case study swims farther than another, in %."""
    return 100.0 * (distance(more) / distance(than) - 1.0)


def wins(first: str, second: str) -> int:
    """Return in how many replicates a treatment swims farther than another."""
    (found,) = (
        one
        for one in document("recovery/report.json")["paired"]
        if (one["first"], one["second"]) == (first, second)
        and one["measure"] == "target_distance_random_poses"
    )
    return int(found["wins"])


def physics(*keys: str, **wanted: Any) -> dict[str, Any]:
    """Return the row of a part of the verification of the physics that has some entries."""
    rows: Any = document("physics/report.json")
    for key in keys:
        rows = rows[key]
    rows = rows if isinstance(rows, list) else rows["rows"]
    (found,) = [row for row in rows if wanted.items() <= row.items()]
    return dict(found)


def worst_quadrature() -> float:
    """Return the largest rms error of the law's points, in %."""
    rows = [r for r in document("physics/report.json")["quadrature"]["rows"]
            if r["rule"] == "the law's"]  # fmt: skip
    return 100.0 * max(max(row["force"], row["torque"]) for row in rows)


def figures(arm: str, *durations: int) -> float:
    """Return the mean OBJ_FIT of an arm of the paper's figures."""
    (found,) = (
        one["objective_fitness"]["mean"]
        for one in document("results/figs-5-to-10/summary.json")["fitness"]
        if one["arm"] == arm and one["durations"] == list(durations)
    )
    return float(found)


def angle_errors(arm: str) -> list[float]:
    """Return the mean errors of the three hidden angles in the last round, in degrees."""
    found = document("results/figs-5-to-10/summary.json")["angle_error"][arm]
    return sorted(math.degrees(one["mean"]) for one in found.values())


def fish_fitness(condition: str) -> tuple[float, float, float]:
    """Return the mean OBJ_FIT of a condition on FourFins, and its interval."""
    (found,) = document(f"results/fish/{condition}.json")["fitness"]
    low, high = found["objective_fitness"]["interval"]
    return found["objective_fitness"]["mean"], low, high


#: Shares of a half and less, in words.
FRACTIONS = {"a quarter": 1 / 4, "a third": 1 / 3, "half": 1 / 2}


def fraction(share: float) -> str:
    """Return the fraction nearest to a share in words, or in % if none is near."""
    name = min(FRACTIONS, key=lambda one: abs(FRACTIONS[one] - share))
    return name if abs(FRACTIONS[name] - share) < 0.05 else f"{share:.0%}"


class Claim(NamedTuple):
    """A sentence of a page with places for what was measured, and whether all of it still holds."""

    page: str
    sentence: str
    values: tuple[Any, ...] = ()
    holds: bool = True

    def written(self) -> str:
        """Return the sentence as the page must have it."""
        return self.sentence.format(*self.values)
