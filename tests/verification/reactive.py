"""The reactive terms held against what is known: ``python -m tests.verification.reactive``.

- ``lattice.py``: a rectangle's added mass from a lattice of vortex rings, against which the law's
  is held;
- :class:`ReactiveMomentum`: robot and water in momentum form, by RK4, against which the scheme is;
- :func:`held_rows` and :func:`swimming_rows`: the thrust of a tail on a body held still, and how
  fast a tail alone swims, with and without the terms.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from aquafish_gym.engines.base import TIMESTEP, Trials, simulate
from aquafish_gym.morphology import DIMENSIONS, Morphology
from aquafish_gym.physics.added_mass import (
    BODY_ADDED_INERTIA,
    BODY_ADDED_MASS,
    finite_span,
    plate_inertia,
    plate_mass,
)
from aquafish_gym.physics.dynamics import forces, on_body
from aquafish_gym.physics.hydrodynamics import DENSITY
from aquafish_gym.physics.kinematics import SWEEP, State
from aquafish_gym.physics.layout import robot_from_column, robot_parameters
from aquafish_gym.physics.reactive import added_water
from aquafish_gym.physics.robot import BODY_INERTIA, BODY_MASS, CAUDAL_Y, NOSE, Fin, Robot
from aquafish_gym.utils.command_line import run_command_line, single_command
from aquafish_gym.utils.validation import integer
from tests.verification.convergence import INTERVAL, WHAT, path_gaps
from tests.verification.lattice import PANELS, added_mass_rows
from tests.verification.momentum import (
    AXES,
    HINGES,
    Momentum,
    about,
    inertia_and_swing,
)
from tests.verification.rk4 import cross, rotation_matrix
from tests.verification.tables import Report, Table
from tests.verification.trials import random_trials

Array = NDArray[np.float64]

# --- robot and water in momentum form -------------------------------------------------------


def _added_by_plates(fin: Fin) -> Array:
    """Return a fin's added masses and inertias, (6,), along and about its frame's axes.

    Each plate brings a mass along its normal, and an inertia about either axis in its plane.
    """
    sizes, found = (fin.width, fin.length, fin.thickness), np.zeros(6)
    for normal in range(3):
        one, other = (axis for axis in range(3) if axis != normal)
        found[normal] += plate_mass(sizes[one], sizes[other])
        found[3 + one] += plate_inertia(sizes[one], sizes[other])
        found[3 + other] += plate_inertia(sizes[other], sizes[one])
    return found


def _fin_axes(which: int, angle: float) -> Array:
    """Return a fin's width, length and normal axis as the columns of a matrix."""
    hinge = np.eye(3) if which < 2 else np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]])
    axes: Array = about(AXES[which], angle) @ hinge
    return axes


def _skew(v: Array) -> Array:
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def water_inertia_and_swing(robot: Robot, angles: Array, rates: Array) -> tuple[Array, Array]:
    """Return what ``momentum.inertia_and_swing`` does, of the water that is carried along.

    By virtual work: each fin's added masses, in its own frame, seen through the matrix that
    gives its motion from the body's.
    """
    inertia = np.diag([*BODY_ADDED_MASS, *BODY_ADDED_INERTIA]).astype(np.float64)
    swing = np.zeros(6)
    for i, fin in enumerate(robot):
        axes = _fin_axes(i, angles[i])
        arm = -0.5 * fin.length * axes[:, 1]
        to_fin = np.kron(np.eye(2), axes.T)
        moves = to_fin @ np.block(
            [[np.eye(3), -_skew(HINGES[i] + arm)], [np.zeros((3, 3)), np.eye(3)]]
        )
        of_joint = to_fin @ np.concatenate([cross(AXES[i], arm), AXES[i]])
        carried = moves.T @ np.diag(_added_by_plates(fin))
        inertia += carried @ moves
        swing += rates[i] * (carried @ of_joint)
    return inertia, swing


