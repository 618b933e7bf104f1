"""What each threshold of the agent is worth: the league's short form.

    python -m experiments.league.thresholds --out out/thresholds

A few short episodes of the seeds *development*, of all that an agent meets, are played with each
threshold of ``aquafish/online/thresholds.py`` halved and doubled. The same command resumes.
table.md says by how many units the way after the onset changes in the mean, and in how many
episodes anything changes: the way after an action, or what the agent notices or decides.
"""

from __future__ import annotations

import hashlib
import inspect
import json
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
import tyro

from aquafish.online import thresholds
from aquafish_gym.runs.command_line import Out, run_command_line
from aquafish_gym.runs.markdown import markdown_table
from aquafish_gym.utils.validation import one_of
from experiments.league.episodes import Episode, episode_numbers, play
from experiments.league.statistics import after_onset
from experiments.tables import experiment, write_tables

CHOOSING = "self-model, library only"
FACTORS = (0.5, 2.0)
_ONE, _TWO = episode_numbers("development", 900, 2)
EPISODES = (
    Episode(CHOOSING, "severe", _ONE, seconds=40.0),
    Episode(CHOOSING, "severe", _TWO, seconds=40.0, sensing="imu"),
    Episode(CHOOSING, "severe", _ONE, seconds=40.0, sensing="gyroscope"),
    Episode(CHOOSING, "severe", _ONE, seconds=40.0, water="dense"),
    Episode(CHOOSING, "severe", _ONE, seconds=40.0, water="vortices"),
    Episode(CHOOSING, "moderate", _ONE, seconds=40.0, water="reactive"),
    Episode(CHOOSING, "mild", _ONE, seconds=40.0),
    Episode(CHOOSING, "early", _ONE, seconds=20.0),
    Episode(CHOOSING, "none", _ONE, seconds=20.0, water="current"),
    Episode(CHOOSING, "current begins", _ONE),
    Episode(CHOOSING, "three faults", _ONE, seconds=40.0),
    Episode(CHOOSING, "two channels", _ONE, seconds=40.0),
    Episode(CHOOSING, "intermittent", _ONE),
    Episode(CHOOSING, "thickness", _ONE, seconds=40.0),
    Episode("self-model", "severe", _ONE, seconds=36.0),
)


class Threshold(NamedTuple):
    """A number of the agent, or several."""

    group: str
    name: str
    unit: str
    decides: str

    @property
    def value(self) -> Any:
        """What it is now."""
        return getattr(thresholds, self.name)


def documented() -> list[Threshold]:
    """Return all thresholds, with what their comments say."""
    text = inspect.getsource(thresholds)
    pattern = r"^# (?P<group>.+)|^(?P<about>(?:#: .+\n)+)(?P<name>[A-Z_]+)"
    found = []
    group = ""
    for match in re.finditer(pattern, text, re.M):
        group = match["group"] or group
        if match["name"]:
            about = match["about"].removeprefix("#: ").replace("\n#: ", " ").strip()
            unit, _, decides = about.partition(": ")
            found.append(Threshold(group, match["name"], unit, decides))
    return found


def meanings() -> str:
    """Return the table of all thresholds in groups, as in ``docs/results/league``."""
    rows = [["threshold", "value", "unit", "decides"]]
    group = ""
    for one in documented():
        if one.group != group:
            group = one.group
            rows.append([f"**{group}**", "", "", ""])
        rows.append([f"`{one.name}`", number_text(one.value), one.unit, one.decides])
    return markdown_table(rows)


def scaled(value: Any, factor: float) -> Any:
    """Return a number, or each of several, times a factor; a count is at least 1."""
    if isinstance(value, tuple):
        return tuple(scaled(one, factor) for one in value)
    return max(1, round(factor * value)) if isinstance(value, int) else factor * value


@dataclass(frozen=True)
class Pass:
    """All episodes with one threshold times a factor."""

    threshold: str
    factor: float

    @property
    def name(self) -> str:
        """For people."""
        return f"{self.threshold} x {self.factor:g}"

    @property
    def file(self) -> str:
        """The path of its result."""
        return f"runs/{self.threshold}/{self.factor:g}.json"


def play_pass(job: Pass) -> dict[str, Any]:
    """Play the episodes; return the way in each, and a hash of all that happened."""
    before = getattr(thresholds, job.threshold)
    setattr(thresholds, job.threshold, scaled(before, job.factor))
    try:
        results = [play(episode) for episode in EPISODES]
    finally:
        setattr(thresholds, job.threshold, before)
    return {
        "ways": [after_onset(result) for result in results],
        "hashes": [
            hashlib.sha256(json.dumps([one["way"], one["events"]]).encode()).hexdigest()
            for one in results
        ],
        "seconds": {"cpu": sum(one["seconds"]["cpu"] for one in results)},
    }


@dataclass(frozen=True)
class Thresholds:
    """Play a few short episodes with each threshold of the agent halved and doubled."""

    example: ClassVar[str] = "--names GLITCH_SDS --out out/thresholds"

    out: Out = Path("out/thresholds")
    names: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME")] = tuple(
        one.name for one in documented()
    )
    """Thresholds."""
    factors: tuple[float, ...] = FACTORS
    """Factors on them."""
    workers: int | None = None
    """Processes; every core if not given. No result but the CPU times depends on it."""

    def execute(self) -> None:
        """Play the missing passes; write table.md."""
        known = [one.name for one in documented()]
        for name in self.names:
            one_of("names", name, known)
        usual = Pass(known[0], 1.0)
        jobs = [usual, *(Pass(name, factor) for name in self.names for factor in self.factors)]
        with experiment(
            jobs, play_pass, self.out, "a league's thresholds", {}, ("table.md",), self.workers
        ) as (folder, results):
            rows = self._tabulate(jobs, results)
            write_tables(folder, {"table": rows})
        for row in rows:
            print("  ".join(f"{cell:>14}" if i else f"{cell:32}" for i, cell in enumerate(row)))

    def _tabulate(self, jobs: Sequence[Pass], results: Sequence[dict[str, Any]]) -> list[list[str]]:
        usual, *played = results
        cells = {
            job: [
                f"{np.mean(np.subtract(result['ways'], usual['ways'])):+.2f}",
                f"{np.count_nonzero(np.not_equal(result['hashes'], usual['hashes']))}",
            ]
            for job, result in zip(jobs[1:], played, strict=True)
        }
        head = ["threshold"]
        for factor in self.factors:
            head += [f"way x {factor:g}, units", f"changed of {len(EPISODES)} x {factor:g}"]
        rows = [head]
        for one in documented():
            if one.name in self.names:
                found = [cell for f in self.factors for cell in cells[Pass(one.name, f)]]
                rows.append([f"`{one.name}`", *found])
        return rows


def number_text(value: Any) -> str:
    """Return a threshold's value as text."""
    return ", ".join(f"{x:.3g}" for x in np.ravel(value).tolist())


if __name__ == "__main__":
    sys.exit(run_command_line("experiments.league.thresholds", Thresholds))
