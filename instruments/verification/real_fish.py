"""How speed and turning depend on the tail's beat: fish and robots of others beside our two laws.

Exponents and Strouhal numbers need no body size, so other robots can be compared with ours. The
published numbers are in ``fish_data.py``, our swims in ``tail_swims.py``.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from instruments.verification import fish_data
from instruments.verification.paper_robot import SWEEP
from instruments.verification.propulsion import BODY_LENGTH, tail_body
from instruments.verification.tables import Report, Table
from instruments.verification.tail_swims import SUBSTEPS, begun_swims, steady_swims, turns_per_beat

Array = NDArray[np.float64]

NAMED = {
    "nominal robot": tail_body(0.4, pectorals=True),
    "its tail alone": tail_body(0.4, pectorals=False),
    "thin tail alone": tail_body(0.02, pectorals=False),
}
# Tails alone, of every thickness with every length and height.
SIZES = {"thickness": (0.02, 0.2, 0.4), "length": (1.0, 1.4, 2.0), "height": (0.6, 1.0)}
TAILS = np.array([(0.0,) * 6 + sizes for sizes in itertools.product(*SIZES.values())])
BODIES = np.concatenate([list(NAMED.values()), TAILS])

AMPLITUDES = (15, 20, 25, 30)  # degrees
# Over the same ratio as the published ones. Beats last a whole number of samples.
FREQUENCIES = (2 / 9, 3 / 9, 4 / 9, 6 / 9, 9 / 9)  # Hz
LIVE = tuple(5.0 * f / FREQUENCIES[0] for f in FREQUENCIES)  # Hz, where Bainbridge's line begins
BIASES = (5, 10, 15)  # degrees, at an amplitude of 15


class Exponent(NamedTuple):
    """An exponent with the ends of its 95% interval."""

    slope: float
    low: float
    high: float


def exponent(x: Iterable[float], y: Iterable[float]) -> Exponent:
    """Return the exponent of y in x: least squares of the logarithms, with Student's t."""
    x, y = np.log(list(x)), np.log(list(y))
    line = stats.linregress(x, y)
    half = float(stats.t.ppf(0.975, len(x) - 2) * line.stderr)
    return Exponent(float(line.slope), float(line.slope) - half, float(line.slope) + half)


def _summary(values: Array) -> dict[str, float]:
    """Return the median and the range of what all tails do."""
    return {
        "slope": float(np.median(values)),
        "low": float(values.min()),
        "high": float(values.max()),
    }


def _rows(reactive: bool, x: Iterable[float], speeds: Array, strouhal: Array) -> list[Report]:
    """Return a row of each named robot and one of all tails, from (F, B) at the values of ``x``."""
    x = list(x)
    fits = [exponent(x, column) for column in speeds.T]
    per_beat = speeds[-1] / BODY_LENGTH  # the last ones are at 1 Hz
    rows = [
        {"swimmer": name, "reactive": reactive, **fit._asdict(), "x": x,
         "speeds": speeds[:, i].tolist(), "strouhal": float(strouhal[-1, i]),
         "lengths_per_beat": float(per_beat[i])}
        for i, (name, fit) in enumerate(zip(NAMED, fits, strict=False))
    ]  # fmt: skip
    alone = slice(len(NAMED), None)
    slopes = np.array([fit.slope for fit in fits[alone]])
    shares = speeds[:, alone] / speeds[-1, alone]
    rows.append(
        {"swimmer": f"{len(slopes)} tails", "reactive": reactive, **_summary(slopes), "x": x,
         "least": shares.min(axis=1).tolist(), "most": shares.max(axis=1).tolist(),
         "strouhal": _summary(strouhal[-1, alone]),
         "lengths_per_beat": _summary(per_beat[alone])}
    )  # fmt: skip
    return rows


def _published() -> Report:
    """Return the exponents of the published numbers."""
    fast = [run for run in fish_data.FREQUENCY_RUNS if run[0] >= 1]
    runs = {
        "frequency": fish_data.FREQUENCY_RUNS,
        "from 1 Hz": fast,
        "turning": fish_data.BIAS_RUNS,
    }
    found: Report = {
        name: exponent(*zip(*table, strict=True))._asdict() for name, table in runs.items()
    }
    found["amplitude"] = [
        exponent(*zip(*fish_data.speeds_at(i), strict=True))._asdict()
        for i in range(len(fish_data.SPEED_SECONDS))
    ]
    speeds = dict(fish_data.FREQUENCY_RUNS)
    scale = fish_data.LENGTH / fish_data.VISCOSITY
    found["strouhal"] = [
        {"frequency": f, "speed": speeds[f], "tip": tip, "strouhal": f * tip / speeds[f],
         "reynolds": speeds[f] * scale, "swimming": math.pi * f * tip * scale}
        for f, tip in fish_data.TIP_EXCURSION.items()
    ]  # fmt: skip
    found["bainbridge"] = exponent(LIVE, map(fish_data.bainbridge, LIVE)).slope
    found["tip"] = exponent(*zip(*fish_data.TIP_EXCURSION.items(), strict=True)).slope
    return found