class ReactiveMomentum(Momentum):
    """One robot under one command in water with reactive terms; its momenta are the whole's.

    Parameters
    ----------
    robot, command, fin_angles, wet
        As :class:`~tests.verification.momentum.Momentum` has them; ``wet=False`` leaves
        out the drag and what the tail sheds, not the water that is carried along.
    """

    def inertia_and_swing(self, t: float) -> tuple[Array, Array]:
        """Return inertia (6, 6) and swing (6,) of robot and water."""
        angles, rates, _ = self.joints(t)
        (a, b), (c, d) = (
            inertia_and_swing(self.robot, angles, rates),
            water_inertia_and_swing(self.robot, angles, rates),
        )
        return a + c, b + d

    def moving(self, velocity: Array, spin: Array) -> Array:
        """Return y at the origin, upright, with a velocity (3,) and a spin (3,) at t = 0."""
        inertia, swing = self.inertia_and_swing(0.0)
        y = self.at_rest()
        y[7:] = inertia @ np.concatenate([velocity, spin]) + swing
        return y

    def velocities(self, t: float, y: Array) -> tuple[Array, Array]:
        """Return the body's velocity and spin, both in body axes."""
        inertia, swing = self.inertia_and_swing(t)
        v = np.asarray(np.linalg.solve(inertia, y[7:] - swing), np.float64)
        return v[:3], v[3:]

    def water(self, t: float, q: Array, velocity: Array, spin: Array) -> tuple[Array, Array]:
        """Return drag's and the shed water's force and torque, in body axes."""
        force, torque = super().water(t, q, velocity, spin)
        angles, rates, _ = self.joints(t)
        fin, axes = self.robot.caudal, _fin_axes(2, angles[2])
        along, normal = axes[:, 1], axes[:, 2]
        arm = -fin.length * along
        at = HINGES[2] + arm
        end = rotation_matrix(q).T @ velocity + cross(spin, at) + rates[2] * cross(AXES[2], arm)
        m = DENSITY * math.pi / 4 * fin.width**2 * finite_span(fin.width, fin.length)
        u, w = float(end @ along), float(end @ normal)
        shed = 0.5 * m * w**2 * along - m * max(u, 0.0) * w * normal
        return force + shed, torque + cross(at, shed)


SUBSTEPS = (1, 2, 4, 8)


def reactive_reference(trials: Trials, robot: int, samples: int, h: float = TIMESTEP) -> Array:
    """Return position, quaternion and spin (samples, 10) of one robot by RK4."""
    model = ReactiveMomentum.of(
        trials.morphologies[robot], trials.commands[robot], trials.fin_angles[robot]
    )
    y, path = model.at_rest(), []
    for i in range(samples):
        y = model.run(y, h, round(INTERVAL / h), i * INTERVAL)
        _, spin = model.velocities((i + 1) * INTERVAL, y)
        path.append(np.concatenate([y[:7], spin]))
    return np.array(path)


def scheme_errors(trials: Trials, samples: int) -> list[dict[str, Array]]:
    """Return each robot's largest gap to RK4 (B,), of each of ``WHAT``, for each ``SUBSTEPS``."""
    truths = np.array([reactive_reference(trials, i, samples) for i in range(len(trials))])
    every, found = round(INTERVAL / TIMESTEP), []
    for substeps in SUBSTEPS:
        log = simulate(
            trials.morphologies, trials.commands, trials.fin_angles, steps=samples * every,
            substeps=substeps, dtype="float64", record="pose", reactive=True,
        )  # fmt: skip
        assert log.position is not None
        assert log.quaternion is not None
        assert log.gyro is not None
        paths = np.concatenate([log.position, log.quaternion, log.gyro], axis=2)
        found.append(path_gaps(paths[:, every - 1 :: every], truths))
    return found


def convergence_rows(robots: int, samples: int, seed: int) -> list[dict[str, object]]:
    """Return the scheme's median and largest error at each step, and the order that is seen."""
    found = scheme_errors(random_trials(robots, seed), samples)
    rows: list[dict[str, object]] = []
    for what, unit in WHAT.items():
        medians = [float(np.median(gap[what])) for gap in found]
        for i, substeps in enumerate(SUBSTEPS):
            following = medians[i + 1] if i + 1 < len(medians) else None
            rows.append(
                {
                    "what": what,
                    "unit": unit,
                    "step": TIMESTEP / substeps,
                    "median": medians[i],
                    "maximum": float(found[i][what].max()),
                    "order": None if following is None else math.log2(medians[i] / following),
                }
            )
    return rows


# --- thrust and speed -----------------------------------------------------------------------

