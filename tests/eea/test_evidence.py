"""Each command and option that the map of the paper names is one of this version."""

from __future__ import annotations

import pathlib
import re

from aquafish_gym.runs.command_line import parse
from eea.cli.study import StudyCommand

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
