"""``python -m eea watch``: from a swim in a file to "this is no longer my body"."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aquafish_gym import Damage, Morphology
from eea import (
    SwimLog,
    infer_changes,
    infer_log,
    load_posterior,
    read_log,
    save_posterior,
    watch_swim,
    write_log,
)
from eea.__main__ import main
from eea.core.config import FitConfig
from eea.fish import known_body
from eea.fish.known import Watched
from eea.infer.answer import Answer
from eea.infer.known import Verdict
from tests.eea.infer.swing import infer as infer_swing
from tests.eea.infer.test_swims import BODY, swim
from tests.pictures import is_drawn

STRUCK = 320  # samples


@pytest.fixture(scope="module")
def belief(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a posterior inferred from a swim in a file."""
    folder = tmp_path_factory.mktemp("belief")
    write_log(folder / "swim.csv", swim(1, 520))
    found = infer_log(
        read_log(folder / "swim.csv"), FitConfig(alternatives="never"), moving=True, threads=1
    )
    save_posterior(folder / "posterior.npz", found.belief)
    return folder / "posterior.npz"


def test_a_swim_of_the_same_body_is_said_to_be_that(
    belief: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_log(tmp_path / "swim.csv", swim(5, 520))
    words = ["watch", "--log", str(tmp_path / "swim.csv"), "--posterior", str(belief)]
    assert main([*words, "--threads", "1"]) == 0
    assert "4 windows: this is still the body that was inferred" in capsys.readouterr().out


def test_a_change_is_printed_plotted_and_saved(
    belief: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = Damage.parse("right_pectoral:length=0.6").apply(Morphology.coerce(BODY))
    write_log(tmp_path / "swim.csv", swim(6, 720, other, STRUCK))
    words = ["watch", "--log", str(tmp_path / "swim.csv"), "--posterior", str(belief)]
    assert main([*words, "--out", str(tmp_path / "out"), "--threads", "1"]) == 0
    assert "this is no longer the body that was inferred" in capsys.readouterr().out
    document = json.loads((tmp_path / "out" / "watched.json").read_text())
    assert 0.01 * STRUCK < document["noticed"] < 0.01 * STRUCK + 3.0
    assert [row["same"] for row in document["windows"]] == [True] * 3 + [False] * 3
    assert is_drawn(tmp_path / "out" / "watched.png")


def test_what_is_no_posterior_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_log(tmp_path / "swim.csv", swim(5, 200))
    np.savez(tmp_path / "other.npz", x=np.zeros(3))
    words = ["watch", "--log", str(tmp_path / "swim.csv")]
    assert main([*words, "--posterior", str(tmp_path / "other.npz")]) == 2
    assert "posterior" in capsys.readouterr().err


@pytest.mark.parametrize("option", ["alarm", "seed", "threads"])
def test_nothing_is_written_for_a_wrong_option(
    option: str, belief: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_log(tmp_path / "swim.csv", swim(5, 200))
    words = ["watch", "--log", str(tmp_path / "swim.csv"), "--posterior", str(belief)]
    out = tmp_path / "out"
    assert main([*words, "--out", str(out), f"--{option}", "-1"]) == 2
    assert f"{option} must be" in capsys.readouterr().err
    assert not out.exists()


def test_the_seconds_of_all_trials_count(belief: Path) -> None:
    first, second = swim(5, 320), swim(7, 320)
    log = SwimLog(
        np.concatenate([first.time, second.time]),
        np.concatenate([first.gyro, second.gyro]),
        np.concatenate([first.commands, second.commands]),
        np.repeat([1, 2], [len(first.time), len(second.time)]),
    )
    watched = watch_swim(log, load_posterior(belief), threads=1)
    assert len(watched.looks) == 4
    lasted = float(np.ptp(first.time))
    np.testing.assert_allclose(watched.time, [1.2, 2.2, lasted + 1.2, lasted + 2.2], atol=0.02)
    assert str(watched).startswith(f"{watched.time[-1]:.4g} s of swimming, 4 windows")


def test_an_alarm_that_never_comes_is_refused(
    belief: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_log(tmp_path / "swim.csv", swim(5, 200))
    words = ["watch", "--log", str(tmp_path / "swim.csv"), "--posterior", str(belief)]
    assert main([*words, "--alarm", "0"]) == 2
    assert "alarm must be a finite number in [1e-100, 1]; got 0" in capsys.readouterr().err


def test_still_water_is_no_swim(belief: Path) -> None:
    time = 0.01 * np.arange(500)
    noise = np.random.default_rng(0).normal(0.0, 0.01, (500, 3))
    with pytest.raises(ValueError, match="no servo moves in any of its trials"):
        watch_swim(SwimLog(time, noise, np.zeros((500, 3))), load_posterior(belief))


def test_a_posterior_of_another_robot_is_refused() -> None:
    log, other = swim(5, 200), infer_swing().belief
    with pytest.raises(ValueError, match="belief must be a posterior of this fish, with left_pec"):
        watch_swim(log, other)
    with pytest.raises(ValueError, match="belief must be a posterior of this fish"):
        infer_changes(log, other)
    silent = replace(load_nominal(), sigma=-1.0)
    with pytest.raises(ValueError, match="belief must be a posterior: its sigma"):
        infer_changes(log, silent)


def load_nominal() -> Answer:
    return known_body(Morphology.nominal(), 0.01)


def test_a_change_is_noticed_by_the_end_of_a_window_and_no_chance_is_stated_as_0():
    looks = (Verdict(0.5, True, 1.0), Verdict(0.0, False, 99.0))
    said = str(Watched(np.array([1.2, 2.2]), looks, 1e-6))
    assert "by 2.2 s this is no longer the body that was inferred (p < 1e-300; one" in said
