"""The real fish: its reader, its law, and what is found from files that these tests write."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from aquafish_gym.engines.api import simulate as swim_in_engine
from aquafish_gym.utils.storage import DamagedFileError
from aquafish_gym.utils.validation import InvalidArgumentError
from eea.core.config import FitConfig
from experiments.real.beat import AHEAD, BEATS_HZ, Swing, cases_of, learn_swing, observe
from experiments.real.fish import LAW, errors, half_widths, infer, predict
from experiments.real.fish_report import draw_fish, fish_text
from experiments.real.fish_rivals import RIVALS
from experiments.real.michigan import folds, read, straight_speeds
from experiments.real.planar_fish import (
    CAPSULE_LENGTH,
    FRAME,
    WATER,
    Beat,
    Planar,
    Swimmer,
    planar_step,
    swim,
)
from instruments.verification.paper_robot import (
    BODY_ADDED_INERTIA,
    BODY_ADDED_MASS,
    BODY_INERTIA,
    BODY_MASS,
    CAUDAL_Y,
    SWEEP,
)
from tests.pictures import is_drawn

FISH = Swimmer(
    tail_length=0.08, tail_height=0.06, tail_drag=2.0, hinge=0.12, hull_length=0.2, hull_along=1.5,
    hull_across=6.0, sway_mass=2.5, yaw_inertia=0.004, servo_gain=0.8, trim=0.05, marker=-0.02,
)  # fmt: skip
COMMANDS = [(a, b) for a in (15, 25) for b in (-40, -20, 0, 30)]
FRAMES = 190
QUICK = FitConfig(alternatives="never", bodies=16, poses=1, descents=2, polished=1, restarts=0)
PLACE_NOISE = 0.001  # m
HEADING_NOISE = 0.01  # rad


def write_run(folder: Path, command: tuple[int, int], number: int = 1) -> None:
    """Write a run of a synthetic fish from rest on."""
    rng = np.random.default_rng([*map(abs, command), number, command[1] > 0])
    start = np.array([[0.5, 0.4, 0.0, 0.0, 0.0, 0.0, rng.uniform(0.0, 6.0)]])
    numbers = {name: np.array([value]) for name, value in FISH._asdict().items()}
    rate = np.array([2 * np.pi * rng.normal(2.0, 0.1)])
    tail = np.deg2rad([command])
    (pose,) = swim(numbers, tail, start, rate, np.array([FRAMES]), FRAMES)
    pose = pose + rng.normal(0.0, [PLACE_NOISE, PLACE_NOISE, HEADING_NOISE], pose.shape)
    x, y, heading = pose.T
    vx, vy, turn = np.gradient(pose, FRAME, axis=0).T
    surge = vx * np.cos(heading) + vy * np.sin(heading)
    sway = vy * np.cos(heading) - vx * np.sin(heading)
    wrapped = (heading + np.pi) % (2 * np.pi) - np.pi
    time = 0.1 + FRAME * np.arange(FRAMES)
    place = folder / f"Amp{command[0]}Bias{command[1]}"
    place.mkdir(exist_ok=True, parents=True)
    table = np.column_stack([time, surge, sway, turn, wrapped, x, y])
    np.savetxt(place / f"STATES{number}.txt", table, fmt="%.6f")


def test_runs_are_read_with_their_commands_and_an_unwrapped_heading(tmp_path: Path) -> None:
    write_run(tmp_path, (25, -40), 1)
    write_run(tmp_path, (15, 30), 2)
    first, second = read(tmp_path)
    assert first.command == (15, 30)
    assert second.command == (25, -40)
    assert first.tail == pytest.approx([0.2618, 0.5236], abs=1e-4)
    assert len(first.pose) == FRAMES
    assert first.samples == 32
    assert list(first.starts) == [4, 9, 14, 19]
    assert np.abs(np.diff(second.pose[:, 2])).max() < 1.0


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda lines: [line.rsplit(" ", 1)[0] for line in lines], "7 columns time, surge"),
        (lambda lines: lines[:20], "40 or more rows"),
        (lambda lines: lines[:50] + lines[51:], "none missing"),
        (lambda lines: [*lines, "1 2 x 4 5 6 7"], "no table of numbers"),
    ],
)
def test_a_damaged_run_is_refused_by_its_name(tmp_path: Path, spoil, said: str) -> None:  # type: ignore[no-untyped-def]
    write_run(tmp_path, (15, 30))
    path = tmp_path / "Amp15Bias30" / "STATES1.txt"
    path.write_text("\n".join(spoil(path.read_text().splitlines())))
    with pytest.raises(DamagedFileError, match=said) as raised:
        read(tmp_path)
    assert "Amp15Bias30/STATES1.txt" in str(raised.value)


def write_straight_run(folder: Path, amplitude: int, seconds: float = 6.0) -> None:
    """Write a filtered run whose speed in m/s is a hundredth of its time."""
    place = folder / f"Amp{amplitude}Bias0"
    place.mkdir(exist_ok=True)
    time = np.arange(0.7, seconds, FRAME)
    np.savetxt(place / "ASTATES1.txt", np.column_stack([time, 0.001 * time, time, time, time]))


def test_speeds_of_straight_runs_are_means_about_equal_times(tmp_path: Path) -> None:
    write_straight_run(tmp_path, 30)
    write_straight_run(tmp_path, 15)
    found = straight_speeds(tmp_path)
    assert [amplitude for amplitude, _ in found] == [15, 30]
    assert found[0][1] == pytest.approx([0.03, 0.04, 0.05], abs=2e-4)
    write_straight_run(tmp_path, 15, 5.0)
    with pytest.raises(DamagedFileError, match=r"must last until 5\.5 s; it ends at 4\.9"):
        straight_speeds(tmp_path)
    with pytest.raises(InvalidArgumentError, match="filtered runs without bias"):
        straight_speeds(tmp_path / "Amp15Bias0")


def test_folds_never_split_a_command(tmp_path: Path) -> None:
    for command in COMMANDS:
        write_run(tmp_path, command, 1)
        write_run(tmp_path, command, 2)
    runs = read(tmp_path)
    held = folds(runs)
    assert sorted(command for fold in held for command in fold) == sorted(COMMANDS)
    for fold in held:
        tested = {run.name for run in runs if run.command in fold}
        known = {run.name for run in runs if run.command not in fold}
        assert not {name.split("/")[0] for name in tested} & {n.split("/")[0] for n in known}


def test_the_state_is_that_of_the_fish_at_its_last_frame() -> None:
    t = FRAME * np.arange(-45, 1)
    heading = 0.3 + 0.2 * t - 0.05 * t**2 + 0.06 * np.sin(2 * np.pi * 1.9 * t + 1.2)
    along = 0.08 * t + 0.01 * t**2
    pose = np.column_stack([1.0 + along * np.cos(0.3), 2.0 + along * np.sin(0.3), heading])
    assert pytest.approx(np.round(BEATS_HZ, 2)) == BEATS_HZ
    state = observe(pose, Swing(2.1, 0.15, 0.01))
    rate = 2 * np.pi * 1.9
    assert state.beat == pytest.approx(1.9, abs=1e-6)
    assert state.phase == pytest.approx(1.2, abs=1e-6)
    assert state.heading == pytest.approx(heading[-1], abs=1e-9)
    assert state.yaw_rate == pytest.approx(0.2 + 0.06 * rate * math.cos(1.2), abs=1e-6)
    # The velocity has the direction 0.3, the fish that of its heading.
    off = heading[-1] - 0.3
    assert state.surge == pytest.approx(0.08 * math.cos(off), abs=1e-6)
    assert state.sway == pytest.approx(-0.08 * math.sin(off), abs=1e-6)
    assert (state.x, state.y) == pytest.approx((1.0, 2.0), abs=1e-9)


def test_the_planar_law_is_the_engines() -> None:
    """A tail alone, of no thickness, swims in the plane as in the engine."""
    length, height, beat = 1.4, 0.6, 1.0
    samples, substeps = 150, 20
    log = swim_in_engine(
        [[0.0] * 6 + [0.0, length, height]],
        np.tile([0.0, 0.0, beat], (1, samples, 1)),
        (0.0, 0.0, 0.4),
        steps=samples,
        dtype="float64",
        substeps=substeps,
        record="pose",
        reactive=True,
        begun=1,
        velocity=(0.3, 0.8, 0.0),
        spin=(0.0, 0.0, 0.5),
    )
    unit = (WATER * (BODY_MASS + BODY_ADDED_MASS[1])) ** (-1 / 3)  # m: the surge mass is 1 kg
    fish = Swimmer(
        tail_length=length * unit,
        tail_height=height * unit,
        tail_drag=1.0,
        hinge=-CAUDAL_Y * unit,
        hull_length=CAPSULE_LENGTH * unit,
        hull_along=1.0,
        hull_across=1.0,
        sway_mass=WATER * unit**3 * (BODY_MASS + BODY_ADDED_MASS[0]),
        yaw_inertia=WATER * unit**5 * (BODY_INERTIA[2] + BODY_ADDED_INERTIA[2]),
        servo_gain=1.0,
        trim=0.0,
        marker=0.0,
    )
    # The engine's fish begins with its nose along y.
    state = Planar(0.0, 0.0, math.pi / 2, 0.8 * unit, -0.3 * unit, 0.5, 0.4)
    for _ in range(samples * substeps):
        state = planar_step(fish, Beat(SWEEP, 0.0, 2 * math.pi * beat), state, 0.01 / substeps)
    assert log.position is not None
    assert log.rpy is not None
    swum = np.array([state.x, state.y]) / unit
    assert swum == pytest.approx(log.position[0, -1, :2], abs=2e-3)
    assert np.linalg.norm(swum) > 0.5
    turned = state.heading - math.pi / 2
    assert turned == pytest.approx(log.rpy[0, -1, 2], abs=2e-3)
    assert abs(turned) > 0.05


@pytest.mark.slow
def test_a_synthetic_fish_is_found_again_and_predicted_at_other_commands(tmp_path: Path) -> None:
    for command in COMMANDS:
        write_run(tmp_path, command)
    runs = read(tmp_path)
    held = folds(runs)[0]
    known = cases_of([run for run in runs if run.command not in held])
    new = cases_of([run for run in runs if run.command in held])
    swing = learn_swing(known)
    draws = infer(known, swing, config=QUICK)
    assert draws["trim"].mean() == pytest.approx(FISH.trim, abs=0.03)
    before = predict(draws, known, swing)
    ours = predict(draws, new, swing)
    left = errors(ours.pose, new)
    assert ours.pose.shape == (len(new), AHEAD // 6, 3)
    last = left[:, 9]  # after 2 s
    assert np.sqrt((last[:, :2] ** 2).sum(axis=1).mean()) < 0.015
    assert np.sqrt((last[:, 2] ** 2).mean()) < 0.06
    there = np.isfinite(left)
    inside = np.abs(left) <= half_widths(before, known, ours)
    assert 0.75 < inside[there].mean() <= 1.0


def test_the_report_has_a_row_a_predictor_and_a_picture(tmp_path: Path) -> None:
    seconds = [0.2 * (i + 1) for i in range(25)]
    rows = {
        name: {"position_cm": [k * t for t in seconds], "heading_rad": [0.01 * t for t in seconds]}
        for k, name in enumerate((LAW, *RIVALS), 1)
    }
    paths = {"seen": [[0.5, 0.4], [0.6, 0.5]], "predicted": [[0.5, 0.4], [0.6, 0.4]]}
    table = {
        "seconds": seconds,
        "by_second": rows,
        "cases": {"2": 7, "5": 3},
        "held_90": 0.9,
        "held_90_by": {"2": [0.9, 0.8, 1.0], "5": [1.0, 1.0, 0.5]},
        "swims": [{"command": [20, 50], **paths}],
        "straight_speeds": [(15, [0.05, 0.06, 0.07])],
    }
    said = fish_text(table)
    assert f"| {LAW} | 2.0 cm, 0.02 rad | 5.0 cm, 0.05 rad |" in said
    assert f"| {RIVALS[0]} | 4.0 cm" in said
    assert "| 15 | 0.0500 | 0.0600 | 0.0700 |" in said
    draw_fish(table, tmp_path / "fish.png")
    assert is_drawn(tmp_path / "fish.png")
