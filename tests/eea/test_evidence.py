"""What the documents say that studies showed is what the committed studies show."""

from __future__ import annotations

import json
import pathlib
import re

from aquafish_gym.runs.command_line import parse
from eea.cli.study import StudyCommand
from eea.study.arms import ARMS, MINUS, signed

DOCS = pathlib.Path(__file__).parents[2] / "docs"
SUMMARY = json.loads((DOCS / "results" / "ablations" / "summary.json").read_text())
CONDITIONS = ("ideal", "none", "in-band", "out-of-band-100", "out-of-band")


def measured() -> dict[str, list[str]]:
    """Return what the map must say of each ablation with an effect: conditions and effects."""
    found: dict[str, list[str]] = {}
    for effect in SUMMARY["effects"]:
        condition = next(c for c in CONDITIONS if effect["first"].endswith(f"-{c}"))
        last = effect["rows"][0]["last_round"]
        low, high = last["interval"]
        if low <= 0.0 <= high:
            continue
        words = f"{ARMS[condition].label.format(models=100)} {signed(last['mean'])}"
        found.setdefault(effect["first"].removesuffix(f"-{condition}"), []).append(words)
    return found


def test_the_maps_evidence_is_what_the_ablations_measured() -> None:
    table = (DOCS / "paper_map.md").read_text().split("## Where the paper leaves a choice")[1]
    cells = [line.rsplit("|", 2)[1] for line in table.splitlines() if line.startswith("| ")]
    written = dict(
        part.strip().removeprefix("`").split("`: ")
        for cell in cells
        for part in cell.split("; ")
        if "`: " in part
    )
    assert written == {name: ", ".join(effects) for name, effects in measured().items()}


def test_every_command_and_option_that_the_map_names_is_one_of_this_version() -> None:
    text = (DOCS / "paper_map.md").read_text()
    commands = re.findall(r"^aquafish study (.*)$", text, re.MULTILINE)
    words = re.findall(r"`(--(?:in-band|genetic|exploration|out-of-band)\.[^`]*)`", text)
    assert len(words) >= 12
    assert commands
    for command in commands:
        parse(StudyCommand, "study", command.split()).study()
    plain = parse(StudyCommand, "study", ["--figure", "7", "9"]).study()
    for word in words:
        study = parse(StudyCommand, "study", ["--figure", "7", "9", *word.split()]).study()
        assert study.arms != plain.arms, word


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
