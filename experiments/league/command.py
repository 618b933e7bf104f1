"""The league: damage strikes a swimming robot, and the clock runs on.

    python examples/recovery_league.py --entrants self-model "PPO, fins" --episodes 10 --out DIR

Every entrant plays the same episodes of AquaFishRecovery-v0, which last 60 s, without a reset. In
the tiers severe, moderate and mild something random breaks between 15 and 30 s; held-out has 26
frozen damages, of which --episodes 130 plays each five times; in none nothing breaks. Other tiers
have faults that begin early, three at once, a current that begins, and faults that the agent has no
words for. With --task return they play AquaFishReturn-v0, of which the table has the share of
successes. An agent of your own enters as a class with ``begin(fin_angles)`` and
``act(observation)``: add it to ``ENTRANTS``.

DIR holds league.json, {entrant: {tier: {way_after_onset, ...}}}, pace.png, a file for each episode,
and tables. The same command resumes.

- table.md: the ways; of the return, the successes.
- times.md: what was spent in an episode, and before the first one.
- blind.md: each entrant's gain over *blind* in the same episodes, which is what recognising is
  worth; of the return, how often each returns where blind does not, and the reverse.
- gain.md, which the return lacks: the self-model's gain over each entrant, and how often each
  regains its pace.
- recognition.md: how often and how soon the self-model knew what broke.

``experiments.league.whole`` plays all tables.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar

import tyro

from aquafish_gym.bodies import plan_key
from aquafish_gym.engines.packages import available_cores
from aquafish_gym.plans import AQUAFISH, check_plan
from aquafish_gym.rendering.pictures import save_figure
from aquafish_gym.runs.command_line import Out, Plan
from aquafish_gym.runs.jobs import finished
from aquafish_gym.runs.workers import check_workers
from aquafish_gym.utils.storage import write_document
from aquafish_gym.utils.validation import InvalidArgumentError, finite_array, integer, one_of
from experiments.league.entrants import CEILING, ENTRANTS, USUAL
from experiments.league.episodes import (
    SECONDS,
    TIERS,
    Episode,
    Seeds,
    Sensing,
    Task,
    count_damages,
    damage_of,
    episode_numbers,
    play,
)
from experiments.league.statistics import (
    Result,
    interval,
    pace,
    pace_figure,
    recognition,
    share,
    summary,
)
from experiments.league.waters import Water
from experiments.tables import experiment, interval_text, write_tables

SCHEMA = "aquafish.league/3"
HERO = "self-model"
BLIND = "blind"
ORACLE = "oracle"


@dataclass(frozen=True)
class League:
    """Let entrants play the same episodes, in which something breaks while they swim."""

    example: ClassVar[str] = "--entrants self-model blind --episodes 5 --out out/league"
    main_options: ClassVar[tuple[str, ...]] = (
        "out", "entrants", "tiers", "episodes", "seeds", "plan", "task", "water", "sensing",
        "workers",
    )  # fmt: skip

    out: Out = Path("out/league")
    entrants: Annotated[
        tuple[str, ...], tyro.conf.arg(metavar="NAME", help=f"Some of: {'; '.join(ENTRANTS)}.")
    ] = USUAL
    tiers: Annotated[
        tuple[str, ...], tyro.conf.arg(metavar="TIER", help=f"Some of: {'; '.join(TIERS)}.")
    ] = ("severe", "moderate", "mild")
    episodes: int = 100
    """Episodes of each tier."""
    seeds: Seeds = "published"
    """Set of the episodes. Make and tune agents on development alone, play held-out once."""
    first: int = 0
    """The first episode of the set."""
    plan: Plan = "aquafish"
    task: Task = "recovery"
    """To swim on for the whole time, or to return to a line of buoys in time."""
    noise: float = 0.01
    """Standard deviation of the gyroscope's noise, rad/s."""
    water: Water = "still"
    """Still; with an unknown current of up to 0.2 units/s; with added mass; MuJoCo's own drag, or
    drag, lift and added mass (extra bench); with vortices; with skin friction x 5 and fins twice as
    dense; or still, with PyBullet's mechanics."""
    sensing: Sensing = "fins"
    """What is sensed beside the gyroscope: the IMU's directions and the initial fin angles; the
    directions; or nothing."""
    seconds: float = SECONDS
    """Length of an episode, s."""
    workers: int | None = None
    """Processes; every core if not given. No result but the CPU times depends on it."""
    scheduler: Annotated[str | None, tyro.conf.arg(metavar="ADDRESS")] = None
    """Address of a dask scheduler whose workers play, such as tcp://host:8786. They must be able to
    import this clone: start them with its folder in PYTHONPATH."""

    def jobs(self) -> list[Episode]:
        """Return all episodes; refuse settings that cannot be played."""
        for name, known in (("entrants", ENTRANTS), ("tiers", TIERS)):
            for one in getattr(self, name):
                one_of(name, one, known)
        plan = check_plan(self.plan)
        for name in self.entrants:
            if plan != AQUAFISH and not ENTRANTS[name].any_plan:
                able = [one for one, entry in ENTRANTS.items() if entry.any_plan]
                raise InvalidArgumentError(
                    f"entrants of the plan {plan.name} must be of {', '.join(able)}; got {name!r}"
                )
        integer("episodes", self.episodes, 1)
        integer("first", self.first, 0)
        finite_array("seconds", self.seconds, (), SECONDS, 3600.0, "s")
        if self.task == "return":
            finite_array("seconds", self.seconds, (), SECONDS, SECONDS, "s of the task return")
            if self.water == "current":
                raise InvalidArgumentError(
                    "water must not be current in the task return, which has its own; try still"
                )
        check_workers(self.workers, self.scheduler)
        conditions = self.noise, self.water, self.sensing, self.seconds, self.task, plan
        numbers = episode_numbers(self.seeds, self.first, self.episodes)
        for tier in self.tiers:
            for number in numbers:
                damage_of(tier, number, self.task, plan)  # may lack the number
        return [
            Episode(entrant, tier, number, *conditions)
            for number in numbers
            for tier in self.tiers
            for entrant in self.entrants
        ]

    def cpu_left(self) -> tuple[int, float]:
        """Return how many episodes are missing, and about how many CPU seconds they take."""
        jobs = self.jobs()
        done = finished(self.out, jobs)
        left = [job for job in jobs if job not in done]
        scale = self.seconds / SECONDS
        return len(left), sum(scale * _cpu(job) for job in left)

    def execute(self) -> None:
        """Play the missing episodes; write league.json, the tables and pace.png."""
        jobs = self.jobs()
        missing, cpu = self.cpu_left()
        print(expectation(missing, len(jobs), cpu, self.workers, self.scheduler), file=sys.stderr)
        settings = {
            name: getattr(self, name)
            for name in ("noise", "water", "sensing", "seconds", "seeds", "first", "task")
        } | plan_key(check_plan(self.plan))
        outputs = [f"{name}.md" for name in ("table", "times", "blind", "gain", "recognition")]
        with experiment(
            jobs, play, self.out, "a league", settings, (*outputs, "league.json", "pace.png"),
            self.workers, self.scheduler,
            lambda missing: play(min(missing, key=_cpu)),  # compiles for all
        ) as (folder, results):  # fmt: skip
            tables = self._tables(jobs, results)
            write_tables(folder, tables)
        for row in tables["table"]:
            print("  ".join(f"{cell:>20}" if i else f"{cell:26}" for i, cell in enumerate(row)))

    def _tables(
        self, jobs: Sequence[Episode], results: Sequence[dict[str, Any]]
    ) -> dict[str, list[list[str]]]:
        """Return the tables by name; write league.json and pace.png."""
        played: dict[tuple[str, str], list[Result]] = {}
        for job, result in zip(jobs, results, strict=True):
            played.setdefault((job.entrant, job.tier), []).append(result)
        league = {
            entrant: {
                tier: summary(
                    played[entrant, tier],
                    count_damages(tier),
                    {
                        other: played[other, tier]
                        for other in (BLIND, HERO, ORACLE, CEILING)
                        if other in self.entrants and other != entrant
                    },
                    played.get((ORACLE, tier)),
                )
                for tier in self.tiers
            }
            for entrant in self.entrants
        }
        write_document(self.out / "league.json", league, SCHEMA)
        save_figure(pace_figure(played, self.entrants, self.tiers), self.out / "pace.png")
        tables = {"times": self._times(played)}
        if HERO in self.entrants:
            tables["recognition"] = self._recognition(played)
        if self.task == "return":
            returned = {"table": self._returns(league), "blind": self._alone(league)}
            return tables | returned
        gains = {"blind": self._over_blind(league), "gain": self._gains(league)}
        return tables | gains | {"table": self._ways(league)}

    def _ways(self, league: Mapping[str, Mapping[str, Any]]) -> list[list[str]]:
        """Return the ways, what was lost to the oracle, and failures."""
        tier = self.tiers[0]
        rows = [
            [
                "entrant", *(f"{tier}, units" for tier in self.tiers), f"lost, {tier}",
                f"s to 50, 80, 90%, {tier}", "failures, all", "false alarms, all",
            ]
        ]  # fmt: skip
        for entrant, tiers in league.items():
            times = tiers[tier].get("seconds_to", {}).values()
            rows.append(
                [
                    entrant,
                    *(interval_text(tiers[one]["way_after_onset"]) for one in self.tiers),
                    _gain(tiers[tier], ORACLE, -1.0),
                    ", ".join(f"{some['median']:.1f}" for some in times) or "-",
                    f"{sum(one.get('failures', 0) for one in tiers.values())}",
                    f"{sum(one['false_alarms'] for one in tiers.values())}",
                ]
            )
        return rows

    def _times(self, played: Mapping[tuple[str, str], list[Result]]) -> list[list[str]]:
        """Return what was spent in an episode, and before the first one."""
        rows = [["entrant", "CPU s", "offline CPU s", "offline steps"]]
        for entrant in self.entrants:
            offline = ENTRANTS[entrant].offline(check_plan(self.plan))
            spent = [one["seconds"]["cpu"] for tier in self.tiers for one in played[entrant, tier]]
            rows.append(
                [
                    entrant,
                    f"{sum(spent) / len(spent):.1f}",
                    f"{offline.seconds:.0f}",
                    f"{offline.steps:.1e}",
                ]
            )
        return rows

    def _returns(self, league: Mapping[str, Mapping[str, Any]]) -> list[list[str]]:
        """Return the table of the task return: successes, and the way over the ground."""
        rows = [["entrant", *(f"success, {tier}" for tier in self.tiers)]]
        rows[0] += [f"units, {tier}" for tier in self.tiers]
        for entrant, tiers in league.items():
            found = [tiers[tier] for tier in self.tiers]
            rates = [one["success_rate"] for one in found]
            rows.append(
                [
                    entrant,
                    *(f"{share:.0%} [{low:.0%}, {high:.0%}]" for share, low, high in rates),
                    *(interval_text(one["way_after_onset"]) for one in found),
                ]
            )
        return rows

    def _alone(self, league: Mapping[str, Mapping[str, Any]]) -> list[list[str]]:
        """Return how often the entrants return where blind does not, and the reverse."""
        rows = [["entrant", *(f"only it, only blind, {tier}" for tier in self.tiers)]]
        for entrant, tiers in league.items():
            over = [tiers[tier]["over"].get(BLIND) for tier in self.tiers]
            cells = [f"{one['only_own']}, {one['only_other']}" if one else "-" for one in over]
            rows.append([entrant, *cells])
        return rows

    def _over_blind(self, league: Mapping[str, Mapping[str, Any]]) -> list[list[str]]:
        """Return the entrants' paired gains over blind."""
        rows = [["entrant", *(f"gain over blind, {tier}" for tier in self.tiers)]]
        rows[0] += [f"worse, {tier}" for tier in self.tiers]
        for entrant, tiers in league.items():
            found = [tiers[tier] for tier in self.tiers]
            counts = [
                f"{one['over'][BLIND]['worse']} of {one['episodes']}"
                if BLIND in one["over"]
                else "-"
                for one in found
            ]
            rows.append([entrant, *(_gain(one, BLIND) for one in found), *counts])
        return rows

    def _recognition(self, played: Mapping[tuple[str, str], list[Result]]) -> list[list[str]]:
        """Return how well and how soon the self-model knew what broke, a tier a row."""
        rows = [
            [
                "tier", "pace, units/s", "pace, of the oracle's", "right", "after one alarm",
                "fins named", "unknown", "changed, s", "refined, s",
            ]
        ]  # fmt: skip
        for tier in self.tiers:
            results = played[HERO, tier]
            found = recognition(results)
            oracle = played.get((ORACLE, tier))
            part = None if oracle is None else share(results, oracle)
            counts = [
                f"{found[name]} of {found['episodes']}"
                for name in ("right", "at_once", "named_fins", "unknown")
            ]
            waits = [found[name] for name in ("changed", "refined")]
            rows.append(
                [
                    tier,
                    interval_text(
                        interval([pace(r) for r in results], count_damages(tier), 0.0), 3
                    ),
                    "-" if part is None else interval_text(part, 3),
                    *counts,
                    *("-" if wait is None else f"{wait:.1f}" for wait in waits),
                ]
            )
        return rows

    def _gains(self, league: Mapping[str, Mapping[str, Any]]) -> list[list[str]]:
        """Return the self-model's paired gains over the entrants, and the entrants' successes."""
        rows = [["entrant", *(f"self-model's gain, {tier}" for tier in self.tiers)]]
        rows[0] += [f"successes, {tier}" for tier in self.tiers]
        for entrant, tiers in league.items():
            found = [tiers[tier] for tier in self.tiers]
            counts = [
                f"{one['successes']} of {one['compared']}" if "successes" in one else "-"
                for one in found
            ]
            rows.append([entrant, *(_gain(one, HERO, -1.0) for one in found), *counts])
        return rows


def _cpu(job: Episode) -> float:
    """Return about how many CPU seconds an episode of 60 s takes."""
    return ENTRANTS[job.entrant].cpu


def expectation(
    missing: int, total: int, cpu: float, workers: int | None, scheduler: str | None
) -> str:
    """Return a sentence on how many episodes are missing, and how long they will take.

    Examples
    --------
    >>> expectation(40, 100, 7200.0, 2, None)
    '40 of 100 episodes to play: about 120 CPU minutes, 60 minutes on 2 processes'
    """
    text = f"{missing} of {total} episodes to play: about {cpu / 60.0:.0f} CPU minutes"
    if scheduler is not None:
        return f"{text} of the cluster"
    count = workers or available_cores()
    return f"{text}, {cpu / 60.0 / count:.0f} minutes on {count} processes"


def _gain(found: Mapping[str, Any], other: str, sign: float = 1.0) -> str:
    """Return a cell: the paired gain over another entrant, or with sign -1 the other's gain."""
    if other not in found["over"]:
        return "-"
    values = [sign * value for value in found["over"][other]["mean"]]
    return interval_text((values[0], *sorted(values[1:])), 2)
