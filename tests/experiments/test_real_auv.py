"""The AUV: its logs, their sessions, the rotors' rate, and what is named in a swim."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from aquafish_gym.utils.storage import DamagedFileError
from aquafish_gym.utils.validation import InvalidArgumentError
from experiments.real import auv
from experiments.real.auv import (
    CALLED,
    DRAWS,
    NUMBERS,
    VERDICTS,
    auv_table,
    evidence,
    healthy_interval,
    learn,
    record,
    splits,
)
from experiments.real.auv_report import auv_text, draw_auv
from experiments.real.haizhe import (
    CONDITIONS,
    HEALTHY,
    IDLE_PWM,
    RATE_HZ,
    SAMPLES,
    Swim,
    read_swim,
    read_swims,
    sessions,
)
from experiments.real.rotor_line import Rotor, find_rotor, spectra
from tests.pictures import is_drawn

HEAD = "time,pwm1,pwm2,pwm3,pwm4,depth,press,voltage,roll,pitch,yaw,a_x,a_y,a_z,w_row,w_pitch,w_yaw"
ROTOR = Rotor(22.0, 0.4, np.inf)
STILL = 4  # samples before thrust
PAUSE = 150.0  # s


def write_swim(
    path: Path,
    rng: np.random.Generator,
    *,
    clock: float = 70000.0,
    volts: float = 12.0,
    roll: float = 5.0,
    pwm: float = 1198.0,
    offset: float = 0.0,
    sink: float = 0.0,
    line: float = 0.3,
    faster: float = 0.0,
) -> None:
    """Write a swim as the robot's logger does; ``line`` is the amplitude of a rotor's in deg/s."""
    count = STILL + SAMPLES + 3
    t = np.arange(count) / RATE_HZ
    driven = np.arange(count) >= STILL
    seconds = np.maximum(t - STILL / RATE_HZ, 0.0)
    volts_and_pwm = volts / 11.85 * ((pwm - IDLE_PWM) / 98.0) ** ROTOR.exponent
    rate = ROTOR.rate_hz * volts_and_pwm
    depth = offset + 0.5 * volts_and_pwm**5 * np.exp(sink) * (1.0 - np.exp(-seconds / 3.0))
    depth += rng.normal(0.0, 0.01, count) + rng.normal(0.0, 0.01)
    turning = np.where(driven, -30.0 * (1.0 - np.exp(-seconds)), 0.0)
    yaw = 80.0 + np.cumsum(turning) / RATE_HZ
    turning = turning + driven * line * np.cos(
        2 * np.pi * rate * (1.0 + faster) * t + rng.uniform(0.0, 6.0)
    )
    turning += rng.normal(0.0, 0.6, count)
    hour, rest = divmod(int(clock), 3600)
    stamp = hour * 10000 + rest // 60 * 100 + rest % 60
    lines = [HEAD]
    for i in range(count):
        motors = f"{pwm:.0f}" if driven[i] else "1100"
        lines.append(
            f"{stamp},{motors},{motors},{motors},{motors},"
            f"{depth[i]:.2f},{600 + depth[i] / 0.00945:.0f},{volts:.2f},"
            f"{roll + rng.normal(0.0, 0.1):.2f},1.0,{(yaw[i] + 180) % 360 - 180:.2f},"
            f"0,0,9.8,0,0,{turning[i]:.3f}"
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join([*lines, "21,1100"]))  # the last line is cut off


@pytest.fixture(scope="module")
def download(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a download with 80 healthy swims of five sessions, and eight of each fault."""
    root = tmp_path_factory.mktemp("download")
    rng = np.random.default_rng(1)
    faults = {
        HEALTHY: {},
        "AddWeight": {"sink": 0.5},
        "PressureGain_constant": {"offset": 0.15},
        "PropellerDamage_slight": {"line": 0.5, "faster": 0.03},
        "PropellerDamage_bad": {"line": 2.0, "faster": 0.05},
    }
    for folder, fault in faults.items():
        for k in range(5 if folder == HEALTHY else 1):
            for i in range(16 if folder == HEALTHY else 8):
                write_swim(
                    root
                    / "Dataset"
                    / ("train" if i % 4 else "test")
                    / folder
                    / f"{folder}_{k * 16 + i}.csv",
                    rng,
                    clock=60000.0 + k * 40.0 + i * PAUSE,
                    volts=12.3 - 0.1 * k - 0.30 * i * PAUSE / 3600.0,
                    roll=3.0 + 1.2 * k,
                    pwm=float(rng.integers(1190, 1206)),
                    **fault,  # type: ignore[arg-type]
                )
    return root