TAILS = {"prototype": 0.4, "thin": 0.02}  # thickness
FREQUENCIES = (0.25, 0.5, 0.75, 1.0)  # Hz
# Beats from rest: the first are the time to settle, over the others the speed is measured. Many
# more would let the pitch that rounding starts grow, where a robot's course is unstable.
BEATS = (40, 50)
BODY_LENGTH = 2 * NOSE


def tail_body(thickness: float, pectorals: bool) -> Array:
    """Return nine sizes: the nominal body's but for the tail's thickness, or its tail alone."""
    sizes = Morphology.nominal().to_array()
    for i, dimension in enumerate(DIMENSIONS):
        if dimension.fin != "caudal" and not pectorals:
            sizes[i] = 0.0
        elif dimension.name == "caudal.thickness":
            sizes[i] = thickness
    return sizes


def bessel_j1(x: float) -> float:
    """Return the Bessel function J1 of a small x, by its series."""
    return math.fsum(
        (-1) ** k * (x / 2) ** (2 * k + 1) / (math.factorial(k) * math.factorial(k + 1))
        for k in range(12)
    )


def lighthill_thrust(fin: Fin, frequency: float) -> float:
    """Return the mean thrust of a tail on a body held still, in closed form.

    The mean over a cycle of 1/2 m w^2 cos(angle), with w = length * rate and
    angle = SWEEP sin(phase), is 1/2 m length^2 omega^2 SWEEP J1(SWEEP).
    """
    m = DENSITY * math.pi / 4 * fin.width**2 * finite_span(fin.width, fin.length)
    omega = 2 * math.pi * frequency
    return float(0.5 * m * fin.length**2 * omega**2 * SWEEP * bessel_j1(SWEEP))


def held_thrust(robot: Robot, frequency: float, points: int = 64) -> tuple[float, float]:
    """Return the mean force forward on a body held still, by drag and by the reactive terms."""
    still, omega = (0.0, 0.0, 0.0), 2 * math.pi * frequency
    drag = reactive = 0.0
    for phase in 2 * math.pi * (np.arange(points) + 0.5) / points:
        c, s = math.cos(phase), math.sin(phase)
        rates = (0.0, 0.0, SWEEP * omega * c)
        state = State(
            (0.0, 0.0, 0.0, 1.0), still, still, still, (1.0, 0.0), (1.0, 0.0), (c, s), rates
        )
        push = (0.0, 0.0, -SWEEP * omega**2 * s)
        drag += on_body(state, forces(robot, state, still))[0][1] / points
        reactive += added_water(robot, state, push, still).force[1] / points
    return drag, reactive


def held_rows() -> list[dict[str, object]]:
    """Return each tail's mean thrust at 1 Hz on a body held still."""
    rows: list[dict[str, object]] = []
    for tail, thickness in TAILS.items():
        robot = robot_from_column(robot_parameters(tail_body(thickness, False)[None])[:, 0])
        drag, reactive = held_thrust(robot, 1.0)
        closed = lighthill_thrust(robot.caudal, 1.0)
        rows.append({"tail": tail, "drag": drag, "reactive": reactive, "lighthill": closed})
    return rows


def _tip_path(position: Array, turns: Array, phase: Array, length: float) -> Array:
    """Return where the tail's tip is in the world, (T, 3)."""
    angle = SWEEP * np.sin(phase)
    tip = np.stack(
        [length * np.sin(angle), CAUDAL_Y - length * np.cos(angle), np.zeros_like(angle)], axis=1
    )
    path: Array = position + np.einsum("tij,tj->ti", turns, tip)
    return path


def swim_straight(
    bodies: Array, frequency: float, reactive: bool, beats: tuple[int, int] = BEATS
) -> list[tuple[float, float | None]]:
    """Return speed in body lengths/s and Strouhal's number of robots that beat their tails.

    Strouhal's number is frequency times the tip's whole excursion across the path, over the
    speed; None where the robot does not swim forward.

    Parameters
    ----------
    bodies
        (B, 9) sizes.
    frequency
        Of the tail, Hz.
    reactive
        Whether with the reactive terms.
    beats
        From rest to where measuring begins, and to where it ends.
    """
    first, end = (round(n / (frequency * TIMESTEP)) for n in beats)
    log = simulate(
        bodies, (0.0, 0.0, frequency), steps=end, dtype="float64", record="pose", reactive=reactive
    )
    positions, quaternions, angles = (
        np.asarray(part, np.float64)[:, first - 1 :]
        for part in (log.position, log.quaternion, log.fin_angles)
    )
    found: list[tuple[float, float | None]] = []
    for body, position, quaternion, fins in zip(
        bodies, positions, quaternions, angles, strict=True
    ):
        turns = np.array([rotation_matrix(q) for q in quaternion])
        heading = turns[1:, :, 1].mean(axis=0)
        heading /= np.linalg.norm(heading)
        aside = cross(heading, np.array([0.0, 0.0, 1.0]))
        speed = float((position[-1] - position[0]) @ heading) / ((end - first) * TIMESTEP)
        tip = _tip_path(position, turns, fins[:, 2], float(body[7]))
        excursion = float(np.ptp(tip @ aside))
        found.append(
            (speed / BODY_LENGTH, frequency * excursion / speed if speed > 0.001 else None)
        )
    return found


