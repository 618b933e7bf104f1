"""The command ``python -m instruments.verification``: its report, tables and pictures."""

from __future__ import annotations

import contextlib
import io
import json
import pathlib

import pytest
from numpy.testing import assert_allclose

from instruments.verification.__main__ import main
from instruments.verification.propulsion import TAILS
from instruments.verification.report import OF_ANY_PLAN
from instruments.verification.strokes import flipper_stroke, tail_stroke
from instruments.verification.tables import TABLES, make_tables
from tests.pictures import is_drawn

PICTURES = ("strokes", "convergence", "quadrature", "single_precision", "real_fish")


@pytest.fixture(scope="module")
def quick(tmp_path_factory: pytest.TempPathFactory) -> tuple[pathlib.Path, str]:
    """Return where a quick run wrote, and what it printed."""
    out = tmp_path_factory.mktemp("verification")
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        assert main(["--quick", "--out", str(out)]) == 0
    return out, printed.getvalue()


@pytest.mark.slow
@pytest.mark.pybullet
def test_it_runs_every_study(quick: tuple[pathlib.Path, str]) -> None:
    out, printed = quick
    report = json.loads((out / "report.json").read_text())
    mechanics = report["mechanics"]
    for name, (part, _) in TABLES.items():
        if report[part] is not None:
            assert make_tables(report)[name].title.split()[0] in printed
    assert mechanics is not None or "MuJoCo is not installed" in printed
    order = [r["order"] for r in report["convergence"]["rows"] if r["order"] is not None]
    assert_allclose(order, 1.0, atol=0.2)
    swimming = {
        (row["tail"], row["pectorals"], row["reactive"]): row["speed"]
        for row in report["reactive"]["swimming"]
        if row["frequency"] == 1
    }
    for tail in TAILS:
        assert swimming[tail, False, True] > swimming[tail, False, False]
    for name in PICTURES:
        assert is_drawn(out / f"{name}.png")


@pytest.mark.slow
@pytest.mark.pybullet
def test_another_fish_is_verified_by_the_studies_of_any_plan(
    tmp_path: pathlib.Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--quick", "--plan", "tail-fish", "--out", str(tmp_path)]) == 0
    report = json.loads((tmp_path / "report.json").read_text())
    assert set(report) == {"seed", *OF_ANY_PLAN}
    bullet = [row for row in report["agreement"]["rows"] if row["engines"].startswith("PyBullet")]
    assert all(row["maximum"] < 1e-9 for row in bullet)
    assert {"any tail", "any fin"} <= {row["part"] for row in report["quadrature"]["rows"]}
    assert main(["--quick", "--plan", "tail-fish", "--only", "strokes"]) == 2
    assert "only must be one of agreement" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.pybullet
def test_speed_goes_as_frequency_exactly_if_beats_have_equally_many_steps(
    quick: tuple[pathlib.Path, str],
) -> None:
    study = json.loads((quick[0] / "report.json").read_text())["real_fish"]
    for row in study["frequency"]:
        assert_allclose([row["slope"], row["low"], row["high"]], 1.0, atol=1e-6)


@pytest.mark.slow
@pytest.mark.pybullet
def test_only_the_reactive_terms_have_the_amplitude_exponents_that_were_measured(
    quick: tuple[pathlib.Path, str],
) -> None:
    study = json.loads((quick[0] / "report.json").read_text())["real_fish"]
    exponents = study["published"]["amplitude"]
    assert_allclose([one["slope"] for one in exponents], [1.82, 1.72, 1.71], atol=0.01)
    for measured, rows in zip(exponents, study["from rest"], strict=True):
        drag, reactive = rows[:4], rows[4:]
        assert not any(row["reactive"] for row in drag)
        assert all(row["reactive"] for row in reactive)
        assert all(row["slope"] > measured["high"] for row in drag)
        # The interval and the range of 18 tails overlap.
        assert reactive[-1]["low"] < measured["high"]
        assert reactive[-1]["high"] > measured["low"]


def test_without_towing_a_steady_stroke_gives_no_mean_thrust() -> None:
    assert abs(flipper_stroke(0.0).mean_thrust) < 1e-12
    assert abs(tail_stroke(0.0).mean_thrust) < 1e-12


def test_a_flipper_rows_if_it_turns_faster_in_the_half_that_pushes_back() -> None:
    assert flipper_stroke(0.0, 0.5).mean_thrust > 0.1
    assert flipper_stroke(1.0).mean_thrust < 0
    assert tail_stroke(1.0).mean_thrust < 0