@pytest.fixture(scope="module")
def swims(download: Path) -> list[Swim]:
    return read_swims(download)


def test_reader_returns_all_swims_from_the_first_sample_with_thrust(
    download: Path, swims: list[Swim]
) -> None:
    assert [s.condition for s in swims].count(HEALTHY) == 80
    assert len(swims) == 112
    assert len(read_swims(download / "Dataset")) == 112
    swim = swims[0]
    assert swim.rest["pwm1"] == IDLE_PWM
    assert swim.thrust["pwm1"].shape == (SAMPLES,)
    assert (swim.thrust["pwm1"] > IDLE_PWM).all()
    assert swim.thrust["w_yaw"][60:].mean() == pytest.approx(np.deg2rad(-30.0), rel=0.05)
    assert abs(swim.surface_depth_m) < 0.05
    assert {s.clock for s in swims} >= {60000.0, 60150.0}


def test_reader_refuses_other_logs(tmp_path: Path) -> None:
    with pytest.raises(InvalidArgumentError, match="Dataset/train/Normal"):
        read_swims(tmp_path)
    path = tmp_path / "swim.csv"

    def in_radians(text: str) -> str:
        head, *lines, _ = text.splitlines()
        cells = [line.rpartition(",") for line in lines]
        return "\n".join([head, *(f"{rest},{np.deg2rad(float(w)):.5f}" for rest, _, w in cells)])

    changes: dict[str, Callable[[str], str]] = {
        "lacks the columns voltage": lambda text: text.replace("voltage", "volts"),
        "less than 5 s of thrust": lambda text: "\n".join(text.splitlines()[:80]),
        "no number": lambda text: text.replace("12.00", "high", 1),
        "w_yaw must be in deg/s": in_radians,
    }
    for sentence, change in changes.items():
        write_swim(path, np.random.default_rng(0))
        assert read_swim(path).thrust["w_yaw"].min() > -1.0
        path.write_text(change(path.read_text()))
        with pytest.raises(DamagedFileError, match=sentence):
            read_swim(path)


def test_sessions_of_overlapping_clocks_are_told_apart(swims: list[Swim]) -> None:
    labels = sessions(swims)
    healthy = [s for s in swims if s.condition == HEALTHY]
    found = dict.fromkeys(range(5), -1)
    for swim, label in zip(healthy, labels, strict=False):
        session = int(swim.path.stem.rpartition("_")[2]) // 16
        assert found[session] in (-1, label), "a session is split"
        found[session] = int(label)
    assert len(set(found.values())) == 5
    for one, other in itertools.combinations(range(len(swims)), 2):
        assert labels[one] != labels[other] or swims[one].condition == swims[other].condition


def test_rotor_is_found_in_weak_lines_of_healthy_swims(swims: list[Swim]) -> None:
    rotor = find_rotor(spectra([s for s in swims if s.condition == HEALTHY]))
    assert rotor.rate_hz == pytest.approx(ROTOR.rate_hz, abs=0.15)
    assert rotor.exponent == pytest.approx(ROTOR.exponent, abs=0.15)
    assert rotor.clearance > 5.0


