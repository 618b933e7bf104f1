"""The measurement of joint inference: its numbers, its tables, and the page that shows them."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.inference.cases import Case, measure
from tests.inference.settings import SETTINGS, Target
from tests.inference.summary import covered, met, summarise
from tests.inference.swims import SWIMS, measure_swim, summarise_swims
from tests.inference.tables import Pictures, make_tables
from tests.verification.tables import fill_page

DOCS = Path(__file__).parents[3] / "docs"


def test_the_page_shows_the_committed_report():
    page = (DOCS / "inference.md").read_text(encoding="utf-8")
    committed = DOCS / "inference" / "report.json"
    if not committed.exists():  # then it has no numbers either
        assert page.count("-->\n<!-- end of table") == 5
        return
    report = json.loads(committed.read_text(encoding="utf-8"))
    assert list(report["settings"]) == list(SETTINGS)
    assert list(report["swims"]) == list(SWIMS)
    names = tuple(sorted(path.stem for path in committed.parent.glob("*.png")))
    shown = {**make_tables(report), "pictures": Pictures("inference", names)}
    assert fill_page(page, shown) == page


@pytest.fixture(scope="module")
def one():
    return measure(Case("exact", 0), lambda _text, _share: None)


def test_a_robot_is_a_pure_function_of_its_number(one):
    again = measure(Case("exact", 0), lambda _text, _share: None)
    for found in (one, again):
        for done in found["rounds"]:
            done.pop("seconds", None)
    assert again == one
    assert one["rounds"][-1]["fitness"] > 0.99
    assert one["excess"] < 1.0


def test_a_setting_is_summarised_in_shares():
    base = {
        "truth": [0.5] * 9, "low": [[0.4] * 9] * 3, "high": [[0.6] * 9] * 3, "good": True,
        "excess": 0.0, "others": None, "findings": [],
    }  # fmt: skip
    lost = {**base, "truth": [0.9] * 9, "good": False, "excess": 5.0}
    rounds = [
        [{"fitness": fitness, "seconds": seconds} for seconds in (1.0, 2.0, last)]
        for fitness, last in ((0.999, 3.0), (0.985, 5.0))
    ]
    part = summarise("exact", [{**base, "rounds": rounds[0]}, {**lost, "rounds": rounds[1]}])
    assert (part["median"], part["exact"], part["close"]) == pytest.approx((0.992, 0.5, 1.0))
    assert (part["seconds"], part["rounds"]["1"]["seconds"]) == (4.0, 1.0)
    assert part["coverage"]["90%"]["share"] == part["missed"]["share"] == 0.5
    assert part["alarms"]["share"] == 0.5
    assert met(part, Target("rounds.2.exact", low=0.5))
    assert not met(part, Target("missed", high=0.02))
    tables = make_tables({"settings": {"exact": part}})
    assert tables["calibration"].rows[0][2:5] == ("0.9920", "100%", "0.985")
    assert [row[4] for row in tables["asked"].rows] == ["no", "no", "no", "yes", "yes", "no"]


def test_an_interval_that_ends_at_a_truth_at_the_bound_holds_it():
    robot = {"truth": [0.0], "low": [[1e-9]] * 3, "high": [[0.5]] * 3}
    assert covered([robot, robot], ["length"])["90%"]["share"] == 1.0


def test_a_change_in_mid_swim_is_measured():
    struck = measure_swim("struck", 0, np.random.default_rng(0), lambda _text, _share: None)
    part = summarise_swims("struck", [struck])
    assert (part["swims"], part["soon"], part["early"]) == (1, 1, 0)
    lost = {**struck, "noticed": None}
    early = {**struck, "noticed": struck["struck"] - 1.0}
    part = summarise_swims("struck", [struck, lost, early])
    assert (part["soon"], part["early"], part["unnoticed"]) == (1, 1, [lost["damage"]])
    row = make_tables({"settings": {}, "swims": {"struck": part}})["swims"].rows[0]
    assert row[2].startswith("1 noticed within 3 s")


@pytest.mark.slow
def test_the_command_goes_on_and_writes_a_report(tmp_path):
    command = [sys.executable, "-m", "tests.inference", "--out", str(tmp_path), "--bodies", "0.1"]
    command += ["--only", "exact", "prior", "--markdown"]
    first = subprocess.run(command, capture_output=True, text=True, check=True)
    again = subprocess.run(command, capture_output=True, text=True, check=True)
    assert first.stdout == again.stdout
    report = json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))["settings"]
    assert report["exact"]["rounds"]["3"]["exact"] >= 0.8
    assert 0.75 < report["prior"]["coverage"]["90%"]["share"] < 0.97
    assert report["prior"]["missed"]["share"] <= 0.1
    assert np.median(list(report["prior"]["ranks"]["chances"].values())) > 0.01
    assert {path.name for path in tmp_path.glob("*.png")} == {"coverage.png", "ranks.png"}
