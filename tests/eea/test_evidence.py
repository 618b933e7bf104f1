"""What the documents say that studies showed is what the committed studies show."""

from __future__ import annotations

import pathlib
import re

from aquafish_gym.runs.command_line import parse
from eea.cli.study import StudyCommand
from eea.study.arms import MINUS

DOCS = pathlib.Path(__file__).parents[2] / "docs"


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
