"""What docs/paper_map.md says the ablations showed is what they showed."""

from __future__ import annotations

import json
import pathlib
import re

import pytest

from eea.report.arms import arm_label, is_baseline
from eea.report.tables import MINUS, signed
from eea.study.ablations import ABLATIONS, ablation_arms

DOCS = pathlib.Path(__file__).parents[2] / "docs"
SUMMARY = json.loads((DOCS / "results" / "ablations" / "summary.json").read_text())
EFFECTS = {effect["first"]: effect["rows"][0]["last_round"] for effect in SUMMARY["effects"]}
TABLE = (DOCS / "paper_map.md").read_text().split("## Where the paper leaves a choice")[1]
# Choice -> the last cell of its row.
WRITTEN = {
    row.group(1): row.group(2)
    for row in re.finditer(r"^\| ([^|]+) \|.*\| ([^|]*?) ?\|$", TABLE, re.MULTILINE)
}


def evidence(row: str) -> str:
    """Return what the last cell of a row must say of its ablations."""
    parts = []
    for name, ablation in ABLATIONS.items():
        for answer in ablation.answers if ablation.row == row else ():
            found = []
            for condition in ablation.conditions:
                effect = EFFECTS.get(f"{name}-{answer}-{condition}")
                if effect is not None:
                    low, high = effect["interval"]
                    star = "" if low <= 0.0 <= high else "\\*"
                    found.append(f"{arm_label(condition, 100)} {signed(effect['mean'])}{star}")
            if found:
                parts.append(f"`{name}-{answer}`: {', '.join(found)}")
    return "; ".join(parts)


@pytest.mark.parametrize("row", sorted({ablation.row for ablation in ABLATIONS.values()}))
def test_a_choices_evidence_is_what_was_measured(row: str) -> None:
    assert WRITTEN[row] == evidence(row)


def test_every_arm_was_measured_with_ten_replicates_of_256_steps() -> None:
    assert EFFECTS.keys() == {arm for arm in ablation_arms() if not is_baseline(arm)}
    assert all(effect["replicates"] >= 10 for effect in EFFECTS.values())
    assert SUMMARY["durations"] == [256]


def test_every_interval_that_the_results_quote_is_in_a_summary() -> None:
    number = rf"[{MINUS}+]?\d\.\d+"
    quoted = re.findall(
        rf"({number}) \[({number}), ({number})\]", (DOCS / "results.md").read_text()
    )
    summary = (DOCS / "results" / "figs-5-to-10" / "summary.md").read_text().replace("+", "")
    assert len(quoted) >= 10
    for mean, low, high in quoted:
        interval = rf"\[{low}, {high}\]"
        assert re.search(rf"{mean} {interval}|\| {mean} \| [^|]*\| {interval}", summary), mean
