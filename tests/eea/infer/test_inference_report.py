"""The committed measurement of joint inference is whole, and reproducible."""

from __future__ import annotations

import json
from pathlib import Path

from instruments.inference.cases import Case, measure
from instruments.inference.settings import SETTINGS
from instruments.inference.swims import SWIMS

DOCS = Path(__file__).parents[3] / "docs"


def test_the_committed_report_has_every_setting():
    committed = DOCS / "inference" / "report.json"
    report = json.loads(committed.read_text(encoding="utf-8"))
    assert list(report["settings"]) == list(SETTINGS)
    assert list(report["swims"]) == list(SWIMS)


def test_measurement_of_a_robot_depends_on_its_number_alone():
    one, again = (measure(Case("exact", 0)) for _ in range(2))
    for found in (one, again):
        for done in found["rounds"]:
            del done["seconds"]
    assert again == one
    assert one["rounds"][-1]["fitness"] > 0.99
    assert one["excess"] < 1.0
