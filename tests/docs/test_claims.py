"""What README, paper and pages say in numbers is what the committed results say."""

from __future__ import annotations

import json
import re
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import pytest

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
CM_PER_UNIT = 5.0


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
    return -float(found[over][tier]["over"][entrant]["mean"][0])


def worse(entrant: str) -> int:
    """Return the number of episodes in which an entrant is behind blind."""
    tiers = document("results/league/league.json")[entrant].values()
    return sum(tier["over"]["blind"]["worse"] for tier in tiers)


def cell(path: str, row: str, column: str) -> str:
    """Return a cell of a committed table: the row that begins with some cells."""
    lines = (DOCS / path).read_text(encoding="utf-8").splitlines()
    rows = [[one.strip() for one in line.strip("|").split("|")] for line in lines]
    head = next(r for r in rows if column in r)
    wanted = [one.strip() for one in row.split("|")]
    (found,) = [r for r in rows if r[: len(wanted)] == wanted]
    return found[head.index(column)]


def number(path: str, row: str, column: str) -> float:
    """Return the first number of a cell of a committed table."""
    found = re.search(r"-?\d+(?:\.\d+)?", cell(path, row, column))
    assert found
    return float(found[0])


class Claim(NamedTuple):
    """A sentence of a page, with the places of its numbers, and the numbers."""

    page: str
    sentence: str
    values: tuple[Any, ...]

    def written(self) -> str:
        """Return the sentence as the page must have it."""
        return self.sentence.format(*self.values)


TIERS = ("severe", "moderate", "mild")
LEAGUE = "results/league"
CLAIMS = [
    Claim(
        "README.md",
        "NEAT, its search, is weaker: on the true body it swims {:.0f} cm",
        (CM_PER_UNIT * distance("oracle-neat"),),
    ),
    Claim(
        "paper/paper.md",
        "joint inference finds the body with a mean error of the nine fin sizes of {:.3f} of their "
        "ranges (OBJ_FIT {:.3f}, 95% interval {:.3f} to {:.3f}). The gait for it swims {:.1f} "
        "units (of 5 cm) in 20 s, as far as the gait for the true body and fin angles. The old "
        "gait swims {:.1f} units. The paper's method takes {} trials to an OBJ_FIT of {:.3f}, and "
        "its gait by NEAT swims {:.1f} units; NEAT on the true body reaches {:.1f}.",
        (
            1.0 - recovered("joint-fins", "objective_fitness"),
            recovered("joint-fins", "objective_fitness"),
            *recovered("joint-fins", "spread", "objective_fitness", "interval"),
            distance("joint-fins"),
            distance("undamaged"),
            recovered("out-of-band", "trials"),
            recovered("out-of-band", "objective_fitness"),
            distance("out-of-band"),
            distance("oracle-neat"),
        ),
    ),
    Claim(
        "paper/paper.md",
        "After severe damage the agent swims {:.1f} units, an oracle that is given the truth "
        "{:.1f}, and the same agent without recognition {:.1f}. In the same episodes recognition "
        "is worth {:.1f} units after severe damage, {:.1f} after moderate and {:.1f} after mild "
        "damage.",
        (
            way("self-model", "severe"),
            way("oracle", "severe"),
            way("blind", "severe"),
            *(gain("self-model", tier) for tier in TIERS),
        ),
    ),
    Claim(
        "paper/paper.md",
        "the agent keeps {:.0f}% of its way after severe damage.",
        (number(f"{LEAGUE}/ceiling.md", "severe", "self-model, share"),),
    ),
]


def plain(text: str) -> str:
    """Return a page's text in one line."""
    return " ".join(text.split())


@pytest.mark.parametrize("claim", CLAIMS, ids=lambda c: f"{c.page}: {c.sentence[:40]}")
def test_a_page_claims_what_was_measured(claim: Claim) -> None:
    assert plain(claim.written()) in plain((ROOT / claim.page).read_text(encoding="utf-8"))