def study(quick: bool = False) -> Report:
    """Return every exponent, and Strouhal numbers and turns; ``quick`` takes coarse steps."""
    fine = SUBSTEPS // 6 if quick else SUBSTEPS
    # With as many steps in every beat the scheme is as free of a time scale as the law.
    sweeps: dict[str, list[tuple[float, float, int]]] = {
        "amplitude": [(1.0, math.radians(a), fine) for a in AMPLITUDES],
        "half": [(1.0, math.radians(a), fine // 2) for a in AMPLITUDES],
        "frequency": [(f, SWEEP, round(fine * f)) for f in FREQUENCIES],
        "coarse": [(f, SWEEP, 1) for f in FREQUENCIES],
    }
    found: Report = {"published": _published(), **{name: [] for name in sweeps}}
    found |= {"from rest": [[] for _ in fish_data.SPEED_BEATS], "turning": []}
    unsettled: list[float] = []
    for reactive in (False, True):
        for name, points in sweeps.items():
            at = [steady_swims(BODIES, f, reactive, a, steps) for f, a, steps in points]
            x = FREQUENCIES if name in ("frequency", "coarse") else AMPLITUDES
            speeds, strouhal, rest = (np.array(part) for part in zip(*at, strict=True))
            unsettled.append(float(rest.max()))
            found[name] += _rows(reactive, x, speeds, strouhal)
        begun = [begun_swims(BODIES, reactive, a, fine) for a in AMPLITUDES]
        for rows, swims in zip(found["from rest"], zip(*begun, strict=True), strict=True):
            speeds, strouhal = (np.array(part) for part in zip(*swims, strict=True))
            rows += _rows(reactive, AMPLITUDES, speeds, strouhal)
        for bias in BIASES:
            turns = turns_per_beat(
                BODIES, reactive, math.radians(bias), math.radians(AMPLITUDES[0])
            )
            found["turning"].append(
                {"reactive": reactive, "bias": bias, "nominal": float(turns[0]),
                 **_summary(turns[len(NAMED) :])}
            )  # fmt: skip
    found["unsettled"] = max(unsettled)
    found["step_error"] = max(
        abs(a[end] - b[end])
        for a, b in zip(found["amplitude"], found.pop("half"), strict=True)
        for end in ("slope", "low", "high")
    )
    return found


def _law(row: Report) -> str:
    return "drag and reactive" if row["reactive"] else "drag"


def _interval(row: Report, digits: int = 2) -> str:
    return f"{row['slope']:.{digits}f} [{row['low']:.{digits}f}, {row['high']:.{digits}f}]"


def _range(value: float | Report, digits: int = 2) -> str:
    if isinstance(value, float):
        return f"{value:.{digits}f}"
    return _interval(value, digits)


def amplitude_table(report: Report) -> Table:
    """Return how speed depends on the tail's amplitude."""
    measured = map(_interval, report["published"]["amplitude"])
    return Table(
        "exponent of speed in amplitude, 15 to 30 degrees, with 95% interval; of many tails the "
        "median with the range",
        ("swimmer", "law", *(f"after {beats} beats" for beats in fish_data.SPEED_BEATS), "steady",
         "Strouhal number", "body lengths a beat"),
        [
            ("robot of Michigan State", "measured", *measured, "", "", ""),
            *((r["swimmer"], _law(r), *map(_interval, begun), _interval(r), _range(r["strouhal"]),
               _range(r["lengths_per_beat"]))
              for r, *begun in zip(report["amplitude"], *report["from rest"], strict=True)),
        ],
        words=2,
    )  # fmt: skip


def frequency_table(report: Report) -> Table:
    """Return how speed depends on the tail's frequency, at equal and at the engines' own steps."""
    published = report["published"]
    return Table(
        "exponent of speed in frequency, over a ratio of 4.5, likewise",
        ("swimmer", "law", "exponent", "at steps of 10 ms"),
        [
            ("robot of ETH Zurich", "measured", _interval(published["frequency"]), ""),
            ("the same from 1 Hz on", "measured", _interval(published["from 1 Hz"]), ""),
            ("excursion of its tip", "measured", f"{published['tip']:.2f}", ""),
            ("dace, trout, goldfish", "measured", f"{published['bainbridge']:.2f}", ""),
            *((r["swimmer"], _law(r), _interval(r, 3), _interval(coarse))
              for r, coarse in zip(report["frequency"], report["coarse"], strict=True)),
        ],
        words=2,
    )  # fmt: skip


def strouhal_table(report: Report) -> Table:
    """Return the soft-tailed robot's numbers without a unit, from its published swims."""
    return Table(
        "Strouhal, Reynolds and swimming numbers of the robot of ETH Zurich",
        ("frequency (Hz)", "speed (m/s)", "tip's excursion (m)", "Strouhal", "Re", "Sw"),
        [
            (f"{r['frequency']:g}", f"{r['speed']:.3f}", f"{r['tip']:.3f}", f"{r['strouhal']:.1f}",
             f"{r['reynolds']:.0e}", f"{r['swimming']:.0e}")
            for r in report["published"]["strouhal"]
        ],
        words=0,
    )  # fmt: skip


def turning_table(report: Report) -> Table:
    """Return how far a beat turns the fish, by the bias of its tail."""
    published = [
        (f"{bias}", "robot of Michigan State", "measured",
         ", ".join(f"{fish_data.turn_per_beat(turn):.3f}"
                   for other, turn in fish_data.BIAS_RUNS if other == bias))
        for bias in dict.fromkeys(bias for bias, _ in fish_data.BIAS_RUNS)
    ]  # fmt: skip
    ours = [
        (f"{r['bias']}", swimmer, _law(r), cell)
        for r in report["turning"]
        for swimmer, cell in (
            ("nominal robot", f"{r['nominal']:.4f}"),
            (f"{len(TAILS)} tails", _interval(r, 4)),
        )
    ]
    return Table(
        "change of heading in a beat (rad) at an amplitude of 15 degrees, likewise",
        ("bias (degrees)", "swimmer", "law", "turn"),
        published + ours,
        words=3,
    )


def make_tables(report: Report) -> dict[str, Table]:
    """Return every table of what :func:`study` found."""
    return {
        "real_fish_amplitude": amplitude_table(report),
        "real_fish_frequency": frequency_table(report),
        "real_fish_strouhal": strouhal_table(report),
        "real_fish_turning": turning_table(report),
    }
