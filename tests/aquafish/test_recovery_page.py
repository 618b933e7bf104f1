"""The words of the case study's page follow from the outcomes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from aquafish.recovery.command import CaseStudy
from aquafish.recovery.report import shown_replicate
from aquafish_gym import Morphology

HEALTHY = Morphology.nominal()


@pytest.mark.parametrize(
    ("gains", "shown"), [([3.0], 0), ([1.0, 9.0, 2.0], 2), ([4.0, 3.0, 2.0, 1.0], 2), ([1, 1], 0)]
)
def test_the_shown_replicate_has_the_median_gain(gains: list[float], shown: int) -> None:
    outcomes: dict[str, list[dict[str, Any]]] = {
        "joint-fins": [{"target_distance": 10 + gain} for gain in gains],
        "undamaged": [{"target_distance": 10.0} for _ in gains],
    }
    assert shown_replicate(outcomes) == shown


def test_the_commands_on_the_page_name_what_differs_from_the_defaults() -> None:
    study = CaseStudy(held_out=True, format=("svg", "pdf"), film=False, seed=3, out=Path("x"))
    recover, film = study._commands(study.treatments()[0])
    assert recover == "aquafish recover --held-out --seed 3 --format svg pdf --no-film"
    assert film == (
        "aquafish film seed-003/undamaged/controller.json seed-003/undamaged/controller.json "
        "seed-003/joint-fins/controller.json --morphology seed-003/undamaged/morphology.json "
        "--damage none right_pectoral:width=0.4 right_pectoral:width=0.4 "
        "--label healthy 'damaged, old gait' 'damaged, new gait' --html swim.html"
    )
