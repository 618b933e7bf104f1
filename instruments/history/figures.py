"""The figures that the history follows, read from the files that other commands commit.

A figure's name is "FAMILY: WHICH"; a family has one panel of the picture. A file of an old commit
may lack figures, or hold them in another form: then they are left out.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from instruments.inference.settings import EVERY

DIGITS = 6  # significant ones are kept


@dataclass(frozen=True)
class Figure:
    """A measured number.

    Attributes
    ----------
    value
        The number. It is positive if there is no interval.
    low, high
        Its 95% interval; None for what was measured without one, such as a ratio of speeds.

    Examples
    --------
    >>> round(Figure(23.6, 21.3, 25.9).sd, 2)
    1.17
    """

    value: float
    low: float | None = None
    high: float | None = None

    @property
    def sd(self) -> float | None:
        """The standard deviation of a normal density with this interval; None without one."""
        if self.low is None or self.high is None or not self.low < self.high:
            return None
        return (self.high - self.low) / (2.0 * 1.96)

    def document(self) -> list[float]:
        """Return value, low and high, or the value alone, ready for JSON."""
        ends = [end for end in (self.low, self.high) if end is not None]
        return [float(f"{number:.{DIGITS}g}") for number in (self.value, *ends)]


Figures = dict[str, Figure]


def inference_figures(text: str) -> Figures:
    """Return how often 90% intervals hold, of ``python -m instruments.inference``'s report."""
    found = {}
    for name, part in json.loads(text)["settings"].items():
        if name in ("quiet", "loud", "prior", "world", "edges"):
            held = part["coverage"]["90%"]
            title = f"coverage of 90% intervals: {EVERY[name].title}"
            found[title] = Figure(held["share"], *held["interval"])
    return found


LEAGUE_ENTRANTS = ("PPO, fins", "RMA", "blind", "self-model", "oracle")


def league_figures(text: str) -> Figures:
    """Return distances after the damage in units of 5 cm, of ``examples/recovery_league.py``."""
    league = json.loads(text)
    found = {}
    for entrant in LEAGUE_ENTRANTS:
        for tier, part in league.get(entrant, {}).items():
            found[f"league, {tier}: {entrant}"] = Figure(*part["way_after_onset"])
    for tier, part in league.get("self-model", {}).items():
        if gain := part.get("over", {}).get("blind"):
            found[f"league, self-model's gain: {tier}"] = Figure(*gain["mean"])
    return found


SCORED = ("CMA-ES, fins", "PPO, fins")
_CELL = re.compile(r"(-?[\d.]+) \[(-?[\d.]+), (-?[\d.]+)\]")


def score_figures(text: str) -> Figures:
    """Return the returns of reference controllers, of ``python -m experiments.scores``."""
    lines = [[cell.strip() for cell in line.split("|")[1:-1]] for line in text.splitlines()]
    head, *rows = (line for line in lines if line and not line[0].startswith("-"))
    found = {}
    for row in rows:
        cells = dict(zip(head, row, strict=True))
        if cells["controller"] not in SCORED or "," in cells["environment"]:
            continue
        for tier in ("whole", "severe"):
            if match := _CELL.fullmatch(cells[tier]):
                name = f"return, {tier}: {cells['environment']}, {cells['controller']}"
                found[name] = Figure(*map(float, match.groups()))
    return found


_INFERRED = ("out-of-band", "joint-fins", "swims-on")
# Measure of the report -> its name here, and the treatments whose results vary in it.
_RECOVERED = {
    "objective_fitness": ("OBJ_FIT", _INFERRED),
    "target_distance_random_poses": ("distance", ("undamaged", *_INFERRED, "oracle-fins")),
}


def recovery_figures(text: str) -> Figures:
    """Return distances in units of 5 cm and errors of bodies, of ``aquafish recover``."""
    found = {}
    for treatment, part in json.loads(text)["treatments"].items():
        for measure, (word, followed) in _RECOVERED.items():
            if treatment in followed and measure in part["spread"]:
                spread = part["spread"][measure]
                name = f"case study, {word}: {treatment}"
                found[name] = Figure(spread["mean"], *spread["interval"])
    return found


# A row of the benchmark's table: what, engine, dtype, batch, threads, rate, ratio.
_TIMED = re.compile(
    r" *(\d+) (.+?) +(pybullet|numba|mujoco|-) +(float32|float64|-) +(\d+) +(\d+) +(.+?)"
    r" +(?:-|[\d.]+% of #\d+|([\d,.]+) x #(\d+))"
)
_Timed = tuple[str, ...]
# The row and the one that it is compared with -> the figure.
RATIOS: Mapping[tuple[_Timed, _Timed], str] = {
    (("AquaFish-v0", "numba", "float64", "1", "1"),
     ("AquaFish-v0", "pybullet", "float64", "1", "1")): "AquaFish-v0, numba to PyBullet",
    (("damaged episodes", "numba", "float32", "1024", "1"),
     ("AquaFish-v0", "pybullet", "float64", "1", "1")): "episodes of 1,024 to one on PyBullet",
    (("LaneVecEnv", "numba", "float32", "1024", "2"),
     ("DummyVecEnv", "pybullet", "float64", "8", "1")): "LaneVecEnv of 1,024 to 8 on PyBullet",
    (("our law, no log", "numba", "float32", "4096", "1"),
     ("our law, no log", "pybullet", "float64", "8", "1")): "4,096 open loops to 8 on PyBullet",
    (("our law, pose", "numba", "float32", "256", "1"),
     ("rollout, box fluid", "mujoco", "float64", "256", "1")): "256 open loops to MuJoCo",
    (("30 evolved, 6 nodes", "numba", "float32", "150", "1"),
     ("neat-python's network", "pybullet", "float64", "1", "1")): "NEAT's 150 to one on PyBullet",
    (("PPO, SB3VecEnv", "numba", "float32", "64", "2"),
     ("PPO, DummyVecEnv", "numba", "float64", "64", "1")): "PPO, SB3VecEnv to DummyVecEnv",
}  # fmt: skip
TIMES = ("PPO, DummyVecEnv", "PPO, SB3VecEnv")


def speed_figures(text: str) -> Figures:
    """Return ratios of speed and PPO's seconds to its score, of docs/performance.md."""
    found = {}
    for table in re.findall(r"```text\n(.*?)```", text, re.DOTALL):
        rows: dict[str, _Timed] = {}
        for line in table.splitlines():
            if match := _TIMED.fullmatch(line):
                number, *row, rate, ratio, other = match.groups()
                rows[number] = tuple(row)
                name = RATIOS.get((rows[number], rows.get(other, ())))
                if ratio and name:
                    found[f"ratio of speed: {name}"] = Figure(float(ratio.replace(",", "")))
                if row[0] in TIMES and rate.endswith(" s"):
                    found[f"seconds to 90% of the score: {row[0]}"] = Figure(float(rate[:-2]))
    return found


#: File of the repository -> what reads its text.
SOURCES: Mapping[str, Callable[[str], Figures]] = {
    "docs/inference/report.json": inference_figures,
    "docs/results/league/league.json": league_figures,
    "docs/results/scores/table.md": score_figures,
    "docs/results/scores/return.md": score_figures,
    "docs/recovery/report.json": recovery_figures,
    "docs/performance.md": speed_figures,
}


def family_of(name: str) -> tuple[str, str]:
    """Return a figure's family, and which of the family it is."""
    family, _, which = name.partition(": ")
    return family, which


def read_figure(numbers: Any) -> Figure:
    """Return the figure of a row's numbers: the value, or the value and its interval's ends."""
    return Figure(*map(float, numbers))
