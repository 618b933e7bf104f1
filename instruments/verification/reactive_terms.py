"""The reactive terms held against what is known: one study, and its tables.

- ``lattice.py``: a rectangle's added mass from a lattice of vortex rings, against which the law's
  is held;
- ``water_momentum.py``: robot and water in momentum form, against which the scheme is;
- ``propulsion.py``: thrust and speed.
"""

from __future__ import annotations

from instruments.verification.convergence import INTERVAL
from instruments.verification.lattice import PANELS, added_mass_rows
from instruments.verification.paper_robot import (
    BODY_ADDED_INERTIA,
    BODY_ADDED_MASS,
    BODY_INERTIA,
    BODY_MASS,
)
from instruments.verification.propulsion import (
    FREQUENCIES,
    OFF_COURSE,
    WATCHED,
    course_rows,
    held_rows,
    swimming_rows,
)
from instruments.verification.tables import Report, Table
from instruments.verification.water_momentum import convergence_rows


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


def make_tables(report: Report) -> dict[str, Table]:
    """Return every table of what :func:`study` found."""
    return {
        "reactive_added_mass": added_mass_table(report),
        "reactive_added_inertia": added_inertia_table(report),
        "reactive_body": body_table(report),
        "reactive_convergence": convergence_table(report),
        "reactive_held": held_table(report),
        "reactive_swimming": swimming_table(report),
        "reactive_course": course_table(report),
    }