def swimming_rows(beats: tuple[int, int] = BEATS) -> list[dict[str, object]]:
    """Return how fast tails swim, alone and with the nominal pectorals trailing."""
    cases = [(tail, pectorals) for tail in TAILS for pectorals in (False, True)]
    bodies = np.array([tail_body(TAILS[tail], pectorals) for tail, pectorals in cases])
    return [
        {
            "tail": tail,
            "pectorals": pectorals,
            "frequency": frequency,
            "reactive": reactive,
            "speed": speed,
            "strouhal": strouhal,
        }
        for reactive in (False, True)
        for frequency in FREQUENCIES
        for (tail, pectorals), (speed, strouhal) in zip(
            cases, swim_straight(bodies, frequency, reactive, beats), strict=True
        )
    ]


# A vertical current so weak starts no more than a disturbance.
DISTURBANCE, OFF_COURSE, WATCHED = 1e-3, 0.5, 300  # units/s, rad, beats


def course_rows(watched: int = WATCHED) -> list[dict[str, object]]:
    """Return after how many beats at 1 Hz a slight disturbance has pitched a swimmer off course.

    None if it holds its course for as long as it was ``watched``.
    """
    rows: list[dict[str, object]] = []
    for reactive in (False, True):
        for tail, thickness in TAILS.items():
            for pectorals in (False, True):
                log = simulate(
                    tail_body(thickness, pectorals), (0.0, 0.0, 1.0),
                    steps=round(watched / TIMESTEP), dtype="float64", record="pose",
                    current=(0.0, 0.0, DISTURBANCE), reactive=reactive,
                )  # fmt: skip
                assert log.quaternion is not None
                x, y, z, w = log.quaternion[0].T
                off = np.abs(2 * (y * z + x * w)) > math.sin(OFF_COURSE)  # of the body's axis
                beats = float(np.argmax(off)) * TIMESTEP if off.any() else None
                rows.append(
                    {"tail": tail, "pectorals": pectorals, "reactive": reactive, "beats": beats}
                )
    return rows


# --- the report -----------------------------------------------------------------------------


def study(seed: int = 0, quick: bool = False) -> Report:
    """Return all figures on the reactive terms; ``quick`` makes each of next to nothing."""
    robots, seconds = (2, 0.64) if quick else (20, 5.12)
    return {
        "robots": robots,
        "seconds": seconds,
        "added_mass": added_mass_rows(2 if quick else PANELS),
        "body": [
            {"what": what, "ratio": ratio}
            for what, ratio in (
                ("along", BODY_ADDED_MASS[1] / BODY_MASS),
                ("across", BODY_ADDED_MASS[0] / BODY_MASS),
                ("turning", BODY_ADDED_INERTIA[0] / BODY_INERTIA[0]),
            )
        ],
        "convergence": convergence_rows(robots, round(seconds / INTERVAL), seed),
        "held": held_rows(),
        "swimming": swimming_rows((4, 6)) if quick else swimming_rows(),
        "course": course_rows(20) if quick else course_rows(),
        "watched": 20 if quick else WATCHED,
    }


def _share_table(report: Report, motion: str, title: str) -> Table:
    return Table(
        title,
        ("length / width", "lattice", "law", "its error"),
        [
            (f"{r['aspect']:g}", f"{r[f'{motion}_lattice']:.3f}", f"{r[f'{motion}_law']:.3f}",
             f"{r[f'{motion}_error']:+.1%}")
            for r in report["added_mass"]
        ],
        words=0,
    )  # fmt: skip