def test_few_sessions_tell_little_of_the_next_one() -> None:
    rng = np.random.default_rng(0)
    session = np.repeat(np.arange(4), 10)
    offsets = rng.normal(0.0, 0.2, (4, 3))
    numbers = offsets[session] + rng.normal(0.0, 0.02, (40, 3))
    low, high = healthy_interval(learn(numbers, session), 0.9).T
    means = numbers.reshape(4, 10, 3).mean(axis=1)
    students = 2.353  # of three degrees of freedom, where 90% are within
    expected = students * np.sqrt(1.25 * means.var(axis=0, ddof=1))
    np.testing.assert_allclose(0.5 * (high - low), expected, rtol=0.1)
    np.testing.assert_allclose(0.5 * (high + low), means.mean(axis=0), atol=0.02)
    many = rng.normal(0.0, 0.02, (40, 3))  # sessions that do not differ
    low, high = healthy_interval(learn(many, session), 0.9).T
    np.testing.assert_allclose(0.5 * (high - low), 1.645 * 0.02, rtol=0.35)


@pytest.mark.slow
def test_a_heavier_swim_is_named_and_an_ordinary_one_is_not(swims: list[Swim]) -> None:
    conditions = np.array([s.condition for s in swims])
    labels = sessions(swims)
    healthy = np.flatnonzero(conditions == HEALTHY)
    known = healthy[labels[healthy] != labels[healthy[0]]][:50]
    numbers = record(swims).numbers(ROTOR, known, labels)
    reference = learn(numbers[known], labels[known])

    def share(rows: np.ndarray, name: str) -> float:
        found = np.array([evidence(reference, swim) for swim in numbers[rows]])
        np.testing.assert_allclose(found.sum(axis=1), 1.0, atol=1e-3)
        found[:, 0] *= 3.0
        return float((found.argmax(axis=1) == CALLED.index(name)).mean())

    assert share(labels == labels[healthy[0]], "nothing is broken") > 0.8
    for condition, name in (
        ("AddWeight", "it is heavier"),
        ("PressureGain_constant", "the depth sensor is off"),
        ("PropellerDamage_bad", "a propeller is damaged"),
    ):
        assert share(conditions == condition, name) == 1.0


def test_a_lighter_swim_is_not_called_heavier() -> None:
    rng = np.random.default_rng(0)
    reference = learn(rng.normal(0.0, [0.02, 0.1, 1.0], (50, len(NUMBERS))), np.arange(50) % 5)
    for change, called in ((-0.6, "nothing is broken"), (0.6, "it is heavier")):
        found = evidence(reference, np.array([0.0, change, 0.0]))
        assert found.argmax() == CALLED.index(called)


def test_no_session_is_known_in_part(swims: list[Swim]) -> None:
    healthy = np.array([s.condition == HEALTHY for s in swims])
    session = sessions(swims)
    found = splits(healthy, session, seed=0)
    assert len(found) == 10 * DRAWS  # pairs of five sessions
    for split in found:
        assert healthy[split.known].all()
        assert not set(session[split.others]) & set(session[split.unseen])
        assert set(split.known) <= set(split.others)
        assert set(np.flatnonzero(~healthy)) <= set(split.unseen)
        assert len(split.others) + len(split.unseen) == len(swims)
        assert set(split.judged) <= set(split.unseen)
    verdicts = np.bincount(np.concatenate([split.judged for split in found]))
    assert verdicts.tolist() == [VERDICTS] * len(swims)


@pytest.mark.slow
def test_table_tells_how_often_each_fault_is_named(
    download: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(auv, "DRAWS", 1)
    monkeypatch.setattr(auv, "VERDICTS", 1)
    monkeypatch.setattr(auv, "HELD_OUT_SESSIONS", 1)
    monkeypatch.setattr(auv, "splits", lambda *of: splits(*of)[:2])  # of five, for time
    table = auv_table(download)
    assert table["weight"] == table["depth_sensor"] == table["thruster_bad"] == 1.0
    assert table["false_alarms"] < 0.2
    assert table["at_odds"]["1"]["false_alarms"] >= table["at_odds"]["10"]["false_alarms"]
    assert table["sessions"]["healthy"] == 5
    assert list(table["called"]) == list(CONDITIONS.values())
    for shares in table["called"].values():
        assert sum(shares.values()) == pytest.approx(1.0)
    assert "| weight added | 0.0% | 100.0% | 0.0% | 0.0% |" in auv_text(table)
    draw_auv(table, tmp_path / "auv.png")
    assert is_drawn(tmp_path / "auv.png")
