"""The reader of CrazyPAD's logs, and what is found about drones in logs that these tests write."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from zlib import crc32

import numpy as np
import pytest
from numpy.typing import NDArray

from aquafish_gym.utils.storage import DamagedFileError
from aquafish_gym.utils.validation import InvalidArgumentError
from experiments.real import drones
from experiments.real.blade import loss
from experiments.real.command import RealDrones
from experiments.real.crazypad import build, cuts_in_name, flights, read_log, session
from experiments.real.drones import Healthy, Verdict, conditions, cuts_of, drones_table, infer
from experiments.real.drones_report import drones_text
from experiments.real.hover import AXES, FULL_COMMAND, MIX, commands, hover
from experiments.real.quadrotor import GAINS, TRIMS, Known, Spread, quadrotor
from tests.pictures import is_drawn

LEVEL = np.array([-0.47, 0.01, -0.03, 0.08])
SPREAD = Spread(np.array([0.005, 0.002, 0.0015, 0.006]), gain=0.008, battery=0.018)
NOISE = dict(zip(AXES, (0.005, 0.0035, 0.004, 0.009), strict=True))
SAMPLES = 1500  # 15 s
WHOLE = (0.0, 0.0, 0.0, 0.0)


def write_log(
    path: Path, columns: Mapping[str, NDArray[np.float64]], types: str = "", version: int = 2
) -> None:
    """Write a log as a Crazyflie does, with one rare event among the samples."""
    types = types or "f" * len(columns)
    fields = b"".join(
        f"{name}({kind})\0".encode() for name, kind in zip(columns, types, strict=True)
    )
    body = struct.pack("<BHH", 0xBC, version, 2)
    body += (
        struct.pack("<H", 0xFFFF) + b"fixedFrequency\0" + struct.pack("<H", len(columns)) + fields
    )
    body += (
        struct.pack("<H", 12) + b"activeMarkerModeChanged\0" + struct.pack("<H", 1) + b"mode(B)\0"
    )
    stamp, ticks = {1: ("<HI", 10), 2: ("<HQ", 10_000)}[version]
    row = struct.Struct("<" + types)
    for i, values in enumerate(zip(*columns.values(), strict=True)):
        whole = [v if kind == "f" else int(v) for v, kind in zip(values, types, strict=True)]
        body += struct.pack(stamp, 0xFFFF, i * ticks) + row.pack(*whole)
        if i == 5:
            body += struct.pack(stamp, 12, i * ticks) + b"\1"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(body + crc32(body).to_bytes(4, "little"))


def write_flight(
    path: Path, lost: Sequence[float], seed: int, known: Sequence[float] = WHOLE
) -> None:
    """Write a flight out and back of a drone that has lost so much since it was known."""
    rng = np.random.default_rng(seed)
    robot = quadrotor(Known(LEVEL, np.array(known), SPREAD))
    time = 0.01 * np.arange(SAMPLES)
    aloft = np.abs(time - 7.5) > 1.5
    x = np.where(time < 7.5, 0.3 * time, 0.3 * (15.0 - time))
    values = {name: np.array([1.0]) for name in ("blade",)}
    values |= {f"M{k + 1} lost": np.array([mm]) for k, mm in enumerate(lost)}
    values |= {f"load at M{k}": np.zeros(1) for k in (1, 2, 3, 4)}
    values |= {name: np.zeros(1) for name in (*GAINS, "battery", "flapping")}
    values |= {name: rng.normal(0.0, sd, 1) for name, sd in zip(TRIMS, SPREAD.flight, strict=True)}
    values["resistive"] = np.array([0.36])
    signal = robot.simulate(values, np.gradient(x, time)[None])[0]
    axes = signal + rng.normal(0.0, 10.0, signal.shape) * [NOISE[axis] for axis in AXES]
    motors = np.exp(axes @ np.linalg.inv(MIX).T) * FULL_COMMAND * aloft[:, None]
    columns = {f"motor.m{k + 1}": motors[:, k] for k in range(4)}
    columns |= {"stateEstimate.x": x, "stateEstimate.z": 0.5 * aloft}
    write_log(path, columns, "IIIIff")


def test_logs_of_motors_and_of_the_controller_hold_the_same_commands(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    thrust = rng.uniform(30_000, 40_000, 50).round()
    roll, pitch = 2.0 * rng.integers(-2000, 2000, (2, 50)).astype(float)
    yaw = rng.integers(-2000, 2000, 50).astype(float)
    names = [f"controller.cmd_{axis}" for axis in ("thrust", "roll", "pitch", "yaw")]
    write_log(tmp_path / "E8_log00", dict(zip(names, (thrust, roll, pitch, yaw), strict=True)))
    half = roll / 2.0, pitch / 2.0
    motors = {
        "motor.m1": thrust - half[0] + half[1] + yaw,
        "motor.m2": thrust - half[0] - half[1] - yaw,
        "motor.m3": thrust + half[0] - half[1] + yaw,
        "motor.m4": thrust + half[0] + half[1] - yaw,
    }
    write_log(tmp_path / "E8_log01", motors, "IIII", version=1)
    one = read_log(tmp_path / "E8_log00")
    other = read_log(tmp_path / "E8_log01")
    np.testing.assert_allclose(commands(one), commands(other), atol=1e-6)
    np.testing.assert_allclose(one["t"], other["t"])
    assert one["t"][-1] == pytest.approx(0.49)
    assert len(one["t"]) == 50, "the rare event is no sample"


def test_damaged_logs_are_refused_with_the_reason(tmp_path: Path) -> None:
    path = tmp_path / "E8_log00"
    write_log(path, {"motor.m1": np.arange(20.0)})
    content = path.read_bytes()
    for bad, words in (
        (b"\x00" + content[1:], "begin with 0xBC"),
        (content[:-30], "cut short or damaged"),
        (b"", "begin with 0xBC"),
        (content.replace(b"m1(f)", b"m1(z)"), "cut short or damaged"),
    ):
        path.write_bytes(bad)
        with pytest.raises(DamagedFileError, match=words):
            read_log(path)
    body = content[:-4].replace(b"m1(f)", b"m1(z)")
    path.write_bytes(body + crc32(body).to_bytes(4, "little"))
    with pytest.raises(DamagedFileError, match="no known type"):
        read_log(path)
    with pytest.raises(InvalidArgumentError):
        read_log(tmp_path / "nothing")


def test_a_name_says_what_was_cut() -> None:
    assert cuts_in_name("cut_M2_1.5мм_1мм_44.5мм_M1_1мм_1мм_45мм") == (2.0, 2.5, 0.0, 0.0)
    assert cuts_in_name("cut_m3_2mm_2mm") is None
    with pytest.raises(InvalidArgumentError, match="47 mm in all"):
        cuts_in_name("cut_propeller_M3_1mm_1mm_44mm")


def test_a_round_tip_loses_little_at_first() -> None:
    thrust, torque = loss(np.array([0.0, 0.5, 1.0, 4.0]))
    assert thrust[0] == torque[0] == 0.0
    assert (np.diff(thrust) < 0.0).all()
    assert thrust[1] / 0.5 > thrust[3] / 4.0, "less a millimetre than later"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two sessions of two conditions, and healthy flights of three builds."""
    motors = tmp_path / "data" / "motor_data"
    (tmp_path / "data" / "controller_data").mkdir(parents=True)
    names = {
        "cut_propeller_M3_1mm_46mm": (0.0, 0.0, 1.0, 0.0),
        "cut_propeller_M3_2mm_1.5mm_43.5mm": (0.0, 0.0, 3.5, 0.0),
        "cut_M2_1.5мм_1.5мм_44мм_M1_1.5мм_1.5мм_44мм": (3.0, 3.0, 0.0, 0.0),
        "cut_M2_0.5мм_46.5мм": (0.0, 0.5, 0.0, 0.0),
    }
    for i, (name, cuts) in enumerate(names.items()):
        for k in range(2):
            write_flight(motors / name / f"E9_log0{k}", cuts, seed=10 * i + k)
    for drone, numbers in {"E8": (0, 1, 2, 3), "E9": (0, 1, 3, 4)}.items():
        for k in numbers:
            path = motors / "normal_flight" / f"{drone}_log0{k}"
            write_flight(path, WHOLE, seed=100 + k)
    return tmp_path


