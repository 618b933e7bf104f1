"""The league: damage strikes a swimming robot, and the clock runs on.

    python examples/recovery_league.py --entrants self-model "PPO, fins" --episodes 10 --out DIR

Every entrant plays the same episodes of AquaFishRecovery-v0, which last 60 s, without a reset. In
the tiers severe, moderate and mild something random breaks between 15 and 30 s; held-out has 26
frozen damages, of which --episodes 130 plays each five times; in none nothing breaks. An agent of
your own enters as a class with ``begin(fin_angles)`` and ``act(observation)``: add it to
``ENTRANTS``.

DIR holds league.json, {entrant: {tier: {way_after_onset, ...}}}, table.md, gain.md, pace.png and a
file for each episode. The same command resumes. gain.md has the self-model's gain over each entrant
in the same episodes, and how often each is successful.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, ClassVar

import tyro

from aquafish_gym.rendering.pictures import save_figure
from aquafish_gym.runs.command_line import Out
from aquafish_gym.utils.storage import write_bytes, write_document
from aquafish_gym.utils.validation import finite_array, integer, one_of
from experiments.league.entrants import ENTRANTS
from experiments.league.episodes import TIERS, Episode, Sensing, Water, play
from experiments.league.statistics import Result, pace_figure, summary
from experiments.tables import do_table, markdown

SCHEMA = "aquafish.league/2"
HERO = "self-model"
ORACLE = "oracle"


@dataclass(frozen=True)
class League:
    """Let entrants play the same episodes, in which something breaks while they swim."""

    example: ClassVar[str] = "--entrants self-model blind --episodes 5 --out out/league"

    out: Out = Path("out/league")
    entrants: Annotated[
        tuple[str, ...], tyro.conf.arg(metavar="NAME", help=f"Some of: {'; '.join(ENTRANTS)}.")
    ] = tuple(ENTRANTS)
    tiers: Annotated[
        tuple[str, ...], tyro.conf.arg(metavar="TIER", help=f"Some of: {'; '.join(TIERS)}.")
    ] = ("severe", "moderate", "mild")
    episodes: int = 100
    """Episodes of each tier."""
    first: int = 0
    """The number of the first episode; those of the reference scores are 0 to 99."""
    noise: float = 0.01
    """Standard deviation of the gyroscope's noise, rad/s."""
    water: Water = "still"
    """Still; with an unknown current of up to 0.2 units/s; with added mass; MuJoCo's own drag, or
    drag, lift and added mass (extra bench); or still, with PyBullet's mechanics."""
    sensing: Sensing = "fins"
    """What is sensed beside the gyroscope: the IMU's directions and the initial fin angles; the
    directions; or nothing."""
    seconds: float = 60.0
    """Length of an episode, s."""
    workers: int | None = None
    """Processes; every core if not given. No result but the CPU times depends on it."""

    def execute(self) -> None:
        """Play the missing episodes; write league.json, table.md, gain.md and pace.png."""
        for name, known in (("entrants", ENTRANTS), ("tiers", TIERS)):
            for one in getattr(self, name):
                one_of(name, one, known)
        integer("episodes", self.episodes, 1)
        integer("first", self.first, 0)
        finite_array("seconds", self.seconds, (), 60.0, 3600.0, "s")
        settings = {
            name: getattr(self, name) for name in ("noise", "water", "sensing", "seconds", "first")
        }
        conditions = self.noise, self.water, self.sensing, self.seconds
        jobs = [
            Episode(entrant, tier, self.first + i, *conditions)
            for i in range(self.episodes)
            for tier in self.tiers
            for entrant in self.entrants
        ]
        rows = do_table(
            jobs, play, self.out, "a league", settings,
            partial(self._tabulate, jobs), self.workers, ("league.json", "gain.md", "pace.png"),
            lambda missing: play(missing[0]),  # compiles for all
        )  # fmt: skip
        for row in rows:
            print("  ".join(f"{cell:>20}" if i else f"{cell:26}" for i, cell in enumerate(row)))

    def _tabulate(
        self, jobs: Sequence[Episode], results: Sequence[dict[str, Any]]
    ) -> list[list[str]]:
        played: dict[tuple[str, str], list[Result]] = {}
        for job, result in zip(jobs, results, strict=True):
            played.setdefault((job.entrant, job.tier), []).append(result)
        league = {
            entrant: {
                tier: summary(
                    played[entrant, tier],
                    len(TIERS[tier]),
                    played.get((ORACLE, tier)),
                    played.get((HERO, tier)),
                )
                for tier in self.tiers
            }
            for entrant in self.entrants
        }
        write_document(self.out / "league.json", league, SCHEMA)
        save_figure(pace_figure(played, self.entrants, self.tiers), self.out / "pace.png")
        write_bytes(self.out / "gain.md", markdown(self._gains(league)).encode())
        tier = self.tiers[0]
        rows = [
            [
                "entrant", *(f"{tier}, units" for tier in self.tiers), f"lost, {tier}",
                f"s to 50, 80, 90%, {tier}", "failures, all", "false alarms, all",
                f"CPU s, {tier}",
                "offline CPU s", "offline steps",
            ]
        ]  # fmt: skip
        for entrant, tiers in league.items():
            offline = ENTRANTS[entrant].offline
            times = tiers[tier].get("seconds_to", {}).values()
            rows.append(
                [
                    entrant,
                    *(_interval(tiers[one]["way_after_onset"]) for one in self.tiers),
                    _interval(tiers[tier]["lost"]) if "lost" in tiers[tier] else "-",
                    ", ".join(f"{some['median']:.1f}" for some in times) or "-",
                    f"{sum(one.get('failures', 0) for one in tiers.values())}",
                    f"{sum(one['false_alarms'] for one in tiers.values())}",
                    f"{tiers[tier]['cpu']:.1f}",
                    f"{offline.seconds:.0f}",
                    f"{offline.steps:.1e}",
                ]
            )
        return rows

    def _gains(self, league: Mapping[str, Mapping[str, Any]]) -> list[list[str]]:
        """Return the self-model's paired gains over the entrants, and the entrants' successes."""
        rows = [["entrant", *(f"self-model's gain, {tier}" for tier in self.tiers)]]
        rows[0] += [f"successes, {tier}" for tier in self.tiers]
        for entrant, tiers in league.items():
            found = [tiers[tier] for tier in self.tiers]
            gains = [
                _interval(one["hero_gain"], 2) if "hero_gain" in one and entrant != HERO else "-"
                for one in found
            ]
            counts = [
                f"{one['successes']} of {one['compared']}" if "successes" in one else "-"
                for one in found
            ]
            rows.append([entrant, *gains, *counts])
        return rows


def _interval(values: Sequence[float], digits: int = 1) -> str:
    middle, low, high = (f"{value:z.{digits}f}" for value in values)
    return f"{middle} [{low}, {high}]"