def added_mass_table(report: Report) -> Table:
    """Return the law's share of an endless strip's added mass, against the lattice's."""
    return _share_table(report, "normal", "added mass of a rectangle, as a share of a strip's")


def added_inertia_table(report: Report) -> Table:
    """Return the same of its inertia about the width axis."""
    return _share_table(report, "swing", "added inertia of a rectangle about its width, likewise")


def body_table(report: Report) -> Table:
    """Return the ellipsoid's added mass and inertia."""
    return Table(
        "added mass and inertia of the body, relative to its own",
        ("motion", "ratio"),
        [(r["what"], f"{r['ratio']:.3f}") for r in report["body"]],
    )


def convergence_table(report: Report) -> Table:
    """Return the scheme's error at each step."""
    return Table(
        f"with reactive terms, the scheme against RK4, {report['robots']} robots over "
        f"{report['seconds']:g} s",
        ("what", "step (s)", "median", "maximum", "order"),
        [
            (f"{r['what']} ({r['unit']})", f"{r['step']:g}", f"{r['median']:.1e}",
             f"{r['maximum']:.1e}", "" if r["order"] is None else f"{r['order']:.2f}")
            for r in report["convergence"]
        ],
    )  # fmt: skip


def held_table(report: Report) -> Table:
    """Return the thrust of a tail on a body held still."""
    return Table(
        "mean thrust of a tail at 1 Hz on a body held still",
        ("tail", "drag", "reactive terms", "Lighthill"),
        [
            # Rounding leaves 1e-16 where there is none.
            (r["tail"], *(f"{round(r[k], 9) + 0.0:.4f}" for k in ("drag", "reactive", "lighthill")))
            for r in report["held"]
        ],
    )


def _kind(row: Report) -> tuple[str, str, str]:
    """Return a swimmer's tail, pectorals and law in words."""
    return (
        row["tail"],
        "trailing" if row["pectorals"] else "none",
        "drag and reactive" if row["reactive"] else "drag",
    )


def swimming_table(report: Report) -> Table:
    """Return speeds, with Strouhal's number in brackets, one column a frequency."""
    cells: dict[tuple[str, str, str], list[str]] = {}
    for r in report["swimming"]:
        number = "-" if r["strouhal"] is None else f"{r['strouhal']:.2f}"
        cells.setdefault(_kind(r), []).append(f"{r['speed'] + 0.0:.3f} ({number})")
    return Table(
        "speed in body lengths/s (Strouhal's number)",
        ("tail", "pectorals", "law", *(f"{f:g} Hz" for f in FREQUENCIES)),
        [(*kind, *row) for kind, row in sorted(cells.items(), key=lambda item: item[0])],
        words=3,
    )


def course_table(report: Report) -> Table:
    """Return for how long swimmers hold their course."""
    return Table(
        f"beats at 1 Hz until a disturbance has pitched a swimmer by {OFF_COURSE:g} rad",
        ("tail", "pectorals", "law", "beats"),
        [
            (*_kind(r), f"over {report['watched']}" if r["beats"] is None else f"{r['beats']:.0f}")
            for r in sorted(report["course"], key=_kind)
        ],
        words=3,
    )


REACTIVE_TABLES = {
    "reactive_added_mass": added_mass_table,
    "reactive_added_inertia": added_inertia_table,
    "reactive_body": body_table,
    "reactive_convergence": convergence_table,
    "reactive_held": held_table,
    "reactive_swimming": swimming_table,
    "reactive_course": course_table,
}


def make_tables(report: Report) -> dict[str, Table]:
    """Return every table of what :func:`study` found."""
    return {name: make(report) for name, make in REACTIVE_TABLES.items()}


@dataclass(frozen=True)
class Reactive:
    """Hold the optional reactive terms against what is known, and print what was found."""

    seed: int = 0
    """All that is random follows from it."""
    quick: bool = False
    """Run each study on next to nothing, to see that it runs."""
    markdown: bool = False
    """Print the tables in Markdown."""

    def execute(self) -> None:
        """Run the studies and print the tables."""
        integer("seed", self.seed, 0)
        for table in make_tables(study(self.seed, self.quick)).values():
            if self.markdown:
                print(f"\n{table.title}\n\n{table.markdown()}")
            else:
                Console(highlight=False).print(table.rich())


if __name__ == "__main__":
    sys.exit(run_command_line("tests.verification.reactive", single_command(Reactive)))