def test_sessions_are_never_split(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    hovers = [hover(flight) for flight in flights(folder)]
    found = conditions(hovers)
    assert list(found) == ["E9, 9 April", "E9, May"]
    for name, of in found.items():
        assert {session(one.flight) for condition in of for one in condition} == {name}
        totals = [cuts_of(condition).sum() for condition in of]
        assert totals == sorted(totals)
    healthy = Healthy([one for one in hovers if one.flight.healthy])
    assert "E8 a" not in {build(one.flight) for one in healthy.without("E8 a").hovers}

    asked = []

    def recorded(known: Known, judged: Sequence[drones.Hover], _noise: object) -> Verdict:
        asked.append((known, judged))
        lost = np.array([0.0, 0.0, 2.0, 0.0])
        ends = np.stack([lost, lost - 0.6, lost + 0.6], axis=1)
        return Verdict(True, 0.1, lost, lost, ends, np.full(4, 1.5))

    monkeypatch.setattr(drones, "infer", recorded)
    table = drones_table(folder)
    for known, judged in asked[:2]:
        (name,) = {session(one.flight) for one in judged}
        first = found[name][0]
        assert known.cuts.tolist() == cuts_of(first).tolist()
        np.testing.assert_allclose(known.level, np.mean([one.mean for one in first], axis=0))
        assert not {id(one) for one in first} & {id(one) for one in judged}
    assert len(asked) == 2 + 4 + 8 + 8
    assert table["rmse_mm"] == pytest.approx({"E9, 9 April": 0.5, "E9, May": 7.625**0.5})
    assert table["named"] == 0.5
    assert table["held_90_if_cut"] == pytest.approx(1 / 3)
    assert table["false_alarms"] == table["healthy_flights"] == 8
    assert table["would_not_show_mm"] == 1.5
    assert "| known: this build | 0.50 |" in drones_text(table)
    out = folder / "out"
    RealDrones(folder, out).execute()
    written = json.loads((out / "drones.json").read_text())
    assert written["rmse_mm"] == table["rmse_mm"]
    assert written["schema"] == "aquafish.real/1"
    assert is_drawn(out / "drones.png")


@pytest.mark.slow
def test_a_cut_is_found_with_its_interval_and_a_whole_drone_is_not_named(tmp_path: Path) -> None:
    motors = tmp_path / "motor_data"
    (tmp_path / "controller_data").mkdir()
    start = (0.0, 0.0, 1.0, 0.0)
    for k in range(3):
        cut = motors / "cut_propeller_M3_2.5mm_2mm_42.5mm" / f"E8_log0{k}"
        write_flight(cut, (0.0, 0.0, 3.5, 0.0), seed=k, known=start)
        write_flight(motors / "normal_flight" / f"E8_log0{k}", WHOLE, seed=50 + k, known=start)
    hovers = [hover(flight) for flight in flights(tmp_path)]
    known = Known(LEVEL, np.array(start), SPREAD)
    found = infer(known, [one for one in hovers if not one.flight.healthy], NOISE)
    assert found.broken
    assert found.nothing < 0.05
    assert found.mean.argmax() == 2
    middle, low, high = found.if_cut[2]
    assert low < 3.5 < high
    assert abs(middle - 3.5) < 0.8
    assert high - low < 4.0
    whole = infer(known, [one for one in hovers if one.flight.healthy], NOISE)
    assert not whole.broken
    assert whole.nothing > 0.5
    assert (whole.median == 0.0).all()
    assert ((whole.hidden > 0.3) & (whole.hidden < 3.0)).all()
